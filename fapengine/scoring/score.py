"""``Score``: all measures of one recording, against what there is to compare it with."""

from dataclasses import asdict, dataclass
from typing import Any

from fapengine.errors import UsageError
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.behaviour import Behaviour, Intensity, behaviour_of, intensity_of
from fapengine.scoring.contacts import CLOSED_MM, Contacts, closures_of_phones, closures_of_truth, teeth_of_phones
from fapengine.scoring.likeness import Array, Likeness, likeness_of
from fapengine.scoring.mouth import Mouth, mouth_of
from fapengine.scoring.timing import Timing, timing_of_phones, timing_of_truth
from fapengine.speech.phone_track import PhoneTrack

DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class AgainstPhones:
    """What phones tell."""

    closures: Contacts
    teeth: Contacts
    timing: Timing


@dataclass(frozen=True, slots=True, kw_only=True)
class AgainstTruth:
    """What another recording tells."""

    closures: Contacts
    timing: Timing
    likeness: Likeness
    behaviour: Behaviour
    """Head and eyes of the truth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Every figure of a recording."""

    duration_s: float
    frames: int
    closed_mm: float
    """Opening under which lips counted as closed."""
    behaviour: Behaviour
    phones: AgainstPhones | None = None
    truth: AgainstTruth | None = None
    intensity: Intensity | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, rounded, for JSON."""
        found: dict[str, Any] = _rounded(asdict(self))
        return found


def score_motion(
    track: FapTrack,
    *,
    truth: FapTrack | None = None,
    phones: PhoneTrack | None = None,
    power: Array | None = None,
    offset_s: float = 0.0,
    closed_mm: float = CLOSED_MM,
) -> Score:
    """Score a recording.

    Parameters
    ----------
    track : FapTrack
        The lip sync that is judged.
    truth : FapTrack, optional
        Another recording of the same speech.
    phones : PhoneTrack, optional
        What is said, in IPA.
    power : (N,) float64, optional
        Mean square of the sound in each 10 ms.
    offset_s : float
        Time of the others at which the track begins.
    closed_mm : float
        Opening under which lips count as closed.

    Raises
    ------
    UsageError
        If a recording has fewer than two frames, or phones are words that nobody has pronounced.
    """
    return score_mouth(
        mouth_of(track, offset_s=offset_s),
        truth=mouth_of(truth) if truth is not None else None,
        phones=phones,
        power=power,
        closed_mm=closed_mm,
    )


def score_mouth(
    mouth: Mouth,
    *,
    truth: Mouth | None = None,
    phones: PhoneTrack | None = None,
    power: Array | None = None,
    closed_mm: float = CLOSED_MM,
) -> Score:
    """Score a mouth, of a track or of a film; as :func:`score_motion`, ``power`` (N,) included.

    Raises
    ------
    UsageError
        If phones are words that nobody has pronounced, or ``closed_mm`` is not positive.
    """
    if not closed_mm > 0:
        raise UsageError(f"closed_mm: got {closed_mm}, expected more than 0")
    if phones is not None and phones.spelled:
        raise UsageError("phones: got spelled words, expected phones; pronounce them first")
    return Score(
        duration_s=mouth.end_s - float(mouth.times_s[0]),
        frames=len(mouth.times_s),
        closed_mm=closed_mm,
        behaviour=behaviour_of(mouth),
        phones=_by_phones(mouth, phones, closed_mm) if phones is not None else None,
        truth=_by_truth(mouth, truth, closed_mm) if truth is not None else None,
        intensity=intensity_of(mouth, power) if power is not None else None,
    )


def _by_phones(mouth: Mouth, phones: PhoneTrack, closed_mm: float) -> AgainstPhones:
    return AgainstPhones(
        closures=closures_of_phones(mouth, phones, closed_mm=closed_mm),
        teeth=teeth_of_phones(mouth, phones),
        timing=timing_of_phones(mouth, phones),
    )


def _by_truth(mouth: Mouth, truth: Mouth, closed_mm: float) -> AgainstTruth:
    return AgainstTruth(
        closures=closures_of_truth(mouth, truth, closed_mm=closed_mm),
        timing=timing_of_truth(mouth, truth),
        likeness=likeness_of(mouth, truth),
        behaviour=behaviour_of(truth),
    )


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return round(value, DIGITS) if isinstance(value, float) else value
