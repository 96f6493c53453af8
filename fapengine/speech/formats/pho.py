"""MBROLA ``.pho``: one phone a line, ``name milliseconds [percent hertz]...``; ``;`` begins a comment.

Names are SAMPA of the language (MBROLA documentation), ``_`` is silence.
"""

from fapengine.errors import DataError
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.formats.textgrid import decode_text
from fapengine.speech.phone_track import PhoneTrack

MAX_PHONE_MS = 600_000.0
"""Ten minutes: longer is a mistake, not a phone."""


def parse_pho(data: bytes, *, alphabet: str = "x-sampa") -> PhoneTrack:
    """Read a ``.pho`` file.

    Raises
    ------
    DataError
        For a line that is no phone, with its number.
    """
    entries: list[Entry] = []
    now_s = 0.0
    for number, line in enumerate(decode_text(data, ".pho").splitlines(), start=1):
        fields = line.split(";", 1)[0].split()
        if not fields:
            continue
        where = f"line {number}"
        if len(fields) < 2:
            raise DataError(f".pho: got {line.strip()[:40]!r}, expected a phone and its milliseconds", where=where)
        try:
            numbers = [float(field) for field in fields[1:]]
        except ValueError as error:
            raise DataError(
                f".pho: got {line.strip()[:40]!r}, expected numbers behind the phone", where=where
            ) from error
        if not 0 <= numbers[0] <= MAX_PHONE_MS:
            raise DataError(f"duration: got {fields[1]} ms, expected 0..{MAX_PHONE_MS:g}", where=where)
        end_s = now_s + numbers[0] / 1000
        entries.append(Entry(now_s, end_s, fields[0], where))
        now_s = end_s
    if not entries:
        raise DataError(".pho: got no phone at all, expected lines such as 'b 65'")
    return track_of(entries, ".pho", alphabet=alphabet)
