"""Files that another file names, and that are read with it: buffers and images of glTF, materials, scans."""

import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import unquote

from fapengine.errors import FapEngineError
from fapengine.files.gltf.document import text_of_gltf
from fapengine.files.gltf.json_cursor import parse_json
from fapengine.files.paths import read_bytes

PLY_HEADER = 1 << 16
"""Bytes of a PLY that may hold the name of its texture."""


def files_named_in(path: Path) -> Iterator[Path]:
    """Tell which files are read with one, by its content; none where it cannot be read, which is told elsewhere.

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
    """Tell the scans of a session, which may stand elsewhere, and what they name themselves."""
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
"""Readers of the names in a file, by its ending; the names are relative to its folder."""
