"""Small mistakes made on purpose, and the tests that notice each of them.

    python design/mutations.py [--only NAME] [--all]

The tree is copied to a temporary folder with nothing beside it, as a stranger's clone has it. One mistake at a time is
made there, and the tests that should notice it run (with ``--all``: all unit tests). A mistake that no test notices
breaks a promise that nobody checks; the exit code is then 1. :data:`MUTATIONS` is the list.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import track
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
Verdict = Literal["killed", "survived", "broken"]
"""Whether a test failed, all passed, or pytest could not run them."""


@dataclass(frozen=True)
class Mutation:
    """One mistake."""

    name: str
    file: str
    """Path in the repository."""
    old: str
    """Text that occurs once in it."""
    new: str
    why: str
    """Promise that the mistake breaks."""
    tests: tuple[str, ...]
    """Tests that should notice it, as pytest names them."""


MUTATIONS = (
    # The codec
    Mutation(
        "zero run", "fapengine/codec/kernels.py", "ZERO_RUN = 22", "ZERO_RUN = 23",
        "the arithmetic coder stuffs a one after 22 zeros: without it every other decoder reads another stream",
        ("tests/native/test_codec.py",),
    ),
    Mutation(
        "proof of an I plane", "fapengine/codec/decoder.py", "PROOF = 8", "PROOF = 1",
        "noise is not taken for a stream: eight planes must decode behind an I plane of unknown shape",
        ("tests/unit/codec/test_resync.py::test_an_i_plane_of_unknown_shape_proves_itself_by_eight_planes_behind_it",),
    ),
    Mutation(
        "frames held back", "fapengine/codec/decoder.py", "HELD = 4", "HELD = 0",
        "no frame decoded out of damage is shown",
        ("tests/unit/codec/test_resync.py::test_frames_after_damage_are_right_or_absent",),
    ),
    Mutation(
        "marker bits", "fapengine/codec/header.py", "LIST_MARKER_EVERY = 4", "LIST_MARKER_EVERY = 5",
        "a marker bit stands before every fourth sent bound",
        ("tests/unit/codec/test_vectors.py", "tests/unit/codec/test_bitstream.py"),
    ),
    Mutation(
        "time code", "fapengine/codec/decoder.py", "(self._number, now_s)", "(0, now_s)",
        "a time code sets the clock at its plane, and time goes on from there",
        ("tests/unit/codec/test_bitstream.py::test_time_codes_set_the_time_and_it_goes_on",),
    ),
    # Phones to motion
    Mutation(
        "chin on the jaw", "fapengine/mpeg4/fapu.py", "moved - moved_mm", "moved + moved_mm",
        "FAP 18 moves the chin against the jaw: what the jaw carries is taken off",
        ("tests/unit/trajectory/test_planner.py::test_determined_faps_are_measured_by_unit_and_direction",),
    ),
    Mutation(
        "margin of rest", "fapengine/trajectory/targets.py", "REST_MARGIN_S = 0.12", "REST_MARGIN_S = 0.24",
        "the face is neutral 120 ms after the last phone",
        ("tests/unit/trajectory/test_planner.py",),
    ),
    Mutation(
        "shortest pause", "fapengine/trajectory/targets.py", "MIN_PAUSE_S = 0.1", "MIN_PAUSE_S = 0.3",
        "a pause of a tenth of a second or longer passes through rest",
        ("tests/unit/trajectory/test_planner.py",),
    ),
    Mutation(
        "length of a closure", "fapengine/trajectory/closures.py", "MIN_HOLD_S = 0.04", "MIN_HOLD_S = 0.004",
        "lips that touch stay together for 40 ms",
        ("tests/unit/trajectory/test_closures.py::test_holds_lie_in_their_phones_and_last_40_ms",),
    ),
    Mutation(
        "quintic", "fapengine/trajectory/hermite.py", "-15 * rest + 7 * slope", "-15 * rest + 8 * slope",
        "value, velocity and acceleration are continuous along the path",
        ("tests/unit/trajectory/test_stream.py::test_the_path_is_c2_and_local",),
    ),
    Mutation(
        "eyes counter the head", "fapengine/trajectory/gestures.py",
        "np.subtract(levels[_GLANCE], _HEAD_RAD", "np.add(levels[_GLANCE], _HEAD_RAD",
        "the gaze rests where it was while the head turns (vestibulo-ocular reflex)",
        ("tests/unit/trajectory/test_gestures.py::test_eyes_counter_the_head",),
    ),
    Mutation(
        "phones ahead", "fapengine/trajectory/stream.py", "AHEAD_PHONES = 5", "AHEAD_PHONES = 2",
        "phones that come five phones early give the offline path",
        ("tests/unit/trajectory/test_stream.py::test_phones_that_come_early_enough_give_the_offline_path",),
    ),
    # The live engine
    Mutation(
        "jump to the sound", "fapengine/engine/session.py", "JUMP_S = 0.08", "JUMP_S = 0.24",
        "sound that is 80 ms off is jumped to",
        ("tests/unit/engine/test_engine.py",),
    ),
    Mutation(
        "late phones", "fapengine/engine/session.py",
        '"late", now_s, late[utterance.number])', '"late", now_s, late[utterance.number] + 1)',
        "the sender is told how many phones came late",
        ("tests/unit/engine/test_engine.py",),
    ),
    Mutation(
        "repeats of what is over", "fapengine/engine/session.py",
        "if revision <= self.over.get", "if revision < self.over.get",
        "a datagram that comes twice does not start an utterance again",
        ("tests/unit/engine/test_engine.py",),
    ),
    Mutation(
        "end of a gap", "fapengine/engine/utterance.py", "range(before + 1, after)\n", "range(before + 1, after - 1)\n",
        "phones that are missing are concealed up to the next one",
        ("tests/unit/engine/test_engine.py::test_a_missing_phone_is_concealed_and_a_late_one_counted",),
    ),
    # The wire
    Mutation(
        "sound outranks the clock", "fapengine/wire/speech_osc/session.py", "        window.heard_s = now_s\n", "",
        "while a sender tells where its sound is, the clocks do not move the face",
        ("tests/unit/wire/test_protocol_receiver.py",),
    ),
    Mutation(
        "repeated begin", "fapengine/wire/speech_osc/session.py",
        "message.revision <= window.revision", "message.revision < window.revision",
        "a begin that comes twice is counted and changes nothing",
        ("tests/unit/wire/test_protocol_receiver.py",),
    ),
    Mutation(
        "padding", "fapengine/wire/osc.py", "(stop - here) // 4 * 4 + 4", "(stop - here + 3) // 4 * 4",
        "an OSC string ends with at least one NUL",
        ("tests/unit/wire/test_osc.py",),
    ),
    Mutation(
        "offset of a clock", "fapengine/wire/speech_osc/clock.py",
        "(answered_s - back_s)) / 2", "(answered_s - back_s)) / 3",
        "the offset is the mean of both ways",
        ("tests/unit/wire/test_protocol_clock.py",),
    ),
    Mutation(
        "late time tags", "fapengine/wire/speech_osc/clock.py", "LATE_IN_A_ROW = 3", "LATE_IN_A_ROW = 4",
        "tags far behind are believed at the third",
        ("tests/unit/wire/test_protocol_clock.py",),
    ),
    Mutation(
        "when to ask again", "fapengine/wire/speech_osc/receive_window.py", "MAX_UNBEGUN = 10", "MAX_UNBEGUN = 11",
        "a sender is told ten times of an utterance that was never begun",
        ("tests/unit/wire/test_protocol_receiver.py",),
    ),
    Mutation(
        "number of a frame", "fapengine/wire/fap_osc.py", "[number + 1 for", "[number + 2 for",
        "frames are numbered without gaps: a receiver counts what was lost",
        ("tests/unit/wire/test_fap_osc.py",),
    ),
    Mutation(
        "turn to the left", "fapengine/wire/vmc.py", "halves = (-yaw / 2", "halves = (yaw / 2",
        "a head that turns left turns left in VMC too",
        ("tests/unit/wire/test_vmc.py",),
    ),
    Mutation(
        "escapes of SLIP", "fapengine/wire/framing.py", "part[0] == ESC_END", "part[0] != ESC_END",
        "any bytes go through a stream",
        ("tests/unit/wire/test_framing.py",),
    ),
    # Elsewhere
    Mutation(
        "numbers ahead", "fapengine/server/watchdog.py", "AHEAD_FRAMES = 120", "AHEAD_FRAMES = 0",
        "no receiver takes the last frame of a killed server for a late one",
        ("tests/unit/server/test_server_sinks.py::test_a_guard_puts_every_face_to_rest_that_was_open",),
    ),
    Mutation(
        "taking turns", "fapengine/server/intake/ingress.py", "rotate(-1)", "rotate(0)",
        "a flood from one sender keeps nobody else waiting",
        ("tests/unit/server/test_server_ingress.py",),
    ),
    Mutation(
        "scaled pauses", "fapengine/speech/formats/synthesizers.py",
        '"vowel_length", scale=pauses', '"vowel_length"',
        "VOICEVOX multiplies pauses by pauseLengthScale",
        ("tests/unit/speech/test_formats.py::test_pauses_of_voicevox_are_scaled",),
    ),
    Mutation(
        "overlap of labels", "fapengine/speech/formats/entries.py", "OVERLAP_S = 1.5e-3", "OVERLAP_S = 0.1",
        "labels that overlap by more than is rounded away are refused",
        ("tests/unit/speech",),
    ),
    Mutation(
        "inside of a skin", "fapengine/mesh/rig/feature_points.py",
        "MIN_NORMAL_COSINE = 0.2", "MIN_NORMAL_COSINE = -1.0",
        "feature points lie on the outside of a skin that has an inside",
        ("tests/unit/mesh/test_import_head.py::test_points_lie_on_the_outside_of_a_skin_that_has_an_inside",),
    ),
    Mutation(
        "ridge", "fapengine/retarget/blend.py", "RIDGE = 1e-3", "RIDGE = 0.1",
        "blendshapes reach the pose that FAPs ask for",
        ("tests/unit/retarget/test_blend.py",),
    ),
)  # fmt: skip


@contextmanager
def clone() -> Iterator[Path]:
    """Copy what git would commit, with nothing beside it."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        copy = Path(folder) / "clone"
        for name in filter(None, listed.stdout.decode().split("\0")):
            if (ROOT / name).is_file():
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, copy / name)
        yield copy


def run(copy: Path, tests: Sequence[str]) -> Verdict:
    """Run tests in a copy."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    environment.pop("PYTEST_ADDOPTS", None)
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True)
    return "killed" if done.returncode == 1 else "survived" if done.returncode == 0 else "broken"


def judge(copy: Path, mutation: Mutation, *, everything: bool = False) -> Verdict:
    """Make one mistake in a copy, run its tests, and take it back."""
    path = copy / mutation.file
    good = path.read_text()
    if good.count(mutation.old) != 1:
        return "broken"
    # Compiled files are told apart by size and whole seconds of their time: each state needs a second of its own.
    now = int(max(time.time(), path.stat().st_mtime)) + 1
    path.write_text(good.replace(mutation.old, mutation.new))
    os.utime(path, (now, now))
    try:
        return run(copy, ("tests/unit",) if everything else mutation.tests)
    finally:
        path.write_text(good)
        os.utime(path, (now + 1, now + 1))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", metavar="NAME", action="append", help="this mutation alone; may be repeated")
    parser.add_argument("--all", action="store_true", help="run all unit tests, not only those named")
    asked = parser.parse_args()
    chosen = [mutation for mutation in MUTATIONS if not asked.only or mutation.name in asked.only]
    if not chosen:
        parser.error(f"--only: got {asked.only}, expected names of {', '.join(one.name for one in MUTATIONS)}")
    console = Console()
    table = Table("mutation", "file", "seconds", "verdict")
    verdicts = []
    with clone() as copy:
        tests = sorted({test for mutation in chosen for test in mutation.tests})
        if run(copy, tests) != "survived":
            console.print("the tests fail before anything was changed")
            return 1
        for mutation in track(chosen, "mutations", console=Console(stderr=True), transient=True):
            started = time.monotonic()
            verdicts.append(judge(copy, mutation, everything=asked.all))
            table.add_row(mutation.name, mutation.file, f"{time.monotonic() - started:.0f}", verdicts[-1])
    console.print(table)
    console.print(f"{verdicts.count('killed')} of {len(verdicts)} killed")
    return int(verdicts.count("killed") < len(verdicts))


if __name__ == "__main__":
    sys.exit(main())
