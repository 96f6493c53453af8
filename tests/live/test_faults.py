"""A few moments of ``make faults``: what is killed leaves whole files, faces at rest, and nobody behind."""

import pytest

from tests.faults.__main__ import inject


@pytest.mark.parametrize(
    ("only", "moments"),
    [
        ("command encode", 2),
        pytest.param("command encode", 4, marks=pytest.mark.nightly),
        ("server: server", 1),
        ("server: voice", 1),
        pytest.param("agent: painter", 1, marks=pytest.mark.nightly),
    ],
)
def test_what_is_killed_leaves_nothing_half_done(only: str, moments: int) -> None:
    rows = inject(moments, seed=2, only=only)
    assert sum(row.moments for row in rows.values()) == moments
    assert [one for row in rows.values() for one in row.wrong] == []
