"""The sheet of FAPs shows each of them."""

from design.fap_sheet import OTHERS, VIEWS, values
from fapengine.mpeg4 import fap


def test_every_fap_is_on_the_sheet_and_both_ways_where_it_has_two() -> None:
    shown = [each for group in VIEWS for each in fap.FAPS if each.group == group]
    assert [each.number for each in shown] == list(range(3, 69))
    assert set(OTHERS) <= {each.number for each in shown}
    for each in shown:
        ways = values(each, 2.0)
        assert ways[0] > 0
        assert ways[1:] == ([-ways[0]] if each.bidirectional else [])
