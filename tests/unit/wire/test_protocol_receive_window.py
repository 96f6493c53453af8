"""What a receive window knows as its begin, phones and end arrive in any order."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.wire.speech_osc.receive_window import ReceiveWindow, gaps
from fapengine.wire.speech_osc.schema import BeginUtterance, EndUtterance, Phones, WirePhone

BEGIN, END = BeginUtterance("anna", 1), EndUtterance("anna", 1, 1)
PHONES = Phones("anna", 1, 0, 0, (WirePhone("m", 0, 80_000),))


def window() -> ReceiveWindow:
    return ReceiveWindow(7, "ipa")


def test_a_window_begins_ends_and_is_over() -> None:
    one = window()
    known = [(one.begun, one.end, one.is_whole)]
    for step in (lambda: one.begin(BEGIN, "ipa"), lambda: one.take(PHONES), lambda: one.finish(END)):
        step()
        known.append((one.begun, one.end, one.is_whole))
    assert known == [(None, None, False), (BEGIN, None, False), (BEGIN, None, False), (BEGIN, END, True)]
    assert not one.is_stopped
    one.close(5.0)
    assert (one.is_cancelled, one.is_over, one.is_stopped) == (False, True, True)


def test_what_arrives_before_its_begin_is_kept() -> None:
    one = window()
    one.take(PHONES)
    one.finish(END)
    assert one.begun is None
    one.begin(BEGIN, "ipa")
    assert (one.begun, one.end, one.is_whole) == (BEGIN, END, True)


def test_a_revision_empties_the_window() -> None:
    one = window()
    one.begin(BEGIN, "ipa")
    one.finish(END)
    one.begin(BeginUtterance("anna", 1, 1), "ipa")
    assert (one.revision, one.end, one.phones, one.is_stopped) == (1, None, {}, False)


def test_a_revision_of_a_cancelled_utterance_begins_it_again() -> None:
    one = window()
    one.begin(BEGIN, "ipa")
    one.is_cancelled = True
    one.begin(BEGIN, "ipa")
    assert not one.is_cancelled


@pytest.mark.parametrize("messages", [(), (BEGIN,), (BEGIN, END)], ids=("waiting", "open", "ended"))
def test_a_cancelled_window_stays_so_when_the_engine_closes_it(messages: tuple[object, ...]) -> None:
    one = window()
    for message in messages:
        one.begin(message, "ipa") if isinstance(message, BeginUtterance) else one.finish(END)
    one.is_cancelled = True
    assert (one.is_over, one.is_stopped) == (False, True)
    one.close(5.0)
    assert (one.is_cancelled, one.is_over) == (True, True)


@given(st.sets(st.integers(0, 30)), st.integers(0, 10), st.integers(10, 30) | st.none())
def test_gaps_are_what_is_missing(known, first, stop):
    found = gaps(known, first, stop)
    last = max(known, default=-1) + 1 if stop is None else stop
    assert [n for run in found for n in range(*run)] == [n for n in range(first, last) if n not in known]
    assert all(before[1] < behind[0] for before, behind in pairwise(found))
