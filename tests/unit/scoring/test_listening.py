"""Answers of listening tests, counted by hand."""

import pytest

from fapengine.errors import DataError
from fapengine.scoring.statistics import COLUMNS, parse_answers, preference_of

HEADER = ",".join(COLUMNS)


def row(listener: str, item: str, left: str, right: str, choice: str, trial: int = 1) -> str:
    return f"{listener},1,{trial},{item},{left},{right},{choice},3.2,2"


def table(*rows: str) -> bytes:
    return "\n".join([HEADER, *rows, ""]).encode()


def answers_of(listener: str, chosen: str, passed: int) -> list[str]:
    """Eight pairs of a and b, as a string of those that were chosen, and four checks."""
    pairs = [
        row(
            listener,
            f"u{n}",
            *(("a", "b") if n % 2 else ("b", "a")),
            "left" if (name == "a") == bool(n % 2) else "right",
        )
        for n, name in enumerate(chosen)
    ]
    checks = [row(listener, "u0", "still", "moving", "right" if n < passed else "left", 9 + n) for n in range(4)]
    return [*pairs, *checks]


def test_a_preference_is_counted_and_inattentive_listeners_are_not() -> None:
    rows = [*answers_of("x", "aaaabaaa", 4), *answers_of("y", "bbaaaaaa", 3), *answers_of("z", "bbbbbbbb", 2)]
    found = preference_of(parse_answers(table(*rows)))
    assert (found.system, found.other, found.chosen, found.answers) == ("a", "b", 13, 16)
    assert (found.listeners, found.excluded) == (2, {"z": 0.5})
    assert found.share == 13 / 16
    assert (found.low, found.high) == pytest.approx((0.5435, 0.9595), abs=1e-4)  # Clopper and Pearson
    assert found.p == pytest.approx(2 * (560 + 120 + 16 + 1) / 2**16)
    assert (found.over_listeners.mean, found.over_listeners.count) == (13 / 16, 2)
    assert (found.over_listeners.low, found.over_listeners.high) == (6 / 8, 7 / 8)
    assert found.by_item == {"u0": 0.5, "u1": 0.5, "u2": 1.0, "u3": 1.0, "u4": 0.5, "u5": 1.0, "u6": 1.0, "u7": 1.0}


def test_the_one_that_is_preferred_is_named() -> None:
    found = preference_of(parse_answers(table(*answers_of("x", "bbbbbbba", 4))))
    assert (found.system, found.chosen, found.by_item["u7"]) == ("b", 7, 0.0)


def test_what_was_saved_twice_counts_once() -> None:
    one, other = (table(*answers_of(name, chosen, 4)) for name, chosen in (("x", "aaaaaaaa"), ("y", "bbbbbbbb")))
    found = preference_of(parse_answers(one + other + one))
    assert (found.share, found.answers, found.listeners) == (0.5, 16, 2)


def test_files_may_be_joined() -> None:
    one, other = (table(*answers_of(name, "aaaabbbb", 4)) for name in "xy")
    assert len(parse_answers(one + other)) == 24


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected the columns"),
        (b"listener,item\n", "expected the columns"),
        (b"\xff", "is not a table of UTF-8"),
        (table("x,1"), r"got 'x,1', expected a choice of left or right \(at line 2\)"),
        (table(row("x", "u", "a", "b", "both")), "expected a choice of left or right"),
        (table(), "got 0 about no system of listeners that count"),
        (table(*answers_of("z", "aaaaaaaa", 0)), r"got 0 about no system of listeners that count \(1 left out\)"),
        (table(row("x", "u", "a", "b", "left"), row("x", "u", "a", "c", "left")), "got 2 about a, b, c"),
    ],
)
def test_what_is_no_such_test_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        preference_of(parse_answers(data))
