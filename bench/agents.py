"""Cost of a voice agent's face: seconds of processor for a second of face, and so agents on one core.

``python -m bench.agents`` measures each part by itself on one spoken text, at 25 frames a second and 512 x 512 or
``--size``, and prints agents a core; ``--plot FILE.svg`` draws it (matplotlib). It draws by ``--renderer``: ``native``,
``gl``, or by default as an agent would. OpenGL in software takes all cores: processor time counts, not the clock.
``--json`` for programs.

``--minutes N`` has two bots of Pipecat speak in one process beside a process that only computes, and counts: audio that
went in and came out, images drawn and skipped, memory. It needs the environment of :mod:`bench.latency`'s Pipecat.
Where other programs take the machine, ``chrt -f 10`` puts the bots before them.
"""

import argparse
import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import numpy as np

from fapengine.agents.face import AgentFace
from fapengine.files.heads.load import load_head_for_calls
from fapengine.files.profiles import load_profile
from fapengine.host.stream import StreamHost
from fapengine.host.words import TimedWord
from fapengine.mpeg4.track import FapTrack
from fapengine.recognition.protocol import Recognizer
from fapengine.recognition.small_recognizer import SmallRecognizer
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.render.drawing import RenderOptions, parse_edges
from fapengine.render.native import NativeRenderer, open_renderer
from fapengine.render.renderer import FaceRenderer
from fapengine.server.calls.tracks import VIDEO_HZ, DrawnEncoder, opus_encoder
from fapengine.speech.marks import words_of
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.pronounce import Pronouncer
from fapengine.wire.fap_osc import encode_track
from tests.direct_recognizer import DirectRecognizer

TEXT = "Good morning. I looked at the plan you sent me, and most of it is fine; but the budget may be a problem."
DIALOGUE = (
    "Hello, this is the booking desk. How can I help you today?",
    "Of course. Could you tell me the day and the number of guests?",
    "We have a table for four at half past seven on Friday, would that suit you?",
    "I can also offer you a quiet room upstairs, but it is only free until nine.",
    "Great. May I have your name and a telephone number, please?",
    "Thank you, I have written that down.",
    "You will get a message from us in a few minutes, with everything in it.",
    "If you want to change something, just call us again before Thursday evening.",
    "Let me look that up for you, one moment please.",
    "Yes, there is parking behind the house, and it costs nothing after six.",
    "I am sorry, I did not understand that. Could you say it again?",
    "The kitchen can make the soup without cream, that is no problem at all.",
    "Your order left our store on Monday and should reach you tomorrow.",
    "I see two accounts under this address. Which one do you mean?",
    "The second payment failed because the card has expired.",
    "You can send the shoes back within thirty days, and we pay for it.",
    "First press the button on the back until the light turns green.",
    "Then wait a minute, and tell me what you see on the screen.",
    "That is strange. Please pull the plug, count to ten, and put it back.",
    "Good, now it works. Is there anything else that I can do for you?",
)
"""Sentences that an agent has said before the time that is measured."""
SAID_NOW = (
    "Good morning. I looked at the plan you sent me, and most of it is fine; but the budget may be a problem.",
    "The train from the airport takes twenty minutes, and a ticket costs about nine pounds.",
    "I would not worry about that. The doctor will call you back this afternoon.",
    "We can move your appointment to next Wednesday, at a quarter to eleven.",
)
"""Sentences whose cost is measured: 39 of their 65 words are among :data:`DIALOGUE`."""
RATE_HZ, SIDE_PX = 25, 512
Renderer = FaceRenderer | NativeRenderer
DRAWN = 100
"""Frames of which drawing and encoding are measured."""


def _shown(stage: StreamHost, samples: np.ndarray, rate_hz: int) -> list[np.ndarray]:
    stage.push(samples, rate_hz)
    stage.end()
    frames = []
    while stage.is_speaking:
        frames.append(stage.next(1 / RATE_HZ).faps)
    return frames


def _cpu_s(work: Callable[[], object], seconds: float, repeats: int = 3) -> float:
    """Least processor time for a second of face."""
    costs = []
    for _ in range(repeats):
        begun_s = time.process_time()
        work()
        costs.append((time.process_time() - begun_s) / seconds)
    return min(costs)


def measured(side_px: int = SIDE_PX, renderer: str = "auto") -> dict[str, float]:
    """Processor time of each part for a second of face, s."""
    voice, profile = EspeakVoice("en-us"), load_profile("grid_s1_en")
    speech = voice.speak(TEXT)
    words = [TimedWord(*word) for word in words_of(speech.phones.phones)]
    length_s = speech.duration_s

    known = Pronouncer(voice).words([(word.text, word.start_s, word.end_s or 0.0) for word in words])

    def by_words() -> list[np.ndarray]:
        stage = StreamHost(profile, rng=np.random.default_rng(1), pronounce=lambda _: known)
        stage.words(words)
        return _shown(stage, speech.samples, speech.sample_rate_hz)

    def by_recognizer(make: Callable[[], Recognizer]) -> list[np.ndarray]:
        stage = StreamHost(profile, rng=np.random.default_rng(1), recognizer=DirectRecognizer(make()))
        return _shown(stage, speech.samples, speech.sample_rate_hz)

    frames = by_words()
    costs = {"stage, alone": _cpu_s(by_words, length_s)}
    costs |= _pronouncing(voice)
    for name, make in {"PocketSphinx": SphinxRecognizer, "small recognizer": SmallRecognizer}.items():
        costs[name] = max(_cpu_s(partial(by_recognizer, make), length_s) - costs["stage, alone"], 0.0)
    count = len(frames)
    track = FapTrack.from_values(np.array(frames), rate_hz=RATE_HZ)
    costs["Opus"] = _cpu_s(lambda: _opus(speech.samples, speech.sample_rate_hz), length_s)
    costs["FAPs as OSC"] = _cpu_s(lambda: encode_track(track, session="a"), count / RATE_HZ)
    return costs | _pictures(frames, RenderOptions(size=(side_px, side_px), renderer=renderer))


def _pictures(frames: list[np.ndarray], drawing: RenderOptions) -> dict[str, float]:
    """Processor time of drawing and encoding for a second of face: as an agent speaks, and as it listens."""
    listening: list[bytes] = []
    head = load_head_for_calls("default", drawing.size)
    hard = replace(drawing, samples=parse_edges("none"))
    with open_renderer(head, drawing) as renderer, open_renderer(head, hard) as other:
        pictures = _drawn(renderer, frames[:DRAWN])
        works: dict[str, Callable[[], object]] = {
            "drawing": lambda: _drawn(renderer, frames[:DRAWN]),
            "drawing, listening": lambda: listening.extend(_listened(renderer)),
            "drawing, hard edges": lambda: _drawn(other, frames[:DRAWN]),
            "VP8, 500 kbit/s": lambda: _vp8(pictures, drawing.size),
            "VP8, listening": lambda: _vp8(listening[:DRAWN], drawing.size),
        }
        rounds = [{name: _cpu_s(work, DRAWN / RATE_HZ, repeats=1) for name, work in works.items()} for _ in range(6)]
    return {name: min(costs[name] for costs in rounds) for name in works}


def _drawn(renderer: Renderer, frames: list[np.ndarray]) -> list[bytes]:
    """I420 images, as calls draw them."""
    return [renderer.draw(frame, "i420").tobytes() for frame in frames]


class _PainterHere:
    """Stands in for the process that draws."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer

    async def picture(self, faps: np.ndarray) -> bytes:
        return _drawn(self._renderer, [faps])[0]


def _listened(renderer: Renderer) -> list[bytes]:
    """Pictures of an agent that nobody lets speak, its stage's work among them."""
    actor = AgentFace(StreamHost(load_profile("grid_s1_en"), rng=np.random.default_rng(1)), RATE_HZ)
    actor.painter = _PainterHere(renderer)  # type: ignore[assignment]

    async def pictures() -> list[bytes]:
        shown = []
        for number in range(DRAWN):
            actor.show(actor.frame(number / RATE_HZ)[0])
            shown.append(await actor.drawn(60.0))
        return [picture.pixels for picture in shown if picture is not None]

    return asyncio.run(pictures())


def _pronouncing(voice: EspeakVoice) -> dict[str, float]:
    """Processor time of pronouncing for a second of face, in the middle of a talk."""
    said, said_now = ([voice.speak(text) for text in texts] for texts in (DIALOGUE, SAID_NOW))
    talk = [words_of(speech.phones.phones) for speech in said_now]
    portions = {
        "words, one by one": [[word] for words in talk for word in words],
        "words, by sentences": talk,
    }
    costs: dict[str, list[float]] = {name: [] for name in portions}
    for _ in range(3):
        for name, cut in portions.items():
            pronouncer = Pronouncer(voice)
            for speech in said:
                pronouncer.words(words_of(speech.phones.phones))
            begun_s = time.process_time()
            for words in cut:
                pronouncer.words(words)
            costs[name].append((time.process_time() - begun_s) / sum(speech.duration_s for speech in said_now))
    return {name: min(each) for name, each in costs.items()}


def _vp8(pictures: list[bytes], size: tuple[int, int]) -> None:
    """Encode as calls do."""
    encoder = DrawnEncoder()
    for number, picture in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(np.frombuffer(picture, np.uint8).reshape(-1, size[0]), format="yuv420p")
        frame.pts, frame.time_base = number * VIDEO_HZ // RATE_HZ, Fraction(1, VIDEO_HZ)
        encoder.encode(frame)


def _opus(samples: np.ndarray, rate_hz: int) -> None:
    """Encode as calls do, 20 ms at a time."""
    encoder, block = opus_encoder(), rate_hz // 50
    for begin in range(0, len(samples) - block + 1, block):
        frame = av.AudioFrame.from_ndarray(samples[None, begin : begin + block], format="s16", layout="mono")
        frame.sample_rate, frame.pts = rate_hz, begin
        frame.time_base = Fraction(1, rate_hz)
        encoder.encode(frame)


KINDS = {
    "drawn, PocketSphinx": ("stage, alone", "PocketSphinx", "drawing", "VP8, 500 kbit/s", "Opus"),
    "drawn, small recognizer": ("stage, alone", "small recognizer", "drawing", "VP8, 500 kbit/s", "Opus"),
    "drawn, with words": ("stage, alone", "words, one by one", "drawing", "VP8, 500 kbit/s", "Opus"),
    "drawn, hard edges, words": ("stage, alone", "words, one by one", "drawing, hard edges", "VP8, 500 kbit/s", "Opus"),
    "drawn, listening": ("drawing, listening", "VP8, listening", "Opus"),
    "FAPs, PocketSphinx": ("stage, alone", "PocketSphinx", "FAPs as OSC"),
    "FAPs, small recognizer": ("stage, alone", "small recognizer", "FAPs as OSC"),
    "FAPs, word by word": ("stage, alone", "words, one by one", "FAPs as OSC"),
    "FAPs, by sentences": ("stage, alone", "words, by sentences", "FAPs as OSC"),
    "FAPs, with phones": ("stage, alone", "FAPs as OSC"),
}
"""Ways to give an agent a face, each with the parts of the work that it needs."""


def agents_a_core(costs: dict[str, float]) -> dict[str, float]:
    """Divide one core among agents of each kind: how many it carries."""
    return {kind: 1 / sum(costs[part] for part in parts) for kind, parts in KINDS.items()}


def _plot(costs: dict[str, float], path: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 4.2), layout="constrained")
    axes.set_prop_cycle(color=pyplot.get_cmap("tab20").colors)
    for part in costs:
        shares = [1e3 * costs[part] if part in parts else 0.0 for parts in KINDS.values()]
        before = [
            1e3 * sum(costs[other] for other in list(costs)[: list(costs).index(part)] if other in parts)
            for parts in KINDS.values()
        ]
        axes.barh(list(KINDS), shares, left=before, label=part)
    for row, (parts, count) in enumerate(zip(KINDS.values(), agents_a_core(costs).values(), strict=True)):
        axes.text(1e3 * sum(costs[part] for part in parts), row, f"  {count:.{count < 10:d}f} a core", va="center")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.25e3 * max(sum(costs[part] for part in parts) for parts in KINDS.values()))
    axes.set_xlabel(f"ms of processor for a second of face, {RATE_HZ} frames/s, {SIDE_PX} x {SIDE_PX}")
    axes.legend(fontsize="small", loc="lower right")
    figure.savefig(path, metadata={"Date": None})


async def soak(minutes: float, bots: int = 2) -> None:
    """Print a line a minute, and at the end whether all audio came out."""
    from bench.latency import bot

    until_s, begun_s = time.monotonic() + 60.0 * minutes, time.monotonic()
    voice = EspeakVoice("en-us")
    speeches = [voice.speak(text) for text in DIALOGUE]
    sent, received, faces = [0.0] * bots, [0.0] * bots, []

    async def talk(number: int) -> None:
        def heard(samples: np.ndarray) -> None:
            received[number] += len(samples) / speeches[0].sample_rate_hz

        async with bot(lambda _: None, heard, (SIDE_PX, SIDE_PX)) as (face, push, end):
            faces.append(face)
            while time.monotonic() < until_s:
                for speech in speeches[number:]:
                    if time.monotonic() >= until_s:
                        break
                    step = round(0.04 * speech.sample_rate_hz)
                    began_s = time.monotonic()
                    for at in range(0, len(speech.samples), step):
                        await asyncio.sleep(began_s + at / speech.sample_rate_hz - time.monotonic())
                        await push(speech.samples[at : at + step], speech.sample_rate_hz)
                    await end()
                    sent[number] += speech.duration_s
                    await asyncio.sleep(2.0)  # the other one speaks
            for _ in range(60):
                if received[number] >= sent[number] - 1e-6:
                    break
                await asyncio.sleep(1.0)

    async def report() -> None:
        while True:
            counts = [face._face.pictures.counts for face in faces]
            row = {
                "minute": round((time.monotonic() - begun_s) / 60.0, 1),
                "sent_s": [round(each, 2) for each in sent], "received_s": [round(each, 2) for each in received],
                "drawn": sum(each.drawn for each in counts), "skipped": sum(each.left_out for each in counts),
                "restarts": sum(each.restarts for each in counts), "rss_mb": _rss_mb(), "load": os.getloadavg()[0],
            }  # fmt: skip
            print(json.dumps(row), flush=True)
            await asyncio.sleep(60.0)

    def as_others() -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # where the bots were put before the others

    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"], preexec_fn=as_others)
    reporting = asyncio.create_task(report())
    try:
        await asyncio.gather(*map(talk, range(bots)))
    finally:
        reporting.cancel()
        busy.kill()
        busy.wait()
    lost_s = [into_s - out_s for into_s, out_s in zip(sent, received, strict=True)]
    print(f"sound sent {sum(sent):.2f} s, lost {sum(lost_s):.3f} s")


def _rss_mb() -> float:
    """Return the memory of this process, MB."""
    return round(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--plot", type=Path, metavar="FILE.svg")
    parser.add_argument("--size", type=int, default=SIDE_PX, metavar="PIXELS", help="width and height")
    parser.add_argument("--renderer", choices=("auto", "native", "gl"), default="auto")
    parser.add_argument("--minutes", type=float, help="two bots that speak for so long")
    given = parser.parse_args()
    if given.minutes:
        asyncio.run(soak(given.minutes))
        return
    costs = measured(given.size, given.renderer)
    if given.plot:
        _plot(costs, given.plot)
    if given.json:
        print(json.dumps({"cpu_s": costs, "agents_a_core": agents_a_core(costs)}))
        return
    for part, cost_s in costs.items():
        print(f"{part:25s} {1e3 * cost_s:7.1f} ms of processor for a second of face")
    for kind, count in agents_a_core(costs).items():
        print(f"{kind:25s} {count:7.1f} agents on one core")


if __name__ == "__main__":
    main()
