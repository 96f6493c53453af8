"""Built-in heads, cached on disk: building one takes a second or two, reading it a few hundredths of a second.

They are in the folder ``built-heads`` of ``$FAPENGINE_CACHE``, or of ``fapengine`` in the system's cache folder;
``FAPENGINE_CACHE=off`` disables it. The key is the digest of all code and tables that make a head, so a changed program
never reads an old one. Only a folder with our ``CACHEDIR.TAG`` that belongs to this user is used, and only files that
this module wrote are removed. A cache that cannot be used is reported once, and heads are built without it.
"""

import hashlib
import logging
import os
import re
import sys
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path

import numpy

import fapengine.mesh
from fapengine._strict_toml import MAX_BYTES, quoted
from fapengine.errors import FapEngineError, ResourceError
from fapengine.files.heads.folder import OWNED, SCHEMA, TOML_NAME, HeadInfo, load_folder, save_head
from fapengine.files.paths import read_bytes
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh

CACHE_VARIABLE = "FAPENGINE_CACHE"
MAX_KEPT = 16
"""Cached heads, about 2 MB each; beyond that the least recently used one is removed."""
MADE_BY = ("mesh", "geometry", "mpeg4")
"""Packages with the code and tables that make a head."""
MADE_OF = (".py", ".npz", ".csv", ".toml")
"""Endings of these files."""
OURS = HeadInfo("fapengine", "Apache-2.0")
TAG = "CACHEDIR.TAG"
TAGGED = b"""Signature: 8a477f597d28d172789f06886806bc55
# This folder contains heads that fapengine built, and can be removed. https://bford.info/cachedir/
"""
"""Content of the tag of our folder."""
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
    folder = _folder()
    if folder is None:
        return _build(style, level)
    kept = folder / _digest(style, level)
    with suppress(FapEngineError, OSError):  # missing, damaged or not ours: it is built again
        _check_ours(folder)
        head = load_folder(kept)[1]
        with suppress(OSError):
            os.utime(kept)
        return head
    head = _build(style, level)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _check_ours(folder)
        save_head(kept, head, OURS)
        _forget_oldest(folder)
    except (FapEngineError, OSError) as error:
        _report(f"{CACHE_VARIABLE}: built heads are not kept: {error}")
    return head


def _check_ours(folder: Path) -> None:
    """Raise an error unless a folder belongs to this user and has our tag, which an empty one gets."""
    if folder.stat().st_uid != getattr(os, "getuid", lambda: 0)():
        raise ResourceError(f"{folder} belongs to another user")
    if not any(folder.iterdir()):
        (folder / TAG).write_bytes(TAGGED)
    if not (folder / TAG).is_file() or read_bytes(folder / TAG) != TAGGED:
        raise ResourceError(f"{folder} was not made by fapengine, as it lacks our {TAG}")


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


def _folder() -> Path | None:
    """Folder of the cache; None if it is disabled or the user has no home folder."""
    chosen = os.environ.get(CACHE_VARIABLE, "")
    if chosen == "off":
        return None
    if chosen:
        return Path(chosen) / "built-heads"
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
    return system / "fapengine" / "built-heads"


def _digest(style: HeadStyle, level: str) -> str:
    """Digest of everything that a head depends on."""
    return hashlib.sha256(f"{_program()} {style} {level}".encode()).hexdigest()[:32]


@cache
def _program() -> str:
    """Digest of code and tables as this process found them first: later ones are not those that it runs."""
    import scipy  # not needed before

    digest = hashlib.sha256(f"{SCHEMA} {numpy.__version__} {scipy.__version__}".encode())
    package = Path(fapengine.mesh.__path__[0]).parent
    for folder in MADE_BY:
        for source in sorted((package / folder).rglob("*")):
            if source.suffix in MADE_OF:
                digest.update(source.read_bytes())
    return digest.hexdigest()
