"""Opening and writing, with errors that name the path."""

from pathlib import Path

from fapengine.errors import ResourceError, UsageError


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises
    ------
    UsageError
        If it is not there or cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file; folders are made.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror})") from error
