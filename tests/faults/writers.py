"""Every command that writes, stopped at a random moment: what it leaves is whole, and what it read is as it was."""

import random
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fapengine.capture.marker_track import MarkerTrack
from fapengine.files.fba import load_fba
from fapengine.files.gltf.document import parse_gltf
from fapengine.files.heads.load import load_head
from fapengine.files.motion import load_fap, load_motion
from fapengine.files.moving import sequence_files
from fapengine.files.pictures import load_picture
from fapengine.files.profiles import load_profile
from fapengine.files.recordings import load_markers, save_markers
from fapengine.files.sound import load_sound, save_wav
from fapengine.files.timings import load_timings
from fapengine.mesh.default_head.head import build_head
from fapengine.voices.espeak import EspeakVoice
from tests.faults.processes import Marked, becomes, left_over
from tests.unit.cli.test_fit import record
from tests.videos import load_video

TEXT = "Bright sunshine."
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SECOND_S = 0.02
"""Time after which a signal comes again, sometimes."""
TAKE_FRAMES = 200
END = 3_000
"""Looks within which a program ends that was told to."""


MADE = {
    "a.fba": "encode a.fap -o a.fba",
    "a.csv": "convert a.fap -o a.csv",
    "a.glb": "head export default:level=coarse -o a.glb",
}
"""Inputs that are made when a command needs them, each by a command."""


@dataclass(frozen=True)
class Job:
    """A command with short inputs."""

    words: str
    outputs: tuple[str, ...]
    """Names in the folder, as :func:`is_whole` reads them."""


FILM = ("x.mp4", "x.fap", "x.wav", "x.png")
JOBS = {
    "say": Job(f"say '{TEXT}' -o x.mp4 --size 128", FILM),
    "say folder": Job(f"say '{TEXT}' -o x --size 64", ("x/frame_%04d.png", *FILM[1:])),
    "animate": Job("animate a.pho --audio a.wav -o x.webm --size 128", ("x.webm", *FILM[1:])),
    "animate sound": Job("animate a.wav --transcript-file a.txt -o x.fap", ("x.fap",)),
    "align": Job("align a.wav --transcript-file a.txt -o x.TextGrid", ("x.TextGrid",)),
    "render": Job("render a.fap --audio a.wav -o x.mp4 --size 256", ("x.mp4",)),
    "render gif": Job("render a.fap -o x.gif --size 64", ("x.gif",)),
    "render pictures": Job("render a.fap -o x_%03d.png --size 64", ("x_%03d.png",)),
    "encode": Job("encode a.fap -o x.fba", ("x.fba",)),
    "decode": Job("decode a.fba -o x.fap", ("x.fap",)),
    "convert": Job("convert a.fap -o x.csv", ("x.csv",)),
    "convert into": Job("convert a.fap --into a.glb -o x.glb", ("x.glb",)),
    "capture": Job("capture a.csv -o x.fap", ("x.fap",)),
    "reduce": Job("reduce a.npz -o x.npz --back x.trc", ("x.npz", "x.trc")),
    "batch": Job("batch rows.csv -o x --to fap --workers 2", ("x/index.csv", *(f"x/{row}.fap" for row in "abcdef"))),
    "inspect": Job("inspect a.fba --plot x.png", ("x.png",)),
    "score": Job("score a.fap --phones a.pho -o x.html", ("x.html",)),
    "fit": Job("fit S07 -o x --faps", ("x/profile.toml",)),
    "head import": Job("head import face.ply --points points.csv -o x", ("x/head.toml",)),
    "head export": Job("head export default:level=coarse -o x.glb", ("x.glb",)),
    "head check": Job("head check default -o x.png", ("x.png",)),
}


def is_whole(path: Path) -> bool:
    """Whether an output holds what it should, to its end; False where it is not there, or a piece."""
    readers: dict[str, Callable[[Path], object]] = {
        ".mp4": lambda path: _is_long(load_video(path).duration_s),
        ".webm": lambda path: _is_long(load_video(path).duration_s),
        ".gif": lambda path: path.read_bytes().endswith(b"\x3b"),
        ".fap": lambda path: _is_long(len(load_fap(path)) / 30),
        ".wav": lambda path: _is_long(len(load_sound(path)[0]) / load_sound(path)[1]),
        ".png": lambda path: load_picture(path).size,
        ".TextGrid": lambda path: _is_long(load_timings(path).duration_s),
        ".fba": lambda path: _is_long(len(load_fba(path).track) / 30),
        ".csv": lambda path: _is_long(len(load_motion(path)) / 30),
        ".glb": lambda path: parse_gltf(path.read_bytes(), _no_file),
        ".npz": lambda path: all(array.size for array in np.load(path).values()),
        ".trc": lambda path: load_markers(path).markers.frame_count == TAKE_FRAMES,
        ".html": lambda path: path.read_text().rstrip().endswith("</html>"),
    }
    if path.name == "profile.toml":
        return bool(load_profile(path.parent).phones)
    if path.name == "head.toml":
        return len(load_head(str(path.parent)).vertices_mm) > 100
    if path.name == "index.csv":
        return len(path.read_text().splitlines()) == 7
    if "%" in path.name:
        files = sequence_files(path)
        return _is_long(len(files) / 30) and all(load_picture(file).size for file in files)
    return bool(readers[path.suffix](path))


def _no_file(name: str) -> bytes:
    raise AssertionError(f"a GLB that is whole names {name}")


def _is_long(duration_s: float) -> bool:
    return duration_s > 0.9


def _is_there(path: Path) -> bool:
    return bool(sequence_files(path)) if "%" in path.name else path.exists()


class Writers:
    """Inputs, and each command's outputs and time.

    Stateful.
    """

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self._folder, self._rng = folder, rng
        self._inputs = folder / "inputs"
        self._inputs.mkdir()
        speech = EspeakVoice().speak(TEXT)
        save_wav(self._inputs / "a.wav", speech.samples, speech.sample_rate_hz)
        (self._inputs / "a.txt").write_text(TEXT)
        rows = [f"{phone.label} {1000 * phone.duration_s:.0f}" for phone in speech.phones.phones]
        (self._inputs / "a.pho").write_text(
            "\n".join(["m 100", "a 100", *(row for row in rows if row.isascii()), "_ 500"])
        )
        self._run(self._inputs, "animate a.pho -o a.fap")
        (self._inputs / "rows.csv").write_text("id,timings\n" + "".join(f"{row},a.pho\n" for row in "abcdef"))
        moved = np.sin(np.arange(TAKE_FRAMES) / 20)[:, None, None] * np.linspace(1, 5, 5)[:, None]
        positions_mm = np.random.default_rng(1).uniform(-60, 60, (5, 3)) + moved
        save_markers(self._inputs / "a.npz", MarkerTrack(positions_mm=positions_mm, labels=(*"ABCDE",), rate_hz=100.0))
        self._done: dict[str, tuple[Path, float]] = {}

    def _make_face(self) -> None:
        head = build_head()
        import trimesh

        trimesh.Trimesh(head.vertices_mm / 1000, head.triangles, process=False).export(self._inputs / "face.ply")
        used = set(np.unique(head.triangles).tolist())
        rows = [f"{name},{index}" for name, index in head.feature_points.items() if index in used]
        (self._inputs / "points.csv").write_text("\n".join(["point,vertex", *rows]))

    def once(self, command: str) -> str:
        """Stop a command at a random moment; "" or what is wrong then."""
        job, rng = JOBS[command], self._rng
        done, took_s = self._finished(command)
        place = self._folder / "now"
        shutil.rmtree(place, ignore_errors=True)
        was_there = rng.random() < 0.5
        shutil.copytree(done if was_there else self._inputs, place)
        before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
        number = rng.choice(SIGNALS)
        with Marked.start(self._command(job), place) as one:
            late_s = rng.uniform(0.2, 1.02) * took_s
            end_s = time.monotonic() + late_s
            while one.process.poll() is None and time.monotonic() < end_s:
                time.sleep(0.001)
            one.process.send_signal(number)
            if number != signal.SIGKILL and rng.random() < 0.2:  # impatient
                time.sleep(SECOND_S)
                one.process.send_signal(number)
            if not becomes(lambda: one.process.poll() is not None, END):
                return f"{number.name} after {late_s:.2f} s: it runs on"
            told = one.process.communicate()[1]
            code = one.process.returncode
            runs_on = left_over(one.mark)
        wrong = [f"{line} runs on" for line in runs_on]
        if code not in (0, -number, 128 + number):
            wrong.append(f"exit code {code}: {told[-2000:]}")
        wrong += self._looked_at(job, place, before, was_there=was_there)
        hidden = [path.name for path in place.rglob(".*")]
        if hidden and number == signal.SIGKILL:
            self._run(place, job.words)
            hidden = [f"{path.name} after the next run" for path in place.rglob(".*")]
        wrong += hidden
        return "; ".join(f"{number.name} after {late_s:.2f} s of {took_s:.2f} s: {one}" for one in wrong)

    def _looked_at(self, job: Job, place: Path, before: dict[Path, bytes], *, was_there: bool) -> list[str]:
        wrong = []
        for name in job.outputs:
            path = place / name
            if _is_there(path):
                try:
                    is_good = is_whole(path)
                except Exception as error:  # noqa: BLE001  whatever it is
                    is_good, name = False, f"{name} ({type(error).__name__}: {error})"
                if not is_good:
                    wrong.append(f"{name} is not whole")
            elif was_there:
                wrong.append(f"{name} is gone")
        names = {path.relative_to(self._inputs) for path in self._inputs.rglob("*") if path.is_file()}
        wrong += [  # inputs of commands that come later are not in the folders of those that came before
            f"{name} was changed"
            for name in names
            if place / name in before and (place / name).read_bytes() != before[place / name]
        ]
        return wrong

    def _finished(self, command: str) -> tuple[Path, float]:
        """Folder after the command, and how long it took; made when it is first asked for."""
        if command not in self._done:
            if command == "fit" and not (self._inputs / "S07").exists():
                record(self._inputs / "S07")
            for name, words in MADE.items():
                if name in JOBS[command].words.split() and not (self._inputs / name).exists():
                    self._run(self._inputs, words)
            if command == "head import" and not (self._inputs / "face.ply").exists():
                self._make_face()
            place = self._folder / command.replace(" ", "-")
            shutil.copytree(self._inputs, place)
            begun_s = time.monotonic()
            self._run(place, JOBS[command].words)
            took_s = time.monotonic() - begun_s
            bad = [name for name in JOBS[command].outputs if not is_whole(place / name)]
            assert not bad, f"{command} does not write {bad}"
            self._done[command] = place, took_s
        return self._done[command]

    @staticmethod
    def _command(job: Job) -> list[str]:
        import shlex

        return [sys.executable, "-m", "fapengine", *shlex.split(job.words)]

    def _run(self, place: Path, words: str) -> None:
        with Marked.start(self._command(Job(words, ())), place) as one:
            told = one.process.communicate()[1]
            assert one.process.returncode == 0, told
