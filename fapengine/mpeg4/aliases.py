"""Other spellings of FAP names, and the number each stands for. The standard's own are in :mod:`fapengine.mpeg4.fap`.

Some BIFS names are the standard's names of *other* FAPs (BIFS calls FAP 53 as Table C.1 calls FAP 6), so each dialect
is looked up by itself.
"""

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap

BIFS_NAMES: dict[int, str] = {
    6: "stretch_l_corner",
    7: "stretch_r_corner",
    10: "lower_b_lip_lm",
    11: "lower_b_lip_rm",
    53: "stretch_l_cornerlip",
    54: "stretch_r_cornerlip",
}
"""Fields of the BIFS node ``FAP`` that are spelled unlike Table C.1 (node templates of gpac)."""


def bifs_name(number: int) -> str:
    """Name of a low-level FAP as a field of the BIFS node.

    Examples
    --------
    >>> bifs_name(3), bifs_name(53)
    ('open_jaw', 'stretch_l_cornerlip')
    """
    return BIFS_NAMES.get(number) or fap.spec(number).name


def number_of_bifs(name: str) -> int:
    """FAP number of a field of the BIFS node.

    Raises
    ------
    UsageError
        If there is no such field.

    Examples
    --------
    >>> number_of_bifs("stretch_l_cornerlip")
    53
    """
    for row in fap.FAPS:
        if bifs_name(row.number) == name:
            return row.number
    raise UsageError(f"BIFS field: got {name!r}, expected a name of the FAP node")
