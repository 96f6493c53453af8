"""BIFS names: each stands for one FAP, and comes back."""

import pytest

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.aliases import BIFS_NAMES, bifs_name, number_of_bifs

pytestmark = pytest.mark.conformance


def test_every_name_comes_back() -> None:
    assert [number_of_bifs(bifs_name(row.number)) for row in fap.FAPS] == list(range(3, 69))
    assert len({bifs_name(row.number) for row in fap.FAPS}) == 66
    assert all(fap.spec(number).name != name for number, name in BIFS_NAMES.items())


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(UsageError, match="stretch_l_cornerlip_o"):
        number_of_bifs("stretch_l_cornerlip_o")
