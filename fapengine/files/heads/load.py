"""Heads by name: our own, as any person, or a folder."""

from pathlib import Path

from fapengine.files.heads.built import OURS, load_built
from fapengine.files.heads.folder import HeadInfo, load_folder
from fapengine.mesh.default_head.people import parse_person
from fapengine.mesh.default_head.style import LEVELS
from fapengine.mesh.face_mesh import FaceMesh

DEFAULT_HEAD = "default"


def load_head(name: str) -> FaceMesh:
    """Load a head: a person of our own, or the folder of another.

    Parameters
    ----------
    name : str
        ``"default"``, ``"woman"``, ``"man"``, ``"child"``, ``"older"`` or ``"random:7"``, each also with changes, as
        ``"woman:age=0.8,level=fine"``; else a folder.

    Raises
    ------
    UsageError
        If there is no such folder or look.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    look = parse_person(name)
    return load_built(*look) if look else load_folder(Path(name))[1]


def load_levels(name: str) -> list[FaceMesh]:
    """Load a head and, if it is our own, its coarsest level of detail after it; a folder holds one level.

    Raises as :func:`load_head`.
    """
    levels, look, coarsest = [load_head(name)], parse_person(name), next(iter(LEVELS))
    if look and look[1] != coarsest:
        levels.append(load_built(look[0], coarsest))
    return levels


def load_head_info(name: str) -> HeadInfo:
    """Tell where a head comes from. Raises as :func:`load_head`."""
    return OURS if parse_person(name) else load_folder(Path(name))[0]
