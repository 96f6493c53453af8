"""States of a receive window, as its theory of operation draws them."""

import pytest

from fapengine.wire.speech_osc.receive_window import ReceiveWindow, State
from fapengine.wire.speech_osc.schema import BeginUtterance, EndUtterance, Phones, WirePhone

BEGIN, END = BeginUtterance("anna", 1), EndUtterance("anna", 1, 1)
PHONES = Phones("anna", 1, 0, 0, (WirePhone("m", 0, 80_000),))


def window() -> ReceiveWindow:
    return ReceiveWindow(7, "ipa")


def test_a_window_opens_ends_and_is_over() -> None:
    one = window()
    states = [one.state]
    for step in (lambda: one.begin(BEGIN, "ipa"), lambda: one.take(PHONES), lambda: one.finish(END)):
        step()
        states.append(one.state)
    assert states == [State.WAITING, State.OPEN, State.OPEN, State.ENDED]
    assert one.is_whole
    assert not one.is_stopped
    one.close(5.0)
    assert (one.state, one.is_over, one.is_stopped) == (State.OVER, True, True)


def test_what_overtakes_its_begin_counts_when_that_comes() -> None:
    one = window()
    one.take(PHONES)
    one.finish(END)
    assert one.state is State.WAITING
    one.begin(BEGIN, "ipa")
    assert one.state is State.ENDED


def test_a_revision_opens_it_again() -> None:
    one = window()
    one.begin(BEGIN, "ipa")
    one.finish(END)
    one.begin(BeginUtterance("anna", 1, 1), "ipa")
    assert (one.state, one.end, one.phones) == (State.OPEN, None, {})


@pytest.mark.parametrize("messages", [(), (BEGIN,), (BEGIN, END)], ids=("waiting", "open", "ended"))
def test_what_is_cancelled_stays_so_when_the_engine_is_through(messages: tuple[object, ...]) -> None:
    one = window()
    for message in messages:
        one.begin(message, "ipa") if isinstance(message, BeginUtterance) else one.finish(END)
    one.cancel()
    assert (one.state, one.is_over, one.is_stopped) == (State.CANCELLED, False, True)
    one.close(5.0)
    assert (one.state, one.is_over) == (State.CANCELLED, True)
