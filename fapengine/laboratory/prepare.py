"""From a session to displacements: head motion removed, head axes found, neutral pose measured, gaps filled.

Theory of operation
-------------------
1. The markers of the skull give a template, and the rigid motion that carries each frame's skull onto it (Horn's
   quaternions, with less weight for markers that slip). It removes the head's motion from the face. A frame with fewer
   than three skull markers counts as unseen.
2. The neutral pose is the median over the silences, or over the frames that ``session.toml`` names.
3. Its feature points, fitted to those of a standard face by rotation, shift and scale, give the head axes (+x left,
   +y up, +z out), for any axes of the recording. Where a mirrored face fits far better, left and right are exchanged:
   an error.
4. Gaps are filled by a model of the whole session, at the rank that predicts hidden entries best (paper 003).

So the model does not depend on any rigid motion of head or room, nor on the order of markers or takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fapengine._arrays import Array
from fapengine.capture.conventions import again
from fapengine.capture.marker_track import Interval, Session
from fapengine.errors import DataError
from fapengine.geometry.rigid import RigidMotion, fit_rigid, fit_rigid_robust, fit_template
from fapengine.laboratory.marker_driver import MIN_SKULL, HeadReference
from fapengine.laboratory.setup import Moment, Setup
from fapengine.models.missing import choose_rank, fit_gaps
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from fapengine.speech.phone_track import SILENCE

MIN_FRAMES = 50
MIN_NAMED = 4
"""Feature points that head axes need."""
MIRROR_RATIO = 0.6
"""A mirrored fit with less than this fraction of the residual means exchanged sides."""
SHARED_TURN_RAD = 0.035
"""2 degrees: a face without skull markers that turns more to the sides still has head motion."""
RANKS = (3, 5, 8, 12, 16, 24, 36, 48)
FRAMES_FOR_TEMPLATE = 2000
FRAMES_FOR_RANK = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """One take without head motion."""

    name: str
    moved_mm: NDArray[np.float32]
    """(T, M, 3) from the neutral pose, head axes; no gaps. Single precision keeps a micrometre, in half the memory."""
    phones: tuple[Interval, ...]
    head: RigidMotion
    """Batch (T,): neutral head to head, in head axes, about the origin of the neutral pose."""


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """Gaps, and how they were filled."""

    seen: Array
    """(M,): fraction of frames that show each marker."""
    rank: int
    ranks: tuple[int, ...]
    error_mm: Array
    """(len(ranks),): root mean square distance of entries that were hidden for the trial."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prepared:
    """A session, ready for the models."""

    subject: str
    rate_hz: float
    labels: tuple[str, ...]
    """(M,): as recorded."""
    points: tuple[str, ...]
    """(M,): feature point of each marker, or ``""``."""
    neutral_mm: Array
    """(M, 3), head axes."""
    scale: float
    """Size of the standard's face over this one."""
    takes: tuple[Displacements, ...]
    gaps: Gaps | None
    warnings: tuple[str, ...]
    reference: HeadReference
    """Aligns the heads of other takes with this one."""

    @property
    def named(self) -> tuple[str, ...]:
        """Feature points that were recorded."""
        return tuple(point for point in self.points if point)

    def by_point(self, values: Array) -> dict[str, Array]:
        """Values of markers, (..., M, 3), by feature point: (..., 3) each."""
        return {point: values[..., index, :] for index, point in enumerate(self.points) if point}

    def pick(self, points: Sequence[str], *takes: Displacements) -> NDArray[Any]:
        """All frames of some feature points in some takes: (T, P, 3) mm."""
        columns = [self.points.index(point) for point in points]
        return np.concatenate([take.moved_mm[:, columns] for take in takes])

    def during(self, moment: Moment) -> Array:
        """All markers during a moment: (T, M, 3) mm."""
        take = next(take for take in self.takes if take.name == moment.take)
        return moment.frames(take.moved_mm, self.rate_hz).astype(np.float64)


def prepare(session: Session, setup: Setup, face_mm: dict[str, Array], *, rng: np.random.Generator) -> Prepared:
    """Remove head motion, axes and gaps from a session's takes.

    Parameters
    ----------
    face_mm : dict of feature point to (3,) mm
        A standard face in head axes; gives the orientation, not the shape.
    rng : numpy.random.Generator
        Hides entries to choose the rank of the gap model.
    """
    warnings: list[str] = []
    frames = sum(take.markers.frame_count for take in session.takes)
    if frames < MIN_FRAMES:
        raise DataError(f"recordings: needs at least {MIN_FRAMES} frames in all, got {frames}", where=session.subject)
    _check_names(session, setup)
    session = _without_unseen(session, setup, warnings)
    face = tuple(sorted((name for name in session.labels if name not in setup.head), key=session.labels.index))
    points = tuple(setup.points.get(name, name if name in FEATURE_POINT_NAMES else "") for name in face)
    twice = next((p for i, p in enumerate(points) if p and p in points[:i]), None)
    if twice:
        raise DataError(f"feature point {twice}: two markers have this name, requires one", where=session.subject)
    template = _skull_template(session, setup)
    room = HeadReference(setup.head, template, RigidMotion(np.eye(3), np.zeros(3)))
    still, heads = [], []
    for take in session.takes:
        positions, head = room.hold(take.markers, take.markers.select(face), take=take.name, notes=warnings)
        still.append(positions)
        heads.append(head)
    neutral = _neutral(session, setup, still, face)
    axes, scale = _head_axes(neutral, points, face_mm, session.subject)
    neutral = axes.apply(neutral)
    moved = []
    while still:  # one by one: a session may fill most of the memory
        moved.append((axes.apply(still.pop(0)) - neutral).astype(np.float32))
    if not setup.head:
        _warn_of_shared_turns(moved, neutral, session, warnings)
    filled, gaps = _fill(moved, rng, warnings)
    takes = tuple(
        Displacements(take.name, displaced, take.phones, axes @ head @ axes.inverse())
        for take, displaced, head in zip(session.takes, filled, heads, strict=True)
    )
    return Prepared(
        subject=session.subject, rate_hz=session.rate_hz, labels=face, points=points, neutral_mm=neutral, scale=scale,
        takes=takes, gaps=gaps, warnings=tuple(warnings),
        reference=HeadReference(setup.head, axes.apply(template), axes),
    )  # fmt: skip


def _check_names(session: Session, setup: Setup) -> None:
    for name in (*setup.head, *setup.points):
        if name not in session.labels:
            raise DataError(
                f"marker {name!r}: unknown marker; use some of {', '.join(session.labels[:12])} ...",
                where="session.toml",
            )
    takes = {take.name: take for take in session.takes}
    for name in (*setup.head, *setup.points, *(name for name in session.labels if name in FEATURE_POINT_NAMES)):
        if again(name) in session.labels:
            raise DataError(
                f"marker {name!r}: is the label of two markers (the other is read as {again(name)!r}); rename one",
                where=session.subject,
            )
    moments = [pose.moment for pose in setup.poses] + [held.moment for held in setup.held_phones]
    for moment in moments + ([setup.neutral] if setup.neutral else []):
        if moment.take not in takes:
            raise DataError(f"take {moment.take!r}: unknown take; use one of {', '.join(takes)}", where="session.toml")
        length = takes[moment.take].markers.duration_s
        if not 0 <= moment.start_s < moment.end_s <= length + 1e-9:
            raise DataError(
                f"take {moment.take!r}: got {moment.start_s:g} to {moment.end_s:g} s, must be within its {length:g} s",
                where="session.toml",
            )


def _without_unseen(session: Session, setup: Setup, warnings: list[str]) -> Session:
    """Leave out markers that no frame shows; one that ``session.toml`` names must be seen."""
    seen = np.sum([take.markers.valid.sum(axis=0) for take in session.takes], axis=0)
    never = [name for name, count in zip(session.labels, seen, strict=True) if not count]
    for name in never:
        if name in setup.points or name in setup.head or name in FEATURE_POINT_NAMES:
            raise DataError(f"marker {name!r}: no frame shows it, so its motion is unknown", where=session.subject)
        warnings.append(f"marker {name}: no frame shows it, left out")
    if not never:
        return session
    kept = [name for name in session.labels if name not in never]
    return replace(session, takes=tuple(replace(t, markers=t.markers.select(kept)) for t in session.takes))


def _skull_template(session: Session, setup: Setup) -> Array:
    """(H, 3): mean shape of the markers of the skull, mm."""
    if not setup.head:
        return np.zeros((0, 3))
    if len(setup.head) < MIN_SKULL:
        raise DataError(f"head: needs at least {MIN_SKULL} markers, got {len(setup.head)}", where="session.toml")
    frames = np.concatenate([take.markers.select(setup.head).positions_mm for take in session.takes])
    complete = np.flatnonzero(~np.isnan(frames[..., 0]).any(axis=1))
    if not len(complete):
        raise DataError(f"head: no frame shows all of {', '.join(setup.head)}", where=session.subject)
    return fit_template(frames[complete[_spread(len(complete), FRAMES_FOR_TEMPLATE)]])


def _spread(count: int, most: int) -> NDArray[np.intp]:
    """(N,): at most ``most`` of ``count`` rows, evenly spread."""
    return np.linspace(0, count - 1, min(count, most)).astype(np.intp)


def _neutral(session: Session, setup: Setup, still: list[Array], labels: tuple[str, ...]) -> Array:
    """(M, 3): median of the named frames, else of all silences, of takes (T, M, 3)."""
    moments = [
        Moment(take.name, p.start_s, p.end_s) for take in session.takes for p in take.phones if p.label == SILENCE
    ]
    tracks = dict(zip((take.name for take in session.takes), still, strict=True))
    frames = [
        moment.frames(tracks[moment.take], session.rate_hz)
        for moment in ([setup.neutral] if setup.neutral else moments)
    ]
    shown = np.concatenate([np.zeros((0, len(labels), 3)), *frames])
    seen = (~np.isnan(shown[..., 0])).sum(axis=0)
    if not len(shown):
        raise DataError(
            "neutral pose: missing; the phone timings have no silence, and session.toml has no [neutral]",
            where=session.subject,
        )
    if not seen.all():
        hidden = [label for label, count in zip(labels, seen, strict=True) if not count]
        raise DataError(f"neutral pose: no frame shows {', '.join(hidden)}", where=session.subject)
    return np.asarray(np.nanmedian(shown, axis=0), dtype=np.float64)


def _head_axes(
    neutral: Array, points: tuple[str, ...], face: dict[str, Array], where: str
) -> tuple[RigidMotion, float]:
    """Motion that turns the neutral pose into head axes, about its centre; and the standard face's size over its."""
    named = [index for index, point in enumerate(points) if point in face]
    if len(named) < MIN_NAMED:
        raise DataError(
            f"feature points: got {len(named)} among the markers ({', '.join(points[i] for i in named)}), expected at"
            f" least {MIN_NAMED}: name markers 8.1, 8.2 ... or list them under [points] in session.toml",
            where=where,
        )
    ours, theirs = neutral[named], np.stack([face[points[index]] for index in named])
    ours, theirs = ours - ours.mean(axis=0), theirs - theirs.mean(axis=0)
    scale = float(np.sqrt((theirs**2).sum() / (ours**2).sum()))

    def fit(positions: Array) -> tuple[RigidMotion, float]:
        motion = fit_rigid(scale * positions, theirs)
        return motion, float(np.linalg.norm(motion.apply(scale * positions) - theirs))

    turn, off = fit(ours)
    if fit(ours * [-1.0, 1.0, 1.0])[1] < MIRROR_RATIO * off:
        raise DataError(
            "recording: left and right are exchanged against the feature points' names (left is the subject's)",
            where=where,
        )
    centre = neutral.mean(axis=0)
    return RigidMotion(turn.rotation, -turn.rotation @ centre), scale


def _warn_of_shared_turns(
    moved: list[NDArray[np.float32]], neutral: Array, session: Session, warnings: list[str]
) -> None:
    """Without skull markers, say so where the face as a whole turns."""
    for take, displacement in zip(session.takes, moved, strict=True):
        seen = ~np.isnan(displacement[..., 0])
        usable = seen.sum(axis=1) >= max(MIN_SKULL, len(neutral) // 2)
        if not usable.any() or len(neutral) < MIN_SKULL:
            continue
        frames = np.where(seen[..., None], displacement, 0.0)[usable] + neutral
        turn, _ = fit_rigid_robust(frames, neutral, seen[usable].astype(np.float64))
        turns = Rotation.from_matrix(turn.rotation).as_quat()
        angle = 2 * np.linalg.norm(turns[:, 1:3], axis=1)  # yaw and roll: the jaw looks like pitch
        if np.median(angle) > SHARED_TURN_RAD:
            warnings.append(
                f"take {take.name}: the face turns sideways as a whole by {np.degrees(np.median(angle)):.1f} degrees;"
                " name the skull's markers (head = [...] in session.toml)"
            )


def _fill(
    moved: list[NDArray[np.float32]], rng: np.random.Generator, warnings: list[str]
) -> tuple[list[NDArray[np.float32]], Gaps | None]:
    if not any(np.isnan(take).any() for take in moved):
        return moved, None
    frames = np.concatenate(moved)
    seen = ~np.isnan(frames[..., 0])
    some = _spread(len(frames), FRAMES_FOR_RANK)
    ranks = tuple(rank for rank in RANKS if rank < min(len(some), 3 * frames.shape[1]) - 2)
    rank, error = choose_rank(frames[some], seen[some], ranks, rng=rng)
    filled = fit_gaps(frames, seen, rank).fill(frames, seen).astype(np.float32)
    nothing = int((~seen.any(axis=1)).sum())
    if nothing:
        warnings.append(f"{nothing} frames show no marker at all: they get the mean pose")
    return np.split(filled, np.cumsum([len(take) for take in moved])[:-1]), Gaps(seen.mean(axis=0), rank, ranks, error)
