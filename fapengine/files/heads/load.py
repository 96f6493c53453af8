"""Heads by name: our own in any look, or a folder."""

from pathlib import Path

from fapengine.files.heads.built import OURS, load_built
from fapengine.files.heads.folder import HeadInfo, load_folder
from fapengine.mesh.default_head.style import LEVELS, HeadStyle, parse_look
from fapengine.mesh.face_mesh import FaceMesh

DEFAULT_HEAD = "default"


def load_head(name: str) -> FaceMesh:
    """Load a head's folder; ``"default"`` is our own, ``"default:age=0.8,level=fine"`` it with another look.

    Raises
    ------
    UsageError
        If there is no such folder or look.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    return load_built(*_look(name)) if _is_ours(name) else load_folder(Path(name))[1]


def load_levels(name: str) -> list[FaceMesh]:
    """Load a head and, if it is our own, its coarsest level of detail after it; a folder holds one level.

    Raises as :func:`load_head`.
    """
    levels, coarsest = [load_head(name)], next(iter(LEVELS))
    if _is_ours(name):
        style, level = _look(name)
        if level != coarsest:
            levels.append(load_built(style, coarsest))
    return levels


def load_head_info(name: str) -> HeadInfo:
    """Tell where a head comes from. Raises as :func:`load_head`."""
    return OURS if _is_ours(name) else load_folder(Path(name))[0]


def _is_ours(name: str) -> bool:
    return name == DEFAULT_HEAD or name.startswith(f"{DEFAULT_HEAD}:")


def _look(name: str) -> tuple[HeadStyle, str]:
    return parse_look(name[len(DEFAULT_HEAD) + 1 :])
