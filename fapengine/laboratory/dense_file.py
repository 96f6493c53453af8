"""A dense face as files: ``dense.toml`` (schema, subject, digest) and ``dense.npz`` (all arrays).

Strict: an entry that is missing, unknown, of the wrong shape or with the wrong digest is a :class:`ProfileError`. The
arrays are the papers', in float32: ``marker_mean_mm``, ``marker_modes_mm`` (paper 003, section 3), ``mean_mm``,
``modes_mm`` (section 4), ``face_mean_mm``, ``face_modes``, ``variances``, ``marker_centre_mm``, ``estimator`` (paper
004, equations 4 to 12), ``scan_weights`` and ``take_weights`` (of the sparse model), and what lays takes and colours
on.
"""

import hashlib
import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import DAMAGE
from fapengine._strict_toml import parse_toml, quoted, spell_path
from fapengine.errors import ProfileError, UsageError
from fapengine.geometry.rigid import RigidMotion
from fapengine.laboratory.dense_face import DenseFace, ModeRig
from fapengine.laboratory.marker_driver import HeadReference, MarkerDriver
from fapengine.laboratory.setup import Paint
from fapengine.models.dense import DenseModes, LinearEstimator
from fapengine.models.missing import GapModel

SCHEMA = 1
TOML_NAME, ARRAYS_NAME = "dense.toml", "dense.npz"
MAX_BYTES = 1 << 30
"""Bytes of all arrays, unpacked; a small archive cannot ask for more."""

Arrays = dict[str, Any]


def format_dense(face: DenseFace) -> dict[str, bytes]:
    """Write a dense face's files; :func:`parse_dense` reads them back, to single precision."""
    arrays = _marker_arrays(face.labels, face.points, face.neutral_mm, face.reference, face.sparse) | {
        "mean_mm": _single(face.modes.mean_mm),
        "modes_mm": _single(face.modes.modes_mm),
        "face_mean_mm": _single(face.estimator.mean_face_mm),
        "face_modes": _single(face.estimator.modes),
        "variances": face.estimator.variances,
        "marker_centre_mm": face.estimator.mean_markers_mm,
        "estimator": face.estimator.matrix,
        "triangles": face.triangles.astype(np.int32),
        "scan_weights": _single(face.scan_weights),
        "take_names": np.array(list(face.take_weights), np.str_),
        "take_frames": np.array([len(rows) for rows in face.take_weights.values()], np.int64),
        "take_weights": _single(
            np.concatenate([np.zeros((0, len(face.sparse.modes_mm))), *face.take_weights.values()])
        ),
    }
    paint = face.paint or Paint()
    for name, values in (("uv", paint.uv), ("albedo", paint.albedo)):
        if values is not None:
            arrays[name] = _single(values)
    if paint.texture is not None:
        arrays["texture"] = paint.texture
    data = _packed(arrays)
    lines = [
        f"schema = {SCHEMA}",
        f"subject = {quoted(face.subject)}",
        f"licence = {quoted(face.licence)}",
        f"ridge = {face.modes.ridge:g}",
        f"noise_mm = {face.noise_mm:.6f}",
        f"ridge_error_mm = {face.modes.left_out_mm:.6f}",
        f"left_out_modes_mm = {face.left_out_mm[0]:.6f}",
        f"left_out_estimator_mm = {face.left_out_mm[1]:.6f}",
        f"sha256 = {quoted(hashlib.sha256(data).hexdigest())}",
    ]
    return {TOML_NAME: ("\n".join(lines) + "\n").encode(), ARRAYS_NAME: data}


@dataclass(frozen=True, slots=True)
class _Document:
    """``dense.toml``, key by key."""

    schema: int
    subject: str
    licence: str
    ridge: float
    ridge_error_mm: float
    noise_mm: float
    left_out_modes_mm: float
    left_out_estimator_mm: float
    sha256: str


def parse_dense(files: Mapping[str, bytes]) -> DenseFace:
    """Read a dense face from :data:`TOML_NAME` and :data:`ARRAYS_NAME`."""
    for name in (TOML_NAME, ARRAYS_NAME):
        if name not in files:
            raise ProfileError(f"got files {sorted(files)}, expected {name} among them", where=name)
    document = parse_toml(files[TOML_NAME], _Document, TOML_NAME, ProfileError, schema=SCHEMA)
    if (digest := hashlib.sha256(files[ARRAYS_NAME]).hexdigest()) != document.sha256:
        raise ProfileError(
            f"sha256 of {ARRAYS_NAME}: got {digest}, expected {document.sha256}", where=spell_path(TOML_NAME, "sha256")
        )
    try:
        return _face(document, _unpacked(files[ARRAYS_NAME]))
    except (*DAMAGE, UsageError, TypeError, OverflowError, MemoryError) as error:  # arrays may be of any shape
        raise ProfileError(f"arrays: {error}", where=ARRAYS_NAME) from error


def _face(document: _Document, arrays: Arrays) -> DenseFace:
    labels, points, neutral_mm, reference, sparse = _markers(arrays)
    ends = np.cumsum(arrays["take_frames"])
    rows = np.split(arrays["take_weights"].astype(np.float64), ends[:-1]) if len(ends) else []
    names = [str(name) for name in arrays["take_names"]]
    if len(ends) and int(ends[-1]) != len(arrays["take_weights"]):
        raise UsageError(f"take_frames: got {int(ends[-1])} in all, expected {len(arrays['take_weights'])}")
    paint = {name: arrays[name] for name in ("uv", "texture", "albedo") if name in arrays}
    return DenseFace(
        subject=document.subject, licence=document.licence, labels=labels, points=points, neutral_mm=neutral_mm,
        reference=reference, sparse=sparse,
        modes=DenseModes(arrays["mean_mm"], arrays["modes_mm"], document.ridge, document.ridge_error_mm),
        estimator=LinearEstimator(
            mean_markers_mm=arrays["marker_centre_mm"], mean_face_mm=arrays["face_mean_mm"],
            modes=arrays["face_modes"], variances=arrays["variances"], matrix=arrays["estimator"],
        ),
        triangles=arrays["triangles"], paint=Paint(**paint) if paint else None, noise_mm=document.noise_mm,
        left_out_mm=(document.left_out_modes_mm, document.left_out_estimator_mm),
        scan_weights=arrays["scan_weights"], take_weights=dict(zip(names, rows, strict=True)),
    )  # fmt: skip


def format_rig(rig: ModeRig) -> bytes:
    """Write what drives a head's modes, for the head's folder; :func:`parse_rig` reads it back."""
    driver = rig.driver
    return _packed(
        _marker_arrays(driver.labels, driver.points, driver.neutral_mm, driver.reference, driver.sparse)
        | {
            "matrix": driver.matrix, "from_sparse": driver.from_sparse, "offset": driver.offset,
            "modes_mm": rig.modes_mm, "axes": rig.axes, "scale": np.array(rig.scale), "origin_mm": rig.origin_mm,
        }
    )  # fmt: skip


def parse_rig(data: bytes, where: str) -> ModeRig:
    """Read what drives a head's modes."""
    try:
        arrays = _unpacked(data)
        labels, points, neutral_mm, reference, sparse = _markers(arrays)
        driver = MarkerDriver(
            labels=labels, points=points, neutral_mm=neutral_mm, reference=reference, sparse=sparse,
            matrix=arrays["matrix"], from_sparse=arrays["from_sparse"], offset=arrays["offset"],
        )  # fmt: skip
        return ModeRig(
            driver=driver, modes_mm=arrays["modes_mm"], axes=arrays["axes"], scale=float(arrays["scale"]),
            origin_mm=arrays["origin_mm"],
        )  # fmt: skip
    except (*DAMAGE, UsageError, TypeError, OverflowError, MemoryError) as error:
        raise ProfileError(f"arrays: {error}", where=where) from error


def _marker_arrays(
    labels: tuple[str, ...],
    points: tuple[str, ...],
    neutral_mm: NDArray[np.float64],
    reference: HeadReference,
    sparse: GapModel,
) -> Arrays:
    return {
        "labels": np.array(labels, np.str_), "points": np.array(points, np.str_), "neutral_mm": neutral_mm,
        "skull_labels": np.array(reference.labels, np.str_), "skull_mm": reference.markers_mm,
        "axes_turn": reference.axes.rotation, "axes_shift_mm": reference.axes.translation_mm,
        "marker_mean_mm": sparse.mean_mm, "marker_modes_mm": sparse.modes_mm,
        "marker_noise_mm": np.array(sparse.noise_mm),
    }  # fmt: skip


def _markers(
    arrays: Arrays,
) -> tuple[tuple[str, ...], tuple[str, ...], NDArray[np.float64], HeadReference, GapModel]:
    labels, points, skull = (tuple(map(str, arrays[name])) for name in ("labels", "points", "skull_labels"))
    reference = HeadReference(
        skull, arrays["skull_mm"].reshape(-1, 3), RigidMotion(arrays["axes_turn"], arrays["axes_shift_mm"])
    )
    if reference.axes.rotation.shape != (3, 3):
        raise UsageError(f"axes_turn: got shape {reference.axes.rotation.shape}, expected (3, 3)")
    sparse = GapModel(arrays["marker_mean_mm"], arrays["marker_modes_mm"], float(arrays["marker_noise_mm"]), 0)
    if not sparse.noise_mm > 0:
        raise UsageError(f"marker_noise_mm: must be a positive number, got {sparse.noise_mm}")
    return labels, points, arrays["neutral_mm"], reference, sparse


def _single(values: NDArray[np.float64]) -> NDArray[np.float32]:
    return values.astype(np.float32)


def _packed(arrays: Arrays) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _unpacked(data: bytes) -> Arrays:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > MAX_BYTES:
        raise UsageError(f"must have at most {MAX_BYTES} bytes unpacked, got {size}")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
