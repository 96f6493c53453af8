"""Built-in heads, cached on disk: building one takes a second or two, reading it a few hundredths of a second.

They are in the folder of :mod:`fapengine._cache`. The key is the digest of all code and tables that make a head, so a
changed program never reads an old one. Only files that this module wrote are removed. A cache that cannot be used is
reported once, and heads are built without it.
"""

import hashlib
import re
from functools import cache, lru_cache
from pathlib import Path

from fapengine._cache import least_recently_used, read_or_make, sources
from fapengine._strict_toml import MAX_BYTES, quoted
from fapengine.files.heads.folder import OWNED, SCHEMA, TOML_NAME, HeadInfo, load_folder, save_head
from fapengine.files.paths import read_bytes
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh

OURS = HeadInfo("fapengine", "Apache-2.0")
KEPT = re.compile("[0-9a-f]{32}")
"""Names of the heads in it."""


@lru_cache(maxsize=4)
def load_built(style: HeadStyle, level: str = "normal") -> FaceMesh:
    """Return a built-in head of a style and level, from the cache if possible.

    Raises
    ------
    UsageError
        If the level is unknown.
    """
    return read_or_make(
        lambda: _digest(style, level), lambda: _build(style, level), lambda path: load_folder(path)[1], _write
    )


def _write(kept: Path, head: FaceMesh) -> None:
    """Write a head, and remove the oldest that this module wrote; a folder that contains anything else stays."""
    save_head(kept, head, OURS, compressed=False)
    source = f"source = {quoted(OURS.source)}\n".encode()
    ours = [
        path
        for path in kept.parent.iterdir()
        if KEPT.fullmatch(path.name)
        and (path / TOML_NAME).is_file()
        and source in read_bytes(path / TOML_NAME, MAX_BYTES)
    ]
    for old in least_recently_used(ours):
        if not old.is_symlink() and {path.name for path in old.iterdir()} <= set(OWNED):
            for name in OWNED:
                (old / name).unlink(missing_ok=True)
            old.rmdir()


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
