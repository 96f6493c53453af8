"""The interface of voices: text in, audio and timed phones out."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import as_sound
from fapengine._strict_toml import check_fields, checked
from fapengine.errors import UsageError
from fapengine.speech.marks import MarkedText, TimedMark, timed_marks, with_loudness, words_of
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

MAX_PAD_S = 3600.0
"""Longest silence that is put before or after speech."""
SHORT_S = 0.25
"""Time by which a sound may end before its phones: an inaudible last phone, rounding of a codec."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Speech:
    """One spoken utterance."""

    samples: NDArray[np.int16]
    """(N,) int16, mono, read-only. Other forms of sound are converted: :func:`fapengine._arrays.as_sound`."""
    sample_rate_hz: int
    phones: PhoneTrack
    """IPA; covers the whole audio, silence included."""
    remarks: tuple[str, ...] = ()
    """Warnings about text that was not spoken as written, such as a script that the voice does not read."""
    text: str = ""
    """The text without its marks, if the voice knows it."""
    marks: tuple[TimedMark, ...] = ()
    """Inline cues of the text (:mod:`fapengine.speech.marks`), in the time of the audio."""

    def __post_init__(self) -> None:
        samples, rate_hz = as_sound((self.samples, self.sample_rate_hz), "samples")
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "sample_rate_hz", rate_hz)
        check_fields(self)
        if self.phones.duration_s > self.duration_s + SHORT_S:
            raise UsageError(
                f"phones: end at {self.phones.duration_s:.2f} s, but the sound lasts {self.duration_s:.2f} s; are they"
                " in seconds, and of this sound?"
            )

    @property
    def duration_s(self) -> float:
        """Length of the audio in seconds."""
        return len(self.samples) / self.sample_rate_hz

    @checked
    def padded(self, *, lead_s: float, tail_s: float) -> "Speech":
        """Add silence before and after, so that a face starts and ends at neutral.

        Raises
        ------
        UsageError
            If a length is not 0 to :data:`MAX_PAD_S` seconds.
        """
        for name, length_s in (("lead_s", lead_s), ("tail_s", tail_s)):
            if not 0 <= length_s <= MAX_PAD_S:
                raise UsageError(f"{name}: got {length_s}, expected 0 to {MAX_PAD_S:g} s")
        lead, tail = (round(length_s * self.sample_rate_hz) for length_s in (lead_s, tail_s))
        samples = np.concatenate([np.zeros(lead, np.int16), self.samples, np.zeros(tail, np.int16)])
        shift_s = lead / self.sample_rate_hz
        moved = [replace(p, start_s=p.start_s + shift_s, end_s=p.end_s + shift_s) for p in self.phones.phones]
        end_s = len(samples) / self.sample_rate_hz
        if tail:
            moved.append(Phone(SILENCE, moved[-1].end_s if moved else shift_s, end_s))
        marks = tuple(replace(m, at_s=m.at_s + shift_s, until_s=m.until_s + shift_s) for m in self.marks)
        return replace(self, samples=samples, phones=PhoneTrack.from_phones(moved), marks=marks)

    def marked(self, text: MarkedText) -> "Speech":
        """Add the inline cues of the text; their loudness is added to the phones."""
        marks = tuple(timed_marks(text, words_of(self.phones.phones), self.duration_s))
        phones = replace(self.phones, phones=with_loudness(self.phones.phones, marks))
        unknown = [f"text: the mark {label!r} says nothing that a face could show" for label in text.unknown]
        unsaid = [
            f"text: the voice takes no sounds; {text.text[start:stop]!r} was spoken as it is written"
            for start, stop, _ in text.sounds
        ]
        remarks = dict.fromkeys((*self.remarks, *unknown, *unsaid, *text.remarks))  # pieces have some already
        return replace(self, phones=phones, text=text.text, marks=marks, remarks=tuple(remarks))


@runtime_checkable
class Voice(Protocol):
    """Anything that speaks a text and gives the times of its phones."""

    def speak(self, text: str) -> Speech:
        """Speak ``text``."""
