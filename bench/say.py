"""The main job's speed: sentence to video at 512 x 512 and 30 frames a second, against real time, stage by stage.

    python -m bench.say [--json FILE]

The yardstick is the speech's own duration (1.0 times real time); drawing is set against clearing and reading back an
empty picture of the same size in the same run. Each figure is the best of three.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import moderngl
import numpy as np

from fapengine.app.manner import Manner
from fapengine.app.outputs import SaveOptions
from fapengine.app.performance import perform
from fapengine.app.report import Report
from fapengine.app.talk import write_talk
from fapengine.files.sound import load_sound
from fapengine.mesh.default_head.head import build_head
from fapengine.render.context import create_context
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.voices.espeak import EspeakVoice

SENTENCES = {
    "one sentence": "Bright sunshine shimmers on the ocean.",
    "a paragraph": "Bright sunshine shimmers on the ocean. Six pale fish swim below the waves, and a small boat "
    "drifts past the old harbour wall, while people on the beach watch the birds go by and talk about the weather.",
}
LONG_TEXT = SENTENCES["a paragraph"] + (
    " Later in the evening the wind turns, the water grows dark, and the fishermen pull their nets on to the sand"
    " before the first drops of rain begin to fall. Nobody hurries, because everybody knows that the storm will be"
    " over by tomorrow morning."
)
ROUNDS = 3
GOAL = 1.0
CPU_GOAL = 1.0
FIRST_FRAME_GOAL_S = 1.0
STARTS = 5
STAMPED_SAY = """
import sys
from fapengine.app import outputs
from fapengine.cli import main
write = outputs.write_moving
def stamped(path, frames, **options):
    def seen():
        for frame in frames:
            print("frame", flush=True)
            yield frame
    write(path, seen(), **options)
outputs.write_moving = stamped
main()
"""
"""``fapengine say``, which prints a line whenever a frame is handed to the film's writer."""


def whole_job(text: str) -> Report:
    """Run the job in this process; imports are already done."""
    with tempfile.TemporaryDirectory() as folder:
        report = Report()
        with report.stage("voice"):
            speech = EspeakVoice().speak(text).padded(lead_s=0.3, tail_s=0.5)
        with report.stage("plan"):
            manner = Manner(expressions={"joy": 0.4})
            performance = perform(speech.phones, (speech.samples, speech.sample_rate_hz), manner, text=text)
        write_talk(performance, Path(folder) / "bench.mp4", SaveOptions(report=report))
    return report


def drawing() -> dict[str, float]:
    """Milliseconds a frame: drawing the head, and the yardstick, an empty picture of that size."""
    frames = np.random.default_rng(1).normal(0, 80, (60, 68))
    with FaceRenderer(build_head(), RenderOptions(samples=0)) as renderer:
        ours = min(_seconds(lambda: list(renderer.frames(frames))) for _ in range(ROUNDS)) / len(frames)
    with create_context() as context:
        target: moderngl.Framebuffer = context.framebuffer([context.texture((512, 512), 4)])

        def empty() -> None:
            for _ in range(len(frames)):
                target.clear(0.1, 0.2, 0.3)
                target.read(components=3)

        yardstick = min(_seconds(empty) for _ in range(ROUNDS)) / len(frames)
    return {"ours_ms": 1000 * ours, "empty_ms": 1000 * yardstick, "ratio": ours / yardstick, "frames_per_s": 1 / ours}


def whole_program(text: str, edges: str) -> float:
    """Processor seconds of ``fapengine say`` from start to end, all threads, for each second of its film."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "fapengine",
            "say",
            text,
            "-o",
            str(Path(folder) / "bench.mp4"),
            "--antialias",
            edges,
        ]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        samples, rate_hz = load_sound(Path(folder) / "bench.wav")
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / (len(samples) / rate_hz)


def first_frame_s(folder: str) -> float:
    """Wall seconds from the start of the interpreter to the first frame of ``fapengine say`` in the film."""
    command = [sys.executable, "-c", STAMPED_SAY, "say", "Hi.", "-o", str(Path(folder) / "hi.mp4")]
    started_s = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        seen = process.stdout.readline()
        taken_s = time.perf_counter() - started_s
        process.stdout.read()
    if seen != b"frame\n" or process.returncode:
        sys.exit(f"fapengine say: got exit status {process.returncode}, expected a film")
    return taken_s


def help_seconds() -> float:
    """How long ``fapengine --help`` takes, start of the interpreter included."""
    command = [sys.executable, "-m", "fapengine", "--help"]
    return min(_seconds(lambda: subprocess.run(command, check=True, capture_output=True)) for _ in range(5))


def _seconds(work) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path)
    wanted = parser.parse_args()
    result: dict[str, object] = {"help_s": help_seconds(), "drawing": drawing()}
    print(f"fapengine --help: {result['help_s']:.2f} s (promise: 0.4 s)")
    print(
        "drawing 512 x 512: {ours_ms:.1f} ms = {frames_per_s:.0f} frames/s; empty picture {empty_ms:.2f} ms".format(
            **result["drawing"]
        )
    )
    for name, text in SENTENCES.items():
        best = max((whole_job(text) for _ in range(ROUNDS)), key=lambda report: report.as_dict()["times_real_time"])
        figures = best.as_dict()
        result[name] = figures
        print(
            f"\n{name}: {best.duration_s:.2f} s of speech in {figures['total_s']:.2f} s,"
            f" {figures['times_real_time']:.2f} times real time (goal: more than {GOAL:g})"
        )
        for stage, seconds in best.stages.items():
            print(f"  {stage:>14} {seconds:6.2f} s  {100 * seconds / figures['total_s']:5.1f} %")
    whole_program(SENTENCES["one sentence"], "soft")  # from now on the built head is kept
    with tempfile.TemporaryDirectory() as folder:
        first_s = sorted(first_frame_s(folder) for _ in range(STARTS))
    result["first_frame_s"] = {"min": first_s[0], "median": first_s[STARTS // 2]}
    print(
        "\nfirst frame of a second run: {min:.2f} s, median {median:.2f} s of {starts} starts"
        " (goal: at most {goal:g} s)".format(**result["first_frame_s"], starts=STARTS, goal=FIRST_FRAME_GOAL_S)
    )
    result["cpu"] = {edges: whole_program(LONG_TEXT, edges) for edges in ("soft", "fine")}
    print(f"\n{len(LONG_TEXT.split())} words, the whole program: processor seconds for each second of film")
    for edges, share in result["cpu"].items():
        print(f"  {edges:>14} {share:6.2f}" + (f"  (goal: at most {CPU_GOAL:g})" if edges == "soft" else ""))
    if wanted.json:
        wanted.json.write_text(json.dumps(result, indent=2))
    if any(result[name]["times_real_time"] < GOAL for name in SENTENCES):
        sys.exit("slower than real time")


if __name__ == "__main__":
    main()
