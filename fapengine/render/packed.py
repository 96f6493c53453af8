"""Packed meshes, kept on disk beside the built heads: packing one takes 0.1 s, reading it a few milliseconds.

The key is the digest of the mesh and of all code that packs it; the texture is not kept, as the mesh has it. A file
that is missing or damaged is written again. Without a cache (see :mod:`fapengine._cache`), meshes are packed each time.
"""

import hashlib
import os
import re
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fapengine._arrays import unpack
from fapengine._cache import least_recently_used, read_or_make, sources
from fapengine.mesh.face_mesh import FaceMesh, iris_share
from fapengine.render.packing import PackedMesh, pack, skin_of

ARRAYS = ("vertices", "displacements", "normal_deltas")
PART = "part."
"""Prefix of the names of triangles."""
PACKED_BY = ("packing.py", "programs.py")
"""Files of this folder that define what is kept; others are in :func:`fapengine._cache.sources`."""
KEPT = re.compile(r"packed-[0-9a-f]{32}\.npz(\.[0-9a-f]{8})?")
"""Names of our files, and of those that a crash left unfinished."""


def packed_mesh(mesh: FaceMesh) -> PackedMesh:
    """Pack a mesh, or read what was packed before; errors as :func:`~fapengine.render.packing.pack`."""
    return read_or_make(
        lambda: f"packed-{_digest(mesh)}.npz", lambda: pack(mesh), lambda path: _read(path, mesh), _write
    )


def _read(path: Path, mesh: FaceMesh) -> PackedMesh:
    kept = unpack(path.read_bytes())
    return PackedMesh(
        **{name: kept[name] for name in ARRAYS},
        parts={name.removeprefix(PART): kept[name] for name in kept if name.startswith(PART)},
        skin=skin_of(mesh),
        texels_per_mm=float(kept["texels_per_mm"]),
        edge_mm=float(kept["edge_mm"]),
        iris=iris_share(mesh),
        iris_albedo=mesh.iris_albedo,
    )


def _write(path: Path, packed: PackedMesh) -> None:
    """Write a file that is complete or not there, and remove the oldest ones."""
    arrays: dict[str, Any] = {name: getattr(packed, name) for name in (*ARRAYS, "texels_per_mm", "edge_mm")}
    arrays |= {PART + name: triangles for name, triangles in packed.parts.items()}
    new = path.with_name(f"{path.name}.{os.urandom(4).hex()}")
    try:
        with new.open("xb") as file:
            np.savez(file, **arrays)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)
    ours = [each for each in path.parent.iterdir() if KEPT.fullmatch(each.name) and not each.is_symlink()]
    for old in least_recently_used(ours):
        old.unlink(missing_ok=True)


def _digest(mesh: FaceMesh) -> str:
    digest = hashlib.sha256(_program().encode())
    _feed(digest, mesh)
    return digest.hexdigest()[:32]


@cache
def _program() -> str:
    """Digest of all code that packs, as this process found it first."""
    digest = hashlib.sha256(sources().encode())
    for name in PACKED_BY:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    """Add an array with its shape, the fields of a dataclass, or the spelling of anything else."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str} {value.shape}".encode())
        digest.update(np.ascontiguousarray(value))
    elif is_dataclass(value):
        for field in fields(value):
            _feed(digest, getattr(value, field.name))
    else:
        digest.update(f"{value!r};".encode())
