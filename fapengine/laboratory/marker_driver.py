"""From a recorded take to the weights of a dense face's modes: papers 003 and 004, "animation".

Theory of operation
-------------------
1. The take's head is aligned with the session's by the markers of the skull, as in :mod:`.prepare`; its motion is kept.
2. Markers that a frame does not show are filled by the sparse model (paper 003, section 3).
3. ``"estimator"`` (paper 004, equation 11): ``a = A (p - neutral)``. ``"modes"`` (paper 003, section 4): the sparse
   model's weights of the frame are the dense modes' (equation 3), here converted to the estimator's modes: the scans
   span both, so nothing is lost.

A weight is a mode's standard deviations over the scans, from the neutral face.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from fapengine._arrays import Array, Mask, freeze, frozen
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import RigidMotion, fit_rigid, fit_rigid_robust
from fapengine.models.missing import GapModel

Way = Literal["estimator", "modes"]
WAYS: tuple[Way, ...] = get_args(Way)
MIN_SKULL = 3
DISTRUSTED = 0.2
"""Median trust of a marker of the skull below which it is reported: it is off by more than twice the noise."""
MIN_SEEN_SHARE = 0.25
"""Fraction of the face's markers, in the median frame, below which a take is refused."""


@dataclass(frozen=True, slots=True, eq=False)
class HeadReference:
    """The session's head: positions of its skull's markers, or axes of its room. Arrays are read-only."""

    labels: tuple[str, ...]
    """(H,): markers of the skull; empty if the session's head does not move."""
    markers_mm: Array
    """(H, 3): their positions, head axes."""
    axes: RigidMotion
    """Room to head axes, for a session with a still head."""

    def __post_init__(self) -> None:
        freeze(self, markers_mm=(len(self.labels), 3))

    def hold(
        self, track: MarkerTrack, face: MarkerTrack, *, take: str = "", notes: list[str] | None = None
    ) -> tuple[Array, RigidMotion]:
        """Remove the head's motion from markers of a take.

        Parameters
        ----------
        track, face : MarkerTrack
            Markers of the skull, and those to free, of the same frames.
        take : str
            Name of the take, for messages.
        notes : list of str, optional
            Gets a line if frames do not show the head, and for each marker of the skull that slips.

        Returns
        -------
        (T, M, 3) float64, mm
            Markers of ``face`` in head axes, NaN where one is not seen or the head is unknown.
        RigidMotion
            (T,): motion of the head since the first frame, in head axes.
        """
        count = face.frame_count
        if not self.labels:
            still = self.axes.apply(face.positions_mm)
            return still, RigidMotion(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
        where = f"take {take}" if take else ""
        kept = [index for index, name in enumerate(self.labels) if name in track.labels]
        if len(kept) < MIN_SKULL:
            missing = ", ".join(name for name in self.labels if name not in track.labels)
            raise DataError(f"head: missing {missing} of the skull's markers, requires {MIN_SKULL}", where=where)
        skull = track.select([self.labels[index] for index in kept])
        tracked = skull.valid.sum(axis=1) >= MIN_SKULL
        if not tracked.any():
            raise DataError(f"head: no frame shows {MIN_SKULL} of its markers", where=where)
        head_from_room, trust = _fit_skull(skull, self.markers_mm[kept], tracked)
        if notes is not None:
            if not tracked.all():
                hidden = f"{np.sum(~tracked)} of {count}"
                notes.append(f"{where}: head unknown in {hidden} frames, which count as unseen")
            for label, worth in zip(skull.labels, trust, strict=True):
                if worth < DISTRUSTED:
                    notes.append(f"{where}: head marker {label} slips, and gets less weight")
        still = head_from_room.apply(face.positions_mm)
        still[~tracked] = np.nan
        first = RigidMotion(head_from_room.rotation[0], head_from_room.translation_mm[0])
        return still, first @ head_from_room.inverse()


def _fit_skull(skull: MarkerTrack, template_mm: Array, tracked: Mask) -> tuple[RigidMotion, Array]:
    """Fit the markers of a skull to a template, (H, 3), in every tracked frame, (T,).

    Returns
    -------
    RigidMotion
        (T,): template from room. Other frames get the motion of the next tracked one.
    (H,) float64
        Median trust in each marker; 1 for three markers, which fit exactly.
    """
    frames = np.where(skull.valid[..., None], skull.positions_mm, 0.0)[tracked]
    weight = skull.valid[tracked].astype(np.float64)
    if len(template_mm) == MIN_SKULL:
        motion, trust = fit_rigid(frames, template_mm, weight), np.ones((1, MIN_SKULL))
    else:
        motion, trust = fit_rigid_robust(frames, template_mm, weight)
    held = np.clip(np.searchsorted(np.flatnonzero(tracked), np.arange(len(tracked))), 0, tracked.sum() - 1)
    return RigidMotion(motion.rotation[held], motion.translation_mm[held]), np.median(trust, axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class DrivenTake:
    """Motion of a dense face in a take. Arrays are read-only."""

    weights: Array
    """(T, K): standard deviations of each mode from the neutral face."""
    head: RigidMotion
    """(T,): motion of the head since the first frame, in head axes."""
    markers_mm: Array
    """(T, M, 3): markers without head motion, gaps filled."""
    rate_hz: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SessionMarkers:
    """Markers of a session's face, and the model of their motion. Arrays are read-only."""

    labels: tuple[str, ...]
    """(M,): as recorded."""
    points: tuple[str, ...]
    """(M,): feature point of each, or ``""``."""
    neutral_mm: Array
    """(M, 3): the session's neutral pose, head axes."""
    reference: HeadReference
    sparse: GapModel
    """Fills gaps, and gives the weights of paper 003, section 3."""

    def __post_init__(self) -> None:
        count = len(self.labels)
        freeze(self, neutral_mm=(count, 3))
        for name, got in (("points", self.points), ("sparse markers", self.sparse.mean_mm)):
            if len(got) != count:
                raise UsageError(f"{name}: got {len(got)}, expected {count}, the number of labels")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MarkerDriver(SessionMarkers):
    """Converts a take's markers into weights of the modes. Arrays are read-only."""

    matrix: Array
    """(K, 3M): weights for each mm of a marker's coordinate (paper 004, equation 12)."""
    from_sparse: Array
    """(J, K): weights for each of the sparse model's."""
    offset: Array
    """(K,): weights of the sparse model's mean face."""

    def __post_init__(self) -> None:
        SessionMarkers.__post_init__(self)
        freeze(self, matrix=("K", self.neutral_mm.size), offset=("K",))
        freeze(self, from_sparse=(len(self.sparse.modes_mm), len(self.matrix)))

    def weights(self, markers_mm: Array, way: Way = "estimator") -> Array:
        """(T, K) of complete markers, (T, M, 3) mm, head axes."""
        markers = frozen(markers_mm, "markers_mm", ("T", len(self.labels), 3), np.float64)
        if way not in WAYS:
            raise UsageError(f"way: got {way!r}, expected {' or '.join(WAYS)}")
        if way == "estimator":
            return np.asarray((markers - self.neutral_mm).reshape(len(markers), -1) @ self.matrix.T)
        return np.asarray(self.sparse.scores(markers) @ self.from_sparse + self.offset)

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
