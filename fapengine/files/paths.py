"""Opening and writing, with errors that name the path. A file is written whole, or what stood there stays."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file that takes its place at once, when it is whole; folders are made.

    Inside, write to the path that is given: it lies in the same folder and has the same suffix. Whatever ends the
    writing early (an error, Ctrl-C, a full disk) leaves what stood there before. Links are followed; a device or a pipe
    is written as it is.

    Raises
    ------
    ResourceError
        If it cannot be written, or for an OSError inside.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        target = path.resolve()
        if target.exists() and not target.is_file():
            yield target
            return
        new = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(4)}{target.suffix}")
        try:
            new.touch(exist_ok=False)
            if target.exists():
                new.chmod(target.stat().st_mode & 0o777)
            yield new
            with new.open("rb") as written:
                os.fsync(written.fileno())
            new.replace(target)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file as :func:`replacing` does.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    with replacing(path) as new:
        new.write_bytes(data)
