"""Wrong calls of the public interface: each is a UsageError, or a DataError, that names the argument."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fapengine as f
from fapengine.voices.protocol import Speech

NAN, ROW = float("nan"), [[0] * 68]
PHONES = f.PhoneTrack.from_phones([f.Phone("m", 0.0, 0.2), f.Phone("a", 0.2, 0.4)])
TRACK = f.FapTrack.from_values(ROW, rate_hz=25.0)


class Still:
    """A voice that needs no program."""

    def speak(self, text: str) -> Speech:
        return Speech(samples=np.zeros(6400, np.int16), sample_rate_hz=16_000, phones=PHONES)


def speak(**wrong: Any) -> f.Performance:
    return f.speak(**{"text": "Hi.", "voice": Still(), **wrong})


def animate(**wrong: Any) -> f.Performance:
    return f.animate(**{"timings": PHONES, **wrong})


def save(**wrong: Any) -> Path:
    return f.save(**{"track": TRACK, "path": "/nonexistent/a.fap", **wrong})


def mood(**wrong: Any) -> f.Mood:
    return f.Mood(**{"expression": f.Expression.JOY, **wrong})


def phone(**wrong: Any) -> f.Phone:
    return f.Phone(**{"label": "a", "start_s": 0.0, "end_s": 1.0, **wrong})


TEXTS: tuple[object, ...] = (None, 3, b"x", ["x"], np.zeros(3))
NUMBERS: tuple[object, ...] = ("30", None, [30], NAN, b"1", np.zeros(3))
WRONG: dict[tuple[Callable[..., object], str], tuple[object, ...]] = {
    (speak, "text"): TEXTS,
    (speak, "voice"): (None, 3, b"en", object()),
    (speak, "seed"): (-1, 1.5, "1", None, NAN),
    (speak, "rate_hz"): (*NUMBERS, 0, -1.0, 1e9, float("inf")),
    (speak, "style"): ({"jaw": 1}, f.Style, "still", 3),
    (speak, "profile"): (None, 3, b"grid", "nobody"),
    (speak, "expressions"): ("joy", None, 3, {"joy": "x"}, {"glee": 1}, {"joy": NAN}, {"joy": -1}, [3], ["joy:x"]),
    (animate, "timings"): (None, 3, b"x", [], PHONES.phones),
    (animate, "sound"): (np.zeros(9), b"x", 3, (np.zeros(9),), (np.zeros(9), "16000"), (np.zeros(9), 44.1)),
    (animate, "seed"): (-1, 1.5, "1"),
    (animate, "rate_hz"): ("30", NAN, 0, 1e9),
    (animate, "channel"): (1, "1"),
    (animate, "transcript"): ("hello", 3),
    (animate, "recognizer"): ("small", 3),
    (animate, "style"): ({"jaw": 1}, f.Style),
    (save, "track"): (None, ROW, np.zeros((1, 68)), PHONES),
    (save, "path"): (None, 3, b"a.fap", "/nonexistent/a.xyz"),
    (save, "size"): (3, "64x64", (64,), (64.5, 64)),
    (save, "at_s"): ("1", NAN),
    (save, "shapes"): (3, b"arkit"),
    (save, "kbit_s"): ("4", 4.0, NAN),
    (save, "head"): (None, 3, b"default"),
    (save, "drawing"): (3, "front"),
    (save, "on_frame"): (3, "x"),
    (mood, "expression"): ("joy", 1, None),
    (mood, "strength"): ("1", -1, NAN, 3.0),
    (mood, "start_s"): ("1", -1, NAN),
    (phone, "label"): (None, 3, b"a", ""),
    (phone, "start_s"): ("0", None, -1, NAN, 2.0),
    (phone, "end_s"): ("1", None, NAN, float("inf")),
    (f.Style, "jaw"): ("1", None, -1, NAN, 4.0),
    (f.Style, "method"): ("magic", 3, None),
    (f.Style, "blinks"): ("no", 3, None),
    (f.FapTrack.pose, "rate_hz"): ("25", 0, -1, NAN, None),
    (f.FapTrack.pose, "open_jaw"): ("300", None, 0.5, NAN),
    (f.load, "path"): (None, 3, b"a.fap", "a.xyz"),
    (f.load_head, "name"): (None, 3, b"default", "nobody"),
}
CASES = [(call, name, value) for (call, name), values in WRONG.items() for value in values]

SPEECH = Still().speak("")
POSE = {"values": TRACK.values, "mask": TRACK.mask, "visemes": TRACK.visemes, "expressions": TRACK.expressions}
GIVEN: dict[Callable[..., object], dict[str, object]] = {
    f.FapTrack: {**POSE, "frame_numbers": TRACK.frame_numbers, "rate_hz": 25.0},
    f.FapTrack.from_values: {"values": ROW, "rate_hz": 25.0},
    f.FapTrack.cut: {"self": TRACK, "start_s": 0.0, "end_s": 1.0},
    f.FapTrack.blend: {"self": TRACK, "other": TRACK, "weight": 0.5},
    f.FapTrack.column: {"self": TRACK, "name": "open_jaw"},
    f.FapTrack.equals: {"self": TRACK, "other": TRACK},
    f.Phone: {"label": "a", "start_s": 0.0, "end_s": 1.0},
    f.PhoneTrack: {"phones": PHONES.phones},
    f.PhoneTrack.from_phones: {"phones": list(PHONES.phones)},
    f.Speech: {"samples": SPEECH.samples, "sample_rate_hz": 16_000, "phones": PHONES},
    f.Speech.padded: {"self": SPEECH, "lead_s": 0.0, "tail_s": 0.0},
    f.Performance: {"track": TRACK, "phones": PHONES},
    f.Performance.save: {"self": f.Performance(track=TRACK, phones=PHONES), "path": "/nonexistent/a.fap"},
    f.Performance.visemes: {"self": f.Performance(track=TRACK, phones=PHONES)},
    f.Performance.weights: {"self": f.Performance(track=TRACK, phones=PHONES)},
    f.Mood: {"expression": f.Expression.JOY},
    f.Style: {},
    f.Style.without: {"self": f.Style()},
    f.HeadStyle: {},
    f.RenderOptions: {},
    f.RenderOptions.parse: {},
    f.Encoder: {"rate_hz": 25.0},
    f.EncoderOptions: {},
    f.Decoder: {},
    f.Decoder.feed: {"self": f.Decoder()},
    f.ServerConfig: {},
    f.Server: {"config": f.ServerConfig()},
    f.Client: {},
    f.Face: {"silent": True},
    f.load: {"path": "a.fap"},
    f.load_head: {},
    f.load_profile: {},
    f.frames: {"track": TRACK},
    f.save: {"track": TRACK, "path": "/nonexistent/a.fap"},
    f.weights: {"track": TRACK},
    f.visemes: {"source": PHONES},
    f.animate: {"timings": PHONES},
    f.speak: {"text": "Hi.", "voice": Still()},
}
"""Right arguments of every public class, function and method that takes any."""
UNSAID = {
    "score",
    "Expression",
    "Voice",
    "DataError",
    "FapEngineError",
    "ResourceError",
    "UsageError",
    "Profile",
    "Head",
}
"""Names whose constructors nobody calls: a number's, an interface, exceptions, what files are loaded into. Scores have
tests of their own."""


def every() -> list[tuple[Callable[..., object], str, object]]:
    """Every parameter with an object that fits nothing, with bytes, and where it is no number, with NaN."""
    found: list[tuple[Callable[..., object], str, object]] = []
    for call, given in GIVEN.items():
        parameters = [name for name in inspect.signature(call).parameters if name not in ("self", "faps")]
        found += [(call, name, value) for name in parameters for value in (object(), b"x", {1: 2}) if given is not None]
    return [each for each in found if (each[0], each[1], type(each[2])) != (f.Decoder.feed, "data", bytes)]


def test_every_public_name_is_here() -> None:
    assert {name.__qualname__.partition(".")[0] for name in GIVEN} | UNSAID >= set(f.__all__)


@pytest.mark.parametrize(
    ("call", "name", "value"), every(), ids=[f"{c.__qualname__}({n}={type(v).__name__})" for c, n, v in every()]
)
def test_what_fits_nothing_is_refused(call: Callable[..., object], name: str, value: object) -> None:
    with pytest.raises((f.UsageError, f.DataError)):
        call(**{**GIVEN[call], name: value})


def test_the_table_is_long() -> None:
    assert len(CASES) >= 110


@pytest.mark.parametrize(
    ("call", "name", "value"), CASES, ids=[f"{call.__name__}({name}={value!r:.20})" for call, name, value in CASES]
)
def test_a_wrong_argument_is_named(call: Callable[..., object], name: str, value: object) -> None:
    with pytest.raises((f.UsageError, f.DataError)) as raised:
        call(**{name: value})
    words = name, name.removesuffix("s"), name.partition("_")[0], repr(value).lower()[:60]
    assert any(word in str(raised.value).lower() for word in words)
