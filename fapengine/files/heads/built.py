"""Built-in heads, cached on disk: building one takes a second or two, reading it a few hundredths of a second.

The folder is ``$FAPENGINE_CACHE``, or ``fapengine`` in the system's cache folder; ``FAPENGINE_CACHE=off`` disables it.
The key is the digest of all code and tables that make a head, so a changed program never reads an old one.
"""

import hashlib
import os
import shutil
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import numpy

import fapengine.mesh
from fapengine.errors import FapEngineError
from fapengine.files.heads.folder import SCHEMA, HeadInfo, load_folder, save_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh

CACHE_VARIABLE = "FAPENGINE_CACHE"
MAX_KEPT = 16
"""Cached heads, about 2 MB each; beyond that the least recently used one is removed."""
MADE_BY = ("mesh", "geometry", "mpeg4")
"""Packages with the code and tables that make a head."""
OURS = HeadInfo("fapengine", "Apache-2.0")


@lru_cache(maxsize=4)
def load_built(style: HeadStyle, level: str = "normal") -> FaceMesh:
    """Return a built-in head of a style and level, from the cache if possible.

    Raises
    ------
    UsageError
        If the level is unknown.
    """
    folder = _folder()
    if folder is None:
        return _build(style, level)
    kept = folder / _digest(style, level)
    with suppress(FapEngineError):  # missing or damaged: it is built again
        head = load_folder(kept)[1]
        with suppress(OSError):
            os.utime(kept)
        return head
    head = _build(style, level)
    with suppress(FapEngineError, OSError):  # a full or read-only disk costs only time
        save_head(kept, head, OURS)
        newest_first = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        for old in newest_first[MAX_KEPT:]:
            shutil.rmtree(old, ignore_errors=True)
    return head


def _build(style: HeadStyle, level: str) -> FaceMesh:
    from fapengine.mesh.default_head.head import build_head  # imports much of scipy, which a cached head does not need

    return build_head(style, level=level)


def _folder() -> Path | None:
    """Folder of the cache; None if it is disabled or the user has no home folder."""
    chosen = os.environ.get(CACHE_VARIABLE, "")
    if chosen == "off":
        return None
    if chosen:
        return Path(chosen) / "heads"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "darwin":
        system = home / "Library" / "Caches"
    elif sys.platform == "win32":
        system = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    else:
        system = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return system / "fapengine" / "heads"


def _digest(style: HeadStyle, level: str) -> str:
    """Digest of everything that a head depends on."""
    import scipy  # not needed before

    digest = hashlib.sha256(f"{SCHEMA} {numpy.__version__} {scipy.__version__}".encode())
    digest.update(f"{style} {level}".encode())
    package = Path(fapengine.mesh.__path__[0]).parent
    for folder in MADE_BY:
        for source in sorted((package / folder).rglob("*")):
            if source.suffix in (".py", ".npz"):
                digest.update(source.read_bytes())
    return digest.hexdigest()[:32]
