"""FAP interpolation tables: the example of the format's text, the rules of the paths through a graph, hostile text."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.codec.decoder import decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.fit import PARTNERS, Fit, Link, Polynomial, Term, fill_track, parse_fit
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from tests.fit_files import format_fit

EXAMPLE = b"""2
2  2 3
3  31 45 65
1
0 1 1
1 125  1 74   1 0 1 1
0
0
0
1 3  1 1   1 0 1 2
2 37  0 12  2  0 1 1  1 1 2  1 3 1  0 4 1
"""
"""Of the format's text: FAP 31, 45 and 65 from FAP 2 and 3."""
COPY = Polynomial((Term(1, ((0, 1, 1),)),))
ONE = Polynomial()


def rows(**faps: float) -> tuple[np.ndarray, np.ndarray]:
    """One frame: values and what is known, by FAP number."""
    values, known = np.zeros((1, 68)), np.zeros((1, 68), bool)
    for name, value in faps.items():
        column = fap.column(int(name.removeprefix("f")))
        values[0, column], known[0, column] = value, True
    return values, known


def chain(*links: Link, nodes: tuple[tuple[int, ...], ...]) -> Fit:
    return Fit(nodes, links)


def test_the_example_gives_the_values_of_its_formula() -> None:
    link = parse_fit(EXAMPLE).links[0]
    two, three = 9.0, 16.0
    below = (12 * two * three**0.5 - 3 * two**4) / 37
    expected = [-(74 / 125) * two, 0.0, -(1 / 3) * two**0.5 / below]
    np.testing.assert_allclose(link.evaluate(np.array([[two, three]])), [expected], rtol=1e-14)


def test_a_negative_base_under_an_even_root_has_no_value_and_is_counted() -> None:
    root = Polynomial((Term(1, ((0, 1, 2),)),))
    table = chain(Link(0, 1, 1, ((root, ONE),)), nodes=((3,), (14,)))
    values, known = rows(f3=-4)
    assert table.fill(values, known, np.ones((1, 68), bool)) == 1
    assert not known[0, fap.column(14)]
    values, known = rows(f3=9)
    assert table.fill(values, known, np.ones((1, 68), bool)) == 0
    assert values[0, fap.column(14)] == 3


def test_the_lowest_priority_number_whose_faps_are_known_is_taken_and_chains_follow() -> None:
    double = Polynomial((Term(2, ((0, 1, 1),)),))
    table = chain(
        Link(0, 2, 2, ((COPY, ONE),)), Link(1, 2, 1, ((double, ONE),)), Link(2, 3, 1, ((double, ONE),)),
        nodes=((3,), (4,), (5,), (6,)),
    )  # fmt: skip
    wanted = np.ones((1, 68), bool)
    values, known = rows(f3=10, f4=100)
    table.fill(values, known, wanted)
    assert values[0, [fap.column(5), fap.column(6)]].tolist() == [200, 400]
    values, known = rows(f3=10)
    table.fill(values, known, wanted)
    assert values[0, [fap.column(5), fap.column(6)]].tolist() == [10, 20]


def test_what_was_sent_is_kept_and_what_is_not_wanted_stays_unknown() -> None:
    table = chain(Link(0, 1, 1, ((COPY, ONE), (COPY, ONE))), nodes=((3,), (4, 5)))
    values, known = rows(f3=10, f4=7)
    wanted = np.ones((1, 68), bool)
    wanted[0, fap.column(5)] = False
    table.fill(values, known, wanted)
    assert values[0, fap.column(4)] == 7
    assert not known[0, fap.column(5)]


def test_nodes_with_fap_1_or_2_are_left_alone() -> None:
    table = chain(Link(0, 1, 1, ((COPY, ONE),)), Link(2, 0, 1, ((COPY, ONE),)), nodes=((2,), (14,), (3,)))
    values, known = rows(f2=5, f3=4)
    table.fill(values, known, np.ones((1, 68), bool))
    assert not known[0, fap.column(14)]
    assert values[0, fap.column(2)] == 5


def test_the_other_half_of_the_face_and_the_other_lip_follow_from_one_half() -> None:
    sent = [3, 4, 5, 6, 8, 10, 12, 14, 15, 16, 17, 18, 19, 31]
    values, known = np.zeros((1, 68)), np.zeros((1, 68), bool)
    for number in sent:
        values[0, fap.column(number)], known[0, fap.column(number)] = number, True
    PARTNERS.fill(values, known, np.ones((1, 68), bool))
    numbers = (np.flatnonzero(known[0]) + 1).tolist()
    assert numbers == sorted([*sent, 7, 9, 11, 13, 20, 32, *range(51, 61)])
    assert values[0, fap.column(60)] == 12


@pytest.mark.parametrize("table", [None, PARTNERS])
def test_a_face_that_is_shown_has_every_fap_and_one_half_moves_the_other(table: Fit | None) -> None:
    sent, twins = fap.columns(4, 5, 6, 8, 19, 31, 33, 39, 41), fap.columns(51, 52, 7, 9, 20, 32, 34, 40, 42)
    values, mask = np.zeros((5, fap.FAP_COUNT), np.int32), np.zeros((5, fap.FAP_COUNT), bool)
    values[:, sent], mask[:, sent] = np.arange(5)[:, None] * np.arange(10, 10 + len(sent)), True
    track = replace(FapTrack.from_values(values, rate_hz=25.0), mask=mask)
    decoded = decode(encode(track, EncoderOptions(quant=0, unsent="interpolate")))
    shown, unreal = fill_track(decoded, table=table)
    assert unreal == 0
    assert shown.mask[:, fap.column(3) :].all()
    np.testing.assert_array_equal(shown.values[:, sent], decoded.track.values[:, sent])
    np.testing.assert_array_equal(shown.values[:, twins], decoded.track.values[:, sent])


@pytest.mark.parametrize("table", [PARTNERS, parse_fit(b"0 0"), parse_fit(EXAMPLE)])
def test_what_is_written_is_read_back(table: Fit) -> None:
    assert parse_fit(format_fit(table)) == table


def test_every_cut_of_a_file_is_truncated() -> None:
    words = format_fit(PARTNERS).split()
    for count in range(0, len(words), 37):
        with pytest.raises(TruncatedError):
            parse_fit(b" ".join(words[:count]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"1 1 69 0", "a FAP: got '69', expected an integer 1 to 68"),
        (b"1 1 3 1 0 1 1", "leads to: got '1', expected an integer 0 to 0"),
        (b"1 1 3 0 7", "1 numbers follow the last link"),
        (b"1 1 3 x", "the number of links: got 'x'"),
        (b"-1", "the number of nodes: got '-1'"),
        (b"1 1 3 1 0 0 1 1 0", "a divisor: got '0', expected an integer 1 to 2147483647"),
        ("²".encode(), "the number of nodes"),
    ],
)
def test_what_is_wrong_is_said(text: bytes, said: str) -> None:
    with pytest.raises(DataError, match=said.replace(".", r"\.")):
        parse_fit(text)


@given(st.lists(st.integers(-1, 70), max_size=40))
def test_any_numbers_are_a_table_or_a_data_error(numbers: list[int]) -> None:
    try:
        table = parse_fit(" ".join(map(str, numbers)).encode())
    except DataError:
        return
    assert parse_fit(format_fit(table)) == table


@pytest.mark.parametrize(
    "parts",
    [
        (((69,),), ()),
        (((),), ()),
        (((3,),), (Link(0, 1, 1, ((COPY, ONE),)),)),
        (((3,), (4,)), (Link(0, 1, 1, ()),)),
        (((3,), (4,)), (Link(0, 1, 1, ((Polynomial((Term(1, ((1, 1, 1),)),)), ONE),)),)),
    ],
)
def test_tables_that_cannot_be(parts: tuple[tuple[tuple[int, ...], ...], tuple[Link, ...]]) -> None:
    with pytest.raises(UsageError):
        Fit(*parts)


def test_a_link_beyond_the_nodes_is_told_which_there_are() -> None:
    with pytest.raises(UsageError, match=r"a link to node 2, expected 0 to 1$"):
        chain(Link(0, 2, 1, ((COPY, ONE),)), nodes=((3,), (4,)))
