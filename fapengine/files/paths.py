"""Reading and writing files, with errors that name the path; a file or folder is replaced completely or not at all.

Theory of operation
-------------------
Output is written next to its target under a hidden name, ``.talk.part-0f3a….mp4``, and replaces the target by one
system call when it is complete. The writer holds a lock (flock) on the hidden name, which ends with its process: an
unlocked one was left by a process that was killed, and is removed when the same target is written again. Errors and
signals that Python handles remove it at once; :func:`remove_unfinished` removes the rest at the end of the program, as
an exception may have come between two lines.
"""

import atexit
import contextlib
import ctypes
import errno
import glob
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

from fapengine.errors import DataError, ResourceError, UsageError

try:
    import fcntl
except ImportError:  # Windows: without locks, leftovers are not removed
    fcntl = None  # type: ignore[assignment]

MAX_STEM = 100
"""Number of characters of the target's name in the hidden name."""
MAX_BYTES = 1 << 30
"""Largest file that is read at once, unless its kind has a limit of its own."""
GIVEN = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")
"""Names of what this process was started with, which may be a pipe."""
RENAME_EXCHANGE = 2
"""Flag of Linux' renameat2: exchange two names."""
AT_FDCWD = -100

_process = os.getpid()
_unfinished: dict[Path, int | None] = {}
"""Hidden names that this process is writing, each with the file descriptor that holds its lock."""


STANDARD = "-"
"""Name of standard input or output."""


@lru_cache(maxsize=1)
def _whole(stream: BinaryIO) -> bytes:
    """Read a stream to its end or one byte beyond the limit, once; later calls return the same bytes."""
    return stream.read(MAX_BYTES + 1)


def is_standard(path: Path) -> bool:
    """Whether a name means standard input or output: ``-``, or ``-.csv`` to give the format."""
    return path.stem == STANDARD and str(path) == path.name


def standard_output(path: Path, ending: str) -> Path:
    """Add to ``-`` the ending of its format; other names are unchanged."""
    return path.with_name(f"{STANDARD}{ending}") if str(path) == STANDARD else path


def refuse_standard_output(path: Path) -> None:
    """Reject standard output, where several files, or one that replaces another when complete, cannot be written.

    Raises
    ------
    UsageError
        If the path is ``-``.
    """
    if is_standard(path):
        raise UsageError(f"path: got {path}, but this cannot be written to standard output; expected a file's name")


def resolved(path: Path) -> Path:
    """Absolute path without links.

    Raises
    ------
    UsageError
        If a link leads to itself, or a null character is in the name.
    """
    _check_name(path)
    place = Path(os.path.realpath(path))
    if any(part.is_symlink() for part in (place, *place.parents)):
        raise UsageError(f"path: got {path}, a link that leads to itself; expected another name")
    return place


LFS_POINTER, MAX_POINTER = b"version https://git-lfs", 1024
"""What stands in a clone for a large file, and the most bytes that it has."""


def open_file(path: Path, most: int | None = None) -> BinaryIO:
    """Open a file for reading that has at most ``most`` bytes.

    Devices and named pipes are not opened, except those that this process was started with (:data:`GIVEN`).

    Raises
    ------
    UsageError
        If it does not exist, cannot be read or is larger.
    DataError
        If it is a pointer of Git LFS.
    """
    _check_name(path)
    try:
        found = path.stat()
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode) or str(path).startswith(GIVEN)):
            raise UsageError(f"{path}: cannot be read (a device or a pipe); expected a file, or - for standard input")
        _check_size(path, found.st_size, most)
        file = path.open("rb")
        if found.st_size < MAX_POINTER and file.peek(len(LFS_POINTER)).startswith(LFS_POINTER):
            file.close()
            raise DataError(f"{path}: got a pointer of Git LFS, expected the file itself (git lfs pull)")
        return file
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Read a whole file of at most ``most`` bytes, up to :data:`MAX_BYTES`; ``-`` is standard input.

    Raises
    ------
    UsageError
        If it does not exist, cannot be read or is larger.
    """
    if str(path) == STANDARD:
        if sys.stdin is None:
            raise UsageError("-: standard input is closed; expected a file's name")
        data = _whole(sys.stdin.buffer)
    else:
        with open_file(path, most) as file:
            try:
                data = file.read() if path.is_file() else file.read(most + 1)
            except OSError as error:
                raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    _check_size(path, len(data), most)
    return data


def _check_name(path: Path) -> None:
    if "\0" in str(path):
        raise UsageError(f"path: got {str(path)!r:.60}, expected a name without null characters")


def _check_size(path: Path, size: int, most: int | None) -> None:
    if most is not None and size > most:
        raise UsageError(f"{path}: cannot be read (got {size} bytes or more, expected at most {most})")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file that replaces the old one atomically when it is complete; missing folders are created.

    Inside, write to the given path, which is in the same folder and has the same suffix. Whatever ends the writing
    early (an error, Ctrl-C, a full disk) leaves the old file unchanged. Links are followed; a device or a pipe is
    written directly.

    Raises
    ------
    ResourceError
        If it cannot be written, and for an OSError inside the block.
    """
    refuse_standard_output(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        target = resolved(path)
        if target.exists() and not target.is_file():
            yield target
            return
        with _hidden(target, target.parent) as new:
            held = _begin(new, lambda: os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666))
            if target.exists():
                new.chmod(target.stat().st_mode & 0o777)
            yield new
            os.fsync(held)
            new.replace(target)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextmanager
def replacing_folder(path: Path, *, owned: Collection[str]) -> Iterator[Path]:
    """Write a folder that replaces the old one atomically when it is complete; missing parent folders are created.

    Inside, write into the given folder. Whatever ends the writing early leaves the old folder unchanged. If the old
    folder also contains other files, these are kept, and the new files are moved into it one by one.

    Parameters
    ----------
    path : Path
    owned : collection of str
        Patterns of names in the folder that an earlier run may have written, such as ``"takes/*.fap"``: files that
        are not written again are removed.

    Raises
    ------
    ResourceError
        If it cannot be written, and for an OSError inside the block.
    """
    try:
        target = resolved(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_left_over(target, target)
        at_once = not target.exists() or _may_be_exchanged(target, owned)
        with _hidden(target, target.parent if at_once else target) as new:
            _begin(new, lambda: _opened_folder(new))
            yield new
            if not target.exists():
                new.rename(target)
            elif not (at_once and _exchange(new, target)):
                _put_one_by_one(new, target, owned)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of a file before the message of a DataError raised inside."""
    try:
        yield
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error


@contextmanager
def locating(path: Path | str, separator: str = ", ") -> Iterator[None]:
    """Put the name of a file, and a separator, before the place of a DataError raised inside."""
    try:
        yield
    except DataError as error:
        where = f"{path}{separator}{error.where}" if error.where else str(path)
        raise type(error)(error.message, where=where, clause=error.clause) from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file as :func:`replacing` does, or standard output.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    if is_standard(path):
        if sys.stdout is None:
            raise ResourceError(f"{path}: cannot be written (standard output is closed)")
        sys.stdout.buffer.write(data)
        return
    with replacing(path) as new:
        new.write_bytes(data)


@atexit.register
def remove_unfinished() -> None:
    """Remove unfinished output of this process; for the end of the program."""
    if os.getpid() == _process:
        for path in list(_unfinished):
            _remove(path)
            _forget(path)


@contextmanager
def _hidden(target: Path, folder: Path) -> Iterator[Path]:
    """Choose a hidden name for a target; an existing file of that name is removed at the end."""
    _remove_left_over(target, folder)
    new = folder / f".{target.stem[:MAX_STEM]}.part-{secrets.token_hex(8)}{target.suffix}"
    _unfinished[new] = None  # before it is created: a signal may come at any line
    try:
        yield new
    finally:
        _remove(new)
        _forget(new)


def _begin(path: Path, make: Callable[[], int]) -> int:
    """Create a hidden file or folder, and lock it; returns the file descriptor of the lock."""
    while True:
        held = _unfinished[path] = make()
        if fcntl is None:
            return held
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(held, fcntl.LOCK_EX)
        if path.exists() and os.path.samestat(path.stat(), os.fstat(held)):
            return held
        os.close(held)  # another process removed it as a leftover between both calls


def _opened_folder(path: Path) -> int:
    path.mkdir()
    return os.open(path, os.O_RDONLY)


def _forget(path: Path) -> None:
    held = _unfinished.pop(path, None)
    if held is not None:
        os.close(held)


def _remove(path: Path) -> None:
    """Remove a file or folder, if it exists; failures are ignored."""
    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _remove_left_over(target: Path, folder: Path) -> None:
    """Remove hidden names of this target that no living process has locked."""
    if fcntl is None:
        return
    pattern = f".{glob.escape(target.stem[:MAX_STEM])}.part-{'[0-9a-f]' * 16}{glob.escape(target.suffix)}"
    for left in folder.glob(pattern):
        if left.is_symlink() or not (left.is_file() or left.is_dir()):
            continue
        with contextlib.suppress(OSError):
            held = os.open(left, os.O_RDONLY)
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails if a process is writing it
                _remove(left)
            finally:
                os.close(held)


def _owned_files(folder: Path, owned: Collection[str]) -> set[Path]:
    return {path for pattern in owned for path in folder.glob(pattern) if path.is_symlink() or not path.is_dir()}


def _may_be_exchanged(target: Path, owned: Collection[str]) -> bool:
    """Whether a folder contains only owned files, and can be replaced as a whole."""
    if not target.is_dir() or Path.cwd().is_relative_to(target) or not os.access(target.parent, os.W_OK):
        return False
    ours = _owned_files(target, owned)
    folders = {path.parent for path in ours}
    return all(path in ours or (path in folders and set(path.iterdir()) <= ours) for path in target.iterdir())


def _put_one_by_one(new: Path, target: Path, owned: Collection[str]) -> None:
    """Move files into an existing folder one by one; owned files that are not written again are removed."""
    written = {path.relative_to(new) for path in new.rglob("*") if path.is_file()}
    # TOML files come last, as they refer to the others.
    for name in sorted(written, key=lambda name: (name.suffix == ".toml", name)):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (new / name).replace(target / name)
    for path in _owned_files(target, owned):
        if path.relative_to(target) not in written:
            path.unlink()


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names atomically; False if the system cannot."""
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    if renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0:
        return True
    if (number := ctypes.get_errno()) in (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM):
        raise OSError(number, os.strerror(number))
    return False


def is_mp4(data: bytes) -> bool:
    """Detect an MP4 file by its first bytes."""
    return data[4:8] == b"ftyp"
