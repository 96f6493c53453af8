"""The phones around a time, as a line of text."""

from fapengine.speech.phone_track import PhoneTrack

BEFORE, AFTER = 6, 10
"""Numbers of phones shown on either side."""


def ticker(phones: PhoneTrack, position_s: float) -> tuple[str, str, str]:
    """Return the labels of the phones before a position, at it, and after it.

    Examples
    --------
    >>> from fapengine.speech.phone_track import Phone
    >>> track = PhoneTrack.from_phones([Phone("h", 0.0, 0.1), Phone("a", 0.1, 0.2), Phone("j", 0.3, 0.4)])
    >>> ticker(track, 0.15), ticker(track, 9.0)
    (('h', 'a', '· j'), ('h a · j', '', ''))
    """
    labels = ["·" if phone.is_silence else phone.label for phone in phones.phones]
    at = sum(phone.end_s <= position_s for phone in phones.phones)
    now = labels[at] if at < len(labels) and position_s >= 0 else ""
    return " ".join(labels[max(at - BEFORE, 0) : at]), now, " ".join(labels[at + 1 : at + 1 + AFTER])
