"""Left and right of a face."""

from fapengine.mpeg4 import fap


def _across(name: str) -> str:
    """Name of the FAP on the other side; the same of one in the middle."""
    for left, right in (("_l_", "_r_"), ("_lm", "_rm")):
        if left in name:
            return name.replace(left, right)
        if right in name:
            return name.replace(right, left)
    return name


TWINS = [0, 1, *(fap.column(fap.by_name(_across(row.name)).number) for row in fap.FAPS)]
"""(68,): for each column, that of the FAP on the other side."""
