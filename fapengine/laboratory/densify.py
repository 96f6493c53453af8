"""Fit a dense face to a session's scans: paper 003, section 4, and the estimator of paper 004."""

from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError
from fapengine.geometry.surface import Surface
from fapengine.laboratory.dense_face import DenseFace
from fapengine.laboratory.prepare import Prepared
from fapengine.laboratory.setup import Scan, Setup
from fapengine.models.dense import bind, fit_dense_modes, fit_estimator, remesh, sparse_facets
from fapengine.models.missing import GapModel, fit_gaps
from fapengine.models.scans import ScanFit, fit_scan

STRANGE_MM, UNSETTLED = 2.5, 0.2
"""Median distance from the landmarks, and fraction of unsettled fits, above which scans and markers are of two people:
3.3 mm and 0.27 (last steps of more than 0.1 um) with another person's scans, 1.8 mm and 0 with the speaker's own."""
MIN_SCANS, MIN_MARKERS, MIN_LANDMARKS = 3, 12, 3
FRAMES = 4000
"""Frames of the session for the sparse model; more do not change eight modes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DenseStudy:
    """The dense face, and how each scan was fitted."""

    face: DenseFace
    fits: tuple[tuple[str, ScanFit, float], ...]
    """Name of the scan, its fit, and the fraction of the vertices that are on it."""
    registration: tuple[tuple[str, Surface, Surface, Array], ...]
    """Of each scan in head axes, the reference first: name, surface as scanned, surface with the reference's vertices,
    and fitted markers, (M, 3) mm."""

    @property
    def warnings(self) -> list[str]:
        """A doubt that scans and markers show the same person, if there is one."""
        fits = [fit for _, fit, _ in self.fits]
        off_mm, lost = np.median([fit.landmark_rms_mm for fit in fits]), sum(not fit.settled for fit in fits)
        if off_mm <= STRANGE_MM and lost < UNSETTLED * len(fits):
            return []
        return [
            f"scans: the markers' model misses their landmarks by {off_mm:.1f} mm (median), and {lost} of"
            f" {len(fits)} fits do not settle: are scans and markers of the same person?"
        ]


def densify(prepared: Prepared, setup: Setup, *, modes: int) -> DenseStudy:
    """Fit the session's model to every scan, give all scans the same vertices, and learn from them."""
    scans = setup.scans
    if len(scans) < MIN_SCANS:
        raise DataError(f"scans: needs at least {MIN_SCANS} postures, got {len(scans)}", where=prepared.subject)
    if len(prepared.labels) < MIN_MARKERS:
        raise DataError(
            f"markers: needs at least {MIN_MARKERS} to lay a model onto scans, got {len(prepared.labels)}",
            where=prepared.subject,
        )
    frames = prepared.neutral_mm + np.concatenate([take.moved_mm for take in prepared.takes])
    frames = frames[np.linspace(0, len(frames) - 1, min(len(frames), FRAMES)).astype(int)]
    sparse = fit_gaps(frames, np.ones(frames.shape[:2], bool), modes)
    fits = [_find(sparse, scan, prepared) for scan in scans]
    fitted = [
        Surface(fit.scan_from_model.inverse().apply(scan.surface.vertices_mm), scan.surface.triangles)
        for scan, fit in zip(scans, fits, strict=True)
    ]
    points = [fit.points_mm for fit in fits]
    facets = sparse_facets(np.concatenate([frames[:: max(1, len(frames) // 40)], np.stack(points)]))
    binding = bind(fitted[0], points[0], facets)
    faces, met = [fitted[0].vertices_mm], [1.0]
    for scan, surface, position in zip(scans[1:], fitted[1:], points[1:], strict=True):
        try:
            vertices, hit = remesh(binding, fitted[0], surface, position, facets)
        except DataError as error:
            raise type(error)(error.message, where=f"scan {scan.name}") from error
        faces.append(vertices)
        met.append(float(hit.mean()))
    noise_mm = _noise(prepared, fits)
    scores, marks, dense = np.stack([fit.scores for fit in fits]), np.stack(points), np.stack(faces)
    face = DenseFace(
        subject=prepared.subject, licence=setup.licence, labels=prepared.labels, points=prepared.points,
        neutral_mm=prepared.neutral_mm, reference=prepared.reference, sparse=sparse,
        modes=fit_dense_modes(dense, scores), estimator=fit_estimator(dense, marks, noise_mm=noise_mm),
        triangles=fitted[0].triangles, paint=scans[0].paint, noise_mm=noise_mm,
        left_out_mm=_left_out(dense, scores, marks, noise_mm), scan_weights=scores,
        take_weights={take.name: sparse.scores(prepared.neutral_mm + take.moved_mm) for take in prepared.takes},
    )  # fmt: skip
    registration = tuple(
        (scan.name, surface, Surface(vertices, fitted[0].triangles), position)
        for scan, surface, vertices, position in zip(scans, fitted, faces, points, strict=True)
    )
    names = (scan.name for scan in scans)
    return DenseStudy(face=face, fits=tuple(zip(names, fits, met, strict=True)), registration=registration)


def _find(sparse: GapModel, scan: Scan, prepared: Prepared) -> ScanFit:
    marks, where = [], f"scan {scan.name}"
    for name in scan.landmarks:
        if name not in (*prepared.labels, *prepared.named):
            raise DataError(f"landmark {name!r}: is neither a marker nor a recorded feature point", where=where)
        marks.append(prepared.labels.index(name) if name in prepared.labels else prepared.points.index(name))
    if len(set(marks)) < MIN_LANDMARKS:
        raise DataError(f"landmarks: needs at least {MIN_LANDMARKS}, got {len(set(marks))}", where=where)
    try:
        return fit_scan(sparse, scan.surface, marks, list(scan.landmarks.values()))
    except DataError as error:
        raise type(error)(error.message, where=where) from error


def _noise(prepared: Prepared, fits: list[ScanFit]) -> float:
    """Estimate a marker coordinate's deviation: noise of the recording, and distance of the model to the scans.

    The noise is measured on second differences of the positions, which contain little motion: for white noise they have
    sqrt(6) times its deviation. The distance is that of the landmarks: the surface does not show what slid along it.
    """
    second = np.concatenate([np.diff(take.moved_mm, n=2, axis=0) for take in prepared.takes if len(take.moved_mm) > 2])
    tremble = 1.4826 * np.median(np.abs(second[:: max(1, len(second) // FRAMES)])) / np.sqrt(6)
    met = np.sqrt(np.mean([fit.landmark_rms_mm**2 for fit in fits]) / 3)
    return float(np.hypot(tremble, met))


def _left_out(faces: Array, scores: Array, marks: Array, noise_mm: float) -> tuple[float, float]:
    """Predict each scan from the others: mean vertex distance of the dense modes and of the estimator."""
    misses = []
    for index in range(len(faces)):
        others = np.arange(len(faces)) != index
        modes = fit_dense_modes(faces[others], scores[others])
        estimator = fit_estimator(faces[others], marks[others], noise_mm=noise_mm)
        guesses = np.stack([modes.faces_mm(scores[index]), estimator.faces_mm(marks[index])])
        misses.append(np.linalg.norm(guesses - faces[index], axis=-1).mean(axis=-1))
    by_modes, by_estimator = np.mean(misses, axis=0).tolist()
    return by_modes, by_estimator
