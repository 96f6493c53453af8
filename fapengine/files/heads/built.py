"""Built-in heads, cached on disk: building one takes a second or two, reading it a few hundredths of a second.

They are in the folder of :mod:`fapengine._cache`. The key is the digest of all code and tables that make a head, so a
changed program never reads an old one. Only files that this module wrote are removed. A cache that cannot be used is
reported once, and heads are built without it.
"""

import hashlib
import logging
import os
import re
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path

from fapengine._cache import CACHE_VARIABLE, MAX_KEPT, cache_folder, check_ours, sources
from fapengine._strict_toml import MAX_BYTES, quoted
from fapengine.errors import FapEngineError
from fapengine.files.heads.folder import OWNED, SCHEMA, TOML_NAME, HeadInfo, load_folder, save_head
from fapengine.files.paths import read_bytes
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh

OURS = HeadInfo("fapengine", "Apache-2.0")
KEPT = re.compile("[0-9a-f]{32}")
"""Names of the heads in it."""

log = logging.getLogger("fapengine.heads")


@lru_cache(maxsize=4)
def load_built(style: HeadStyle, level: str = "normal") -> FaceMesh:
    """Return a built-in head of a style and level, from the cache if possible.

    Raises
    ------
    UsageError
        If the level is unknown.
    """
    folder = cache_folder()
    if folder is None:
        return _build(style, level)
    kept = folder / _digest(style, level)
    with suppress(FapEngineError, OSError):  # missing, damaged or not ours: it is built again
        check_ours(folder)
        head = load_folder(kept)[1]
        with suppress(OSError):
            os.utime(kept)
        return head
    head = _build(style, level)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_ours(folder)
        save_head(kept, head, OURS, compressed=False)
        _forget_oldest(folder)
    except (FapEngineError, OSError) as error:
        _report(f"{CACHE_VARIABLE}: built heads are not kept: {error}")
    return head


def _forget_oldest(folder: Path) -> None:
    """Remove heads that this module wrote beyond :data:`MAX_KEPT`; a folder that contains anything else stays."""
    source = f"source = {quoted(OURS.source)}\n".encode()
    ours = [
        path
        for path in folder.iterdir()
        if KEPT.fullmatch(path.name)
        and (path / TOML_NAME).is_file()
        and source in read_bytes(path / TOML_NAME, MAX_BYTES)
    ]
    for old in sorted(ours, key=lambda path: path.stat().st_mtime, reverse=True)[MAX_KEPT:]:
        if not old.is_symlink() and {path.name for path in old.iterdir()} <= set(OWNED):
            for name in OWNED:
                (old / name).unlink(missing_ok=True)
            old.rmdir()


@cache
def _report(text: str) -> None:
    """Log a warning, once."""
    log.warning(text)


def _build(style: HeadStyle, level: str) -> FaceMesh:
    from fapengine.mesh.default_head.head import build_head  # imports much of scipy, which a cached head does not need

    return build_head(style, level=level)


def _digest(style: HeadStyle, level: str) -> str:
    """Digest of everything that a head depends on."""
    return hashlib.sha256(f"{_program()} {style} {level}".encode()).hexdigest()[:32]


@cache
def _program() -> str:
    """Digest of the program as this process found it first: a later one is not what it runs."""
    return f"{SCHEMA} {sources()}"
