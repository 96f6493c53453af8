"""Overview of a recording with unnamed markers: visible markers, rigid bodies, quiet frames."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.capture.marker_track import MarkerTrack
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES

FRAMES = 200
"""Frames from which the skull is guessed."""
RIGID_MM = 0.8
"""Standard deviation of the distance of two markers up to which they are on one rigid body: skin slides over bone."""
MIN_HEAD, MAX_MARKERS, MIN_FRAMES = 3, 300, 10
QUIET_S = 0.5
SOFT = ("2.", "3.", "4.", "5.", "6.", "8.")
"""Groups of feature points that can move against the skull, even if they hardly do in a take."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Look:
    """Markers, bodies and quiet frames of a recording."""

    seen: Array
    """(M,): fraction of frames that show each marker."""
    gaps: NDArray[np.intp]
    """(M,): number of stretches in which each is not seen."""
    longest_s: Array
    """(M,): the longest of them."""
    size_mm: Array
    """(3,): box around the median places."""
    head: tuple[str, ...]
    """Markers that keep their distances to each other while others do not: perhaps the skull's."""
    quiet_s: tuple[float, float]
    """Half a second in which the face moves least: perhaps the neutral pose."""
    named: tuple[str, ...]
    """Labels that are feature points of the standard."""


def look_over(track: MarkerTrack) -> Look:
    """Make the overview of a recording."""
    valid = track.valid
    gaps, longest = np.zeros(len(track.labels), np.intp), np.zeros(len(track.labels))
    for marker in range(len(track.labels)):
        edges = np.flatnonzero(np.diff(np.concatenate([[1], valid[:, marker], [1]]).astype(int)))
        gaps[marker] = len(edges) // 2
        longest[marker] = max((b - a for a, b in pairwise(edges) if not valid[a, marker]), default=0) / track.rate_hz
    shown = track.positions_mm[:, valid.any(axis=0)]
    places = np.nanmedian(shown, axis=0) if shown.size else np.zeros((1, 3))
    return Look(
        seen=valid.mean(axis=0),
        gaps=gaps,
        longest_s=longest,
        size_mm=np.ptp(places, axis=0),
        head=guess_head(track),
        quiet_s=_quiet(track),
        named=tuple(label for label in track.labels if label in FEATURE_POINT_NAMES),
    )


def guess_head(track: MarkerTrack) -> tuple[str, ...]:
    """Guess which markers follow the skull alone: the most that keep all their distances to each other.

    Where labels name a head, as joints of a skeleton do, those come first: a hand has more joints.

    Returns
    -------
    tuple of str
        In the track's order; empty where fewer than three do, all do (nothing moves), or frames are too few.
    """
    steps = max(1, track.frame_count // FRAMES)
    bone = np.array([not (name in FEATURE_POINT_NAMES and name.startswith(SOFT)) for name in track.labels])
    columns = np.flatnonzero(bone & (track.valid[::steps].mean(axis=0) > 0.5))[:MAX_MARKERS]
    places = track.positions_mm[::steps, columns]
    if len(columns) < MIN_HEAD or track.frame_count < MIN_FRAMES:
        return ()
    rigid = np.zeros((len(columns), len(columns)), bool)
    for marker in range(len(columns)):
        distance = np.linalg.norm(places - places[:, marker : marker + 1], axis=-1)
        counted = (~np.isnan(distance)).sum(axis=0)
        mean = np.nansum(distance, axis=0) / np.maximum(counted, 1)
        rigid[marker] = np.nansum((distance - mean) ** 2, axis=0) / np.maximum(counted, 1) < RIGID_MM**2
    named = np.array(["head" in track.labels[column].lower() for column in columns])
    order = np.lexsort((-rigid.sum(axis=1), ~named))
    best: list[int] = []
    for seed in order[: min(10, named.sum() or 10)]:
        group = [int(seed)]
        for other in order:
            if other != seed and rigid[other, group].all():
                group.append(int(other))
        best = group if len(group) > len(best) else best
    if not MIN_HEAD <= len(best) < len(track.labels):
        return ()
    return tuple(track.labels[columns[index]] for index in sorted(best))


def _quiet(track: MarkerTrack) -> tuple[float, float]:
    """Begin and end of the stretch in which markers move least against each other."""
    width = min(max(1, round(QUIET_S * track.rate_hz)), track.frame_count)
    middle = np.nansum(track.positions_mm, axis=1) / np.maximum(track.valid.sum(axis=1), 1)[:, None]
    away = track.positions_mm - middle[:, None]
    speed = np.nan_to_num(np.linalg.norm(np.diff(away, axis=0, prepend=away[:1]), axis=-1)).sum(axis=1)
    speed = np.where(track.valid.all(axis=1), speed, speed + speed.max(initial=0.0))  # prefers a moment that shows all
    moved = np.convolve(speed, np.ones(width), mode="valid")
    first = int(moved.argmin())
    return first / track.rate_hz, (first + width) / track.rate_hz


def session_lines(look: Look, track: MarkerTrack, take: str, *, mesh: bool = False) -> list[str]:
    """Make lines of a ``session.toml`` to start from: guesses, and blanks for the user to fill."""
    start_s, end_s = look.quiet_s
    quoted = ", ".join(f'"{name}"' for name in look.head)
    lines = ['subject = "NAME"', 'language = "en-GB"', 'licence = "not stated"']
    lines += ["rate_hz = 60.0    # of the sequence"] if mesh else []
    if quoted:
        lines.append(f"head = [{quoted}]    # guessed: they keep their distances; name only what follows the skull")
    quiet = f'{{ take = "{take}", start_s = {start_s:.2f}, end_s = {end_s:.2f} }}'
    lines.append(f"neutral = {quiet}    # guessed: the quietest")
    if len(look.named) < MIN_HEAD + 1:
        lines += ["", "[points]    # marker = feature point of the standard; lips, chin and cheeks at least"]
        free = [name for name in track.labels if name not in look.head][:8]
        lines += [f'# "{name}" = "8.1"' for name in free]
    return lines
