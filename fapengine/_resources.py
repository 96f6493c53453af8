"""Find the shipped shaders, profiles and web page, in a checkout or an installed wheel."""

from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from fapengine.errors import ResourceError, UsageError


def _data_folder(name: str) -> Traversable:
    packaged = files("fapengine") / "_data" / name
    if packaged.is_dir():
        return packaged
    checkout = Path(__file__).resolve().parent.parent / name
    if checkout.is_dir():
        return checkout
    raise ResourceError(f"{name}: not found in the package nor at {checkout}; reinstall fapengine")


def shader_source(name: str) -> str:
    """Return the text of ``shaders/<name>``, for example ``"face.vert"``."""
    path = _data_folder("shaders") / name
    if not path.is_file():
        known = sorted(p.name for p in _data_folder("shaders").iterdir())
        raise UsageError(f"shader: unknown name {name!r}; use {', '.join(known)}")
    return path.read_text(encoding="utf-8")


def page_files() -> dict[str, bytes]:
    """Return every file of the web page as ``{name: bytes}``; those of the npm package are in ``face/``."""
    folders = {"": _data_folder("web-page"), "face/": _data_folder("fapengine-face")}
    return {
        f"{prefix}{p.name}": p.read_bytes()
        for prefix, folder in folders.items()
        for p in folder.iterdir()
        if p.is_file()
    }


def profile_ids() -> list[str]:
    """Names of the shipped profiles, sorted."""
    return sorted(p.name for p in _data_folder("profiles").iterdir() if (p / "profile.toml").is_file())


def profile_files(profile_id: str) -> dict[str, bytes]:
    """Return every file of a shipped profile as ``{name: bytes}``."""
    if profile_id not in profile_ids():
        names = ", ".join(profile_ids())
        raise UsageError(f"profile: unknown profile {profile_id!r}; use {names}, or a profile folder")
    folder = _data_folder("profiles") / profile_id
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
