"""Plausibility of timings: remarks on what looks wrong, what was assumed, and how to override it.

Each function returns sentences; nothing is corrected here. :func:`remarks_on` collects all remarks on a track, and
:func:`refuse` makes an error of them. The limits are wide: the mean phone of read English lasts 80 ms (TIMIT).
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import log
from statistics import median

import numpy as np

from fapengine._arrays import Sound
from fapengine.errors import DataError
from fapengine.speech.phone_track import Phone, PhoneTrack, Reading, find_unknown
from fapengine.speech.text.words import readers, reads, scripts_in

PHONE_S = (0.02, 0.4)
"""Shortest and longest median of phones that is plausible; a song has long ones."""
USUAL_S = 0.1
"""Usual distance of the onsets of phones and visemes."""
MIN_PHONES = 5
"""Phones from which on their median says something."""
SILENT, FULL_SCALE, CLIPPED_SHARE = 33, 2**15 - 1, 0.001
"""Samples below which a sound is silent (-60 dB), and from which they are clipped; share of these that counts."""
EARLY_S, LATE_S, LATE_TIMES = 0.25, 5.0, 3.0
"""Time by which a sound may end before its phones; time and factor by which it may last longer."""


def likely_unit(onsets: Sequence[float], units_s: Mapping[str, float]) -> str:
    """Find the unit in which the median distance of onsets is nearest to that of speech; the first unit if none tells.

    Parameters
    ----------
    onsets : sequence of float
    units_s : mapping of str to float
        Names of the possible units, and their lengths in s.

    Examples
    --------
    >>> units = {"ticks": 1e-7, "ms": 1e-3, "s": 1.0}
    >>> [likely_unit([n * gap for n in range(9)], units) for gap in (9e5, 85.5, 0.08)], likely_unit([50.0], units)
    (['ticks', 'ms', 's'], 'ticks')
    """
    gaps = [after - before for before, after in pairwise(onsets) if after > before]
    usual = median(gaps) if gaps else USUAL_S / next(iter(units_s.values()))
    return min(units_s, key=lambda unit: abs(log(usual * units_s[unit] / USUAL_S)))


def dropped_remarks(rows: Sequence[tuple[str, float, str]]) -> tuple[str, ...]:
    """Remark on rows that were dropped because they have no length: (label, start in s, place)."""
    if not rows:
        return ()
    label, start_s, where = rows[0]
    count = "1 row was" if len(rows) == 1 else f"{len(rows)} rows were"
    return (
        f"timings: {count} dropped, because end and start are the same: {label[:40]!r} at {start_s:.3f} s ({where})",
    )


def script_remarks(words: Sequence[Phone], code: str, *, is_chosen: bool) -> tuple[str, ...]:
    """Remark on words in scripts that a voice does not read; it would name their letters.

    Parameters
    ----------
    words : sequence of Phone
        Written words.
    code : str
        Language code of the voice.
    is_chosen : bool
        True if the user chose the voice.

    Raises
    ------
    DataError
        If the voice was not chosen by the user, and it does not read half of the words.
    """
    by_script: dict[str, list[Phone]] = {}
    for word in words:
        for script in scripts_in(word.label):
            if not reads(code, script):
                by_script.setdefault(script, []).append(word)
    remarks = []
    for script, unread in by_script.items():
        choice = f"voice=CODE names one that does: {', '.join(readers(script))}" if readers(script) else "no voice does"
        more = f" and {len(unread) - 1} more" if len(unread) > 1 else ""
        first = f"{unread[0].label[:40]!r} at {unread[0].start_s:.3f} s"
        remark = f"words: voice {code!r} does not read {script}: {first}{more}; {choice}"
        if not is_chosen and 2 * len(unread) >= len(words):
            raise DataError(remark)
        remarks.append(remark)
    return tuple(remarks)


def remarks_on(track: PhoneTrack) -> tuple[str, ...]:
    """Collect the remarks of the reading, and those on the alphabet, unknown labels and lengths of phones."""
    remarks = list(track.reading.remarks)
    if track.reading.others:
        remarks.append(f"alphabet: {track.reading}")
    if track.phones and all(phone.is_silence for phone in track.phones):
        remarks.append("phones: there is nothing but silence, so the mouth stays shut; is there speech in it?")
    elif not track.spelled:
        remarks += [f"unknown phone {unknown}" for unknown in find_unknown(track)]
        lengths_s = [phone.duration_s for phone in track.phones if not phone.is_silence]
        remarks += _length_remarks(lengths_s, is_file=track.reading != Reading())
    return tuple(remarks)


def _length_remarks(lengths_s: Sequence[float], *, is_file: bool) -> list[str]:
    usual_s = median(lengths_s) if len(lengths_s) >= MIN_PHONES else USUAL_S
    low_s, high_s = PHONE_S
    if low_s <= usual_s <= high_s:
        return []
    other_s, unit = (1000 * usual_s, "s") if usual_s < low_s else (usual_s / 1000, "ms")
    would = f" would make it {1000 * other_s:.3g} ms" if low_s <= other_s <= high_s else ", if the file is a list"
    said = (
        f"timings: the median of {len(lengths_s)} phones is {1000 * usual_s:.3g} ms, expected {1000 * low_s:g} to"
        f" {1000 * high_s:g} ms; is the unit right?"
    )
    return [f"{said} columns='unit={unit}'{would}" if is_file else said]


def spoken_end_s(phones: PhoneTrack) -> float:
    """End of the last phone that is not silence, in s; 0 if there is none."""
    return max((phone.end_s for phone in phones.phones if not phone.is_silence), default=0.0)


def sound_remarks(sound: Sound | None, phones: PhoneTrack) -> tuple[str, ...]:
    """Remark on a sound that is silent where phones are spoken, clipped, or of another length than its phones."""
    spoken_s = spoken_end_s(phones)
    if sound is None or not len(sound[0]) or not spoken_s:
        return ()
    remarks = []
    loudness, length_s = np.abs(sound[0].astype(np.int32)), len(sound[0]) / sound[1]
    if length_s < spoken_s - EARLY_S:
        remarks.append(
            f"sound: it ends at {length_s:.2f} s, but the timings end at {spoken_s:.2f} s; are they of this recording?"
            " silence was appended"
        )
    elif length_s > max(spoken_s + LATE_S, LATE_TIMES * spoken_s):
        remarks.append(
            f"sound: it lasts {length_s:.2f} s, but the timings end at {spoken_s:.2f} s; are they of this recording,"
            " and is their unit right?"
        )
    if loudness.max() < SILENT:
        return (*remarks, "sound: it is silent, though phones are spoken in it; is it the right file or channel?")
    clipped = float(np.mean(loudness >= FULL_SCALE))
    if clipped >= CLIPPED_SHARE:
        remarks.append(
            f"sound: {100 * clipped:.2g} % of its samples are at full scale (clipped); record or export it more softly"
        )
    return tuple(remarks)


def refuse(remarks: Sequence[str], where: str) -> None:
    """Raise a DataError of all remarks, if there are any; ``where`` is the file or the voice."""
    if remarks:
        raise DataError("; ".join(remarks), where=where)
