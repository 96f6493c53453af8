"""A dense face as files: ``dense.toml`` (schema, subject, digest) and ``dense.npz`` (all arrays).

Strict: an entry that is missing, unknown, of the wrong shape or with the wrong digest is a :class:`ProfileError`. The
arrays are those of the papers: ``marker_mean_mm``, ``marker_modes_mm`` (paper 003, section 3), ``mean_mm``,
``modes_mm`` (section 4), ``face_mean_mm``, ``face_modes``, ``variances``, ``marker_centre_mm``, ``estimator`` (paper
004, equations 4 to 12), ``scan_weights`` and ``take_weights`` (of the sparse model), the head's reference and the
colours.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from fapengine._arrays import DAMAGE, pack, unpack
from fapengine._strict_toml import parse_toml, quoted, spell_path
from fapengine.errors import ProfileError, UsageError
from fapengine.geometry.rigid import RigidMotion
from fapengine.laboratory.dense_face import DenseFace, ModeRig
from fapengine.laboratory.marker_driver import HeadReference, MarkerDriver, SessionMarkers
from fapengine.laboratory.setup import Paint
from fapengine.models.dense import DenseModes, LinearEstimator
from fapengine.models.missing import GapModel

SCHEMA = 1
TOML_NAME, ARRAYS_NAME = "dense.toml", "dense.npz"

SINGLE = ("mean_mm", "modes_mm", "face_mean_mm", "face_modes", "scan_weights", "take_weights", "uv", "albedo")
"""Arrays in single precision."""

Arrays = dict[str, Any]


def format_dense(face: DenseFace) -> dict[str, bytes]:
    """Write a dense face's files; :func:`parse_dense` reads them back, to single precision."""
    arrays = _marker_arrays(face) | {
        "mean_mm": face.modes.mean_mm,
        "modes_mm": face.modes.modes_mm,
        "face_mean_mm": face.estimator.mean_face_mm,
        "face_modes": face.estimator.modes,
        "variances": face.estimator.variances,
        "marker_centre_mm": face.estimator.mean_markers_mm,
        "estimator": face.estimator.matrix,
        "triangles": face.triangles.astype(np.int32),
        "scan_weights": face.scan_weights,
        "take_names": np.array(list(face.take_weights), np.str_),
        "take_frames": np.array([len(rows) for rows in face.take_weights.values()], np.int64),
        "take_weights": np.concatenate([np.zeros((0, len(face.sparse.modes_mm))), *face.take_weights.values()]),
    }
    paint = face.paint or Paint()
    colours = {"uv": paint.uv, "albedo": paint.albedo, "texture": paint.texture}
    arrays |= {name: values for name, values in colours.items() if values is not None}
    arrays |= {name: arrays[name].astype(np.float32) for name in SINGLE if name in arrays}
    data = pack(**arrays)
    document = _Document(
        schema=SCHEMA, subject=face.subject, licence=face.licence, ridge=face.modes.ridge,
        ridge_error_mm=face.modes.left_out_mm, noise_mm=face.noise_mm, left_out_modes_mm=face.left_out_mm[0],
        left_out_estimator_mm=face.left_out_mm[1], sha256=hashlib.sha256(data).hexdigest(),
    )  # fmt: skip
    lines = [f"{key} = {quoted(at) if isinstance(at, str) else f'{at:.6g}'}\n" for key, at in asdict(document).items()]
    return {TOML_NAME: "".join(lines).encode(), ARRAYS_NAME: data}


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
        return _face(document, unpack(files[ARRAYS_NAME]))
    except (*DAMAGE, UsageError, TypeError, OverflowError, MemoryError) as error:  # arrays may be of any shape
        raise ProfileError(f"arrays: {error}", where=ARRAYS_NAME) from error


def _face(document: _Document, arrays: Arrays) -> DenseFace:
    ends, rows = np.cumsum([0, *arrays["take_frames"]]), arrays["take_weights"].astype(np.float64)
    if ends[-1] != len(rows):
        raise UsageError(f"take_frames: got {ends[-1]} in all, expected {len(rows)}")
    weights = {str(name): rows[a:b] for name, (a, b) in zip(arrays["take_names"], pairwise(ends), strict=True)}
    paint = {name: arrays[name] for name in ("uv", "texture", "albedo") if name in arrays}
    return DenseFace(
        subject=document.subject, licence=document.licence, **_markers(arrays),
        modes=DenseModes(arrays["mean_mm"], arrays["modes_mm"], document.ridge, document.ridge_error_mm),
        estimator=LinearEstimator(
            mean_markers_mm=arrays["marker_centre_mm"], mean_face_mm=arrays["face_mean_mm"],
            modes=arrays["face_modes"], variances=arrays["variances"], matrix=arrays["estimator"],
        ),
        triangles=arrays["triangles"], paint=Paint(**paint) if paint else None, noise_mm=document.noise_mm,
        left_out_mm=(document.left_out_modes_mm, document.left_out_estimator_mm),
        scan_weights=arrays["scan_weights"], take_weights=weights,
    )  # fmt: skip


def format_rig(rig: ModeRig) -> bytes:
    """Write what drives a head's modes, for the head's folder; :func:`parse_rig` reads it back."""
    driver = rig.driver
    return pack(
        **_marker_arrays(driver), matrix=driver.matrix, from_sparse=driver.from_sparse, offset=driver.offset,
        modes_mm=rig.modes_mm, axes=rig.axes, scale=np.array(rig.scale), origin_mm=rig.origin_mm,
    )  # fmt: skip


def parse_rig(data: bytes, where: str) -> ModeRig:
    """Read what drives a head's modes."""
    try:
        arrays = unpack(data)
        sizes: Arrays = {name: arrays[name] for name in ("matrix", "from_sparse", "offset")}
        return ModeRig(
            driver=MarkerDriver(**_markers(arrays), **sizes), scale=float(arrays["scale"]),
            **{name: arrays[name] for name in ("modes_mm", "axes", "origin_mm")},
        )  # fmt: skip
    except (*DAMAGE, UsageError, TypeError, OverflowError, MemoryError) as error:
        raise ProfileError(f"arrays: {error}", where=where) from error


def _marker_arrays(owner: SessionMarkers) -> Arrays:
    """Arrays of the session's markers; :func:`_markers` reads them back."""
    reference, sparse = owner.reference, owner.sparse
    return {
        "labels": np.array(owner.labels, np.str_), "points": np.array(owner.points, np.str_),
        "neutral_mm": owner.neutral_mm, "skull_labels": np.array(reference.labels, np.str_),
        "skull_mm": reference.markers_mm, "axes_turn": reference.axes.rotation,
        "axes_shift_mm": reference.axes.translation_mm, "marker_mean_mm": sparse.mean_mm,
        "marker_modes_mm": sparse.modes_mm, "marker_noise_mm": np.array(sparse.noise_mm),
    }  # fmt: skip


def _markers(arrays: Arrays) -> dict[str, Any]:
    """Fields of :class:`SessionMarkers`."""
    labels, points, skull = (tuple(map(str, arrays[name])) for name in ("labels", "points", "skull_labels"))
    axes = RigidMotion(arrays["axes_turn"], arrays["axes_shift_mm"])
    if axes.rotation.shape != (3, 3):
        raise UsageError(f"axes_turn: got shape {axes.rotation.shape}, expected (3, 3)")
    sparse = GapModel(arrays["marker_mean_mm"], arrays["marker_modes_mm"], float(arrays["marker_noise_mm"]))
    if not sparse.noise_mm > 0:
        raise UsageError(f"marker_noise_mm: must be a positive number, got {sparse.noise_mm}")
    reference = HeadReference(skull, arrays["skull_mm"].reshape(-1, 3), axes)
    return {
        "labels": labels, "points": points, "neutral_mm": arrays["neutral_mm"], "reference": reference, "sparse": sparse
    }  # fmt: skip
