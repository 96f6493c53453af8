"""Input that grows: for every reader of :mod:`tests.fuzz.readers`, and for the engine as commands at their limits.

    python -m bench.growth

prints the longest frame of an engine under each of :data:`CROWDS`. Exits 1 where one takes more than :data:`MOST_MS` of
CPU time.
"""

import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from fapengine.capture.arrays import format_npz
from fapengine.capture.c3d import format_c3d
from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.table import format_table, format_trc
from fapengine.codec.encoder import encode
from fapengine.codec.fapfile import format_fap
from fapengine.engine.commands import (
    Append,
    Audio,
    Begin,
    Blink,
    Cancel,
    Command,
    End,
    Express,
    Look,
    Pause,
    Resume,
    Seek,
    SetParameter,
    TurnHead,
)
from fapengine.engine.engine import Engine
from fapengine.expressions import Expression
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend_tracks import format_blend_csv
from fapengine.speech.phone_track import Phone
from tests.fuzz.readers import Reader

LABELS = ("m", "a", "b", "i")
HEAD = "ooTextFile\nTextGrid\n0\n{end}\n<exists>\n1\nIntervalTier\nphones\n0\n{end}\n{count}\n"


def track(frames: int) -> FapTrack:
    """FAPs that move."""
    values = np.zeros((frames, 68), np.int32)
    values[:, 2:14] = (100 * np.abs(np.sin(np.arange(frames) / 5)))[:, None]
    return FapTrack.from_values(values, rate_hz=30.0)


def markers(frames: int) -> MarkerTrack:
    """Four markers that move."""
    moved = np.sin(np.arange(frames) / 9)[:, None, None] * np.linspace(1, 4, 4)[:, None]
    positions = np.random.default_rng(1).normal(0, 60, (4, 3)) + moved
    return MarkerTrack(positions_mm=positions, labels=("8.1", "8.2", "8.3", "8.4"), rate_hz=100.0)


def rows(line: Callable[[int, str], str], head: str = "") -> Callable[[int], bytes]:
    """Make a file of a line for each phone; the line is made of its number and label."""
    return lambda n: (head + "".join(line(place, LABELS[place % 4]) for place in range(n))).encode()


def items(item: Callable[[int, str], object], whole: Callable[[list[object]], object]) -> Callable[[int], bytes]:
    """Make JSON of an object for each phone."""
    return lambda n: json.dumps(whole([item(place, LABELS[place % 4]) for place in range(n)])).encode()


def textgrid(n: int) -> bytes:
    """Make a TextGrid in Praat's short form."""
    words = "".join(f'{place / 10:.1f}\n{(place + 1) / 10:.1f}\n"{LABELS[place % 4]}"\n' for place in range(n))
    head = HEAD.format(end=f"{n / 10:.1f}", count=n).splitlines()
    quoted = [f'"{word}"' if word in ("ooTextFile", "TextGrid", "IntervalTier", "phones") else word for word in head]
    return ("\n".join(quoted) + "\n" + words).encode()


def grid(n: int) -> tuple[list[str], list[str]]:
    """Vertices and triangles (from 1) of a strip."""
    vertices = [f"{place // 2} {place % 2} 0" for place in range(n)]
    return vertices, [f"{place} {place + 1} {place + 2}" for place in range(1, n - 1)]


def obj(n: int) -> bytes:
    """Make a mesh in Wavefront's form."""
    vertices, triangles = grid(n)
    return "".join([*(f"v {one}\n" for one in vertices), *(f"f {one}\n" for one in triangles)]).encode()


def ply(n: int) -> bytes:
    """Make a mesh in Stanford's form."""
    vertices, triangles = grid(n)
    counted = ["3 " + " ".join(str(int(one) - 1) for one in triangle.split()) for triangle in triangles]
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {n - 2}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return (head + "\n".join([*vertices, *counted]) + "\n").encode()


GROWN: dict[str, Callable[[int], bytes]] = {
    "FBA": lambda n: encode(track(n)),
    "FBA, resync": lambda n: encode(track(n)),
    "fap": lambda n: format_fap(track(n)).encode(),
    "shapes": lambda n: _bytes(format_blend_csv(track(n), "arkit")),
    "C3D": lambda n: format_c3d(markers(n)),
    "TRC": lambda n: format_trc(markers(n)),
    "marker table": lambda n: format_table(markers(n)),
    "NPZ": lambda n: format_npz(markers(n)),
    "landmarks": lambda n: json.dumps(np.random.default_rng(1).random((max(n // 40, 1), 468, 3)).tolist()).encode(),
    "mesh, obj": obj,
    "mesh, ply": ply,
    "timings, textgrid": textgrid,
    "timings, htk": rows(lambda n, label: f"{n * 10**6} {(n + 1) * 10**6} {label}\n"),
    "timings, pho": rows(lambda n, label: f"{label} 100\n"),
    "timings, align": rows(lambda n, label: f"{n * 2500} {(n + 1) * 2500} {label}\n"),
    "timings, timit": rows(lambda n, label: f"{n * 1600} {(n + 1) * 1600} {label}\n"),
    "timings, ctm": rows(lambda n, label: f"talk 1 {n / 10:.2f} 0.10 {label}\n"),
    "timings, flite": lambda n: " ".join(f"{LABELS[at % 4]}:{(at + 1) / 10:.1f}" for at in range(n)).encode(),
    "timings, rhubarb-tsv": rows(lambda n, label: f"{n / 10:.2f}\t{'ABCD'[n % 4]}\n"),
    "timings, table": rows(lambda n, label: f"{n / 10:.1f},{(n + 1) / 10:.1f},{label}\n", "start,end,phone\n"),
    "timings, table json": items(
        lambda n, label: {"phone": label, "start": n / 10, "end": (n + 1) / 10}, lambda found: found
    ),
    "timings, phone-list": items(
        lambda n, label: {"phone": "M", "start": n / 10, "end": (n + 1) / 10, "word": "my"},
        lambda found: {"phones": found},
    ),
    "timings, vosk": items(
        lambda n, label: {"conf": 1.0, "start": n / 10, "end": (n + 1) / 10, "word": "my"},
        lambda found: {"result": found, "text": "my"},
    ),
    "timings, openai-words": items(
        lambda n, label: {"word": "my", "start": n / 10, "end": (n + 1) / 10},
        lambda found: {"task": "transcribe", "duration": len(found) / 10, "text": "my", "words": found},
    ),
    "timings, azure": items(lambda n, label: {"audio_offset": n * 10**6, "viseme_id": n % 20}, lambda found: found),
    "timings, polly words": rows(lambda n, label: f'{{"time": {n * 100}, "type": "word", "value": "my"}}\n'),
    "timings, subtitles": rows(
        lambda n, label: f"{n + 1}\n00:{n // 60:02}:{n % 60:02},000 --> 00:{n // 60:02}:{n % 60:02},900\nmy\n\n"
    ),
    "feature points": lambda n: b"point,vertex\n8.1,0\n" + b"8.2,1\n" * n,
    "text": lambda n: "Hello — there, 3 cafés. ".encode() * n,
    "SSML": lambda n: b"<speak>" + b'Hello <break time="1s"/> <prosody rate="slow">there</prosody> ' * n + b"</speak>",
    "sound, WAV": lambda n: _wav(160 * n),
}
"""Input of so many frames, phones, vertices or words by the reader's name."""


def _bytes(data: str | bytes) -> bytes:
    return data.encode() if isinstance(data, str) else data


def _wav(samples: int) -> bytes:
    import io
    import wave

    out = io.BytesIO()
    with wave.open(out, "wb") as file:
        file.setparams((1, 2, 16000, 0, "NONE", ""))
        file.writeframes(bytes(2 * samples))
    return out.getvalue()


TIMES = re.compile(r"start|end|time|offset|begin|^from$|^to$|_ts$|sample$|position|^b$|timestamp", re.I)
"""Keys of JSON whose numbers grow with time."""


def _numbers(value: Any, key: str = "") -> Iterator[float]:
    if isinstance(value, dict):
        yield from (number for name, held in value.items() for number in _numbers(held, name))
    elif isinstance(value, list):
        yield from (number for held in value for number in _numbers(held, key))
    elif isinstance(value, int | float) and not isinstance(value, bool) and TIMES.search(key):
        yield value


def _later(value: Any, by: float, key: str = "") -> Any:
    if isinstance(value, dict):
        return {name: _later(held, by, name) for name, held in value.items()}
    if isinstance(value, list):
        return [_later(held, by, key) for held in value]
    is_time = isinstance(value, int | float) and not isinstance(value, bool) and TIMES.search(key)
    return value + by if is_time else value


def _longer(value: Any, times: int, span: float, key: str = "") -> Any:
    """Repeat the outermost lists of two or more, each time later."""
    if isinstance(value, dict):
        return {name: _longer(held, times, span, name) for name, held in value.items()}
    if isinstance(value, list) and len(value) > 1:
        return [one for turn in range(times) for one in _later(value, turn * span, key)]
    return [_longer(held, times, span, key) for held in value] if isinstance(value, list) else value


def longer_json(good: bytes, times: int) -> bytes | None:
    """Make a JSON document, or lines of such, as long; None where it is no JSON."""
    try:
        whole = json.loads(good)
    except ValueError:
        try:
            lines = [json.loads(line) for line in good.splitlines()]
        except ValueError:
            return None
        grown_lines = _longer(lines, times, max(_numbers(lines), default=0))
        return "\n".join(json.dumps(line) for line in grown_lines).encode()
    return json.dumps(_longer(whole, times, max(_numbers(whole), default=0))).encode()


def grown(reader: Reader, n: int) -> bytes:
    """Input of n rows; where nobody makes such, a good file, again and again: it is read, or refused, in time too."""
    if reader.name in GROWN:
        return GROWN[reader.name](n)
    good = max(reader.good, key=len) if reader.name == "timings, any" else reader.good[0]
    times = max(1, 32 * n // len(good))
    return (longer_json(good, times) if reader.name.startswith("timings") else None) or good * times


MOST_MS = 5.0
"""CPU time that one frame of one session may take, in ms."""
FRAME_HZ = 60
Commands = Iterator[list[Command]]
"""Commands before each frame."""


def utterance(number: int, count: int, each_s: float, labels: tuple[str, ...] = LABELS) -> list[Command]:
    """Make an utterance of many phones, 64 in a piece as senders send them."""
    phones = [Phone(labels[n % len(labels)], n * each_s, (n + 1) * each_s, stress=1) for n in range(count)]
    pieces = [Append(number, n, tuple(phones[n : n + 64])) for n in range(0, count, 64)]
    return [Begin(number), *pieces, End(number, count, count * each_s)]


def _queue(count: int, phones: int, each_s: float, labels: tuple[str, ...] = LABELS) -> Commands:
    yield [command for number in range(count) for command in utterance(number, phones, each_s, labels)]


def _pieces(each_s: float, order: Callable[[int], int], count: int = 15_000) -> Commands:
    """Yield phones one by one, 50 before each frame."""
    yield [Begin(0)]
    for first in range(0, count, 50):
        indices = (order(n) for n in range(first, first + 50))
        yield [Append(0, n, (Phone(LABELS[n % 4], n * each_s, (n + 1) * each_s),)) for n in indices]


def _again(first: list[Command], *commands: Callable[[int], Command], times: int = 100) -> Commands:
    """Yield the same commands many times before each frame."""
    yield first
    for frame in range(120):
        yield [command(frame * times + n) for n in range(times) for command in commands]


def _soon(n: int) -> Command:
    return Express(Expression.JOY, n % 2, 2.0 + 1e-6 * n, 0.01, 0.0, 0.01)


def _changed(n: int) -> Command:
    phones = tuple(Phone(LABELS[(n + at) % 4], 0.04 * at, 0.04 * at + 0.04) for at in range(5, 15))
    return Append(0, 5, phones, n + 1, keeps_earlier=True)


LONG = utterance(0, 15_000, 0.04)
CROWDS: dict[str, Callable[[], Commands]] = {
    "normal speech": lambda: _queue(3, 40, 0.1),
    "32 x 400 phones of 20 ms": lambda: _queue(32, 400, 0.02),
    "32 x 400 phones of 1 ms": lambda: _queue(32, 400, 0.001),
    "32 x 600 labels of 15 characters": lambda: _queue(32, 600, 0.02, ("ptkbdgfsaiuaiua",)),
    "phones one by one": lambda: _pieces(0.02, lambda n: n),
    "phones backwards": lambda: _pieces(0.0001, lambda n: 14_999 - n),
    "every second phone, then the others": lambda: _pieces(0.002, lambda n: 2 * n % 15_000 + n // 7_500),
    "a gap of 15,000 phones": lambda: iter([[Begin(0), LONG[1], Append(0, 14_999, (Phone("a", 0.1, 9.0),))]]),
    "an hour late": lambda: iter([[Begin(0, "at", -100.0), *LONG[1:]]]),
    "ends without phones": lambda: iter([[c for n in range(32) for c in (Begin(n), End(n, 20_000, 0.0))]]),
    "seek": lambda: _again(LONG, lambda n: Seek(0, n * 7.9 % 590)),
    "seek among 31 queued": lambda: _again(list(*_queue(32, 600, 0.02)), lambda n: Seek(0, n * 0.79 % 11)),
    "pause, resume": lambda: _again(LONG, lambda n: Pause(), lambda n: Resume()),
    "jumps of the sound": lambda: _again(LONG, lambda n: Audio(0, n / 6000, n * 7.9 % 590)),
    "speak, cancel": lambda: _again([], Begin, lambda n: Append(n, 0, (Phone("m", 0.1, 0.2),)), lambda n: Cancel()),
    "revise": lambda: _again(LONG, lambda n: Append(0, n, (Phone("m", 0.1 * n, 0.1 * n + 0.1),), n), times=20),
    "phones that change": lambda: _again(LONG, _changed, times=20),
    "cancel over 10 s": lambda: _again(LONG, lambda n: Cancel(fade_s=10.0)),
    "parameters": lambda: _again([], lambda n: SetParameter("jaw", n % 3), lambda n: SetParameter("gaze", n % 2)),
    "turns, looks, blinks": lambda: _again(
        [], lambda n: TurnHead(roll_rad=0, pitch_rad=n % 2, yaw_rad=0), lambda n: Look(n % 2, 0), lambda n: Blink()
    ),
    "expressions at one moment": lambda: _again([], _soon, times=9),
}
"""Commands to one session, each kind at its limits."""


def crowded(name: str, frame: Callable[[Engine, float], object], profile: Any, seconds: float = 4.0) -> Engine:
    """Drive an engine under one of :data:`CROWDS`: ``frame`` makes each of its frames."""
    engine, crowd = Engine(profile, rng=np.random.default_rng(1)), CROWDS[name]()
    engine.open("anna", 0.0)
    for number in range(round(seconds * FRAME_HZ)):
        for command in next(crowd, ()):
            engine.apply("anna", command, number / FRAME_HZ)
        frame(engine, number / FRAME_HZ)
        engine.events()
    return engine


def longest_ms(name: str, profile: Any) -> float:
    """CPU time of a crowd's longest frame in ms: of each the least of three runs, because other work adds to it."""
    runs: list[list[float]] = []

    def timed(engine: Engine, now_s: float) -> None:
        start = time.thread_time()
        engine.frame(now_s)
        runs[-1].append(time.thread_time() - start)

    for _ in range(3):
        runs.append([])
        crowded(name, timed, profile)
    return 1e3 * max(min(frame) for frame in zip(*runs, strict=True))


def main() -> int:
    """Print a line for each crowd."""
    from tests.english import english

    longest = {}
    for name in CROWDS:
        longest[name] = longest_ms(name, english())
        print(f"{longest[name]:8.1f} ms  {name}", flush=True)
    return int(max(longest.values()) > MOST_MS)


if __name__ == "__main__":
    sys.exit(main())
