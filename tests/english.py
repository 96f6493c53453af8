"""The profile that most tests speak with: English as one speaker of GRID says it."""

from functools import cache

from fapengine._resources import profile_files
from fapengine.profiles import Profile, parse_profile


@cache
def english() -> Profile:
    """Read it when it is first asked for, once in each process."""
    return parse_profile(profile_files("grid_s1_en"))
