"""FAP files: a path to a :class:`FapTrack` and back."""

from pathlib import Path

from fapengine.codec.fapfile import format_fap, parse_fap
from fapengine.errors import DataError
from fapengine.files.paths import read_bytes, write_bytes
from fapengine.mpeg4.track import FapTrack


def load_fap(path: Path) -> FapTrack:
    """Read ``.fap`` text.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is no FAP file; the message names it.
    """
    try:
        return parse_fap(read_bytes(path))
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error


def save_fap(path: Path, track: FapTrack, *, single_numbers: bool = False) -> None:
    """Write ``.fap`` text, version 2.1; see :func:`fapengine.codec.fapfile.format_fap`.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    write_bytes(path, format_fap(track, single_numbers=single_numbers).encode())
