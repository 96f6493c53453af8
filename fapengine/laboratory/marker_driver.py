"""From a recorded take to the weights of a dense face's modes: papers 003 and 004, "animation".

Theory of operation
-------------------
1. The take's head is laid onto the session's by the markers of the skull, as in :mod:`.prepare`; what it did is kept.
2. Markers that a frame does not show are filled by the sparse model (paper 003, section 3).
3. ``"estimator"`` (paper 004, equation 11): ``a = A (p - neutral)``. ``"modes"`` (paper 003, section 4): the sparse
   model's weights of the frame are the dense modes' (equation 3), told here in the estimator's modes: the scans span
   both, so nothing is lost.

A weight is a mode's standard deviations over the scans, from the neutral face.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Mask, frozen
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import RigidMotion, fit_rigid, fit_rigid_robust
from fapengine.models.missing import GapModel

Array = NDArray[np.float64]
Way = Literal["estimator", "modes"]
WAYS: tuple[Way, ...] = get_args(Way)
MIN_SKULL = 3
MIN_SEEN_SHARE = 0.25
"""Share of the face's markers, in the median frame, below which a take is refused."""


@dataclass(frozen=True, slots=True, eq=False)
class HeadReference:
    """The session's head: where its skull's markers are, or how its room lies. Arrays are read-only."""

    labels: tuple[str, ...]
    """(H,): markers of the skull; none, if the session's head stood still."""
    markers_mm: Array
    """(H, 3): their places, head axes."""
    axes: RigidMotion
    """Room to head axes, for a session with a still head."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "markers_mm", frozen(self.markers_mm, "markers_mm", (len(self.labels), 3), np.float64))

    def hold(self, track: MarkerTrack, face: MarkerTrack) -> tuple[Array, RigidMotion]:
        """Free markers of a take from the head's motion.

        Returns
        -------
        (T, M, 3) float64, mm
            Markers of ``face`` in head axes, NaN where one is not seen or the head is unknown.
        RigidMotion
            (T,): motion of the head since the first frame, in head axes.
        """
        count = face.frame_count
        if not self.labels:
            still: Array = self.axes.apply(face.positions_mm)
            return still, RigidMotion(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
        missing = [name for name in self.labels if name not in track.labels]
        if len(self.labels) - len(missing) < MIN_SKULL:
            raise DataError(f"take: lacks {', '.join(missing)} of the skull's markers, expected at least {MIN_SKULL}")
        kept = [name for name in self.labels if name not in missing]
        goal = self.markers_mm[[self.labels.index(name) for name in kept]]
        head_from_room, tracked, _ = follow_skull(
            track.select(kept), goal, "take: no frame has 3 of the skull's markers"
        )
        still = head_from_room.apply(face.positions_mm)
        still[~tracked] = np.nan
        room_from_head = head_from_room.inverse()
        first = RigidMotion(head_from_room.rotation[0], head_from_room.translation_mm[0])
        turn = first.rotation @ room_from_head.rotation
        shift = room_from_head.translation_mm @ first.rotation.T + first.translation_mm
        return still, RigidMotion(turn, shift)


def follow_skull(
    skull: MarkerTrack, template_mm: Array, trouble: str, where: str = ""
) -> tuple[RigidMotion, Mask, Array | None]:
    """Fit the markers of a skull to a template, (H, 3), in every frame.

    Parameters
    ----------
    trouble, where : str
        Error if no frame has :data:`MIN_SKULL` markers.

    Returns
    -------
    RigidMotion
        (T,): template from room. Frames with too few markers get the motion of the next frame that has enough.
    tracked : (T,) bool
        Frames with enough markers.
    trust : (H,) float64 or None
        Median trust in each marker; None for three markers, which fit exactly.
    """
    tracked = skull.valid.sum(axis=1) >= MIN_SKULL
    if not tracked.any():
        raise DataError(trouble, where=where)
    frames = np.where(skull.valid[..., None], skull.positions_mm, 0.0)[tracked]
    weight = skull.valid[tracked].astype(np.float64)
    trust = None
    if len(template_mm) == MIN_SKULL:
        motion = fit_rigid(frames, template_mm, weight)
    else:
        motion, worth = fit_rigid_robust(frames, template_mm, weight)
        trust = np.median(worth, axis=0)
    held = np.clip(np.searchsorted(np.flatnonzero(tracked), np.arange(len(tracked))), 0, tracked.sum() - 1)
    return RigidMotion(motion.rotation[held], motion.translation_mm[held]), tracked, trust


@dataclass(frozen=True, slots=True, eq=False)
class DrivenTake:
    """A take as a dense face shows it. Arrays are read-only."""

    weights: Array
    """(T, K): standard deviations of each mode from the neutral face."""
    head: RigidMotion
    """(T,): motion of the head since the first frame, in head axes."""
    markers_mm: Array
    """(T, M, 3): markers without head motion, gaps filled."""
    rate_hz: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MarkerDriver:
    """Converts a take's markers into weights of the modes. Arrays are read-only."""

    labels: tuple[str, ...]
    """(M,): markers of the session's face."""
    points: tuple[str, ...]
    """(M,): feature point of each, or ``""``."""
    neutral_mm: Array
    """(M, 3), head axes."""
    reference: HeadReference
    sparse: GapModel
    """Fills gaps, and gives paper 003's weights."""
    matrix: Array
    """(K, 3M): weights for each mm of a marker's coordinate (paper 004, equation 12)."""
    from_sparse: Array
    """(J, K): weights for each of the sparse model's."""
    offset: Array
    """(K,): weights of the sparse model's mean face."""

    def __post_init__(self) -> None:
        count = len(self.labels)
        for name, shape in (("neutral_mm", (count, 3)), ("matrix", ("K", 3 * count))):
            object.__setattr__(self, name, frozen(getattr(self, name), name, shape, np.float64))
        modes = len(self.matrix)
        if len(self.points) != count or len(self.sparse.mean_mm) != count:
            raise UsageError(f"points, sparse: expected {count} markers, as there are labels")
        shape = (len(self.sparse.modes_mm), modes)
        object.__setattr__(self, "from_sparse", frozen(self.from_sparse, "from_sparse", shape, np.float64))
        object.__setattr__(self, "offset", frozen(self.offset, "offset", (modes,), np.float64))

    def weights(self, markers_mm: Array, way: Way = "estimator") -> Array:
        """(T, K) of complete markers, (T, M, 3) mm, head axes."""
        markers = frozen(markers_mm, "markers_mm", ("T", len(self.labels), 3), np.float64)
        if way not in WAYS:
            raise UsageError(f"way: got {way!r}, expected {' or '.join(WAYS)}")
        if way == "estimator":
            driven: Array = (markers - self.neutral_mm).reshape(len(markers), -1) @ self.matrix.T
            return driven
        scores = self.sparse.scores(markers, np.ones(markers.shape[:2], bool))
        return np.asarray(scores @ self.from_sparse + self.offset)

    def follow(self, track: MarkerTrack, way: Way = "estimator") -> DrivenTake:
        """Drive the modes by a recording."""
        there = [name for name in self.labels if name in track.labels]
        if not there:
            raise DataError(f"take: contains none of the face's markers ({', '.join(self.labels[:8])} ...)")
        positions = np.full((track.frame_count, len(self.labels), 3), np.nan)
        positions[:, [self.labels.index(name) for name in there]] = track.select(there).positions_mm
        whole = MarkerTrack(positions_mm=positions, labels=self.labels, rate_hz=track.rate_hz)
        still, head = self.reference.hold(track, whole)
        seen = ~np.isnan(still[..., 0])
        share = float(np.median(seen.mean(axis=1)))
        if share < MIN_SEEN_SHARE:
            raise DataError(
                f"take: the median frame shows {100 * share:.0f} % of the face's {len(self.labels)} markers, expected"
                f" at least {100 * MIN_SEEN_SHARE:.0f} %"
            )
        notes = []
        if len(there) < len(self.labels):
            absent = [name for name in self.labels if name not in there]
            notes.append(f"{len(absent)} markers are not in the take, and filled: {', '.join(absent[:8])}")
        filled = still if seen.all() else self.sparse.fill(still, seen)
        return DrivenTake(self.weights(filled, way), head, filled, track.rate_hz, tuple(notes))
