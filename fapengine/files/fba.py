"""FBA streams and encoder parameter files: a path to values and back."""

from pathlib import Path

from fapengine.codec.decoder import Decoded, Errors, decode
from fapengine.codec.epf import PlaneOrder, parse_epf
from fapengine.errors import DataError
from fapengine.files.paths import read_bytes


def load_fba(path: Path, *, errors: Errors = "strict", with_costs: bool = False) -> Decoded:
    """Decode an ``.fba`` file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it cannot be decoded; the message names it.
    """
    try:
        return decode(read_bytes(path), errors=errors, with_costs=with_costs)
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error


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
