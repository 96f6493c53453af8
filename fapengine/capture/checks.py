"""What is wrong with a recording though it reads well: markers that exchange places, jump, or never move."""

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.marker_track import MarkerTrack

MAX_SPEED_MM_S = 1500.0
"""Lips and jaw stay under a fifth of this in speech; a head turned fast comes near."""
SHARE = 0.5
"""Markers have exchanged places where that leaves less than this share of their steps."""
SHOWN = 5


def check_track(track: MarkerTrack) -> tuple[str, ...]:
    """Look a track over; each finding names marker and frame.

    Returns
    -------
    findings : tuple of str
        Markers that exchange places from one frame to the next, jump, or stand still to the last digit.
    """
    return (*_exchanges(track), *_constant(track))


def _exchanges(track: MarkerTrack) -> list[str]:
    before, after = track.positions_mm[:-1], track.positions_mm[1:]
    step = np.nan_to_num(np.linalg.norm(after - before, axis=-1))
    limit = max(MAX_SPEED_MM_S / track.rate_hz, 3.0)
    both = track.valid[1:] & track.valid[:-1]
    known = np.where(both | ~both.any(axis=1, keepdims=True), step, np.nan)  # a step that no marker shows is 0
    jumps = step - np.nanmedian(known, axis=1, keepdims=True) > limit  # against what the head as a whole does
    remarks = []
    for frame in np.flatnonzero(jumps.any(axis=1)):
        movers = np.flatnonzero(jumps[frame])
        pairs = _pairs(before[frame, movers], after[frame, movers], step[frame, movers])
        for first, other in pairs:
            names = track.labels[movers[first]], track.labels[movers[other]]
            remarks.append(f"markers {names[0]} and {names[1]} exchange places at frame {frame + 1}")
        paired = {index for pair in pairs for index in pair}
        remarks += [
            f"marker {track.labels[movers[n]]} jumps by {step[frame, movers[n]]:.0f} mm at frame {frame + 1}"
            for n in range(len(movers))
            if n not in paired
        ]
    if len(remarks) > SHOWN:
        remarks = [*remarks[:SHOWN], f"and {len(remarks) - SHOWN} more jumps"]
    return remarks


def _pairs(before: NDArray[np.float64], after: NDArray[np.float64], step: NDArray[np.float64]) -> list[tuple[int, int]]:
    across = np.linalg.norm(after[:, None] - before[None], axis=-1)
    total = across + across.T
    near = total < SHARE * (step[:, None] + step[None])
    return [(int(first), int(other)) for first, other in np.argwhere(np.triu(near, 1))]


def _constant(track: MarkerTrack) -> list[str]:
    if track.frame_count < 2:
        return []
    shown = np.where(np.isnan(track.positions_mm), -np.inf, track.positions_mm).max(axis=0)
    lowest = np.where(np.isnan(track.positions_mm), np.inf, track.positions_mm).min(axis=0)
    still = (shown == lowest).all(axis=-1) & (track.valid.sum(axis=0) > 1)
    return [f"marker {track.labels[index]} never moves" for index in np.flatnonzero(still)]
