"""A recording as via points, and back at any rate: paper 004, "Interpolation"."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import write_bytes
from fapengine.files.recordings import load_markers, save_markers
from fapengine.models.via_points import Reduction, extract_via_points, reduction_curve

CURVE = (0.5, 1.0, 2.0, 4.0)
"""Bounds of the data reduction curve, in times of the one that is asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReduceJob:
    """Input, output and options of a reduction."""

    take: Path
    bound_mm: float
    output: Path
    """Archive of via points (.npz)."""
    back: Path | None = None
    """Recording of the curve through them."""
    rate_hz: float | None = None
    """Frames a second of ``back``; by default the take's."""


def run_reduce(job: ReduceJob) -> list[Reduction]:
    """Find the via points of a recording, and write them: ``times_s``, ``via_mm``, ``labels``, and the reduction curve.

    Returns
    -------
    list of Reduction
        Of the asked bound, then of its multiples in :data:`CURVE`.
    """
    if job.output.suffix != ".npz":
        raise UsageError(f"output: got {job.output}, expected a name that ends with .npz")
    track = load_markers(job.take).markers
    if not track.valid.all():
        worst = int(track.valid.mean(axis=0).argmin())
        raise DataError(
            f"{job.take}: got gaps, most in marker {track.labels[worst]}, expected every marker in every frame"
        )
    points = extract_via_points(track.positions_mm, track.rate_hz, job.bound_mm)
    bounds = [job.bound_mm, *(job.bound_mm * times for times in CURVE if times != 1.0)]
    curve = reduction_curve(track.positions_mm, track.rate_hz, bounds)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, times_s=points.times_s, via_mm=points.positions_mm, labels=np.array(track.labels),
        bound_mm=[row.tolerance_mm for row in curve], share=[row.share for row in curve],
        mean_mm=[row.mean_mm for row in curve], max_mm=[row.max_mm for row in curve],
    )  # fmt: skip
    write_bytes(job.output, buffer.getvalue())
    if job.back is not None:
        rate_hz = job.rate_hz or track.rate_hz
        times_s = np.arange(int(points.times_s[-1] * rate_hz + 1e-9) + 1) / rate_hz
        save_markers(job.back, MarkerTrack(positions_mm=points.sample(times_s), labels=track.labels, rate_hz=rate_hz))
    return curve
