"""Recordings and scans from paths; the ending selects the format, and the content must agree.

Sequences of meshes, as papers on 3D faces exchange them, and lists of their vertices are read here, too.
"""

import io
import logging
import mmap
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import DAMAGE
from fapengine._late import missing
from fapengine.capture.arrays import POSITION_NAMES, format_npz, parse_npz, unpack_npz
from fapengine.capture.articulography import parse_mview, parse_mview_sound, parse_pos
from fapengine.capture.bvh import parse_bvh
from fapengine.capture.c3d import Buffer, format_c3d, parse_c3d, parse_c3d_sound
from fapengine.capture.conventions import UNITS_MM, check_track, understand
from fapengine.capture.landmarks import Picture, parse_landmarks
from fapengine.capture.marker_track import MarkerTrack, RawTrack, RecordedSound
from fapengine.capture.table import format_table, format_trc, parse_table, parse_trc
from fapengine.errors import DataError, UsageError, as_data_error
from fapengine.files.paths import MAX_BYTES, locating, naming, open_file, read_bytes, write_bytes
from fapengine.geometry.surface import Surface
from fapengine.laboratory.setup import Paint
from fapengine.mesh.colours import linear_rgb
from fapengine.models.via_points import ViaPoints

PARSERS: dict[str, Callable[[bytes], RawTrack]] = {
    ".trc": parse_trc, ".csv": parse_table, ".tsv": parse_table, ".npz": parse_npz,
    ".pos": parse_pos, ".mat": parse_mview, ".bvh": parse_bvh,
}  # fmt: skip
"""Readers of markers by ending; C3D is mapped, and tracks of face landmarks need a picture's size."""
LANDMARK_ENDINGS = (".json", ".jsonl")
MIN_VIA_S, MAX_FRAMES_PER_VIA = 1e-4, 1000
"""Least distance of two via points, and mean number of frames per point: a small file cannot ask for gigabytes."""
RECORDINGS = (".c3d", *PARSERS, *LANDMARK_ENDINGS)
"""Endings of recordings; a folder of meshes is also a recording."""
MESHES = (".obj", ".ply", ".glb", ".gltf", ".stl")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recording, and warnings about it."""

    markers: MarkerTrack
    warnings: tuple[str, ...]
    via_points: int = 0
    """Number of via points from which the frames were interpolated; 0 for recorded frames."""


def load_markers(
    path: Path,
    *,
    units: str | None = None,
    up: str | None = None,
    rate_hz: float | None = None,
    picture: Picture | None = None,
) -> Recording:
    """Read a recording.

    Parameters
    ----------
    path : Path
        A file with an ending in :data:`RECORDINGS`, or a folder of meshes (:data:`MESHES`), one per frame, ordered by
        the numbers in their names.
    units, up, rate_hz
        As for :func:`fapengine.capture.conventions.understand`; a folder of meshes needs ``rate_hz``.
    picture : Picture, optional
        Scale of a track of face landmarks.

    Raises
    ------
    UsageError
        If the file cannot be read, or its ending is unknown.
    DataError
        If its content is wrong; ``where`` begins with the path.
    """
    with locating(path):
        raw = _meshes(path) if path.is_dir() else _parse(path, picture)
        via_points = 0 if raw.times_s is None else len(raw.times_s)
        if raw.times_s is not None:
            raw, rate_hz = _recovered(raw, raw.times_s, rate_hz), None
        track, notes = understand(raw, units=units, up=up, rate_hz=rate_hz)
    return Recording(track, (*notes, *check_track(track)), via_points)


def _recovered(raw: RawTrack, times_s: NDArray[np.float64], rate_hz: float | None) -> RawTrack:
    """Sample the motion through via points: at the rate that is asked for, or that of the reduced take."""
    rate_hz = rate_hz or raw.rate_hz
    if rate_hz is None:
        raise DataError("via points: the file does not state the take's rate; give one, or reduce the take again")
    is_regular = times_s.dtype.kind == "f" and times_s.shape == (len(raw.positions),) and np.isfinite(times_s).all()
    if not is_regular or (np.diff(times_s) < MIN_VIA_S).any() or not np.isfinite(raw.positions).all():
        raise DataError(f"via points: must be finite, with a time each, strictly rising by {MIN_VIA_S:g} s or more")
    if times_s[-1] < 0:
        raise DataError(f"via points: the last is at {times_s[-1]:g} s, expected 0 s or later")
    if abs(times_s).max() * rate_hz > MAX_FRAMES_PER_VIA * len(times_s):
        raise DataError(f"via points: {len(times_s)} in {times_s[-1]:g} s at {rate_hz:g} Hz are too far apart")
    with as_data_error("via points: "):
        points = ViaPoints(times_s=times_s, positions_mm=raw.positions)
    return replace(raw, positions=points.frames(rate_hz), rate_hz=rate_hz, times_s=None)


def _parse(path: Path, picture: Picture | None) -> RawTrack:
    ending = path.suffix.lower()
    if ending == ".c3d":
        return _mapped_c3d(path, parse_c3d)
    if ending in LANDMARK_ENDINGS or (picture is not None and ending in (".csv", ".tsv")):
        if picture is None:
            raise DataError(
                "landmarks: got no picture size and scale, expected [landmarks] in session.toml: landmarks are"
                " fractions of an image, not millimetres"
            )
        return parse_landmarks(read_bytes(path), picture)
    if ending not in PARSERS:
        if not ending:
            open_file(path).close()  # raises UsageError for a folder that does not exist
        raise UsageError(f"{path}: got ending {ending!r}, expected one of {', '.join(RECORDINGS)}")
    return PARSERS[ending](read_bytes(path))


def is_table(path: Path) -> bool:
    """Whether a file is a table of markers, by its header."""
    if path.suffix.lower() not in (".csv", ".tsv") or not path.is_file():
        return False
    try:
        parse_table(read_bytes(path))
    except DataError:
        return False
    return True


def load_recorded_sound(path: Path) -> RecordedSound | None:
    """Read the sound that a C3D or MVIEW file has beside its positions; None without one. Raises as load_markers."""
    with locating(path):
        if path.suffix.lower() == ".c3d":
            return _mapped_c3d(path, parse_c3d_sound)
        return parse_mview_sound(read_bytes(path)) if path.suffix.lower() == ".mat" else None


T = TypeVar("T")


def _mapped_c3d(path: Path, parse: Callable[[Buffer], T]) -> T:
    """Map the file into memory: what is not wanted is never read."""
    try:
        if not path.stat().st_size:
            return parse(b"")
        with (
            open_file(path) as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped,
            memoryview(mapped) as view,
        ):
            return parse(view)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error


def save_markers(path: Path, track: MarkerTrack, *, long: bool = False) -> None:
    """Write a recording; the ending selects the format: .c3d, .trc, .csv, .tsv or .npz.

    Raises
    ------
    UsageError
        For another ending.
    ResourceError
        If it cannot be written.
    """
    ending = path.suffix.lower()
    writers: dict[str, Callable[[MarkerTrack], bytes]] = {
        ".c3d": format_c3d, ".trc": format_trc, ".npz": format_npz,
        ".csv": partial(format_table, long=long), ".tsv": partial(format_table, long=long, delimiter="\t"),
    }  # fmt: skip
    if ending not in writers:
        raise UsageError(f"{path}: got ending {ending!r}, expected .c3d, .trc, .csv, .tsv or .npz")
    write_bytes(path, writers[ending](track))


def mesh_files(folder: Path) -> list[Path]:
    """Meshes of a folder, ordered by the last number in their names."""

    def key(path: Path) -> tuple[int, str]:
        return int((re.findall(r"\d+", path.stem) or [-1])[-1]), path.name

    return sorted((path for path in folder.iterdir() if path.suffix.lower() in MESHES), key=key)


def _meshes(folder: Path) -> RawTrack:
    paths = mesh_files(folder)
    if not paths:
        raise DataError(f"mesh sequence: contains no mesh ({', '.join(MESHES)})")
    frames = [load_mesh(path)[0] for path in paths]
    counts = [len(frame) for frame in frames]
    odd = next((n for n, count in enumerate(counts) if count != counts[0]), None)
    if odd is not None:
        raise DataError(
            f"mesh sequence: got {counts[odd]} vertices, expected {counts[0]} as in {paths[0].name}",
            where=paths[odd].name,
        )
    return RawTrack(
        positions=np.stack(frames),
        labels=tuple(f"v{index}" for index in range(counts[0])),
        notes=("every vertex counts as a marker: map some to feature points in session.toml",),
    )


def load_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], Any]:
    """Vertices (V, 3), in the order of the file, triangles (F, 3), and trimesh's visuals.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it contains no mesh.
    ResourceError
        If trimesh is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise missing("trimesh", "meshes") from error
    open_file(path, MAX_BYTES).close()  # raises UsageError for a file that trimesh should not read
    if path.suffix.lower() == ".obj":
        _check_indices(read_bytes(path), path)
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints tracebacks before our message
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of NumPy, for a part without texture coordinates
            mesh: Any = _loaded(path, trimesh, maintain_order=True)
            if isinstance(mesh, trimesh.Scene):
                mesh = _one_mesh(mesh, path, trimesh) if path.suffix.lower() == ".obj" else mesh.to_mesh()
        vertices, triangles = np.array(mesh.vertices, np.float64), np.array(getattr(mesh, "faces", ()), np.int64)
    except Exception as error:  # whatever the library fails with, the file is at fault
        raise DataError(f"mesh: cannot be understood ({type(error).__name__}: {error})", where=str(path)) from error
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not len(vertices) or not np.isfinite(vertices).all():
        raise DataError(f"mesh: got vertices of shape {vertices.shape}, expected finite (V, 3)", where=str(path))
    if not len(triangles):
        raise DataError("mesh: contains no triangles", where=str(path))
    return vertices, triangles, mesh.visual


def _loaded(path: Path, trimesh: Any, *, maintain_order: bool = False) -> Any:
    if path.suffix.lower() != ".obj":
        return trimesh.load(path, process=False, maintain_order=maintain_order)
    file, resolver = io.BytesIO(_with_material(read_bytes(path), path)), trimesh.resolvers.FilePathResolver(str(path))
    return trimesh.load(file, file_type="obj", resolver=resolver, process=False, maintain_order=maintain_order)


def load_textured(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], Any, NDArray[np.int64]]:
    """Read a mesh as :func:`load_mesh` does, and the vertex of the file that each vertex is.

    Along the seams of the image of an OBJ with one material, further copies of vertices follow those of the file.
    """
    vertices, triangles, visual = load_mesh(path)
    own = np.arange(len(vertices))
    if path.suffix.lower() != ".obj" or getattr(getattr(visual, "material", None), "image", None) is None:
        return vertices, triangles, visual, own
    import trimesh

    painted = _loaded(path, trimesh)  # a vertex for each of its texture coordinates, in another order
    uv = getattr(painted.visual, "uv", None) if isinstance(painted, trimesh.Trimesh) else None
    if uv is None or np.shape(painted.faces) != triangles.shape:
        return vertices, triangles, visual, own
    source = np.zeros(len(painted.vertices), np.int64)
    source[painted.faces] = triangles
    copies = np.setdiff1d(np.arange(len(source)), np.unique(source, return_index=True)[1])
    place = source.copy()
    place[copies] = len(vertices) + np.arange(len(copies))
    both = np.concatenate([own, source[copies]])
    placed = np.zeros((len(both), 2))
    placed[place] = uv
    visual.uv = placed
    return vertices[both], place[painted.faces], visual, both


def _one_mesh(scene: Any, path: Path, trimesh: Any) -> Any:
    """Join the parts of an OBJ file, one a material; in the file's order each has the vertices of the file.

    Those are kept once: else there would be as many copies as materials, and cuts between these. A vertex gets the
    colour of its material, or that of the image there: in the file's order trimesh drops many texture coordinates, in
    its own it keeps all.
    """
    parts = list(scene.geometry.values())
    vertices = max((part.vertices for part in parts), key=len, default=np.zeros((0, 3)))
    if not all(np.array_equal(part.vertices, vertices[: len(part.vertices)]) for part in parts):
        return scene.to_mesh()
    colours = np.full((len(vertices), 4), 255, np.uint8)
    materials = {name: getattr(part.visual, "material", None) for name, part in scene.geometry.items()}
    images = {name for name, material in materials.items() if getattr(material, "image", None) is not None}
    painted = trimesh.load(path, process=False).geometry if images else {}
    for name, part in scene.geometry.items():
        used, material = np.unique(part.faces), materials[name]
        if name in images and getattr(painted[name].visual, "uv", None) is not None:
            nearest = painted[name].kdtree.query(vertices[used])[1]
            colours[used] = painted[name].visual.to_color().vertex_colors[nearest]
            continue
        colours[used] = part.visual.vertex_colors[used] if material is None else material.main_color
    faces = np.concatenate([part.faces for part in parts])
    return trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)


_LIBRARY = re.compile(rb"^mtllib[ \t]+(.+)", re.MULTILINE)


def library_of(data: bytes, path: Path) -> bytes:
    """Text of the materials that an OBJ names, which are in its folder; empty without any."""
    named = _LIBRARY.search(data)
    try:
        beside = path.with_name(Path(named[1].strip().decode("utf-8", "replace")).name) if named else path
        return read_bytes(beside) if named and beside.is_file() else b""
    except (OSError, ValueError):  # no name of a file
        return b""


def _with_material(data: bytes, path: Path) -> bytes:
    """Let an OBJ that uses no material of its library, as FLAME's and VOCA's, use the first."""
    first = re.search(rb"^[ \t]*newmtl[ \t]+(.+)", library_of(data, path), re.MULTILINE)
    if first is None or re.search(rb"^usemtl\b", data, re.MULTILINE):
        return data
    return _LIBRARY.sub(rb"\g<0>\nusemtl " + first[1].strip().replace(b"\\", b"\\\\"), data, count=1)


def _check_indices(data: bytes, path: Path) -> None:
    """Reject an OBJ file with an index that has more digits than the file's size: trimesh would allocate that much."""
    if found := re.search(rb"^[ \t]*f[ \t][^\n]*?(\d{%d,})" % (len(str(len(data))) + 1), data, re.MULTILINE):
        raise DataError(f"mesh: got index {found[1][:20].decode()} in {len(data)} bytes", where=str(path))


def load_surface(path: Path, *, units: str = "mm") -> Surface:
    """Read a scan.

    Raises
    ------
    UsageError
        If the file cannot be read or the unit is unknown.
    DataError
        If it contains no triangles.
    ResourceError
        If trimesh is not installed.
    """
    return load_painted(path, units=units)[0]


def load_painted(path: Path, *, units: str = "mm") -> tuple[Surface, Paint | None]:
    """Read a scan and its colours, if it has any. Raises as :func:`load_surface`."""
    if units not in UNITS_MM:
        raise UsageError(f"units: got {units!r}, expected one of {', '.join(UNITS_MM)}")
    vertices, triangles, visual = load_mesh(path)
    with as_data_error(where=str(path)):
        return Surface(vertices * UNITS_MM[units], triangles), find_paint(visual, len(vertices))


def find_paint(visual: Any, count: int) -> Paint | None:
    """Find the colours of a mesh of ``count`` vertices; None if the file has none."""
    texture, uv = _painting(visual, count)
    if texture is not None:
        return Paint(uv=uv, texture=texture)
    albedo = _albedo(visual)
    return None if albedo is None or len(albedo) != count else Paint(albedo=albedo)


def _painting(visual: Any, count: int) -> tuple[NDArray[np.uint8] | None, NDArray[np.float64] | None]:
    """Texture and texture coordinates, (V, 2), of a mesh with one material; trimesh counts v from the bottom."""
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is None or uv is None or np.shape(uv) != (count, 2) or not np.isfinite(uv).all():
        return None, None
    texture = np.asarray(image.convert("RGBA"), np.uint8)
    if np.ptp(texture, axis=(0, 1)).max() == 0:
        return None, None  # a single colour is a default
    return texture, np.asarray(uv, np.float64) * [1.0, -1.0] + [0.0, 1.0]


def _albedo(visual: Any) -> NDArray[np.float64] | None:
    """Linear RGB of each vertex, (V, 3); None if the file has no colours."""
    try:
        coloured = visual.to_color() if hasattr(visual, "to_color") else visual
    except IndexError:  # texture coordinates of one number
        return None
    if not getattr(coloured, "defined", False):  # a material whose image is missing has no colours either
        return None
    srgb = np.asarray(coloured.vertex_colors, np.float64)[:, :3] / 255.0
    if np.ptp(srgb, axis=0).max() == 0.0:
        return None  # a single colour is a default
    return linear_rgb(srgb)


ARRAYS = (".npy", ".npz")


def is_mesh_sequence(path: Path) -> bool:
    """Whether a path is that of arrays of vertices, or of a folder of meshes, a mesh per frame."""
    return path.suffix.lower() in ARRAYS or (path.is_dir() and bool(mesh_files(path)))


def load_vertices(path: Path) -> NDArray[Any]:
    """Read positions of vertices, (T, V, 3) or as the file holds them, in the file's unit.

    Parameters
    ----------
    path : Path
        ``.npy``; ``.npz`` with one array, or one named as in a recording; a folder of meshes, ordered by the numbers in
        their names; or one mesh, whose positions are (1, V, 3).

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If its content is wrong.
    ResourceError
        If trimesh is needed and not installed.
    """
    if path.is_dir() or path.suffix.lower() in MESHES:
        frames = [load_mesh(file)[0] for file in (mesh_files(path) if path.is_dir() else [path])]
        counts = {len(frame) for frame in frames}
        if len(counts) != 1:
            raise DataError(f"{path}: got meshes of {sorted(counts)} vertices, expected one number")
        return np.stack(frames)
    with naming(path):
        return _array(read_bytes(path))


def _array(data: bytes) -> NDArray[Any]:
    if data[:2] != b"PK":
        try:
            return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
        except (*DAMAGE, MemoryError) as error:
            raise DataError(f"NPY: damaged, or contains Python objects: {error}") from error
    arrays = unpack_npz(data)
    name = next((name for name in ("vertices", *POSITION_NAMES) if name in arrays), None)
    if name is None and len(arrays) != 1:
        raise DataError(f"NPZ: got arrays {sorted(arrays)}, expected one, or one called vertices")
    return arrays[name or next(iter(arrays))]


def load_indices(path: Path) -> NDArray[np.int64]:
    """Read vertex indices: a text of whole numbers, separated by commas or white space, or an array of them (``.npy``).

    Returns
    -------
    (N,) int64

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it contains something else.
    """
    data = read_bytes(path)
    with naming(path):
        if path.suffix.lower() in ARRAYS:
            array = _array(data)
            array = np.flatnonzero(array) if array.dtype == bool else array.reshape(-1)
            if array.dtype.kind not in "iu":
                raise DataError(f"indices: got {array.dtype}, expected whole numbers, or true and false")
            return array.astype(np.int64)
        words = data.replace(b",", b" ").split()
        try:
            return np.array([int(word) for word in words], np.int64)
        except (ValueError, OverflowError) as error:
            raise DataError(f"indices: got {error}, expected whole numbers") from error
