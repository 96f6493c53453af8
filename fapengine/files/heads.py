"""Heads of one's own: a mesh file and its feature points in, a head folder out, and back.

A head is a folder: ``head.toml`` (schema, name, source, licence) and ``head.npz`` (all arrays of the mesh, float32).
"""

import csv
import hashlib
import io
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine._toml import parse_toml, quoted
from fapengine.capture.arrays import DAMAGE
from fapengine.errors import DataError, ProfileError, UsageError
from fapengine.files.paths import read_bytes, write_bytes
from fapengine.files.recordings import MESHES, load_mesh
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh
from fapengine.mesh.head import build_head
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES

SCHEMA = 1
TOML_NAME, ARRAYS_NAME = "head.toml", "head.npz"
DEFAULT_HEAD = "default"
ARRAYS = tuple(field.name for field in fields(FaceMesh) if field.name not in ("feature_points", "fapu", "basis"))
NEAREST_SHARE = 0.05
"""A feature point given as a place must have a vertex within this share of the mesh's size."""


def load_face_file(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64] | None]:
    """Read a mesh with its colours.

    Returns
    -------
    vertices : (V, 3) float64
        In the file's order, units and axes.
    triangles : (F, 3) int64
    albedo : (V, 3) float64 or None
        Linear RGB from vertex colours or the base colour texture; None where the file has neither.

    Raises
    ------
    UsageError
        If it cannot be read or its ending is unknown.
    DataError
        If it holds no mesh.
    ResourceError
        If trimesh is not installed.
    """
    if path.suffix.lower() not in MESHES:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(MESHES)}")
    vertices, triangles, visual = load_mesh(path)
    if not len(triangles):
        raise DataError("mesh: got no triangle, expected a face", where=str(path))
    return vertices, triangles, _albedo(visual)


def _albedo(visual: Any) -> NDArray[np.float64] | None:
    """Linear RGB of each vertex; None where the file says nothing about colour."""
    if not getattr(visual, "defined", False):
        return None
    coloured = visual.to_color() if hasattr(visual, "to_color") else visual
    srgb = np.asarray(coloured.vertex_colors, np.float64)[:, :3] / 255.0
    if np.ptp(srgb, axis=0).max() == 0.0:
        return None  # one colour for all is a default, not a painting
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def load_feature_points(path: Path, vertices: NDArray[np.float64]) -> dict[str, int]:
    """Read a table of feature points: columns ``point, vertex``, or ``point, x, y, z`` in the mesh's own units.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        For an unknown or repeated point, or a place away from the mesh; ``where`` is the line.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text), skipinitialspace=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"feature points: is no table ({error})", where=str(path)) from error
    tree, size = cKDTree(vertices), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    found: dict[str, int] = {}
    for line, row in enumerate(rows, 2):
        where = f"{path}, line {line}"
        name = (row.get("point") or "").strip()
        if name not in FEATURE_POINT_NAMES or name in found:
            raise DataError(f"point: got {name!r}, expected a feature point such as 8.2, once", where=where)
        try:
            if row.get("vertex"):
                found[name] = int(row["vertex"])
                continue
            place = np.array([float(row[axis]) for axis in "xyz"])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{name}: got {row}, expected a vertex, or x, y and z", where=where) from error
        distance, index = tree.query(place) if np.isfinite(place).all() else (np.inf, 0)
        if not distance <= NEAREST_SHARE * size:
            raise DataError(f"{name}: got {place.tolist()}, {distance:.4g} away from the mesh", where=where)
        found[name] = int(index)
    return found


def save_head(folder: Path, mesh: FaceMesh, *, source: str, licence: str) -> None:
    """Write a head.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    basis, buffer = mesh.basis, io.BytesIO()
    arrays: dict[str, Any] = {name: getattr(mesh, name) for name in ARRAYS}
    channels = np.array([(channel.fap, channel.start, channel.stop) for channel in basis.channels])
    points = {
        "point_names": np.array(list(mesh.feature_points)),
        "point_vertices": np.array([*mesh.feature_points.values()]),
    }
    lengths = np.array([getattr(mesh.fapu, field.name) for field in fields(Fapu)])
    arrays |= points | {
        "channels": channels, "offsets": basis.offsets, "entry_channels": basis.entry_channels,
        "entry_mm": basis.entry_mm, "fapu_mm": lengths,
    }  # fmt: skip
    np.savez_compressed(buffer, **arrays)
    data = buffer.getvalue()
    toml = (
        f'schema = {SCHEMA}\nsource = {quoted(source)}\nlicence = {quoted(licence)}\nfile = "{ARRAYS_NAME}"\n'
        f'sha256 = "{hashlib.sha256(data).hexdigest()}"\n'
    )
    write_bytes(folder / ARRAYS_NAME, data)
    write_bytes(folder / TOML_NAME, toml.encode())


def load_head(name: str) -> FaceMesh:
    """Load a head's folder; ``"default"`` is our own.

    Raises
    ------
    UsageError
        If there is no such folder.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    if name == DEFAULT_HEAD:
        return build_head()
    folder = Path(name)
    if not (folder / TOML_NAME).is_file():
        raise UsageError(
            f"head: got {name!r}, expected {DEFAULT_HEAD!r} or a folder that `fapengine head import` wrote"
        )
    table = parse_toml(read_bytes(folder / TOML_NAME), str(folder / TOML_NAME), ProfileError)
    if (schema := table.take("schema", int)) != SCHEMA:
        raise table.fail("schema", f"got {schema}, expected {SCHEMA}")
    for key in ("source", "licence"):
        table.take(key, str)
    data = read_bytes(folder / table.take("file", str))
    digest = table.take("sha256", str)
    table.finish()
    if (found := hashlib.sha256(data).hexdigest()) != digest:
        raise table.fail("sha256", f"got {found}, expected {digest}")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return _mesh({name: arrays[name] for name in arrays.files})
    except DAMAGE as error:
        raise ProfileError(f"arrays: {error}", where=str(folder / ARRAYS_NAME)) from error


def _mesh(arrays: dict[str, Any]) -> FaceMesh:
    channels = tuple(Channel(int(number), float(start), float(stop)) for number, start, stop in arrays["channels"])
    names = [str(name) for name in arrays["point_names"]]
    return FaceMesh(
        **{name: arrays[name] for name in ARRAYS},
        feature_points=dict(zip(names, map(int, arrays["point_vertices"]), strict=True)),
        fapu=Fapu(*map(float, arrays["fapu_mm"])),
        basis=DeformationBasis(
            channels=channels,
            offsets=arrays["offsets"],
            entry_channels=arrays["entry_channels"],
            entry_mm=arrays["entry_mm"],
        ),
    )
