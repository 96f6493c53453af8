"""A face driven by a few of its markers, from a recording to arrays and a video: paper 000, section 5."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fapengine._arrays import Array, Mask
from fapengine._strict_toml import checked
from fapengine.app.dense_film import MAX_WEIGHTS, MOVED_BONES, dotted_mesh, fitting
from fapengine.app.drawing import crowd_size, open_crowd
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.moving import check_moving, is_moving, write_moving
from fapengine.files.paths import locating, write_bytes
from fapengine.files.pictures import straight
from fapengine.files.profiles import load_profile
from fapengine.files.recordings import load_markers, load_surface, mesh_files
from fapengine.files.sessions import LoadedSession, read
from fapengine.geometry.rigid import RigidMotion
from fapengine.laboratory.few_markers import Choice, FaceGrid, choose_markers, displacements, edit, facing, make_grid
from fapengine.laboratory.marker_driver import HeadReference
from fapengine.laboratory.space import MIN_KNOWN, recorded_faps
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.profiles import Profile
from fapengine.render.drawing import RenderOptions
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.trajectory.closures import close_lips

HELD_OUT = 0.25
"""Fraction held out to be driven and scored if no other take is given: the last takes, or the end of a single one."""
MIN_MARKERS = 4
"""Least number of markers that span a surface."""
MAX_DOTS = 400
"""Number of markers above which driven ones have no dot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions:
    """Which markers drive a face, and how."""

    markers: tuple[str, ...] | int | None = None
    """Labels or number of the driving markers; None: chosen by the error."""
    skull: tuple[str, ...] = ()
    """Markers on the skull; empty: those of the session, without which the head does not move."""
    tolerance_mm: float = 0.35
    """Largest mean error that the choice of their number may leave."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """Factors of driving markers' displacements; 0 removes one's motion."""
    delay_s: Mapping[str, float] = field(default_factory=dict)
    seed: int = 1


@dataclass(frozen=True, slots=True)
class DriveReport:
    """The driving markers, and the errors of the others."""

    markers: tuple[str, ...]
    reason: str
    learned_takes: int
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
    has_face: bool = False
    """Whether the film shows a head that the driven markers move, beside the surface."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Driven:
    """A face that a few of its markers move. Axes: the face's left, up and out."""

    labels: tuple[str, ...]
    """(M,)."""
    rate_hz: float
    rest_mm: Array
    """(M, 3)."""
    choice: Choice
    """``choice.subset.primary`` (k,) are the driving markers, ``.weights`` (k, M) their weights."""
    driving_mm: Array
    """(T, k, 3): displacements of the driving markers from rest, scaled and delayed as asked for."""
    driven_mm: Array
    """(T, M, 3): displacements of all markers that follow from them."""
    recorded_mm: Array
    """(T, M, 3): recorded displacements; 0 for a marker that the driving take does not have."""
    has: Mask
    """(M,): whether the driving take has a marker."""
    learned: tuple[int, ...]
    """Frames of each take that was learned from."""

    @property
    def driving(self) -> tuple[str, ...]:
        """Labels of the driving markers."""
        return tuple(self.labels[index] for index in self.choice.subset.primary)

    @property
    def off_mm(self) -> Array:
        """(T, M): distance of each marker from the recorded one."""
        return np.asarray(np.linalg.norm(self.driven_mm - self.recorded_mm, axis=-1))

    @property
    def judged(self) -> Mask:
        """(M,): markers that are driven and recorded; the errors are theirs."""
        return self.has & ~np.isin(np.arange(len(self.labels)), self.choice.subset.primary)


@checked
def drive(session: LoadedSession, take: MarkerTrack | None = None, *, options: DriveOptions | None = None) -> Driven:
    """Learn how a few markers move all others, and drive a face by them: paper 000, section 5.

    Parameters
    ----------
    session : LoadedSession
        Takes to learn from. A take's rest position is that of its first frame.
    take : MarkerTrack, optional
        Recording that drives the face. By default the last quarter of the takes, which are then not learned from; of
        a single take its last quarter.
    options : DriveOptions, optional

    Raises
    ------
    UsageError
        If a marker is unknown.
    DataError
        If a take lacks a driving marker, or there are too few frames.
    """
    options = options or DriveOptions()
    tracks = [each.markers for each in session.takes]
    skull = options.skull or session.setup.head
    unknown = [name for name in skull if name not in tracks[0].labels]
    if unknown:
        raise UsageError(f"skull: unknown marker {unknown[0]!r}; use some of {', '.join(tracks[0].labels[:12])}")
    labels = tuple(name for name in tracks[0].labels if name not in skull)
    if len(labels) < MIN_MARKERS:
        raise DataError(f"markers: got {len(labels)} on the face, a surface needs {MIN_MARKERS} or more")
    reference = _reference(tracks, skull)
    freed = [_freed(each.markers, labels, reference, each.name) for each in session.takes]
    rest, moved = freed[0][0], [each for _, each in freed]
    head = load_built(MEASURED)
    face_mm = {name: head.point_mm(name).astype(np.float64) for name in head.feature_points}
    axes = facing(rest, [session.setup.points.get(name, name) for name in labels], face_mm)
    rest, moved = rest @ axes.T, [each @ axes.T for each in moved]  # from here on: left, up, out
    learned, truth = (moved, None) if take is not None else _split(moved, session.session.subject)
    choice = choose_markers(
        learned, rest, _wanted(options, labels), tolerance_mm=options.tolerance_mm,
        rng=np.random.default_rng(options.seed),
    )  # fmt: skip
    names = [labels[index] for index in choice.subset.primary]
    has, rate_hz = np.ones(len(labels), bool), session.session.rate_hz
    if take is not None:
        truth, has = _other_take(take, labels, names, reference)
        truth, rate_hz = truth @ axes.T, take.rate_hz
    assert truth is not None
    driving = edit(truth[:, choice.subset.primary], names, rate_hz, scale=options.scale, delay_s=options.delay_s)
    return Driven(
        labels=labels, rate_hz=rate_hz, rest_mm=rest, choice=choice, driving_mm=driving,
        driven_mm=choice.subset.synthesise(driving), recorded_mm=truth, has=has, learned=tuple(map(len, learned)),
    )  # fmt: skip


def _split(moved: list[Array], where: str) -> tuple[list[Array], Array]:
    """Leave out the last quarter of the takes, or of a single take."""
    if len(moved) == 1:
        first = max(2, round((1 - HELD_OUT) * len(moved[0])))
        learned, driven = [moved[0][:first]], moved[0][first:]
    else:
        count = max(1, round(HELD_OUT * len(moved)))
        learned, driven = moved[:-count], np.concatenate(moved[-count:])
    if not len(driven):
        raise DataError(f"frames: got {len(moved[0])}, expected more to learn from and to drive", where=where)
    return learned, driven


def run_drive(
    grid: Path,
    output: Path,
    options: DriveOptions,
    drawing: RenderOptions,
    *,
    take: Path | None = None,
    film: Path | None = None,
    columns: int = 48,
    rate_hz: float | None = None,
) -> DriveReport:
    """Learn the weights, drive the face, and write arrays and video.

    ``grid`` is a recording of all points to learn from, a session, or a folder of meshes, at ``rate_hz``; ``take``
    drives, in place of the last quarter of ``grid``; ``columns`` are the points of the surface from left to right.
    The archive has ``positions`` (T, M, 3) mm of all markers as they were driven (left, up, out), ``labels``,
    ``rate_hz`` and ``units`` (so it is a recording too), ``driving`` (labels), ``weights`` (k, M), ``error_mm`` (M,),
    and the surface:
    ``grid_mm`` (N, 3), ``grid_triangles`` (F, 3), ``grid_weights`` (k, N).
    """
    if output.suffix != ".npz":
        raise UsageError(f"output: got {output}, expected a name that ends with .npz")
    if film is not None and not is_moving(film):
        raise UsageError(f"film: got {film}, expected a video, an animation or an image sequence")
    session = read(grid, rate_hz=rate_hz)
    other = None if take is None else load_markers(take, rate_hz=rate_hz).markers
    with locating(take or grid):
        driven = drive(session, other, options=options)
    if 3 * len(driven.driving) > MAX_WEIGHTS and film is not None:
        raise UsageError(f"markers: must have at most {MAX_WEIGHTS // 3} for a film, got {len(driven.driving)}")
    subset = driven.choice.subset
    if grid.is_dir() and (meshes := mesh_files(grid)):
        surface = FaceGrid(driven.rest_mm, load_surface(meshes[0]).triangles, subset.weights)
    else:
        surface = make_grid(subset, driven.rest_mm, columns)
    _write(output, driven, surface)
    has_face = film is not None and _film(film, surface, driven, session.setup.points, drawing)
    return replace(_report(driven, len(surface.rest_mm)), has_face=has_face)


def _reference(tracks: list[MarkerTrack], skull: tuple[str, ...]) -> HeadReference:
    """Skull markers in the first frame that shows all of them."""
    still = RigidMotion(np.eye(3), np.zeros(3))
    if not skull:
        return HeadReference((), np.zeros((0, 3)), still)
    for band in (track.select(skull) for track in tracks):
        whole = np.flatnonzero(band.valid.all(axis=1))
        if len(whole):
            return HeadReference(skull, band.positions_mm[whole[0]], still)
    raise DataError(f"skull: no frame shows all of {', '.join(skull)}")


def _freed(track: MarkerTrack, labels: tuple[str, ...], reference: HeadReference, take: str) -> tuple[Array, Array]:
    """Rest position and displacements of some markers of a recording."""
    with locating(f"take {take}"):
        return displacements(track, labels, reference)


def _wanted(options: DriveOptions, labels: tuple[str, ...]) -> int | list[int] | None:
    if not isinstance(options.markers, tuple):
        return options.markers
    unknown = [name for name in options.markers if name not in labels]
    if unknown:
        raise UsageError(
            f"markers: unknown marker {unknown[0]!r}; use some of {', '.join(labels[:12])} ..., or a number"
        )
    return [labels.index(name) for name in options.markers]


def _other_take(
    track: MarkerTrack, labels: tuple[str, ...], names: Sequence[str], reference: HeadReference
) -> tuple[Array, Mask]:
    """Displacements of another take from its own first position, and the markers that it has."""
    missing = [name for name in names if name not in track.labels]
    if missing:
        raise DataError(f"take: lacks {', '.join(missing)}, which drive the face")
    there = tuple(name for name in labels if name in track.labels)
    _, moved = displacements(track, there, reference)
    truth = np.zeros((len(moved), len(labels), 3))
    has = np.isin(labels, there)
    truth[:, has] = moved
    return truth, has


def _film(path: Path, grid: FaceGrid, driven: Driven, points: Mapping[str, str], drawing: RenderOptions) -> bool:
    """Draw the surface with a dot on each marker, the driving ones large, and beside it a face, if one can be moved."""
    profile, head = load_profile(DEFAULT_PROFILE), load_built(MEASURED)
    faps = face_faps(driven, points, profile, head)
    meshes = [_dotted(grid, driven)] if faps is None else [head, _dotted(grid, driven)]
    check_moving(path, rate_hz=driven.rate_hz, size=crowd_size(drawing, len(meshes)), alpha=drawing.components == 4)
    poses = [Pose(row, MOVED_BONES) for row in driven.driving_mm.reshape(len(driven.driving_mm), -1)]
    rows = [[pose] for pose in poses] if faps is None else zip(faps, poses, strict=True)
    with open_crowd(meshes, drawing) as crowd:
        write_moving(path, map(straight, crowd.frames(rows)), rate_hz=driven.rate_hz)
    return faps is not None


def face_faps(driven: Driven, points: Mapping[str, str], standard: Profile, head: FaceMesh) -> Array | None:
    """FAPs, (T, 68) FAPU, by which a standard face shows what was driven; None with too few points of lips and jaw.

    Parameters
    ----------
    points : mapping of str to str
        Feature points of markers that have other names.
    standard : Profile
        Its points move where the recording has none; ``head`` has its size.
    """
    named = {points.get(label, label): index for index, label in enumerate(driven.labels)}
    named = {point: index for point, index in named.items() if point in head.feature_points}
    if sum(point in named for point in standard.space.markers) < MIN_KNOWN:
        return None
    ours, theirs = driven.rest_mm[[*named.values()]], np.stack([head.point_mm(point) for point in named])
    size = float(np.linalg.norm(theirs - theirs.mean(axis=0)) / np.linalg.norm(ours - ours.mean(axis=0)))
    faps = recorded_faps({point: size * driven.driven_mm[:, index] for point, index in named.items()}, standard)
    return close_lips(faps, np.arange(len(faps)) / driven.rate_hz, [])


def _dotted(grid: FaceGrid, driven: Driven) -> FaceMesh:
    """Make what is drawn: its weights are the coordinates of the driving markers' displacements, mm."""
    count, weights = len(driven.rest_mm), driven.choice.subset.weights
    is_driving = np.isin(np.arange(count), driven.choice.subset.primary)
    shown = np.flatnonzero(is_driving | (count <= MAX_DOTS))
    scale, shift = fitting(grid.rest_mm)

    def moves(weights: Array) -> Array:
        """(3k, N, 3): of each marker and axis."""
        return np.asarray(scale * np.einsum("kn,ab->kanb", weights, np.eye(3)).reshape(-1, weights.shape[1], 3))

    return dotted_mesh(
        (scale * grid.rest_mm + shift, moves(grid.weights)), grid.triangles,
        (scale * driven.rest_mm[shown] + shift, moves(weights[:, shown])), is_driving[shown],
    )  # fmt: skip


def _write(path: Path, driven: Driven, grid: FaceGrid) -> None:
    buffer = io.BytesIO()
    places = driven.rest_mm + driven.driven_mm
    np.savez_compressed(
        buffer, positions=places.astype(np.float32), labels=np.array(driven.labels), rate_hz=np.array(driven.rate_hz),
        units=np.array("mm"), driving=np.array(driven.driving), weights=driven.choice.subset.weights,
        error_mm=np.where(driven.has, driven.off_mm.mean(axis=0), np.nan), grid_mm=grid.rest_mm,
        grid_triangles=grid.triangles.astype(np.int32), grid_weights=grid.weights,
    )  # fmt: skip
    write_bytes(path, buffer.getvalue())


def _report(driven: Driven, points: int) -> DriveReport:
    """Sum up the distances of the markers that are judged."""
    report = DriveReport(
        markers=driven.driving, reason=driven.choice.reason, learned_takes=len(driven.learned),
        learned_frames=sum(driven.learned), driven_frames=len(driven.driven_mm), points=points,
    )  # fmt: skip
    judged, off = driven.judged, driven.off_mm
    if not judged.any():
        return report
    mine, by_marker = off[:, judged], np.where(judged, off.mean(axis=0), -1.0)
    return replace(
        report, mean_mm=float(mine.mean()), p95_mm=float(np.quantile(mine, 0.95)), largest_mm=float(mine.max()),
        worst=driven.labels[int(by_marker.argmax())],
        still_mm=float(np.linalg.norm(driven.recorded_mm[:, judged], axis=-1).mean()),
    )  # fmt: skip
