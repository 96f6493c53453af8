"""Speed of the codec in C (fapengine-native) and in Python, in processor time of one run.

Run ``python -m bench.codec``. Frames a second have 66 FAPs and q = 1, as those of the C++ programs that are derived
from the reference software. Commands are whole processes: ``fapengine encode`` and ``decode`` of FAPs as text, q = 4.
"""

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.talking import talking_face
from fapengine.codec import kernels
from fapengine.codec.decoder import decode
from fapengine.codec.encoder import Encoder, encode
from fapengine.codec.fapfile import format_fap

FRAMES = {"C": 15_000, "Python": 200}
COMMAND_FRAMES = {"5 s": 134, "10 min": 18_000}
REFERENCE = {"encode": 38_700, "decode": 25_300}
"""Frames a second of the C++ programs, on a machine of this kind."""
GOALS = {"encode": 5.0, "decode": 4.0}
"""Least ratios of C to them, on a machine of that kind."""
FLOOR = 20.0
"""Ratio of C to Python under which something is broken."""
WITHOUT = "import sys; sys.modules['fapengine_native'] = None; from fapengine.cli import main; main()"
"""The command line where the package is not installed."""
WITH = "from fapengine.cli import main; main()"


def best(function: Callable[[], object], times: int = 5) -> float:
    """Shortest of several runs, seconds of the processor."""
    taken = []
    for _ in range(times):
        start = time.process_time()
        function()
        taken.append(time.process_time() - start)
    return min(taken)


def frames_a_second() -> dict[str, dict[str, int]]:
    compiled, found = kernels.loops, {}
    for name, frames in FRAMES.items():
        kernels.loops = compiled if name == "C" else kernels
        track = talking_face(frames)
        stream = encode(track)
        taken = {"encode": best(lambda: encode(track)), "decode": best(lambda: decode(stream))}  # noqa: B023, at once
        found[name] = {what: round(frames / seconds) for what, seconds in taken.items()}
    kernels.loops = compiled
    return found


def live_frame_ms() -> dict[str, float]:
    encoder, taken = Encoder(rate_hz=25.0), []
    for row in talking_face(2000).values:
        start = time.process_time()
        encoder.frame(row)
        taken.append(1000 * (time.process_time() - start))
    return {"median": round(float(np.median(taken)), 3), "p99": round(float(np.percentile(taken, 99)), 3)}


def command_s(program: str, *words: str) -> float:
    """Least processor time of two runs of a command, seconds."""
    taken = []
    for _ in range(2):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", program, *words], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return round(min(taken), 2)


def commands_s() -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    with TemporaryDirectory() as name:
        text, stream, out = (str(Path(name) / each) for each in ("a.fap", "a.fba", "b.fap"))
        for length, frames in COMMAND_FRAMES.items():
            Path(text).write_text(format_fap(talking_face(frames)), "utf-8")
            for loops, program in (("C", WITH), ("Python", WITHOUT)):
                found[f"{length}, {loops}"] = {
                    "encode": command_s(program, "encode", text, "-q", "4", "-o", stream),
                    "decode": command_s(program, "decode", stream, "-o", out),
                }
    return found


def main() -> None:
    if kernels.loops is kernels:
        sys.exit("fapengine-native is not installed: make native")
    speed = frames_a_second()
    ratios = {what: round(speed["C"][what] / REFERENCE[what], 1) for what in REFERENCE}
    result = {
        "frames_s": speed, "ratio_to_reference": ratios, "goals": GOALS, "live_frame_ms": live_frame_ms(),
        "commands_processor_s": commands_s(),
    }  # fmt: skip
    print(json.dumps(result, indent=2))
    if any(speed["C"][what] < FLOOR * speed["Python"][what] for what in REFERENCE):
        sys.exit(f"slower than {FLOOR} times Python")


if __name__ == "__main__":
    main()
