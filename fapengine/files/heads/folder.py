"""Heads as folders, written and read.

A head is a folder: ``head.toml`` (schema, source, licence, which blendshapes are used), ``head.npz`` (all arrays of the
mesh, float32) and, if it has a texture, ``head.png``; in the cache the texture is in ``head.npz``. A dense face that
``fapengine fit`` learned also has ``head_modes.npz``: its modes, and the map from markers to their weights
(:mod:`fapengine.laboratory.dense_file`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import DAMAGE, pack, unpack
from fapengine._strict_toml import MAX_BYTES as MOST_TOML
from fapengine._strict_toml import parse_toml, quoted, spell_path
from fapengine.errors import DataError, ProfileError, UsageError
from fapengine.files.paths import read_bytes, replacing_folder
from fapengine.files.pictures import format_png, opened
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh, Folds
from fapengine.mpeg4.fapu import Fapu

if TYPE_CHECKING:
    from fapengine.laboratory.dense_face import ModeRig

SCHEMA = 2
TOML_NAME, ARRAYS_NAME, TEXTURE_NAME, MODES_NAME = "head.toml", "head.npz", "head.png", "head_modes.npz"
OWNED = (TOML_NAME, ARRAYS_NAME, TEXTURE_NAME, MODES_NAME)
"""Files of a head's folder."""
OTHERS = ("feature_points", "fapu", "basis", "texture", "folds")
ARRAYS = tuple(field.name for field in fields(FaceMesh) if field.name not in OTHERS)
"""Fields of a head that are arrays."""


@dataclass(frozen=True, slots=True)
class HeadInfo:
    """Origin of a head, and which blendshapes of its file move it."""

    source: str
    licence: str
    used: tuple[str, ...] = ()
    """Blendshapes that FAPs blend."""
    lacking: tuple[str, ...] = ()
    """ARKit's blendshapes that it does not have."""


def save_head(
    folder: Path, mesh: FaceMesh, info: HeadInfo, rig: ModeRig | None = None, *, compressed: bool = True
) -> None:
    """Write a head, and the modes of a dense face; the old folder stays if anything fails.

    Not ``compressed``, it takes 6 MB in place of 2, and a tenth of the time; its texture is one of the arrays.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    basis = mesh.basis
    arrays: dict[str, Any] = {name: getattr(mesh, name) for name in ARRAYS}
    arrays |= {
        "point_names": np.array(list(mesh.feature_points)), "point_vertices": np.array([*mesh.feature_points.values()]),
        "channels": np.array([(channel.fap, channel.start, channel.stop) for channel in basis.channels]),
        "offsets": basis.offsets, "entry_channels": basis.entry_channels, "entry_mm": basis.entry_mm,
        "fapu_mm": np.array([getattr(mesh.fapu, field.name) for field in fields(Fapu)]),
    }  # fmt: skip
    if basis.mix is not None:
        arrays["mix"] = basis.mix
    if mesh.folds is not None:
        arrays |= {f"folds_{field.name}": getattr(mesh.folds, field.name) for field in fields(Folds)}
    if mesh.texture is not None and not compressed:
        arrays["texture"] = mesh.texture
    files = {ARRAYS_NAME: pack(compressed=compressed, **arrays)}
    if mesh.texture is not None and compressed:
        files[TEXTURE_NAME] = format_png(mesh.texture, compress_level=3)
    if rig is not None:
        from fapengine.laboratory.dense_file import format_rig  # imports much of scipy

        files[MODES_NAME] = format_rig(rig)
    lines = [f"schema = {SCHEMA}", f"source = {quoted(info.source)}", f"licence = {quoted(info.licence)}"]
    lines += [f"{key} = [{', '.join(map(quoted, getattr(info, key)))}]" for key in ("used", "lacking")]
    lines.append("[sha256]")
    lines += [f"{quoted(name)} = {quoted(hashlib.sha256(data).hexdigest())}" for name, data in files.items()]
    files[TOML_NAME] = ("\n".join(lines) + "\n").encode()
    with replacing_folder(folder, owned=OWNED) as new:
        for name, data in files.items():
            (new / name).write_bytes(data)


def load_folder(folder: Path) -> tuple[HeadInfo, FaceMesh]:
    """Load a head's folder.

    Raises
    ------
    UsageError
        If there is no such folder.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    info, files = _read(folder)
    texture = None
    if TEXTURE_NAME in files:
        where = str(folder / TEXTURE_NAME)
        try:
            with opened(files[TEXTURE_NAME], ("PNG",), where) as image:
                texture = np.asarray(image, np.uint8)
        except DataError as error:
            raise ProfileError(error.message, where=where) from error
    try:
        return info, _mesh(unpack(files[ARRAYS_NAME]), texture)
    except (*DAMAGE, TypeError, OverflowError, MemoryError) as error:  # arrays may have any shape
        raise ProfileError(f"arrays: {error}", where=str(folder / ARRAYS_NAME)) from error


def load_modes(folder: Path) -> ModeRig | None:
    """Load the rig that drives the modes of a dense face; None for other heads. Raises as :func:`load_folder`."""
    from fapengine.laboratory.dense_file import parse_rig

    files = _read(folder)[1]
    return parse_rig(files[MODES_NAME], str(folder / MODES_NAME)) if MODES_NAME in files else None


@dataclass(frozen=True, slots=True)
class _Document:
    """``head.toml``, key by key."""

    schema: int
    source: str
    licence: str
    sha256: dict[str, str]
    used: tuple[str, ...] = ()
    lacking: tuple[str, ...] = ()


def _read(folder: Path) -> tuple[HeadInfo, dict[str, bytes]]:
    if not (folder / TOML_NAME).is_file():
        raise UsageError(
            f"head: got {str(folder)!r}, expected default, woman, man, child, older, random:NUMBER, "
            "or a folder that `fapengine head import` wrote"
        )
    path = str(folder / TOML_NAME)
    document = parse_toml(read_bytes(folder / TOML_NAME, MOST_TOML), _Document, path, ProfileError, schema=SCHEMA)
    digests = document.sha256
    if ARRAYS_NAME not in digests or set(digests) - set(OWNED):
        raise ProfileError(
            f"got {', '.join(digests) or 'none'}, expected {ARRAYS_NAME}, {TEXTURE_NAME} and {MODES_NAME} alone",
            where=spell_path(path, "sha256"),
        )
    files = {key: read_bytes(folder / key) for key in digests}
    for key, data in files.items():
        if (digest := hashlib.sha256(data).hexdigest()) != digests[key]:
            raise ProfileError(f"got {digest}, expected {digests[key]}", where=spell_path(path, "sha256", key))
    return HeadInfo(document.source, document.licence, document.used, document.lacking), files


def _mesh(arrays: dict[str, Any], texture: NDArray[np.uint8] | None) -> FaceMesh:
    channels = tuple(Channel(int(number), float(start), float(stop)) for number, start, stop in arrays["channels"])
    names = [str(name) for name in arrays["point_names"]]
    return FaceMesh(
        **{
            name: arrays[name] for name in ARRAYS if name in arrays or name != "iris_albedo"
        },  # which older files do not have
        feature_points=dict(zip(names, map(int, arrays["point_vertices"]), strict=True)),
        fapu=Fapu(*map(float, arrays["fapu_mm"])),
        basis=DeformationBasis(
            channels=channels,
            offsets=arrays["offsets"],
            entry_channels=arrays["entry_channels"],
            entry_mm=arrays["entry_mm"],
            mix=arrays.get("mix"),
        ),
        texture=arrays.get("texture", texture),
        folds=Folds(*(arrays[f"folds_{field.name}"] for field in fields(Folds))) if "folds_map" in arrays else None,
    )
