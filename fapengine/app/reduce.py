"""A recording reduced to via points, and sampled again at any rate: paper 004, "Interpolation"."""

from pathlib import Path

import numpy as np

from fapengine._arrays import pack
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import write_bytes
from fapengine.files.recordings import load_markers, save_markers
from fapengine.models.via_points import Reduction, extract_via_points, reduction_curve

CURVE = (0.5, 1.0, 2.0, 4.0)
"""Bounds of the reduction curve, as multiples of the requested one."""


def reduce_take(
    take: Path, bound_mm: float, output: Path, *, back: Path | None = None, rate_hz: float | None = None
) -> list[Reduction]:
    """Find the via points of a recording, and write them; the file is a recording, too.

    It has ``times_s`` (N,), ``via_mm`` (N, M, 3), ``labels`` (M,), ``rate_hz``, and the reduction curve.

    Parameters
    ----------
    take : Path
    bound_mm : float
        Largest error of a marker.
    output : Path
        Archive of via points (.npz).
    back : Path, optional
        Recording of the curve through the via points.
    rate_hz : float, optional
        Frame rate of ``back``; by default that of the take.

    Returns
    -------
    list of Reduction
        For the bound, then for its multiples in :data:`CURVE`.
    """
    if output.suffix != ".npz":
        raise UsageError(f"output: got {output}, expected a name that ends with .npz")
    track = load_markers(take).markers
    if not track.valid.all():
        worst = int(track.valid.mean(axis=0).argmin())
        raise DataError(f"{take}: got gaps, most in marker {track.labels[worst]}, expected every marker in every frame")
    points = extract_via_points(track.positions_mm, track.rate_hz, bound_mm)
    bounds = [bound_mm, *(bound_mm * times for times in CURVE if times != 1.0)]
    curve = reduction_curve(track.positions_mm, track.rate_hz, bounds)
    arrays = pack(
        times_s=points.times_s, via_mm=points.positions_mm, labels=np.array(track.labels),
        rate_hz=track.rate_hz,
        bound_mm=[row.tolerance_mm for row in curve], share=[row.share for row in curve],
        mean_mm=[row.mean_mm for row in curve], max_mm=[row.max_mm for row in curve],
    )  # fmt: skip
    write_bytes(output, arrays)
    if back is not None:
        rate_hz = rate_hz or track.rate_hz
        save_markers(back, MarkerTrack(positions_mm=points.frames(rate_hz), labels=track.labels, rate_hz=rate_hz))
    return curve
