"""Heads of one's own: a mesh file in, a head folder out, and back.

A head is a folder: ``head.toml`` (schema, source, licence, what of the file was used), ``head.npz`` (all arrays of the
mesh, float32) and, where it is painted, ``head.png``.
"""

import csv
import hashlib
import io
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from fapengine._toml import parse_toml, quoted
from fapengine.capture.arrays import DAMAGE
from fapengine.errors import DataError, ProfileError, UnsupportedError, UsageError
from fapengine.files.gltf_textures import MOST_PIXELS, opened
from fapengine.files.heads_rigs import is_rig, load_mapping, load_rig
from fapengine.files.paths import read_bytes, write_bytes
from fapengine.files.recordings import MESHES, load_mesh
from fapengine.mesh.adopted import Adopted
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh
from fapengine.mesh.head import LEVELS, build_head
from fapengine.mesh.morphs import MorphMesh
from fapengine.mesh.morphs_adopt import adopt_morphs
from fapengine.mesh.morphs_axes import BOTH, JAW, LEFT, RIGHT
from fapengine.mesh.morphs_locate import locate
from fapengine.mesh.morphs_names import Choice, choose
from fapengine.mesh.style import parse_look
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES
from fapengine.retarget.arkit import ARKIT_NAMES

SCHEMA = 2
TOML_NAME, ARRAYS_NAME, TEXTURE_NAME = "head.toml", "head.npz", "head.png"
DEFAULT_HEAD = "default"
ARRAYS = tuple(
    field.name for field in fields(FaceMesh) if field.name not in ("feature_points", "fapu", "basis", "texture")
)
LARGEST_BYTES = 1 << 30
"""Of a head's arrays, unpacked; a small archive cannot ask for more."""
NEAREST_SHARE = 0.05
"""A feature point given as a place must have a vertex within this share of the mesh's size."""


def load_neutral(path: Path) -> MorphMesh:
    """Read a mesh without shapes, with its colours.

    Returns
    -------
    MorphMesh
        Vertices in the file's order, units and axes; its texture, or the colours of its vertices, where it has any.

    Raises
    ------
    UsageError
        If it cannot be read or its ending is unknown.
    DataError
        If it holds no mesh, or a texture too large to be read again.
    ResourceError
        If trimesh is not installed.
    """
    if path.suffix.lower() not in MESHES:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(MESHES)}")
    vertices, triangles, visual = load_mesh(path)
    texture, uv = _texture(visual, len(vertices))
    if texture is not None and texture.shape[0] * texture.shape[1] > MOST_PIXELS:
        size = f"{texture.shape[1]}x{texture.shape[0]}"
        raise UnsupportedError(f"texture: got {size} pixels, expected at most {MOST_PIXELS}", where=str(path))
    albedo = None if texture is not None else _albedo(visual)
    return MorphMesh(vertices=vertices, triangles=triangles, shapes={}, texture=texture, uv=uv, albedo=albedo)


def _texture(visual: Any, count: int) -> tuple[NDArray[np.uint8] | None, NDArray[np.float64] | None]:
    """Picture and places in it of a mesh with one material; trimesh counts v from below."""
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is None or uv is None or np.shape(uv) != (count, 2) or not np.isfinite(uv).all():
        return None, None
    return np.asarray(image.convert("RGBA"), np.uint8), np.asarray(uv, np.float64) * [1.0, -1.0] + [0.0, 1.0]


def _albedo(visual: Any) -> NDArray[np.float64] | None:
    """Linear RGB of each vertex; None where the file says nothing about colour."""
    coloured = visual.to_color() if hasattr(visual, "to_color") else visual
    if not getattr(coloured, "defined", False):  # a material whose picture is not there has no colours either
        return None
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


@dataclass(frozen=True, slots=True)
class HeadInfo:
    """Where a head comes from, and what of its file moves it."""

    source: str
    licence: str
    used: tuple[str, ...] = ()
    """Shapes that FAPs blend."""
    lacking: tuple[str, ...] = ()
    """ARKit's shapes that it does not have."""


def adopt_file(path: Path, points: Path | None = None, mapping: Path | None = None) -> tuple[Adopted, HeadInfo]:
    """Make a head of a file: by its shapes, where it has some that are known, else by feature points.

    Parameters
    ----------
    path : Path
        A mesh, or ICT-FaceKit's folder.
    points : Path, optional
        Table of feature points; needed for a mesh without shapes. With shapes, its points go before those found.
    mapping : Path, optional
        What shapes with other names mean.

    Raises
    ------
    UsageError
        If a file cannot be read, or a mesh without shapes comes without points.
    DataError
        If its content is wrong, or no face can be made of it; ``where`` is the file.
    ResourceError
        If trimesh is needed and not installed.
    """
    if is_rig(path):
        rig = load_rig(path)
        moving = [name for name, shape in rig.shapes.items() if len(shape.vertices)]
        choice = choose(moving, ARKIT_NAMES, load_mapping(mapping) if mapping else None)
        absent = [name for name in choice.given if name not in rig.shapes]
        if absent:
            raise DataError(f"mapping: got shape {absent[0]!r}, which the mesh does not have", where=str(mapping))
        if choice.blended or choice.given or points is not None:
            return _adopt_rig(path, rig, choice, points)
        shown = ", ".join(list(rig.shapes)[:8]) or "none"
        raise DataError(
            f"shapes: got {shown}; expected some that are named as ARKit's, Oculus' or VRM's, a mapping file"
            " (--map), or feature points (--points)",
            where=str(path),
        )
    if points is None:
        raise UsageError(f"{path}: has no shapes, so its feature points are needed (--points)")
    return _adopt_rig(path, load_neutral(path), choose((), ARKIT_NAMES), points)


def _adopt_rig(path: Path, rig: MorphMesh, choice: Choice, points: Path | None) -> tuple[Adopted, HeadInfo]:
    standard = build_head()
    marked = load_feature_points(points, rig.vertices) if points else {}
    moves = {
        role: rig.dense(names[0])
        for role, names in ((LEFT, choice.left), (RIGHT, choice.right), (BOTH, choice.both), (JAW, choice.jaw))
        if names
    }
    try:
        found: dict[str, int] = {}
        try:
            found = locate(rig, moves, standard)
        except DataError:
            if points is None:  # with points of one's own, none need be found
                raise
        taken = set(marked.values())
        found = {name: vertex for name, vertex in found.items() if vertex not in taken} | marked
        adopted = adopt_morphs(rig, choice.blended, found, standard, choice.given)
    except DataError as error:
        raise type(error)(error.message, where=str(path)) from error
    return adopted, HeadInfo(path.name, "", adopted.used, choice.missing if adopted.used else ())


def save_head(folder: Path, mesh: FaceMesh, info: HeadInfo) -> None:
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
    if basis.mix is not None:
        arrays["mix"] = basis.mix
    np.savez_compressed(buffer, **arrays)
    files = {ARRAYS_NAME: buffer.getvalue()}
    if mesh.texture is not None:
        files[TEXTURE_NAME] = _png(mesh.texture)
    lines = [f"schema = {SCHEMA}", f"source = {quoted(info.source)}", f"licence = {quoted(info.licence)}"]
    lines += [f"{key} = [{', '.join(map(quoted, getattr(info, key)))}]" for key in ("used", "lacking")]
    lines += [
        "[sha256]",
        *(f"{quoted(name)} = {quoted(hashlib.sha256(data).hexdigest())}" for name, data in files.items()),
    ]
    for name, data in files.items():
        write_bytes(folder / name, data)
    write_bytes(folder / TOML_NAME, ("\n".join(lines) + "\n").encode())


def _png(texture: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(texture).save(buffer, "PNG", compress_level=3)
    return buffer.getvalue()


def load_head(name: str) -> FaceMesh:
    """Load a head's folder; ``"default"`` is our own, ``"default:age=0.8,level=fine"`` it with another look.

    Raises
    ------
    UsageError
        If there is no such folder or look.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    if _is_ours(name):
        style, level = parse_look(name[len(DEFAULT_HEAD) + 1 :])
        return build_head(style, level=level)
    _, files = _read(name)
    folder = Path(name)
    texture = None
    if TEXTURE_NAME in files:
        where = str(folder / TEXTURE_NAME)
        try:
            with opened(files[TEXTURE_NAME], ("PNG",), where) as image:
                texture = np.asarray(image, np.uint8)
        except DataError as error:
            raise ProfileError(error.message, where=where) from error
    try:
        return _mesh(_arrays(files[ARRAYS_NAME]), texture)
    except (*DAMAGE, TypeError, OverflowError, MemoryError) as error:  # arrays may be of any shape
        raise ProfileError(f"arrays: {error}", where=str(folder / ARRAYS_NAME)) from error


def load_levels(name: str) -> list[FaceMesh]:
    """Load a head and, if it is our own, its coarsest level of detail after it; a folder holds one level.

    Raises as :func:`load_head`.
    """
    levels = [load_head(name)]
    if _is_ours(name):
        style, level = parse_look(name[len(DEFAULT_HEAD) + 1 :])
        coarsest = next(iter(LEVELS))
        if level != coarsest:
            levels.append(build_head(style, level=coarsest))
    return levels


def load_head_info(name: str) -> HeadInfo:
    """Tell where a head comes from. Raises as :func:`load_head`."""
    return HeadInfo("fapengine", "Apache-2.0") if _is_ours(name) else _read(name)[0]


def _is_ours(name: str) -> bool:
    return name == DEFAULT_HEAD or name.startswith(f"{DEFAULT_HEAD}:")


def _read(name: str) -> tuple[HeadInfo, dict[str, bytes]]:
    folder = Path(name)
    if not (folder / TOML_NAME).is_file():
        raise UsageError(
            f"head: got {name!r}, expected {DEFAULT_HEAD!r} or a folder that `fapengine head import` wrote"
        )
    table = parse_toml(read_bytes(folder / TOML_NAME), str(folder / TOML_NAME), ProfileError)
    if (schema := table.take("schema", int)) != SCHEMA:
        raise table.fail("schema", f"got {schema}, expected {SCHEMA}: import the head again")
    info = HeadInfo(
        table.take("source", str), table.take("licence", str), table.strings("used"), table.strings("lacking")
    )
    hashes = table.table("sha256")
    table.finish()
    digests = {key: hashes.take(key, str) for key in hashes}
    if ARRAYS_NAME not in digests or set(digests) - {ARRAYS_NAME, TEXTURE_NAME}:
        raise table.fail(
            "sha256", f"got {', '.join(digests) or 'none'}, expected {ARRAYS_NAME} and {TEXTURE_NAME} alone"
        )
    files = {key: read_bytes(folder / key) for key in digests}
    for key, data in files.items():
        if (found := hashlib.sha256(data).hexdigest()) != digests[key]:
            raise hashes.fail(key, f"got {found}, expected {digests[key]}")
    return info, files


def _arrays(data: bytes) -> dict[str, Any]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST_BYTES:
        raise DataError(f"got {size} bytes unpacked, expected at most {LARGEST_BYTES}")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _mesh(arrays: dict[str, Any], texture: NDArray[np.uint8] | None) -> FaceMesh:
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
            mix=arrays.get("mix"),
        ),
        texture=texture,
    )
