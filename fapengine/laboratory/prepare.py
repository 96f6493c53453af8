"""From a session to displacements: head motion taken off, head axes found, neutral pose measured, gaps filled.

Theory of operation
-------------------
1. The markers of the skull give a template, and the rigid motion that carries each frame's skull onto it (Horn's
   quaternions, distrusting what slips). Applied to the face, it leaves the face alone. Fewer than three skull markers
   in a frame leave that frame unknown.
2. The neutral pose is the median over the silences, or over the frames that the laboratory names.
3. Its feature points, laid onto those of the standard's face by rotation, shift and scale, give the head axes (+x left,
   +y up, +z out), however the recording lay. Where a mirrored face fits far better, left and right are exchanged: an
   error.
4. Gaps are filled by a model of the whole session, at the rank that predicts hidden entries best (paper 003).

So the model does not depend on any rigid motion of head or room, nor on the order of markers or takes.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Mask
from fapengine.capture.conventions import again
from fapengine.capture.marker_track import Interval, MarkerTrack, Session
from fapengine.errors import DataError
from fapengine.geometry.rigid import RigidMotion, fit_rigid, fit_rigid_robust, fit_template
from fapengine.laboratory.marker_driver import MIN_SKULL, HeadReference, follow_skull
from fapengine.laboratory.setup import Setup
from fapengine.models.missing import choose_rank, fit_gaps
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES
from fapengine.speech.phone_track import SILENCE

Array = NDArray[np.float64]

MIN_FRAMES = 50
MIN_NAMED = 4
"""Feature points that head axes need."""
MIRROR_RATIO = 0.6
"""A mirrored fit with less than this fraction of the residual means exchanged sides."""
SHARED_TURN_RAD = 0.035
"""2 degrees: a face without skull markers that turns more to the sides was not freed from head motion."""
RANKS = (3, 5, 8, 12, 16, 24, 36, 48)
DISTRUSTED = 0.2
"""Median trust of a head marker below which it is named: it lies off by more than twice the noise."""
FRAMES_FOR_TEMPLATE = 2000
FRAMES_FOR_RANK = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """One take, freed from its head."""

    name: str
    moved_mm: NDArray[np.float32]
    """(T, M, 3) from the neutral pose, head axes; no gaps. Singles hold a micrometre, in half the memory."""
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
    """Lays other takes' heads where these lie."""

    def column(self, point: str) -> int:
        """Marker that is this feature point."""
        return self.points.index(point)

    @property
    def named(self) -> tuple[str, ...]:
        """Feature points that were recorded."""
        return tuple(point for point in self.points if point)


def prepare(session: Session, setup: Setup, face_mm: dict[str, Array], *, rng: np.random.Generator) -> Prepared:
    """Free a session's takes from head motion, axes and gaps.

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
        raise DataError(f"feature point {twice}: got two markers for it, expected one", where=session.subject)
    template, heads = _skull_motion(session, setup, warnings)
    still = [head.hold(take.markers.select(face)) for take, head in zip(session.takes, heads, strict=True)]
    neutral = _neutral(session, setup, still)
    axes, scale = _head_axes(neutral, points, face_mm, session.subject)
    neutral = axes.apply(neutral)
    moved = []
    while still:  # one after the other: a session may be most of the memory
        moved.append((axes.apply(still.pop(0).positions_mm) - neutral).astype(np.float32))
    if not setup.head:
        _warn_of_shared_turns(moved, neutral, session, warnings)
    filled, gaps = _fill(moved, rng, warnings)
    takes = tuple(
        Displacements(take.name, positions, take.phones, _in_axes(head, axes))
        for take, positions, head in zip(session.takes, filled, heads, strict=True)
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
                f"marker {name!r}: is in no recording; got {', '.join(session.labels[:12])} ...", where="session.toml"
            )
    takes = {take.name: take for take in session.takes}
    for name in (*setup.head, *setup.points, *(name for name in session.labels if name in FEATURE_POINT_NAMES)):
        if again(name) in session.labels:
            raise DataError(
                f"marker {name!r}: is the label of more than one, and so not to be told from {again(name)!r}; name"
                " them apart in the files",
                where=session.subject,
            )
    moments = [pose.moment for pose in setup.poses] + [held.moment for held in setup.held_phones]
    moments += [setup.neutral] if setup.neutral else []
    for moment in moments:
        if moment.take not in takes:
            raise DataError(f"take {moment.take!r}: unknown take; use one of {', '.join(takes)}", where="session.toml")
        length = takes[moment.take].markers.duration_s
        if not 0 <= moment.start_s < moment.end_s <= length + 1e-9:
            raise DataError(
                f"take {moment.take!r}: got {moment.start_s:g} .. {moment.end_s:g} s, expected a stretch of its"
                f" {length:g} s",
                where="session.toml",
            )


def _without_unseen(session: Session, setup: Setup, warnings: list[str]) -> Session:
    """Leave out markers that no frame shows; one that the laboratory names must be seen."""
    seen = np.sum([take.markers.valid.sum(axis=0) for take in session.takes], axis=0)
    never = [name for name, count in zip(session.labels, seen, strict=True) if not count]
    for name in never:
        if name in setup.points or name in setup.head or name in FEATURE_POINT_NAMES:
            raise DataError(f"marker {name!r}: is never seen, so its motion cannot be known", where=session.subject)
        warnings.append(f"marker {name} is never seen: left out")
    if not never:
        return session
    kept = [name for name in session.labels if name not in never]
    return replace(session, takes=tuple(replace(t, markers=t.markers.select(kept)) for t in session.takes))


def _skull_motion(session: Session, setup: Setup, warnings: list[str]) -> tuple[Array, list["_Skull"]]:
    """Find the session's template of the skull, (H, 3), and how each take's skull moves against it."""
    if not setup.head:
        counts = [take.markers.frame_count for take in session.takes]
        still = [RigidMotion(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))) for count in counts]
        return np.zeros((0, 3)), [_Skull(motion, None) for motion in still]
    if len(setup.head) < MIN_SKULL:
        raise DataError(f"head: needs at least {MIN_SKULL} markers, got {len(setup.head)}", where="session.toml")
    tracks = [take.markers.select(setup.head) for take in session.takes]
    frames = np.concatenate([track.positions_mm for track in tracks])
    complete = np.flatnonzero(~np.isnan(frames[..., 0]).any(axis=1))
    if not len(complete):
        raise DataError(f"head: no frame shows all of {', '.join(setup.head)}", where=session.subject)
    some = complete[np.linspace(0, len(complete) - 1, min(len(complete), FRAMES_FOR_TEMPLATE)).astype(int)]
    template = fit_template(frames[some])
    return template, [
        _follow(track, template, take.name, warnings) for track, take in zip(tracks, session.takes, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Skull:
    template_from_room: RigidMotion
    tracked: Mask | None
    """(T,): frames that show the head; None for a head that is known not to move."""

    def hold(self, track: MarkerTrack) -> MarkerTrack:
        """Remove head motion from a face; markers are unseen in frames where the head is unknown."""
        if self.tracked is None:
            return track
        still = self.template_from_room.apply(track.positions_mm)
        still[~self.tracked] = np.nan
        return replace(track, positions_mm=still)


def _follow(track: MarkerTrack, template: Array, name: str, warnings: list[str]) -> _Skull:
    motion, tracked, trust = follow_skull(track, template, "head: no frame has 3 of its markers", f"take {name}")
    if not tracked.all():
        warnings.append(
            f"take {name}: head unknown in {np.sum(~tracked)} of {len(tracked)} frames, which count as unseen"
        )
    for label, worth in zip(track.labels, trust, strict=True) if trust is not None else ():
        if worth < DISTRUSTED:
            warnings.append(f"take {name}: head marker {label} does not keep its place, and is distrusted")
    return _Skull(motion, tracked)


def _neutral(session: Session, setup: Setup, still: list[MarkerTrack]) -> Array:
    """(M, 3): median of the named frames, else of all silences."""
    frames = []
    for take, track in zip(session.takes, still, strict=True):
        stretches = [(p.start_s, p.end_s) for p in take.phones if p.label == SILENCE]
        if setup.neutral is not None:
            stretches = [(setup.neutral.start_s, setup.neutral.end_s)] if setup.neutral.take == take.name else []
        for start_s, end_s in stretches:
            first = round(start_s * session.rate_hz)
            frames.append(track.positions_mm[first : max(round(end_s * session.rate_hz), first + 1)])
    shown = np.concatenate([np.zeros((0, *still[0].positions_mm.shape[1:])), *frames])
    seen = (~np.isnan(shown[..., 0])).sum(axis=0)
    if not len(shown):
        raise DataError(
            "neutral pose: missing; the phone timings have no silence, and session.toml has no [neutral]",
            where=session.subject,
        )
    if not seen.all():
        hidden = [label for label, count in zip(still[0].labels, seen, strict=True) if not count]
        raise DataError(f"neutral pose: no frame shows {', '.join(hidden)}", where=session.subject)
    return np.asarray(np.nanmedian(shown, axis=0), dtype=np.float64)


def _head_axes(
    neutral: Array, points: tuple[str, ...], face: dict[str, Array], where: str
) -> tuple[RigidMotion, float]:
    """Motion that turns the neutral pose into head axes, about its centre; and the standard face's size over it."""
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


def _in_axes(skull: _Skull, axes: RigidMotion) -> RigidMotion:
    """Neutral head to head, in head axes: the head motion, to be put back later."""
    back = skull.template_from_room.inverse()
    turn = axes.rotation @ back.rotation @ axes.rotation.T
    shift = (
        (axes.rotation @ back.translation_mm[..., None])[..., 0] + axes.translation_mm - (turn @ axes.translation_mm)
    )
    first = turn[0].T  # the pose of the template is chance: count from the take's first frame
    turn, shift = first @ turn, (first @ (shift - shift[0])[..., None])[..., 0]
    return RigidMotion(turn, shift)


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
        angle = 2 * np.linalg.norm(turn.quaternions()[:, 2:], axis=1)  # yaw and roll: the jaw looks like pitch
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
    some = np.linspace(0, len(frames) - 1, min(len(frames), FRAMES_FOR_RANK)).astype(int)
    ranks = tuple(rank for rank in RANKS if rank < min(len(some), 3 * frames.shape[1]) - 2)
    rank, error = choose_rank(frames[some], seen[some], ranks, rng=rng)
    filled = fit_gaps(frames, seen, rank).fill(frames, seen).astype(np.float32)
    nothing = int((~seen.any(axis=1)).sum())
    if nothing:
        warnings.append(f"{nothing} frames show no marker at all: the mean pose stands in")
    return np.split(filled, np.cumsum([len(take) for take in moved])[:-1]), Gaps(seen.mean(axis=0), rank, ranks, error)
