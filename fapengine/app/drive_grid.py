"""A face driven by a few of its markers, from a recording to arrays and a video: paper 000, section 5."""

import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.moving import check_moving, is_moving, write_moving
from fapengine.files.paths import write_bytes
from fapengine.files.pictures import straight
from fapengine.files.recordings import load_markers, load_surface, mesh_files
from fapengine.geometry.rigid import RigidMotion
from fapengine.geometry.surface import vertex_normals
from fapengine.laboratory.few_markers import Choice, FaceGrid, choose_markers, displacements, facing, make_grid
from fapengine.laboratory.marker_driver import HeadReference
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import BONE_COUNT, Pose
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh, Material
from fapengine.render.drawing import Drawing
from fapengine.render.renderer import CrowdRenderer

Array = NDArray[np.float64]

HELD_OUT = 0.25
"""Fraction of a recording, at its end, that is driven and scored, if there is no other take."""
DRIVING, DRIVEN, SKIN = (0.75, 0.06, 0.04), (0.9, 0.9, 0.9), (0.50, 0.30, 0.22)
"""Linear RGB of driving and driven markers, and of the surface."""
DOT_MM = {True: 2.6, False: 1.2}
"""Radius of a driving and of a driven marker's dot."""
MAX_DOTS = 400
"""Number of markers above which driven ones have no dot."""
OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
FACETS = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
MAX_WEIGHTS = 128
"""Weights that a renderer takes."""
WIDEST_MM = 170.0
"""Width of a face that fills the image."""
PLACE_MM = np.array([0.0, 20.0, 60.0])
"""Position of the middle of the face in the video, head space."""
MOVED_BONES = np.tile(np.eye(4), (BONE_COUNT, 1, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveJob:
    """Input, output and options of a driven grid."""

    grid: Path
    """Recording of all points to learn from, or a folder of meshes."""
    output: Path
    """Archive of arrays (.npz)."""
    markers: tuple[str, ...] | int | None = None
    """Labels or number of the driving markers; None: chosen by the error."""
    take: Path | None = None
    """Driving recording; None: the last quarter of ``grid``."""
    film: Path | None = None
    skull: tuple[str, ...] = ()
    """Markers on the skull; empty: the recording has no head motion."""
    columns: int = 48
    """Points of the grid from left to right."""
    tolerance_mm: float = 0.35
    rate_hz: float | None = None
    """Frame rate of a folder of meshes."""
    seed: int = 1


@dataclass(frozen=True, slots=True)
class DriveReport:
    """The driving markers, and the errors of the others."""

    markers: tuple[str, ...]
    reason: str
    learned_frames: int
    driven_frames: int
    points: int
    """Number of points of the surface."""
    mean_mm: float | None = None
    """Mean distance of driven from recorded markers; None if all markers drive."""
    p95_mm: float | None = None
    largest_mm: float | None = None
    worst: str | None = None
    """Marker with the largest mean error."""
    still_mm: float | None = None
    """Mean distance for a still face."""


def run_drive(job: DriveJob, drawing: Drawing) -> DriveReport:
    """Learn the weights, drive the face, and write arrays and video.

    The archive has ``positions`` (T, M, 3) mm of all markers as they were driven (left, up, out), ``labels``,
    ``rate_hz`` and ``units`` (so it is a recording too), ``driving`` (labels), ``weights`` (k, M), ``error_mm`` (M,),
    and the surface:
    ``grid_mm`` (N, 3), ``grid_triangles`` (F, 3), ``grid_weights`` (k, N).
    """
    if job.output.suffix != ".npz":
        raise UsageError(f"output: got {job.output}, expected a name that ends with .npz")
    if job.film is not None and not is_moving(job.film):
        raise UsageError(f"film: got {job.film}, expected a video, an animation or an image sequence")
    track = load_markers(job.grid, rate_hz=job.rate_hz).markers
    unknown = [name for name in job.skull if name not in track.labels]
    if unknown:
        raise UsageError(f"skull: unknown marker {unknown[0]!r}; use some of {', '.join(track.labels[:12])}")
    labels = tuple(name for name in track.labels if name not in job.skull)
    reference = _reference(track, job.skull)
    rest, moved = _freed(track, labels, reference, job.grid)
    head = load_built(HeadStyle())
    face_mm = {name: head.point_mm(name).astype(np.float64) for name in head.feature_points}
    axes = facing(rest, labels, face_mm)  # from here on: left, up, out
    rest, moved = rest @ axes.T, moved @ axes.T
    learned = len(moved) if job.take else max(2, round((1 - HELD_OUT) * len(moved)))
    choice = choose_markers(
        moved[:learned], rest, _wanted(job, labels), tolerance_mm=job.tolerance_mm, rng=np.random.default_rng(job.seed)
    )
    chosen, rate_hz, truth, has = choice.subset.primary, track.rate_hz, moved[learned:], np.ones(len(labels), bool)
    if 3 * len(chosen) > MAX_WEIGHTS and job.film is not None:
        raise UsageError(f"markers: must have at most {MAX_WEIGHTS // 3} for a film, got {len(chosen)}")
    if job.take is not None:
        names = tuple(labels[index] for index in chosen)
        truth, has, rate_hz = _other_take(job, job.take, labels, names, reference)
        truth = truth @ axes.T
    if not len(truth):
        raise DataError(f"frames: got {len(moved)}, expected more to learn from and to drive", where=str(job.grid))
    driven = choice.subset.synthesise(truth[:, chosen])
    off = np.linalg.norm(driven - truth, axis=-1)
    judged = has & ~np.isin(np.arange(len(labels)), chosen)
    grid = _surface(job, choice, rest)
    _write(job.output, labels, rest + driven, rate_hz, choice, np.where(has, off.mean(axis=0), np.nan), grid)
    if job.film is not None:
        _film(job.film, grid, rest, choice, truth[:, chosen], rate_hz, drawing)
    return _report(choice, labels, off, truth, judged, learned, len(grid.rest_mm))


def _reference(track: MarkerTrack, skull: tuple[str, ...]) -> HeadReference:
    """Skull markers in the first frame that shows all of them."""
    still = RigidMotion(np.eye(3), np.zeros(3))
    if not skull:
        return HeadReference((), np.zeros((0, 3)), still)
    band = track.select(skull)
    whole = np.flatnonzero(band.valid.all(axis=1))
    if not len(whole):
        raise DataError(f"skull: no frame shows all of {', '.join(skull)}")
    return HeadReference(skull, band.positions_mm[whole[0]], still)


def _freed(track: MarkerTrack, labels: tuple[str, ...], reference: HeadReference, path: Path) -> tuple[Array, Array]:
    """Rest position and displacements of some markers of a recording."""
    try:
        return displacements(track, labels, reference)
    except DataError as error:
        raise type(error)(error.message, where=str(path)) from error


def _wanted(job: DriveJob, labels: tuple[str, ...]) -> int | list[int] | None:
    if not isinstance(job.markers, tuple):
        return job.markers
    unknown = [name for name in job.markers if name not in labels]
    if unknown:
        raise UsageError(
            f"markers: unknown marker {unknown[0]!r}; use some of {', '.join(labels[:12])} ..., or a number"
        )
    return [labels.index(name) for name in job.markers]


def _other_take(
    job: DriveJob, path: Path, labels: tuple[str, ...], names: tuple[str, ...], reference: HeadReference
) -> tuple[Array, NDArray[np.bool_], float]:
    """Displacements of another take from its own first position, markers that it has, and its rate."""
    track = load_markers(path, rate_hz=job.rate_hz).markers
    missing = [name for name in names if name not in track.labels]
    if missing:
        raise DataError(f"take: lacks {', '.join(missing)}, which drive the face", where=str(path))
    there = tuple(name for name in labels if name in track.labels)
    _, moved = _freed(track, there, reference, path)
    truth = np.zeros((len(moved), len(labels), 3))
    has = np.isin(labels, there)
    truth[:, has] = moved
    return truth, has, track.rate_hz


def _surface(job: DriveJob, choice: Choice, rest_mm: Array) -> FaceGrid:
    """Surface that is moved: the mesh itself, or a grid over the markers."""
    if job.grid.is_dir():
        return FaceGrid(rest_mm, load_surface(mesh_files(job.grid)[0]).triangles, choice.subset.weights)
    return make_grid(choice.subset, rest_mm, job.columns)


def _film(
    path: Path, grid: FaceGrid, rest_mm: Array, choice: Choice, driving_mm: Array, rate_hz: float, drawing: Drawing
) -> None:
    """Draw the surface with a dot on each marker, the driving ones large; ``driving_mm`` is (T, k, 3)."""
    check_moving(path, rate_hz=rate_hz, size=drawing.size, alpha=drawing.components == 4)
    mesh = dotted_mesh(grid, rest_mm, choice)
    flat = driving_mm.reshape(len(driving_mm), -1)
    with CrowdRenderer([mesh], drawing) as crowd:
        frames = crowd.frames([Pose(row, MOVED_BONES)] for row in flat)
        write_moving(path, map(straight, frames), rate_hz=rate_hz)


def dotted_mesh(grid: FaceGrid, rest_mm: Array, choice: Choice) -> FaceMesh:
    """Make what is drawn: its weights are the coordinates of the driving markers' displacements, mm.

    Parameters
    ----------
    grid : FaceGrid
        +z points out of the face.
    rest_mm : (M, 3) mm
        Markers, in the same space.
    """
    count, k = len(rest_mm), len(choice.subset.primary)
    is_driving = np.isin(np.arange(count), choice.subset.primary)
    sizes = np.where(is_driving, DOT_MM[True], DOT_MM[False])
    if count > MAX_DOTS:
        sizes, shown = sizes[is_driving], np.flatnonzero(is_driving)
    else:
        shown = np.arange(count)
    dots = (rest_mm[shown, None] + sizes[:, None, None] * OCTAHEDRON).reshape(-1, 3)
    vertices = np.concatenate([grid.rest_mm, dots])
    triangles = np.concatenate(
        [grid.triangles, (len(grid.rest_mm) + 6 * np.arange(len(shown))[:, None, None] + FACETS).reshape(-1, 3)]
    )
    weights = np.concatenate([grid.weights, np.repeat(choice.subset.weights[:, shown], 6, axis=1)], axis=1)
    colours = np.repeat(np.where(is_driving[shown, None], DRIVING, DRIVEN), 6, axis=0)
    total = len(vertices)
    steps = weights.T[:, :, None, None] * np.eye(3)  # (N, k, axis of the marker, axis of the point)
    scale = min(1.0, WIDEST_MM / max(float(np.ptp(grid.rest_mm[:, 0])), 1e-9))
    return FaceMesh(
        vertices_mm=(scale * (vertices - grid.rest_mm.mean(axis=0)) + PLACE_MM).astype(np.float32),
        normals=vertex_normals(vertices, triangles).astype(np.float32),
        uv=np.zeros((total, 2), np.float32),
        albedo=np.concatenate([np.tile(SKIN, (len(grid.rest_mm), 1)), colours]).astype(np.float32),
        material=np.full(total, Material.SKIN, np.uint8),
        occlusion=np.ones(total, np.float32),
        bone=np.zeros(total, np.uint8),
        bone_weight=np.zeros(total, np.float32),
        head_weight=np.zeros(total, np.float32),
        triangles=triangles.astype(np.int32),
        feature_points={},
        jaw_pivot_mm=np.zeros(3),
        head_pivot_mm=np.zeros(3),
        eye_pivots_mm=np.zeros((2, 3)),
        fapu=load_built(HeadStyle()).fapu,
        basis=DeformationBasis(
            channels=(Channel(3, -np.inf, np.inf),),
            offsets=(3 * k * np.arange(total + 1)).astype(np.int32),
            entry_channels=np.tile(np.arange(3 * k), total).astype(np.int32),
            entry_mm=(scale * steps).reshape(-1, 3).astype(np.float32),
            mix=np.zeros((3 * k, 1), np.float32),
        ),
    )


def _write(
    path: Path, labels: tuple[str, ...], places: Array, rate_hz: float, choice: Choice, error: Array, grid: FaceGrid
) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, positions=places.astype(np.float32), labels=np.array(labels), rate_hz=np.array(rate_hz),
        units=np.array("mm"), driving=np.array([labels[index] for index in choice.subset.primary]),
        weights=choice.subset.weights, error_mm=error, grid_mm=grid.rest_mm,
        grid_triangles=grid.triangles.astype(np.int32), grid_weights=grid.weights,
    )  # fmt: skip
    write_bytes(path, buffer.getvalue())


def _report(
    choice: Choice,
    labels: tuple[str, ...],
    off: Array,
    truth: Array,
    judged: NDArray[np.bool_],
    learned: int,
    points: int,
) -> DriveReport:
    """Sum up distances ``off``, (T, M) mm, of the markers that were ``judged``."""
    names = tuple(labels[index] for index in choice.subset.primary)
    report = DriveReport(
        markers=names, reason=choice.reason, learned_frames=learned, driven_frames=len(off), points=points
    )
    if not judged.any():
        return report
    mine, by_marker = off[:, judged], np.where(judged, off.mean(axis=0), -1.0)
    return replace(
        report, mean_mm=float(mine.mean()), p95_mm=float(np.quantile(mine, 0.95)), largest_mm=float(mine.max()),
        worst=labels[int(by_marker.argmax())],
        still_mm=float(np.linalg.norm(truth[:, judged], axis=-1).mean()),
    )  # fmt: skip
