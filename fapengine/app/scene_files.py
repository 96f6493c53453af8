"""Face motion in files of other programs: an animation in a GLB or VRM, a VRM animation, and USD."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.files import usd
from fapengine.files.gltf.clip import PRESETS, FaceMotion, Reached, add_clip, format_vrma
from fapengine.files.gltf.head_file import ShapeClip, format_head
from fapengine.files.heads.built import load_built
from fapengine.files.heads.load import load_head, load_head_and_modes, load_head_info, load_head_of_modes
from fapengine.files.paths import naming, read_bytes, write_bytes
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import bone_transforms
from fapengine.models.via_points import STRAIGHT, WAYS
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.puppet import METRES_PER_MM, make_puppet
from fapengine.retarget.skeleton import extra_shapes, mood_shapes

AVATARS = (".glb", ".vrm", ".gltf")
"""Endings of avatars that can get an animation."""
USD = (".usda", ".usdc", ".usd")
BONES = {"jaw": 1, "left eye": 2, "right eye": 3, "head": 4}
"""Rows of :func:`fapengine.mesh.deform.bone_transforms` by bone."""


@dataclass(frozen=True, slots=True)
class Into:
    """The avatar that gets a motion, and how the motion is written."""

    avatar: Path
    """An avatar file, or the name of a head to export."""
    keys: str = "linear"
    """``"linear"``: one keyframe per frame; ``"cubic"``: fewer keyframes."""
    mapping: Path | None = None
    """TOML file that maps other blendshape names."""

    @property
    def is_foreign(self) -> bool:
        """True for an avatar file, False for a head."""
        return self.avatar.suffix.lower() in AVATARS


def check_avatar(path: Path, into: Into) -> None:
    """Reject options that a file with an avatar does not support. Raises UsageError."""
    if into.avatar.suffix[1:].isalpha() and not (into.is_foreign or into.avatar.is_dir()):
        raise UsageError(f"into: got {into.avatar}, expected an avatar ({', '.join(AVATARS)}) or the name of a head")
    if into.keys not in WAYS:
        raise UsageError(f"keys: got {into.keys!r}, expected {' or '.join(WAYS)}")
    if _is_usd(path) and (into.is_foreign or into.keys != STRAIGHT or into.mapping is not None):
        raise UsageError(
            f"into: got {into.avatar}; USD needs the name of a head (such as woman or heads/mine), keys=linear and no"
            " mapping"
        )


def _is_usd(path: Path) -> bool:
    return path.suffix.lower() in USD


def save_scene(path: Path, track: FapTrack, into: Into | None, *, shapes: str | None = None, name: str = "face") -> str:
    """Write an avatar with a motion inside, otherwise unchanged; or the motion as a VRM animation.

    Raises UsageError if the avatar or its mapping cannot be read; DataError if they are invalid, or the avatar has
    nothing that can be moved (``where`` is the file); ResourceError if it cannot be written.

    Parameters
    ----------
    path : Path
    track : FapTrack
        Frames that it skips show the one before.
    into : Into, optional
        The avatar; None for ``.vrma``.
    shapes : str, optional
        For ``.vrma``: ``"vrm1"``, the presets, or ``"arkit"``.
    name : str
        Name of the animation.

    Returns
    -------
    str
        What moves, in words.
    """
    if into is None:
        chosen = shapes or PRESETS
        write_bytes(path, format_vrma(face_motion(track, name), shapes=chosen))
        return f"expressions of {chosen}, head and gaze"
    if _is_usd(path):
        return _save_usd(path, track, str(into.avatar), name)
    from fapengine.files.heads.meshes import files_beside  # for avatars alone
    from fapengine.files.heads.tables import load_mapping

    meanings = load_mapping(into.mapping) if into.mapping else None
    data = read_bytes(into.avatar) if into.is_foreign else exported_head(str(into.avatar))
    with naming(into.avatar):
        written, reached = add_clip(
            data, files_beside(into.avatar), face_motion(track, name), keys=into.keys, meanings=meanings
        )
    write_bytes(path, written)
    return _told(reached)


def _save_usd(path: Path, track: FapTrack, head: str, name: str) -> str:
    motion, info = face_motion(track, name), load_head_info(head)
    moved = usd.save_usd(
        path, make_puppet(load_head(head)), licence=info.licence, source=info.source,
        faps=motion.faps, turns={"Head": motion.turns["head"]}, rate_hz=motion.rate_hz,
    )  # fmt: skip
    return f"moves {moved} shapes, and turns head; {len(motion.faps)} keys"


@dataclass(frozen=True, slots=True)
class Rig:
    """What an exported head has besides ARKit's and Oculus' shapes."""

    on_body: bool
    """Whether it stands on Mixamo's joints."""
    shapes: Callable[[], Mapping[str, Array]]
    """Returns further shapes, (68,) FAPU each."""


RIGS = {"head": Rig(False, dict), "mixamo": Rig(True, extra_shapes)}
VRM_RIG = Rig(True, mood_shapes)


def export_head(name: str, path: Path, rig: str | None = None) -> None:
    """Write a head without a motion, as GLB, VRM 1.0 or USD by the ending of the name.

    Raises UsageError, ProfileError as :func:`fapengine.files.heads.load.load_head` does, or for another ending or rig;
    ResourceError if it cannot be written, or usd-core is not installed.

    Parameters
    ----------
    name : str
    path : Path
        Ends with .glb, .vrm, .usda, .usdc or .usd.
    rig : str, optional
        One of :data:`RIGS`, for a GLB; by default ``head``. A VRM always has Mixamo's joints.
    """
    ending = path.suffix.lower()
    if ending not in (".glb", ".vrm", *USD):
        raise UsageError(f"path: got {path}, expected a name that ends with .glb, .vrm, .usda, .usdc or .usd")
    if rig is not None and rig not in RIGS:
        raise UsageError(f"rig: got {rig!r}, expected {' or '.join(RIGS)}")
    if rig is not None and ending != ".glb":
        raise UsageError(f"rig: got {rig} for {path}, expected a name that ends with .glb; a .vrm has mixamo's joints")
    if ending in USD:
        info = load_head_info(name)
        usd.save_usd(path, make_puppet(load_head(name)), licence=info.licence, source=info.source)
    elif ending == ".vrm":
        write_bytes(path, exported_head(name, VRM_RIG, vrm=path.stem))
    else:
        write_bytes(path, exported_head(name, RIGS[rig or "head"]))


def exported_head(name: str, rig: Rig = RIGS["head"], *, vrm: str = "") -> bytes:
    """Return a head as GLB; with a name in ``vrm`` and :data:`VRM_RIG`, as VRM.

    Raises UsageError, ProfileError as :func:`fapengine.files.heads.load.load_head` does.
    """
    info, (mesh, modes_rig) = load_head_info(name), load_head_and_modes(name)
    modes = None if modes_rig is None else dict(zip(modes_rig.names, modes_rig.modes_mm, strict=True))
    puppet = make_puppet(mesh, modes, rig.shapes())
    return format_head(puppet.on_body() if rig.on_body else puppet, licence=info.licence, source=info.source, vrm=vrm)


def save_take_scene(path: Path, take: Path, into: Into | None) -> str:
    """Write a dense face with a recorded take inside, as weights of its modes and motion of its head.

    Raises UsageError if there is no such head, or the name has another ending; DataError if the recording does not show
    this face (``where`` is the file); ResourceError if it cannot be written.

    Parameters
    ----------
    path : Path
        A GLB.
    take : Path
        Recording of markers.
    into : Into
        A head with modes, or a profile with a dense face.

    Returns
    -------
    str
        How long it is and what moves, in words.
    """
    if into is None or path.suffix.lower() != ".glb" or into.is_foreign:
        raise UsageError(
            f"path: got {path} for a marker recording, expected .glb and a dense face (into=profiles/NAME)"
        )
    from fapengine.app.dense_film import drive

    info = load_head_info(str(into.avatar))
    mesh, rig = load_head_of_modes(str(into.avatar))
    driven = drive(take, rig)
    head = rig.head_transforms(driven.head)
    head[:, :3, 3] *= METRES_PER_MM
    clip = ShapeClip(
        weights=dict(zip(rig.names, driven.weights.T, strict=True)), head=head, rate_hz=driven.rate_hz,
        name=take.stem, keys=into.keys,
    )  # fmt: skip
    puppet = make_puppet(mesh, dict(zip(rig.names, rig.modes_mm, strict=True)))
    write_bytes(path, format_head(puppet, licence=info.licence, source=info.source, clip=clip))
    moved = sum(any(name in part.shapes for part in puppet.parts) for name in rig.names)
    return f"{len(driven.weights)} frames at {driven.rate_hz:g} Hz; moves {moved} modes and the head"


def _told(reached: Reached) -> str:
    """Describe what moves."""
    bones = f", and turns {', '.join(reached.bones)}" if reached.bones else ""
    return f"moves {len(reached.shapes)} shapes{bones}; {reached.keys} keys"


def face_motion(track: FapTrack, name: str) -> FaceMotion:
    """Return a track with the rotations of the bones; the jaw rotates like that of the built-in head."""
    faps = track.filled_values().astype(np.float64)
    if not len(faps):
        raise UsageError("track: contains no frames")
    transforms = bone_transforms(load_built(MEASURED), faps)
    turns: Mapping[str, np.ndarray] = {bone: transforms[:, row, :3, :3] for bone, row in BONES.items()}
    return FaceMotion(faps=faps, turns=turns, rate_hz=track.rate_hz, name=name)
