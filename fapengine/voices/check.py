"""A check of voices, also of your own: phones must be where they are heard in the audio.

>>> import numpy as np
>>> from fapengine.speech.phone_track import Phone
>>> noise = np.random.default_rng(1).normal(size=8000)
>>> [str(breach) for breach in find_breaches(noise, 16000, [Phone("m", 0.0, 0.1), Phone("_", 0.1, 0.5)])]
["loud pause, '_' at 0.100 s: got a level of 1.00 of the whole sound's, expected less than 0.1"]
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import pairwise
from typing import Literal

from numpy.typing import ArrayLike

from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.voices.sounding import MIN_PHONE_S, PAUSE, SoundLevel, ends_as, is_stop, is_vowel

Law = Literal["order", "cover", "unknown", "dropped", "short", "loud pause", "open closure", "late vowel"]
"""Laws of a voice's phones, in the order in which they are checked.

order
    A phone begins where the one before ends.
cover
    The phones begin and end with the audio, within :data:`EDGE_S`.
unknown
    Every label is IPA.
dropped
    Every phone that was spoken is there.
short
    No phone is shorter than 5 ms.
loud pause
    A pause is quiet.
open closure
    The silence before the burst of a stop belongs to the stop.
late vowel
    A vowel after a nasal begins where the sound gets bright.
"""
EDGE_S = 0.001
"""Rounding that a voice may do at the ends of its sound."""
CLOSURE_S = 0.015
"""Least length of a silence before a burst that is missed when it is not the stop's."""
LATE_S = 0.025
"""Longest delay of a vowel after the sound gets bright; less than a frame at 30 frames a second."""


@dataclass(frozen=True, slots=True)
class Breach:
    """A place where the phones do not fit the audio."""

    law: Law
    at_s: float
    label: str
    """Label of the phone, or of the missing one."""
    details: str
    """Actual and expected value."""

    def __str__(self) -> str:
        return f"{self.law}, {self.label!r} at {self.at_s:.3f} s: {self.details}"


def find_breaches(
    samples: ArrayLike, rate_hz: int, phones: Sequence[Phone], *, spoken: Sequence[str] | None = None
) -> tuple[Breach, ...]:
    """Find the places where the phones of an utterance do not fit its audio.

    Parameters
    ----------
    samples : (N,) number
        The audio, mono, any scale.
    rate_hz : int
        Samples per second.
    phones : sequence of Phone
        As the voice gave them, silence included: those of a :class:`~fapengine.speech.phone_track.PhoneTrack`, or a
        list that could not become one.
    spoken : sequence of str, optional
        Labels that the voice spoke, without pauses; needed to find dropped phones.

    Returns
    -------
    tuple of Breach
        In the order of :data:`Law`, then of time; empty for a voice without faults.
    """
    sound = SoundLevel(samples, rate_hz)
    return (
        *_misplaced(phones, sound.duration_s),
        *_unknown(phones),
        *_dropped(phones, spoken),
        *_short(phones),
        *_loud_pauses(phones, sound),
        *_open_closures(phones, sound),
        *_late_vowels(phones, sound),
    )


def _misplaced(phones: Sequence[Phone], duration_s: float) -> Iterator[Breach]:
    for before, phone in pairwise(phones):
        if phone.start_s != before.end_s:
            details = f"got a start {phone.start_s - before.end_s:+.4f} s after the end of the one before, expected 0"
            yield Breach("order", phone.start_s, phone.label, details)
    ends = ((phones[0].start_s, 0.0, phones[0]), (phones[-1].end_s, duration_s, phones[-1])) if phones else ()
    if not phones and duration_s:
        yield Breach("cover", 0.0, "", f"no phones, for a sound of {duration_s:.4f} s")
    for got_s, expected_s, phone in ends:
        if abs(got_s - expected_s) > EDGE_S:
            yield Breach("cover", got_s, phone.label, f"got {got_s:.4f} s, expected the sound's {expected_s:.4f} s")


def _unknown(phones: Sequence[Phone]) -> Iterator[Breach]:
    for phone in phones:
        if not phone.is_silence and not ipa.letters(phone.label):
            yield Breach("unknown", phone.start_s, phone.label, "got a label that is no IPA")


def _dropped(phones: Sequence[Phone], spoken: Sequence[str] | None) -> Iterator[Breach]:
    sounding = [phone for phone in phones if not phone.is_silence]
    labels = [phone.label for phone in sounding]
    for kind, first, last, at, _ in SequenceMatcher(None, spoken or [], labels, autojunk=False).get_opcodes():
        if kind in ("delete", "replace") and spoken:
            at_s = sounding[at].start_s if at < len(sounding) else phones[-1].end_s if phones else 0.0
            for label in spoken[first:last]:
                yield Breach("dropped", at_s, label, "the phone is missing here")


def _short(phones: Sequence[Phone]) -> Iterator[Breach]:
    for phone in phones:
        if not phone.is_silence and phone.duration_s < MIN_PHONE_S:
            details = f"must be at least {1e3 * MIN_PHONE_S:g} ms, got {1e3 * phone.duration_s:.1f}"
            yield Breach("short", phone.start_s, phone.label, details)


def _loud_pauses(phones: Sequence[Phone], sound: SoundLevel) -> Iterator[Breach]:
    for phone in phones:
        level = float(sound.level(phone.start_s, phone.end_s))
        if phone.is_silence and level >= PAUSE:
            details = f"got a level of {level:.2f} of the whole sound's, expected less than {PAUSE:g}"
            yield Breach("loud pause", phone.start_s, SILENCE, details)


def _open_closures(phones: Sequence[Phone], sound: SoundLevel) -> Iterator[Breach]:
    for before, phone in pairwise(phones):
        if not is_stop(phone.label) or is_stop(before.label):
            continue
        silent_s = phone.start_s - sound.quiet_until(phone.start_s, before.start_s)
        if silent_s >= CLOSURE_S and not sound.stays_quiet(phone.start_s, phone.start_s + CLOSURE_S):
            details = f"got {1e3 * silent_s:.0f} ms of silence that belong to {before.label!r} before its burst"
            yield Breach("open closure", phone.start_s, phone.label, details)


def _late_vowels(phones: Sequence[Phone], sound: SoundLevel) -> Iterator[Breach]:
    for before, phone in pairwise(phones):
        if not is_vowel(phone.label) or ends_as(before.label) != "nasal":
            continue
        middle_s = before.start_s + 0.5 * before.duration_s
        bright_s = sound.brightens(middle_s, phone.start_s + 0.6 * phone.duration_s)
        if bright_s is not None and phone.start_s - bright_s > LATE_S and bright_s > middle_s + EDGE_S:
            details = f"got a start {1e3 * (phone.start_s - bright_s):.0f} ms after the sound gets bright"
            yield Breach("late vowel", phone.start_s, phone.label, details)
