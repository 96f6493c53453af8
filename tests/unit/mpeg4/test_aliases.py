"""BIFS names: each stands for one FAP."""

import pytest

from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import BIFS_NAMES, bifs_name

pytestmark = pytest.mark.conformance


def test_every_fap_has_a_name_of_its_own() -> None:
    assert len({bifs_name(row.number) for row in fap.FAPS}) == 66
    assert all(fap.spec(number).name != name for number, name in BIFS_NAMES.items())


def test_two_dialects_use_one_name_for_different_faps() -> None:
    assert fap.by_name("stretch_l_cornerlip").number == 6
    assert bifs_name(53) == "stretch_l_cornerlip"
