"""One utterance: in whatever order its phones come each is said once, and what comes twice changes nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fapengine.engine.commands import Append, Begin, End
from fapengine.engine.utterance import StreamClock, Utterance
from fapengine.speech.phone_track import Phone

COUNT, ZERO_S = 9, 2.0
PHONES = tuple(Phone(label, n / 10, (n + 1) / 10) for n, label in enumerate("mapalibus"))
SHIFTED = [(phone.label, phone.start_s + ZERO_S) for phone in PHONES]


def placed() -> Utterance:
    told = Utterance(1, StreamClock(0.0))
    told.begin(Begin(1))
    told.place(ZERO_S)
    return told


def taken(told: Utterance) -> list[tuple[str, float]]:
    """Take what comes, as a session does."""
    found = []
    for phone, _, place in list(told.coming()):
        found.append((phone.label, phone.start_s))
        told.taken = place
    return found


@given(st.permutations(range(COUNT)), st.sets(st.integers(0, COUNT - 1)))
def test_each_phone_is_said_once_in_whatever_order_it_comes(order: list[int], looks: set[int]) -> None:
    told, said = placed(), []
    for step, index in enumerate(order):
        late = told.add(Append(1, index, (PHONES[index],)))
        said += [(phone.label, phone.start_s) for phone in told.in_stream(late)]
        if step in looks:
            said += taken(told)
    said += taken(told)
    assert sorted(said, key=lambda one: one[1]) == SHIFTED
    assert told.size == COUNT
    assert told.end_s == PHONES[-1].end_s


@given(st.integers(0, COUNT - 1), st.integers(1, COUNT), st.booleans())
def test_phones_that_come_twice_change_nothing(first: int, count: int, is_dry: bool) -> None:
    told = placed()
    told.add(Append(1, 0, PHONES[:4]))
    told.add(Append(1, 4, PHONES[4:]))
    taken(told)
    told.is_dry = is_dry

    def state() -> tuple[object, ...]:
        lists = (dict(told.phones), list(told.order), list(told.known))
        return (*lists, told.taken, told.is_dry, told.last_s, told.slack_s(1.5))

    before = state()
    assert told.add(Append(1, first, PHONES[first : first + count])) == []
    assert state() == before
    assert told.slack_s(1.5) == PHONES[4].start_s - (1.5 - ZERO_S)


@given(st.sets(st.integers(0, COUNT - 1)), st.integers(1, COUNT))
def test_what_is_lost_is_what_never_came_before_the_stated_end(came: set[int], count: int) -> None:
    told = placed()
    for index in sorted(came):
        told.add(Append(1, index, (PHONES[index],)))
    assert told.lost == 0
    told.phone_count = End(1, count, count / 10).phone_count
    assert told.lost == count - len([index for index in came if index < count])
    assert told.add(Append(1, count, PHONES[:1])) == []  # behind the end
    assert told.size == max(came, default=-1) + 1


@given(st.integers(0, COUNT), st.integers(0, 40))
def test_from_a_position_on_only_what_ends_later_is_said(whole: int, zero_s: int) -> None:
    told, from_s = placed(), (whole - 0.5) / 10  # within a phone
    told.add(Append(1, 0, PHONES))
    told.place(zero_s, zero_s + from_s)
    found = taken(told)
    assert [label for label, _ in found] == [phone.label for phone in PHONES[max(whole - 1, 0) :]]
    starts_s = [max(phone.start_s, from_s) + zero_s for phone in PHONES[max(whole - 1, 0) :]]
    np.testing.assert_allclose([start_s for _, start_s in found], starts_s, atol=1e-9)
