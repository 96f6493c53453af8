"""A :class:`PhoneTrack` as the files that other tools read: TextGrid, CTM, JSON, ``.pho``. All but CTM come back."""

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.alphabets.convert import XSAMPA_LETTERS
from fapengine.speech.phone_track import Phone, PhoneTrack

_XSAMPA = {label: spelling for spelling, label in reversed(XSAMPA_LETTERS.items()) if len(label) == 1}
_ASCII_AS_THEY_ARE = frozenset("abcdefhijklmnoprstuvwxyz")


def format_textgrid(track: PhoneTrack) -> bytes:
    """Praat TextGrid, long form, UTF-8: the tiers ``words`` and ``phones`` ("TextGrid file formats", Praat manual).

    Examples
    --------
    >>> text = format_textgrid(PhoneTrack((Phone("m", 0.0, 0.1, word="ma"), Phone("a", 0.1, 0.3, 1, "ma")))).decode()
    >>> 'text = "ˈa"' in text
    True
    """
    phones = [(p.start_s, p.end_s, "" if p.is_silence else ipa.STRESS_MARKS[p.stress] + p.label) for p in track.phones]
    tiers = (("words", _words(track.phones)), ("phones", phones))
    lines = ['File type = "ooTextFile"', 'Object class = "TextGrid"', ""]
    lines += ["xmin = 0", f"xmax = {_seconds(track.duration_s)}", "tiers? <exists>", "size = 2", "item []:"]
    for number, (name, rows) in enumerate(tiers, start=1):
        lines += [
            f"    item [{number}]:", '        class = "IntervalTier"', f'        name = "{name}"', "        xmin = 0",
            f"        xmax = {_seconds(track.duration_s)}", f"        intervals: size = {len(rows)}",
        ]  # fmt: skip
        for index, (start_s, end_s, label) in enumerate(rows, start=1):
            escaped = label.replace('"', '""')
            lines += [
                f"        intervals [{index}]:", f"            xmin = {_seconds(start_s)}",
                f"            xmax = {_seconds(end_s)}", f'            text = "{escaped}"',
            ]  # fmt: skip
    return ("\n".join(lines) + "\n").encode()


def format_ctm(track: PhoneTrack) -> bytes:
    """Kaldi's CTM of phones: file, channel, start, duration, label, confidence; silence is left out (NIST, sctk)."""
    rows = [
        f"sound 1 {phone.start_s:.3f} {phone.duration_s:.3f} {phone.label} {phone.confidence:.2f}"
        for phone in track.phones
        if not phone.is_silence
    ]
    return ("\n".join(rows) + "\n").encode()


def format_phone_json(track: PhoneTrack, extra: Sequence[Mapping[str, object]] = ()) -> bytes:
    """List of phones in JSON, as :mod:`.synthesizers` reads it; ``extra`` adds keys to each phone."""
    rows = [
        {
            "phone": ipa.STRESS_MARKS[phone.stress] + phone.label,
            "start": round(phone.start_s, 4), "end": round(phone.end_s, 4),
            "word": phone.word, "confidence": phone.confidence,
        } | dict(more)
        for phone, more in zip(track.phones, extra or [{}] * len(track.phones), strict=True)
    ]  # fmt: skip
    return (json.dumps({"phones": rows}, ensure_ascii=False, indent=1) + "\n").encode()


def format_pho(track: PhoneTrack) -> bytes:
    r"""MBROLA's ``.pho``: X-SAMPA and milliseconds.

    Examples
    --------
    >>> format_pho(PhoneTrack((Phone("ʃ", 0.0, 0.1), Phone("ɑː", 0.1, 0.25), Phone("_", 0.25, 0.5))))
    b'S 100\nA: 150\n_ 250\n'
    """
    rows, written_ms = [], 0
    for phone in track.phones:
        end_ms = round(phone.end_s * 1000)
        rows.append(f"{'_' if phone.is_silence else to_xsampa(phone.label)} {end_ms - written_ms}")
        written_ms = end_ms
    return ("\n".join(rows) + "\n").encode()


def to_xsampa(label: str) -> str:
    r"""X-SAMPA of an IPA label; marks that it does not spell fall away.

    Examples
    --------
    >>> to_xsampa("tʃ"), to_xsampa("aɪ"), to_xsampa("ɹ")
    ('tS', 'aI', 'r\\')
    """
    spelled = "".join(
        letter if letter in _ASCII_AS_THEY_ARE else _XSAMPA.get(letter, letter) for letter in ipa.letters(label)
    ).replace("ɡ", "g")
    return spelled + (":" if "ː" in label else "") or label


def _words(phones: Sequence[Phone]) -> list[tuple[float, float, str]]:
    rows: list[tuple[float, float, str]] = []
    for word, group in groupby(phones, key=lambda phone: phone.word):
        together = list(group)
        rows.append((together[0].start_s, together[-1].end_s, word))
    return rows


def _seconds(time_s: float) -> str:
    return f"{time_s:.6f}".rstrip("0").rstrip(".")


WRITERS: Mapping[str, Callable[[PhoneTrack], bytes]] = {
    ".textgrid": format_textgrid, ".ctm": format_ctm, ".json": format_phone_json, ".pho": format_pho,
}  # fmt: skip
"""Ending of a name, in small letters, to what writes such a file."""


def check_writable(ending: str) -> None:
    """Refuse a name's ending that no writer has."""
    if ending.lower() not in WRITERS:
        raise UsageError(f"path: got a name that ends with {ending!r}, expected one of .TextGrid, .ctm, .json, .pho")
