"""Names to write, looked at before any work: none is a file that is read, and what would be replaced is known."""

import contextlib
import os
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from fapengine.errors import ResourceError, UsageError
from fapengine.files.animation import is_sequence, sequence_files
from fapengine.files.paths import is_standard


def check_outputs(outputs: Iterable[Path], inputs: Iterable[Path] = (), *, overwrite: bool = True) -> tuple[Path, ...]:
    """Refuse outputs that cannot be meant.

    Parameters
    ----------
    outputs : iterable of Path
        Names that will be written; ``frame_%04d.png`` stands for all files of the sequence.
    inputs : iterable of Path
        Files that are read, with those that they name beside them, and folders whose files are read.
    overwrite : bool
        False to refuse to replace anything.

    Returns
    -------
    tuple of Path
        Files that are there under these names.

    Raises
    ------
    UsageError
        If an output is one of the inputs, under whatever name; if two outputs are one file; if one is a folder; or if
        one is there and may not be replaced.
    ResourceError
        If the folder of an output cannot be written to.
    """
    read = {_identity(file) for path in inputs for file in _files_of(path)}
    seen: dict[Path, Path] = {}
    replaced = []
    for output in outputs:
        if is_standard(output):
            continue
        place = output.resolve()
        if place in seen:
            raise UsageError(f"path: got {seen[place]} and {output}, which are one file; expected different names")
        seen[place] = output
        there = sequence_files(output) if is_sequence(output) else [output] * output.exists()
        for path in there:
            if _identity(path) in read:
                raise UsageError(f"path: got {path}, which is read, and would be written over; expected another name")
            if path.is_dir():
                raise UsageError(f"path: got {path}, which is a folder; expected the name of a file")
        if there and not overwrite:
            more = f" and {len(there) - 1} more" if len(there) > 1 else ""
            raise UsageError(f"path: got {there[0]}{more}, which is there already, expected a new name (no-overwrite)")
        if not there:
            _check_folder(output)
        replaced += there
    return tuple(replaced)


def marks_of(paths: Iterable[Path]) -> dict[Path, tuple[int, ...] | None]:
    """Note by what a file is told from another one that takes its place; None where none is there."""
    marks: dict[Path, tuple[int, ...] | None] = {}
    for path in paths:
        marks[path] = None
        with contextlib.suppress(FileNotFoundError):
            found = path.stat()
            marks[path] = found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size
    return marks


def files_in(folder: Path, owned: Collection[str]) -> list[Path]:
    """Names of files that are written into a folder: those of ``owned`` without ``*``, and what is there of others."""
    return [
        path
        for pattern in owned
        for path in (sorted(folder.glob(pattern)) if "*" in pattern else [folder / pattern])
        if not path.is_dir()
    ]


def listed(paths: Collection[Path], most: int = 6) -> str:
    """Spell paths in a line.

    Examples
    --------
    >>> listed([Path(name) for name in "abcd"], 2)
    'a, b and 2 more'
    """
    more = f" and {len(paths) - most} more" if len(paths) > most else ""
    return ", ".join(str(path) for path in list(paths)[:most]) + more


def _identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_dev, found.st_ino


def _files_of(path: Path) -> Iterator[Path]:
    if not path.exists():
        return
    from fapengine.files.named_files import files_named_in

    if path.is_dir():
        yield from (file for file in path.rglob("*") if file.is_file())
        setup = path / "session.toml"
        yield from (named for named in files_named_in(setup) if os.path.isfile(named))  # noqa: PTH113  False for all names
    else:
        yield path
        yield from (named for named in files_named_in(path) if os.path.isfile(named))  # noqa: PTH113  False for all names


def _check_folder(output: Path) -> None:
    """Refuse a name in a folder that nothing can be written to."""
    place = output.resolve()
    folder = next(parent for parent in place.parents if os.path.lexists(parent))
    if not folder.is_dir():
        raise ResourceError(f"{output}: cannot be written ({folder} is no folder)")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResourceError(f"{output}: cannot be written (Permission denied: {folder})")
