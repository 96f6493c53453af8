"""For all bytes: a track or a DataError, in every timing format."""

import re

from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError
from fapengine.speech.formats.registry import FORMATS, parse_timings
from fapengine.speech.phone_track import PhoneTrack

from ..unit.speech.samples import SAMPLES
from ..unit.speech.timing_corpus import CORPUS, Case

ODD = ("", "-", "1e999", "-1", "NaN", "1e300", "99999999999", '"', "\n", "\0", "é", "{", "[[", "null", "0", "\t", "x y")
"""Cut out; or put in: signs, numbers nobody meant, other types."""


def is_total(data: bytes, file_format: str | None) -> None:
    try:
        track = parse_timings(data, file_format=file_format)
    except DataError:
        return
    assert isinstance(track, PhoneTrack)
    assert track.duration_s <= 86_400.1


@given(st.sampled_from(sorted(SAMPLES)), st.data())
def test_damaged_files(name: str, data: st.DataObject) -> None:
    text = SAMPLES[name]
    for _ in range(data.draw(st.integers(1, 3))):
        at, width = data.draw(st.integers(0, max(len(text) - 1, 0))), data.draw(st.integers(0, 6))
        text = text[:at] + data.draw(st.sampled_from(ODD)) + text[at + width :]
    raw = text.encode(data.draw(st.sampled_from(["utf-8", "utf-16", "utf-16-le", "latin-1"])), "replace")
    is_total(raw, name.split()[0])
    is_total(raw[: data.draw(st.integers(0, len(raw)))], None)


@given(st.sampled_from(CORPUS), st.data())
def test_damaged_files_of_public_tools(case: Case, data: st.DataObject) -> None:
    text = str(case.data)
    at, width = data.draw(st.integers(0, len(text) - 1)), data.draw(st.integers(0, 6))
    is_total((text[:at] + data.draw(st.sampled_from((*ODD, ",", "0,5"))) + text[at + width :]).encode(), None)


@given(st.sampled_from(sorted(FORMATS)), st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_noise(name: str, data: bytes) -> None:
    is_total(data, name)
    is_total(data, None)


def test_every_cut_of_every_format() -> None:
    assert len(SAMPLES) >= len(FORMATS) >= 21
    for name, text in SAMPLES.items():
        raw = text.encode()
        for cut in range(0, len(raw), max(1, len(raw) // 25)):
            is_total(raw[:cut], name.split()[0])
            is_total(raw[:cut] + b"\xff" + raw[cut + 1 :], name.split()[0])


def test_every_number_becomes_absurd() -> None:
    for name, text in SAMPLES.items():
        for number in re.finditer(r"-?\d+(\.\d+)?", text):
            for odd in ("-5", "NaN", "1e400", "1e15", "Infinity"):
                is_total((text[: number.start()] + odd + text[number.end() :]).encode(), name.split()[0])
