"""What labels mean beside their neighbours: closures and bursts, Japanese moraic nasals and long marks.

TIMIT times the closure of a stop and its burst apart; lips show one stop, shut from the closure on. In Japanese the
moraic nasal takes the place of the stop behind it (Okada, Handbook of the IPA, 1999), and so does っ: before p b m the
lips are shut.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

from fapengine.speech.phone_track import Entry, Phone

JAPANESE = ("kana", "voicevox", "openjtalk", "misaki")
"""Names of the sets that write a moraic nasal as ɴ and っ as ʔ."""
_BURSTS = {"bcl": ("b",), "dcl": ("d", "jh"), "gcl": ("g",), "pcl": ("p",), "tcl": ("t", "ch"), "kcl": ("k",)}


def join_closures(entries: Sequence[Entry]) -> list[Entry]:
    """Make one stop of TIMIT's closure and its burst; a closure without one stays, and is the stop itself.

    Examples
    --------
    >>> closed = [Entry(0, 1, "pcl", ""), Entry(1, 2, "p", ""), Entry(2, 3, "kcl", "")]
    >>> [(entry.label, entry.start_s, entry.end_s) for entry in join_closures(closed)]
    [('p', 0, 2), ('kcl', 2, 3)]
    """
    joined: list[Entry] = []
    for entry in entries:
        before = joined[-1] if joined else entry
        bursts = _BURSTS.get(before.label.strip().lower(), ())
        if entry.label.strip().lower() in bursts and before.end_s == entry.start_s:
            joined[-1] = replace(entry, start_s=before.start_s)
        else:
            joined.append(entry)
    return joined


def assimilated(label: str, following: str = "") -> str:
    """Close the lips on a moraic nasal and on っ before p b m, inside a label and at its end.

    Examples
    --------
    >>> assimilated("ɕiɴbɯɴ"), assimilated("ɴ", "mi"), assimilated("kiʔpɯ"), assimilated("ʔ", "ta")
    ('ɕimbɯɴ', 'm', 'kippɯ', 'ʔ')
    """
    whole = re.sub("ʔ(?=p)", "p", re.sub("ɴ(?=[pbm])", "m", f"{label}\0{following}".replace("\0", "", 1)))
    return whole[: len(label)]


def in_japanese(phones: Sequence[Phone]) -> list[Phone]:
    """Let neighbours change each other: moraic nasals, っ, and a long mark by itself, which lengthens what it follows.

    Examples
    --------
    >>> said = [Phone("ka", 0, 1), Phone("ː", 1, 2), Phone("ɴ", 2, 3), Phone("pa", 3, 4)]
    >>> [(phone.label, phone.end_s) for phone in in_japanese(said)]
    [('kaː', 2), ('m', 3), ('pa', 4)]
    """
    changed: list[Phone] = []
    for index, phone in enumerate(phones):
        before = changed[-1] if changed else None
        if phone.label == "ː" and before and not before.is_silence:
            changed[-1] = replace(before, label=before.label + "ː", end_s=phone.end_s)
        else:
            following = next((later.label for later in phones[index + 1 : index + 2]), "")
            changed.append(replace(phone, label=assimilated(phone.label, following)))
    return changed
