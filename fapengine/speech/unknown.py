"""What a track says that no phone set explains: said once a label, with its place."""

from fapengine.speech import ipa
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.reading import STAND_IN, UnknownPhone

__all__ = ["STAND_IN", "UnknownPhone", "find_unknown"]


def find_unknown(track: PhoneTrack) -> tuple[UnknownPhone, ...]:
    """Find the labels that are no IPA, and those that only seem to be, in the order in which they first come.

    Examples
    --------
    >>> from fapengine.speech.phone_track import Phone
    >>> find_unknown(PhoneTrack((Phone("m", 0, 1), Phone("QQ", 1, 2), Phone("QQ", 2, 3))))[0].count
    2
    """
    unknown: dict[str, UnknownPhone] = {}
    for phone in track.phones:
        if phone.is_silence or ipa.letters(phone.label):
            continue
        before = unknown.get(phone.label)
        first_s = before.first_s if before else phone.start_s
        unknown[phone.label] = UnknownPhone(phone.label, before.count + 1 if before else 1, first_s)
    doubtful = track.reading.doubtful if track.reading else ()
    return tuple(sorted((*unknown.values(), *doubtful), key=lambda each: each.first_s))
