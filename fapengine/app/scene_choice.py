"""The target file of a motion: its options, and checks of names and options that belong together.

The files themselves are written by :mod:`fapengine.app.scene_files`, with imports that a video does not need.
"""

from dataclasses import dataclass
from pathlib import Path

from fapengine.errors import UsageError

USD_ENDINGS = (".usda", ".usdc", ".usd")
"""Endings of USD files."""
SCENES = (".glb", ".vrm", ".gltf")
"""Endings of files that a clip can be added to."""
ENDINGS = (".glb", ".vrm", *USD_ENDINGS)
"""Endings of files written with an avatar inside."""
ANIMATION = ".vrma"
"""Ending of a motion for any VRM avatar."""


@dataclass(frozen=True, slots=True)
class Into:
    """Target file of a motion, and options."""

    avatar: Path
    """A scene file, or the name of a head to export."""
    keys: str = "linear"
    """``"linear"``: a key per frame; ``"cubic"``: few keys."""
    mapping: Path | None = None
    """Table of the meaning of other shape names."""


def is_scene(path: Path) -> bool:
    """Whether a name is a file with an avatar inside, or an animation for one."""
    return path.suffix.lower() in (*ENDINGS, ANIMATION)


def check_scene(path: Path, into: Into | None) -> None:
    """Reject options that do not belong together, before any work is done.

    Raises
    ------
    UsageError
        If a scene is to be written without an avatar, or an avatar is given and the name has another ending.
    """
    if into is None:
        if is_scene(path) and path.suffix.lower() != ANIMATION:
            raise UsageError(f"into: got none, expected the avatar that goes into {path} (into=AVATAR.glb)")
        return
    from fapengine.models.via_points import STRAIGHT, WAYS

    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"path: got {path}, expected a name that ends with {' or '.join(ENDINGS)} for into=AVATAR")
    if into.keys not in WAYS:
        raise UsageError(f"keys: got {into.keys!r}, expected {' or '.join(WAYS)}")
    if is_usd(path) and (into.avatar.suffix.lower() in SCENES or into.keys != STRAIGHT or into.mapping is not None):
        told = "a head's name, such as woman or heads/mine, and straight keys"
        raise UsageError(f"into: got {into.avatar}, expected {told}, for USD is written of our own heads alone")


def is_usd(path: Path) -> bool:
    """Whether a name is a USD file."""
    return path.suffix.lower() in USD_ENDINGS
