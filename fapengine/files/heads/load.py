"""Heads by name: built-in people, the folder of a head, or the dense face of a profile."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fapengine.errors import UsageError
from fapengine.files.heads.built import OURS, load_built
from fapengine.files.heads.folder import HeadInfo, load_folder, load_modes
from fapengine.mesh.default_head.style import LEVELS, parse_person
from fapengine.mesh.face_mesh import FaceMesh

if TYPE_CHECKING:
    from fapengine.laboratory.dense_face import ModeRig

DEFAULT_HEAD = "default"
CALLS_PX = 640
"""Longer side of an image up to which level ``calls`` looks like ``normal``."""


def load_head(name: str) -> FaceMesh:
    """Load a head: a built-in person, or the folder of another head.

    Parameters
    ----------
    name : str
        ``"default"``, ``"woman"``, ``"man"``, ``"child"``, ``"older"`` or ``"random:7"``, each optionally with changes,
        such as ``"woman:age=0.8,level=fine"``; or the folder of a head or of a profile with a dense face. If the fit
        adapted the built-in head to the dense face, that head is loaded.

    Raises
    ------
    UsageError
        If there is no such folder or person.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    look, folder = parse_person(name), Path(name)
    if look:
        return load_built(*look)
    from fapengine.files.heads.dense import adapted_in, is_profile, load_dense_head  # imports much of scipy

    if (adapted := adapted_in(folder)) is not None:
        return load_folder(adapted)[1]
    return load_dense_head(folder)[0].mesh if is_profile(folder) else load_folder(folder)[1]


def check_head_name(name: str) -> None:
    """Refuse a name that :func:`load_head` would refuse, without loading anything but a small file.

    Raises
    ------
    UsageError
        If there is no such folder or person.
    """
    if not parse_person(name) and not Path(name).exists():
        load_folder(Path(name))


def load_head_for_calls(name: str, size: tuple[int, int]) -> FaceMesh:
    """Load a head for live images of a size in pixels: a built-in one at level ``calls``.

    A level in ``name``, such as ``"woman:level=normal"``, takes precedence, and images larger than :data:`CALLS_PX`
    get the head of :func:`load_head`, which also states the errors.
    """
    look = parse_person(name)
    if look is None or "level=" in name or max(size) > CALLS_PX:
        return load_head(name)
    return load_built(look[0], "calls")


def load_head_and_modes(name: str) -> tuple[FaceMesh, ModeRig | None]:
    """Load a head and, if it is a dense face, the rig that drives its modes. Raises as :func:`load_head`."""
    folder = Path(name)
    if parse_person(name):
        return load_head(name), None
    from fapengine.files.heads.dense import is_profile, load_dense_head

    if is_profile(folder):
        imported, rig, _ = load_dense_head(folder)
        return imported.mesh, rig
    return load_folder(folder)[1], load_modes(folder)


def load_head_of_modes(name: str) -> tuple[FaceMesh, ModeRig]:
    """Load a dense face for recorded takes: of a profile, or from ``fapengine head import``.

    Raises
    ------
    UsageError
        If the head has no modes.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    mesh, rig = load_head_and_modes(name)
    if rig is None:
        raise UsageError(
            f"head: got {name!r}, which has no modes that a recording could move; expected a profile that was fitted"
            " with [[scan]], or what `fapengine head import` made of one"
        )
    return mesh, rig


def load_levels(name: str) -> tuple[FaceMesh, list[Callable[[], FaceMesh]]]:
    """Load a head, and return functions that load its coarser levels of detail: one for a built-in head, else none.

    Raises as :func:`load_head`.
    """
    look, coarsest = parse_person(name), next(iter(LEVELS))
    has_coarser = look is not None and look[1] != coarsest
    return load_head(name), [partial(load_built, look[0], coarsest)] if look and has_coarser else []


def load_head_info(name: str) -> HeadInfo:
    """Origin of a head. Raises as :func:`load_head`."""
    if parse_person(name):
        return OURS
    from fapengine.files.heads.dense import adapted_in, dense_info, is_profile, load_dense

    folder = adapted_in(Path(name)) or Path(name)
    return dense_info(load_dense(folder)[0]) if is_profile(folder) else load_folder(folder)[0]
