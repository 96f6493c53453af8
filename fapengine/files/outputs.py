"""Checks of output names before any work: no output is an input, and files that would be replaced are known."""

import contextlib
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote

from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.files.moving import is_sequence, sequence_files
from fapengine.files.paths import is_standard, read_bytes, resolved
from fapengine.files.pictures import PNG_MARK
from fapengine.files.sound import WAV_MARK


def check_outputs(outputs: Iterable[Path], inputs: Iterable[Path] = (), *, overwrite: bool = True) -> tuple[Path, ...]:
    """Reject outputs that are probably mistakes.

    Parameters
    ----------
    outputs : iterable of Path
        Names that will be written; ``frame_%04d.png`` means all files of the sequence.
    inputs : iterable of Path
        Files that are read, including those that they reference, and folders with files to read.
    overwrite : bool
        False to refuse to replace anything.

    Returns
    -------
    tuple of Path
        Existing files with these names.

    Raises
    ------
    UsageError
        If an output is one of the inputs, under any name; if two outputs are one file, or would be where the file
        system ignores case; if one is a folder, or a link that leads to itself; or if one exists and may not be
        replaced.
    ResourceError
        If the folder of an output is not writable.
    """

    @cache
    def read() -> set[tuple[object, ...]]:  # called only if an output exists: a folder may hold very many files
        return {key for path in inputs for file in _files_of(path) for key in identities(file)}

    seen: dict[str, Path] = {}
    replaced = []
    for output in outputs:
        if is_standard(output):
            continue
        place = str(resolved(output)).casefold()  # some file systems ignore case
        if place in seen:
            where = "" if resolved(seen[place]) == resolved(output) else " where case does not matter"
            raise UsageError(
                f"path: got {seen[place]} and {output}, which are one file{where}; expected different names"
            )
        seen[place] = output
        there = sequence_files(output) if is_sequence(output) else [output] * output.exists()
        for path in there:
            if read().intersection(identities(path)):
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


def refuse_foreign(paths: Iterable[Path]) -> None:
    """Reject files that a run would replace beside its output, unless an earlier run of fapengine wrote them.

    Raises
    ------
    UsageError
        If a file has no mark of fapengine: that of its WAV and PNG files, or the name in the header of ``.fap``.
    """
    for path in paths:
        if not path.is_file():
            continue
        with path.open("rb") as file:
            head = file.read(256)
            if head[37:41] == b"caBX":  # C2PA's claim, which comes first
                file.seek(45 + int.from_bytes(head[33:37], "big"))
                head = file.read(256)
        is_ours = WAV_MARK in head or "\0".join(PNG_MARK).encode() in head
        if not (is_ours or head.split(maxsplit=2)[:2] == [b"2.1", b"fapengine"]):
            raise UsageError(
                f"path: {path} would be replaced, and is not of fapengine; move it, or name another output"
            )


def marks_of(paths: Iterable[Path]) -> dict[Path, tuple[int, ...] | None]:
    """Identity of each file, to notice when another one replaces it; None for missing ones."""
    marks: dict[Path, tuple[int, ...] | None] = dict.fromkeys(paths)
    for path in marks:
        with contextlib.suppress(FileNotFoundError):
            found = path.stat()
            marks[path] = found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size
    return marks


def files_in(folder: Path, owned: Collection[str]) -> list[Path]:
    """List files written into a folder: names in ``owned`` without ``*``, and existing files that match the others."""
    return [
        path
        for pattern in owned
        for path in (sorted(folder.glob(pattern)) if "*" in pattern else [folder / pattern])
        if not path.is_dir()
    ]


def listed(paths: Collection[Path], most: int = 6) -> str:
    """Format paths for one line.

    Examples
    --------
    >>> listed([Path(name) for name in "abcd"], 2)
    'a, b and 2 more'
    """
    more = f" and {len(paths) - most} more" if len(paths) > most else ""
    return ", ".join(str(path) for path in list(paths)[:most]) + more


def identities(path: Path) -> tuple[tuple[int, int], tuple[str, int, int]]:
    """Two keys of a file of which all its names share one.

    Its number; and, for file systems that ignore case but number each name (exFAT of FUSE), its name, size and time.
    """
    found = path.stat()
    return (found.st_dev, found.st_ino), (str(resolved(path)).casefold(), found.st_size, found.st_mtime_ns)


def _files_of(path: Path) -> Iterator[Path]:
    """Files that reading a path reads: those in a folder or the file itself, and those that it references."""
    if not path.exists():
        return
    yield from (file for file in path.rglob("*") if file.is_file()) if path.is_dir() else (path,)
    document = path / "session.toml" if path.is_dir() else path
    yield from (named for named in files_named_in(document) if os.path.isfile(named))  # noqa: PTH113  False for bad names


def _check_folder(output: Path) -> None:
    """Reject a name in a folder that is not writable."""
    place = resolved(output)
    folder = next(parent for parent in place.parents if os.path.lexists(parent))
    if not folder.is_dir():
        raise ResourceError(f"{output}: cannot be written ({folder} is not a folder)")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResourceError(f"{output}: cannot be written (Permission denied: {folder})")


PLY_HEADER = 1 << 16
"""Longest header of a PLY that is searched for its texture."""


def files_named_in(path: Path) -> Iterator[Path]:
    """Yield the files that a file references, by its content; none if it cannot be read (reported elsewhere).

    Examples
    --------
    >>> list(files_named_in(Path("heard.onnx")))
    [PosixPath('heard.json')]
    """
    if (names := NAMES.get(path.suffix.lower())) is None:
        return
    try:
        yield from (path.parent / name for name in names(path))
    except (FapEngineError, ValueError):
        return


def _of_gltf(path: Path) -> list[str]:
    from fapengine.files.gltf.document import parse_json, text_of_gltf

    root = parse_json(text_of_gltf(read_bytes(path)), "glTF")
    rows = [row for kind in ("buffers", "images") for row in root.items(kind) if "uri" in row]
    return [unquote(uri) for row in rows if not (uri := row.string("uri")).startswith("data:")]


def _of_obj(path: Path) -> Iterator[str]:
    for library in _found(rb"^[ \t]*mtllib[ \t]+(.+)$", read_bytes(path)):
        yield library
        if (path.parent / library).is_file():
            yield from _found(rb"^[ \t]*map_kd[ \t]+(.+)$", read_bytes(path.parent / library))


def _of_ply(path: Path) -> Iterator[str]:
    header, _, _ = read_bytes(path)[:PLY_HEADER].partition(b"end_header")
    yield from _found(rb"^comment[ \t]+texturefile[ \t]+(.+)$", header)


def _of_toml(path: Path) -> Iterator[str]:
    """Yield the scans of a session, which may be in other folders, and the files that they reference."""
    import tomllib

    scans = tomllib.loads(read_bytes(path).decode()).get("scan", [])
    for scan in scans if isinstance(scans, list) else ():
        name = scan.get("file") if isinstance(scan, dict) else None
        if isinstance(name, str):
            yield name
            yield from (str(named) for named in files_named_in((path.parent / name).absolute()))


def _found(pattern: bytes, data: bytes) -> list[str]:
    return [name.decode(errors="surrogateescape").strip() for name in re.findall(pattern, data, re.MULTILINE | re.I)]


NAMES: dict[str, Callable[[Path], "list[str] | Iterator[str]"]] = {
    **dict.fromkeys((".gltf", ".glb", ".vrm"), _of_gltf),
    ".obj": _of_obj,
    ".ply": _of_ply,
    ".toml": _of_toml,
    ".onnx": lambda path: [path.with_suffix(".json").name],
}
"""Functions that read the names in a file, by its ending; the names are relative to its folder."""
