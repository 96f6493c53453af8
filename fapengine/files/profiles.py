"""Profiles by name or by folder."""

from pathlib import Path

from fapengine._resources import profile_files, profile_ids
from fapengine._strict_toml import checked
from fapengine.files.paths import locating, read_bytes, replacing_folder
from fapengine.profiles import ARRAYS_NAME, CONTEXT_NAME, TOML_NAME, Profile, format_profile, parse_profile

PROFILE_FILES = (TOML_NAME, ARRAYS_NAME, CONTEXT_NAME)
"""Names of all files that a profile may have."""


@checked
def load_profile(name: str | Path) -> Profile:
    """Load a built-in profile by name, or any profile by its folder.

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
    with locating(folder, "/"):
        return parse_profile({path.name: read_bytes(path) for path in folder.iterdir() if path.is_file()})


def save_profile(folder: Path, profile: Profile) -> None:
    """Write the files of a profile into a folder, which is created; the old content stays if anything fails.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    with replacing_folder(folder, owned=PROFILE_FILES) as new:
        put_profile(new, profile)


def put_profile(folder: Path, profile: Profile) -> None:
    """Write the files of a profile into an existing folder; OSErrors are not converted."""
    for name, data in format_profile(profile).items():
        (folder / name).write_bytes(data)
