"""Phone timings from a path; the format is found from the content."""

from pathlib import Path

from fapengine.errors import DataError
from fapengine.files.paths import read_bytes
from fapengine.speech.pho import parse_pho
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.textgrid import parse_textgrid

FORMATS = ("textgrid", "pho")


def load_timings(path: Path, *, file_format: str | None = None, tier: str | None = None) -> PhoneTrack:
    """Read phone timings.

    Parameters
    ----------
    path : Path
        The file.
    file_format : str, optional
        One of :data:`FORMATS`; by default found from the content.
    tier : str, optional
        For TextGrid: the phone tier.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If its content is no such format; the message names the file.
    """
    data = read_bytes(path)
    try:
        if (file_format or guess_format(data)) == "textgrid":
            return parse_textgrid(data, tier=tier)
        return parse_pho(data)
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error


def guess_format(data: bytes) -> str:
    """Find the format from the first bytes."""
    head = data[:200].replace(b"\0", b"")
    return "textgrid" if b"ooTextFile" in head or b"TextGrid" in head or b"ooBinaryFile" in head else "pho"
