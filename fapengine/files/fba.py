"""FBA streams and encoder parameter files: a path to values and back."""

from pathlib import Path

from fapengine.codec.decoder import Decoded, Errors, decode
from fapengine.codec.epf import PlaneOrder, parse_epf
from fapengine.errors import DataError
from fapengine.files.fba_film import read_fba_film
from fapengine.files.paths import is_mp4, read_bytes


def load_fba(path: Path, *, errors: Errors = "strict", with_costs: bool = False) -> Decoded:
    """Decode an ``.fba`` file, or the face stream of an MP4 file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it cannot be decoded; the message names it.
    """
    try:
        return decode(read_stream(path), errors=errors, with_costs=with_costs)
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error


def read_stream(path: Path) -> bytes:
    """Read the bytes of a face stream: of an ``.fba`` file, or out of an MP4 file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is an MP4 file without a face stream.
    """
    data = read_bytes(path)
    if not is_mp4(data):
        return data
    stream = read_fba_film(path)
    if stream is None:
        raise DataError("an MP4 file without a face stream; expected an MPEG-4 visual track with a face object")
    return stream


def load_epf(path: Path) -> tuple[PlaneOrder, ...]:
    """Read an ``.epf`` file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is no parameter file; the message names it.
    """
    try:
        return parse_epf(read_bytes(path))
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error
