"""An hour of timings and sound: time and peak memory of each stage, each in a process of its own.

    python -m bench.hour [--seconds 3600] [--rate 30] [--size 64] [--head default:level=coarse] [--json FILE]
        [--only plan fap fba film ...]

*plan* plans the motion; *fap* and *fba* animate the timings with their sound and write FAPs and a stream; *film* draws
and encodes (``--size`` pixels wide and high, of ``--head``, soft edges); *inspect* looks into the stream. Beside each
stands what a quarter of the length takes: work that is linear takes four times as much. Exits 1 where a stage takes
more than :data:`MOST_MB`, or more than :data:`MOST_TIMES` the CPU time of its quarter, or where a film does not begin
with the list of its frames.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import wave
from pathlib import Path

import numpy as np

MOST_MB, MOST_TIMES = 600.0, 4.5
STAGES = ("plan", "fap", "fba", "inspect", "film")
PHONE_S = 0.09
LABELS = ("p", "b", "m", "f", "v", "s", "ʃ", "n", "w", "i", "uː", "ɑ", "æ", "aɪ", "sil")
RATE_HZ = 16_000


def write_inputs(folder: Path, seconds: float) -> tuple[Path, Path]:
    """Write timings (HTK labels) and a sound of this length."""
    rng, timings, sound = np.random.default_rng(1), folder / "talk.csv", folder / "talk.wav"
    labels = rng.choice(LABELS, int(seconds / PHONE_S))
    rows = [f"{n * PHONE_S:.2f},{(n + 1) * PHONE_S:.2f},{label}" for n, label in enumerate(labels)]
    timings.write_text("start,end,phone\n" + "\n".join(rows) + "\n")
    with wave.open(str(sound), "wb") as out:
        out.setparams((1, 2, RATE_HZ, 0, "NONE", ""))
        second = (2000 * np.sin(np.arange(RATE_HZ) * 0.05)).astype("<i2").tobytes()
        for _ in range(int(seconds)):
            out.writeframesraw(second)
    return timings, sound


def command(stage: str, folder: Path, timings: Path, sound: Path, rate_hz: float, size: int, head: str) -> list[str]:
    """Give the command line of a stage; ``plan`` stands for planning alone, in Python."""
    run = [sys.executable, "-m", "fapengine"]
    talk = [*run, "animate", str(timings), "--alphabet", "ipa", "--audio", str(sound), "--fps", f"{rate_hz:g}"]
    if stage == "plan":
        text = (
            "from fapengine import animate; from pathlib import Path;"
            f"track = animate({str(timings)!r}, rate_hz={rate_hz}).track; print(len(track))"
        )
        return [sys.executable, "-c", text]
    if stage == "fap":
        return [*talk, "-o", str(folder / "talk.fap")]
    if stage == "fba":
        return [*run, "encode", str(folder / "talk.fap"), "--quant", "4", "-o", str(folder / "talk.fba")]
    if stage == "inspect":
        return [*run, "inspect", str(folder / "talk.fba"), "--json"]
    return [
        *talk,
        "--head",
        head,
        "--size",
        f"{size}x{size}",
        "--antialias",
        "soft",
        "-o",
        str(folder / "talk.mp4"),
    ]


def measured(arguments: list[str]) -> tuple[float, float]:
    """CPU seconds and peak MB of a command and its children."""
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(arguments)}: ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def starts_with_its_list(film: Path) -> bool:
    """Whether the list of an MP4's frames stands before the frames, so that it plays while it loads."""
    kinds, at, data = [], 0, film.read_bytes()
    while at + 8 <= len(data):
        size = int.from_bytes(data[at : at + 4]) or len(data)
        size = int.from_bytes(data[at + 8 : at + 16]) if size == 1 else size
        kinds.append(data[at + 4 : at + 8])
        at += max(size, 8)
    return b"moov" in kinds and kinds.index(b"moov") < kinds.index(b"mdat")


def main() -> int:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--rate", type=float, default=30.0, help="frames a second")
    parser.add_argument("--size", type=int, default=64, help="of the film, px")
    parser.add_argument("--head", default="default:level=coarse", help="of the film")
    parser.add_argument("--only", nargs="+", choices=STAGES, default=STAGES)
    parser.add_argument("--json", type=Path)
    wanted = parser.parse_args()
    rows, failed = [], False
    print(
        "| stage | CPU, s | of a quarter, s | times | peak memory, MB | of a quarter, MB |\n|---|---|---|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as quarter, tempfile.TemporaryDirectory() as whole:
        jobs = [(Path(quarter), wanted.seconds / 4), (Path(whole), wanted.seconds)]
        inputs = [(folder, *write_inputs(folder, seconds)) for folder, seconds in jobs]
        for stage in wanted.only:
            (less_s, less_mb), (more_s, more_mb) = (
                measured(command(stage, *files, wanted.rate, wanted.size, wanted.head)) for files in inputs
            )
            print(f"| {stage} | {more_s:.1f} | {less_s:.1f} | {more_s / less_s:.2f} | {more_mb:.0f} | {less_mb:.0f} |",
                  flush=True)  # fmt: skip
            rows.append(
                {"stage": stage, "cpu_s": more_s, "quarter_cpu_s": less_s, "mb": more_mb, "quarter_mb": less_mb}
            )
            failed |= more_mb > MOST_MB or more_s > MOST_TIMES * less_s
        film = Path(whole) / "talk.mp4"
        if film.exists() and not starts_with_its_list(film):
            print("the film does not begin with the list of its frames")
            failed = True
    if wanted.json:
        wanted.json.write_text(json.dumps(rows, indent=2))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
