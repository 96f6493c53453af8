"""Into whose file a motion goes: what is asked for, and which names and choices belong together.

The files themselves are :mod:`fapengine.app.scene_files`, whose imports a film does not need.
"""

from dataclasses import dataclass
from pathlib import Path

from fapengine.errors import UsageError
from fapengine.models.keyed_curve import STRAIGHT, WAYS

USD_ENDINGS = (".usda", ".usdc", ".usd")
"""Endings of USD files."""
SCENES = (".glb", ".vrm", ".gltf")
"""Endings of what a clip is put into."""
ENDINGS = (".glb", ".vrm", *USD_ENDINGS)
"""Endings of what is written with an avatar inside."""
ANIMATION = ".vrma"
"""Ending of a motion for any VRM avatar."""


@dataclass(frozen=True, slots=True)
class Into:
    """Whose file a motion goes into, and how."""

    avatar: Path
    """A scene's file, or the name of a head, which is exported."""
    keys: str = STRAIGHT
    """``"linear"``: a key a frame; ``"cubic"``: few."""
    mapping: Path | None = None
    """Table of what shapes of other names mean."""


def is_scene(path: Path) -> bool:
    """Tell whether a name is that of a file with an avatar inside, or of an animation for one."""
    return path.suffix.lower() in (*ENDINGS, ANIMATION)


def check_scene(path: Path, into: Into | None) -> None:
    """Refuse what does not belong together, before any work is done.

    Raises
    ------
    UsageError
        If a scene is to be written and none is given, or one is given and the name has another ending.
    """
    if into is None:
        if is_scene(path) and path.suffix.lower() != ANIMATION:
            raise UsageError(f"into: got none, expected the avatar that goes into {path} (into=AVATAR.glb)")
        return
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"path: got {path}, expected a name that ends with {' or '.join(ENDINGS)} for into=AVATAR")
    if into.keys not in WAYS:
        raise UsageError(f"keys: got {into.keys!r}, expected {' or '.join(WAYS)}")
    if is_usd(path) and (into.avatar.suffix.lower() in SCENES or into.keys != STRAIGHT or into.mapping is not None):
        told = "a head's name, such as woman or heads/mine, and straight keys"
        raise UsageError(f"into: got {into.avatar}, expected {told}, for USD is written of our own heads alone")


def is_usd(path: Path) -> bool:
    """Tell whether a name is that of a USD file."""
    return path.suffix.lower() in USD_ENDINGS
