"""The cache on disk for what costs time to make of a head: where it is, whose it is, and for which program.

It is the folder ``built-heads`` of ``$FAPENGINE_CACHE``, or of ``fapengine`` in the system's cache folder;
``FAPENGINE_CACHE=off`` disables it. Only a folder with our ``CACHEDIR.TAG`` that belongs to this user is used.
"""

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy

from fapengine._arrays import DAMAGE
from fapengine.errors import FapEngineError, ResourceError

Made = TypeVar("Made")
log = logging.getLogger("fapengine.heads")

CACHE_VARIABLE = "FAPENGINE_CACHE"
MAX_KEPT = 16
"""Heads, about 6 MB each, and packed meshes, about 3 MB each; beyond that the least recently used one is removed."""
MADE_BY = ("mesh", "geometry", "mpeg4")
"""Packages with the code and tables that make a head."""
MADE_OF = (".py", ".npz", ".csv", ".toml")
"""Endings of these files."""
TAG = "CACHEDIR.TAG"
TAGGED = b"""Signature: 8a477f597d28d172789f06886806bc55
# This folder contains heads that fapengine built, and can be removed. https://bford.info/cachedir/
"""
"""Content of the tag of our folder."""


def cache_folder() -> Path | None:
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


def check_ours(folder: Path) -> None:
    """Refuse a folder unless it belongs to this user and has our tag, which an empty one gets.

    Raises
    ------
    ResourceError
        If it is not ours.
    OSError
        If it cannot be read or written.
    """
    if folder.stat().st_uid != getattr(os, "getuid", lambda: 0)():
        raise ResourceError(f"{folder} belongs to another user")
    if not any(folder.iterdir()):
        (folder / TAG).write_bytes(TAGGED)
    if not (folder / TAG).is_file() or (folder / TAG).read_bytes() != TAGGED:
        raise ResourceError(f"{folder} was not made by fapengine, as it lacks our {TAG}")


def read_or_make(
    name: Callable[[], str], make: Callable[[], Made], read: Callable[[Path], Made], write: Callable[[Path, Made], None]
) -> Made:
    """Read from the cache what was made before; or make it, and write it there.

    A cache that cannot be used is reported once.

    Parameters
    ----------
    name : callable
        Name of the file or folder in the cache; called only if there is a cache.
    make, read, write : callable
        Called with its path, if with anything, and to write it with what was made.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    kept = folder / name()
    with suppress(FapEngineError, TypeError, *DAMAGE):  # missing, damaged or not ours: it is made again
        check_ours(folder)
        found = read(kept)
        with suppress(OSError):
            os.utime(kept)
        return found
    made = make()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_ours(folder)
        write(kept, made)
    except (FapEngineError, OSError) as error:
        _report(f"{CACHE_VARIABLE}: built heads are not kept: {error}")
    return made


@cache
def _report(text: str) -> None:
    """Log a warning, once."""
    log.warning(text)


def least_recently_used(paths: Iterable[Path]) -> list[Path]:
    """Return the paths beyond the :data:`MAX_KEPT` that were used last."""
    return sorted(paths, key=lambda path: path.stat().st_mtime, reverse=True)[MAX_KEPT:]


@cache
def sources() -> str:
    """Digest of the code and tables that make a head, as this process found them first."""
    import scipy  # not needed before

    digest = hashlib.sha256(f"{numpy.__version__} {scipy.__version__}".encode())
    package = Path(__file__).parent
    for folder in MADE_BY:
        for source in sorted((package / folder).rglob("*")):
            if source.suffix in MADE_OF:
                digest.update(source.read_bytes())
    return digest.hexdigest()
