"""Profiles by name or by folder."""

from pathlib import Path

from fapengine._resources import profile_files, profile_ids
from fapengine.errors import ProfileError
from fapengine.files.paths import read_bytes, write_bytes
from fapengine.profiles import TOML_NAME, Profile, format_profile, parse_profile


def load_profile(name: str | Path) -> Profile:
    """Load a shipped profile by its name, or any profile by its folder.

    Raises
    ------
    UsageError
        If there is neither such a profile nor such a folder.
    ProfileError
        If its content is wrong; ``where`` is file and key.
    """
    folder = Path(name)
    if str(name) in profile_ids() or not (folder / TOML_NAME).is_file():
        return parse_profile(profile_files(str(name)))
    try:
        return parse_profile({path.name: read_bytes(path) for path in folder.iterdir() if path.is_file()})
    except ProfileError as error:
        raise ProfileError(error.message, where=f"{folder}/{error.where}") from error


def save_profile(folder: Path, profile: Profile) -> None:
    """Write a profile's files into a folder, which is made.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    for name, data in format_profile(profile).items():
        write_bytes(folder / name, data)
