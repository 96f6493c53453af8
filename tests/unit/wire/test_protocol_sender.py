"""The sender's side: what goes out when."""

from itertools import pairwise

import pytest

from fapengine.engine.commands import Blink, Express
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.speech.phone_track import Phone
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.schema import (
    Ack,
    BeginUtterance,
    CancelUtterance,
    EndUtterance,
    Hello,
    Nack,
    Notice,
    Phones,
    Ping,
    Pong,
    Welcome,
    WirePhone,
)
from fapengine.wire.speech_osc.send_window import CANCEL_TRIES
from fapengine.wire.speech_osc.sender import OscSender


def anna(command):
    return schema.SessionCommand("anna", command)


def read(packet: bytes) -> list[schema.Wire]:
    return [codec.parse(schema.from_sender()[one.address], one) for one in osc.parse_packet(packet)]


class Desk:
    """A sender, stepped by the millisecond."""

    def __init__(self, **options):
        self.sender = OscSender("anna", **{"instance": 4, **options})
        self.now_s = 0.0
        self.packets = []

    def until(self, until_s, *kinds):
        """(time, message) of all that is sent, of some kinds."""
        sent = []
        while self.now_s < until_s:
            for packet in self.sender.due(self.now_s):
                self.packets.append(packet)
                sent += [(round(self.now_s, 3), told) for told in read(packet) if isinstance(told, kinds or object)]
            self.now_s = round(self.now_s + 0.001, 3)
        return sent

    def hear(self, *told):
        return [one for each in told for one in self.sender.receive(codec.encode(each), self.now_s)]

    def ready(self, **welcome):
        """Welcomed, with an engine whose clock is 100 s ahead."""
        self.until(0.01)
        self.hear(Welcome("anna", 100_000_000, **welcome), Pong(1, 8_000, 100_009_000, 100_009_000))
        return self


def phones(count, first=0):
    return [Phone("mɑ"[n % 2], 0.1 * n, 0.1 * n + 0.1) for n in range(first, first + count)]


def test_greets_until_welcomed_and_pings():
    one = Desk(phone_set="arpabet", language="en", token="key")
    sent = one.until(4.0)
    hellos = [when for when, told in sent if isinstance(told, Hello)]
    assert hellos == pytest.approx([0.0, 0.1, 0.3, 0.6, 1.0, 2.0, 3.0], abs=0.005)
    assert sent[0][1] == Hello("anna", 1, "arpabet", "en", schema.WANT_ACK, "key", 4)
    pings = [when for when, told in sent if isinstance(told, Ping)]
    assert len([when for when in pings if when < 0.35]) >= 8
    one.hear(Welcome("anna", 5))
    sent = one.until(8.5)
    assert [type(told) for _, told in sent] == [Ping, Ping]


def test_an_engine_that_falls_silent_is_greeted_again():
    one = Desk().ready()
    assert one.sender.handshake.is_connected(one.now_s)
    assert one.until(5.0, Hello) == []
    assert len(one.until(7.1, Hello)) >= 2
    assert not one.sender.handshake.is_connected(one.now_s)


def test_pings_tell_what_they_found():
    one = Desk()
    assert one.until(0.005, Ping)[0][1].rtt_us == -1
    one.hear(Pong(1, 0, 100_002_000, 100_002_000))
    (_, ping), *_ = one.until(0.1, Ping)
    assert ping.offset_us == pytest.approx(99_999_500, abs=10)
    assert ping.rtt_us == pytest.approx(5_000, abs=10)


def test_chunks_repeat_the_two_before_them():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(32))
    sent = one.until(0.1, Phones)
    assert [(told.first_index, len(told.phones), told.sequence) for _, told in sent[:4]] == [
        (0, 8, 0), (0, 16, 1), (0, 24, 2), (8, 24, 3),
    ]  # fmt: skip
    assert [when for when, _ in sent[:4]] == [0.01, 0.02, 0.03, 0.04]
    assert sent[3][1].phones[-1] == WirePhone("ɑ", 3_100_000, 100_000)


def test_every_datagram_of_phones_begins_with_the_begin_until_that_is_known():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    assert [type(told) for _, told in one.until(0.02)] == [BeginUtterance]
    one.sender.append(number, phones(8))
    assert {BeginUtterance, Phones} <= {type(told) for _, told in one.until(0.03)}
    one.hear(Ack("anna", number, 8, 0))
    one.sender.append(number, phones(8, 8))
    assert BeginUtterance not in {type(told) for _, told in one.until(0.1)}


def test_no_datagram_is_larger_than_its_limit():
    one = Desk(limit=400)
    one.until(0.01)
    number = one.sender.begin(one.now_s, anchor="at", at_s=9.0)
    one.sender.append(number, [WirePhone("x" * 15, 1000 * n, 1000) for n in range(100)])
    one.sender.end(number)
    sent = one.until(3.0, Phones)
    assert max(len(packet) for packet in one.packets) <= 400
    shown = {index for _, told in sent for index in range(told.first_index, told.first_index + len(told.phones))}
    assert shown == set(range(100))


def test_a_smaller_limit_of_the_engine_is_kept():
    one = Desk().ready(max_datagram=300)
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(30))
    one.until(1.0)
    assert max(len(packet) for packet in one.packets[5:]) <= 300


def test_what_is_not_acknowledged_goes_again_ever_more_seldom():
    one = Desk(repeats=0).ready()
    number = one.sender.begin(one.now_s, anchor="at", at_s=30.0)
    one.sender.append(number, phones(4))
    times = [when for when, _ in one.until(2.0, Phones)]
    gaps = [round(after - before, 2) for before, after in pairwise(times)]
    assert gaps[0] == pytest.approx(0.06, abs=0.01)
    assert gaps == sorted(gaps)
    assert gaps[-1] == 0.25
    one.hear(Ack("anna", number, 1, 0b10))  # 0 and 3 have come
    again = one.until(20.0, Phones)
    assert {(told.first_index, len(told.phones)) for _, told in again} == {(1, 2)}
    assert again[1][0] - again[0][0] > 2.0  # an engine that took so long to answer is not pressed
    one.hear(Ack("anna", number, 4, 0))
    assert one.until(30.0, Phones) == []


def test_an_acknowledgement_of_what_was_not_yet_sent_is_survived():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.hear(Ack("anna", number, 3, 0))  # of one that had the same number before
    one.until(0.1)
    one.sender.append(number, phones(4))
    assert [told.phones[-1].label for _, told in one.until(0.2, Phones)][-1] == "ɑ"


def test_a_quick_answer_counts_for_more_than_one_to_what_was_lost():
    one = Desk(repeats=0).ready()
    number = one.sender.begin(one.now_s, anchor="at", at_s=30.0)
    for first, answered_s in ((0, 0.02), (4, 2.0)):
        one.sender.append(number, phones(4, first))
        one.until(one.now_s + answered_s)
        one.hear(Ack("anna", number, first + 4, 0))
    one.sender.append(number, phones(4, 8))
    first, second = (when for when, _ in one.until(one.now_s + 0.1, Phones))
    assert second - first == pytest.approx(0.06, abs=0.01)


def test_what_can_no_longer_be_shown_is_not_sent():
    one = Desk().ready()
    number = one.sender.begin(one.now_s, anchor="at", at_s=0.5)
    one.sender.append(number, phones(4))
    one.until(1.15)
    assert all(told.first_index == 3 for _, told in one.until(1.19, Phones))
    assert one.until(5.0, Phones) == []


def test_what_is_asked_for_goes_at_once_and_not_twice_in_a_round_trip():
    one = Desk(repeats=0).ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(8))
    one.until(0.05)
    one.hear(
        Nack("anna", number, 2, 5), Nack("anna", number, 2, 5), Nack("anna", number, 90, 95), Nack("anna", 9, 0, 1)
    )
    assert [(told.first_index, len(told.phones)) for _, told in one.until(0.052, Phones)] == [(2, 3)]


def test_an_end_goes_three_times_where_nothing_is_acknowledged():
    one = Desk(acknowledged=False).ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(4))
    one.sender.end(number, duration_s=0.5)
    sent = one.until(1.0)
    assert [when for when, told in sent if isinstance(told, EndUtterance)] == [0.01, 0.03, 0.07]
    assert [(when, len(told.phones)) for when, told in sent if isinstance(told, Phones)] == [
        (0.01, 4), (0.03, 4), (0.07, 4),
    ]  # fmt: skip


def test_an_end_goes_until_it_is_known():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(4))
    one.sender.end(number, duration_s=0.5)
    sent = one.until(0.1)
    ends = [when for when, told in sent if isinstance(told, EndUtterance)]
    assert ends == [0.01, 0.07]
    end = next(told for _, told in sent if isinstance(told, EndUtterance))
    assert (end.phone_count, end.duration_us, end.revision) == (4, 500_000, 0)
    assert end.checksum == schema.checksum(one.sender._windows[number].phones)
    assert [len(told.phones) for when, told in sent if isinstance(told, Phones) and when == 0.07] == [4]
    assert one.until(1.0, EndUtterance)
    one.hear(Ack("anna", number, 4, 0, is_ended=1))
    assert one.until(2.0, EndUtterance) == []
    assert one.sender.is_settled()
    one.hear(Notice("anna", number, "finished"))
    assert one.sender.live == ()


def test_over_tcp_everything_goes_once():
    one = Desk(reliable=True).ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(40))
    one.sender.end(number)
    one.sender.cancel(one.now_s + 1.0, utterance=77)
    one.sender.tell(anna(Express(Expression.JOY)), one.now_s, repeats=True)
    sent = one.until(3.0)
    assert [len(told.phones) for _, told in sent if isinstance(told, Phones)] == [8] * 5
    for kind in (EndUtterance, CancelUtterance, schema.SessionCommand):
        assert len([told for _, told in sent if isinstance(told, kind)]) == 1


def test_what_may_be_repeated_is():
    one = Desk().ready()
    one.sender.tell(anna(Express(Expression.JOY)), one.now_s, repeats=True)
    one.sender.tell(anna(Blink()), one.now_s)
    assert not one.sender.is_settled()
    sent = one.until(1.0)
    assert [when for when, told in sent if told == anna(Express(Expression.JOY))] == [
        0.01,
        0.03,
        0.07,
    ]
    assert len([when for when, told in sent if told == anna(Blink())]) == 1
    assert one.sender.is_settled()


def test_a_cancel_goes_until_it_is_answered():
    one = Desk().ready()
    first, second = one.sender.begin(one.now_s), one.sender.begin(one.now_s)
    one.sender.cancel(one.now_s)
    later = one.sender.begin(one.now_s)
    one.sender.cancel(one.now_s, utterance=9)
    sent = one.until(0.5, CancelUtterance)
    of_all = [(when, told) for when, told in sent if told.utterance == -1]
    assert [when for when, _ in of_all[:4]] == [0.01, 0.03, 0.07, 0.32]
    assert {told.below for _, told in of_all} == {later} == {second + 1} == {first + 2}
    assert one.sender.live == (later,)
    one.hear(Notice("anna", -1, "cancelled", count=of_all[0][1].number + 50))
    assert any(told.utterance == -1 for _, told in one.until(1.0, CancelUtterance))
    one.hear(Notice("anna", -1, "cancelled", count=of_all[0][1].number), Notice("anna", 9, "finished"))
    assert one.until(3.0, CancelUtterance) == []
    one.sender.cancel(one.now_s)
    assert len(one.until(20.0, CancelUtterance)) == CANCEL_TRIES


def test_without_acknowledgements_a_cancel_goes_three_times():
    one = Desk(acknowledged=False)
    one.sender.cancel(0.0)
    assert len(one.until(3.0, CancelUtterance)) == 3
    assert one.until(0.0) == []


def test_an_utterance_at_a_time_waits_a_little_for_the_clock():
    one = Desk()
    one.sender.begin(0.0, anchor="at", at_s=5.0)
    assert one.until(0.2, BeginUtterance) == []
    assert one.sender.next_s(one.now_s) <= 0.25
    assert one.until(0.3, BeginUtterance)[0][0] == pytest.approx(0.25, abs=0.002)
    known = Desk().ready()
    known.sender.begin(known.now_s, anchor="at", at_s=5.0)
    sent = known.until(0.02)
    assert [type(told) for _, told in sent] == [Ping, BeginUtterance]
    assert sent[0][1].rtt_us >= 0


def test_a_revision_sends_all_anew_and_old_acks_mean_nothing():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(4))
    one.until(0.05)
    one.hear(Ack("anna", number, 4, 0))
    one.sender.revise(number, phones(3), one.now_s)
    sent = one.until(0.06)
    assert [told.revision for _, told in sent if isinstance(told, BeginUtterance | Phones)] == [1, 1]
    one.hear(Ack("anna", number, 4, 0, revision=0))
    assert one.until(0.5, Phones)
    one.hear(Ack("anna", number, 3, 0, revision=1))
    assert one.until(1.5, Phones) == []


def test_a_wrong_checksum_is_mended_once():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(4))
    one.sender.end(number)
    one.until(0.05)
    for engine_us in (1, 2, 3):
        one.hear(Notice("anna", number, "error", engine_us=engine_us, reason="checksum"))
    assert {told.revision for _, told in one.until(0.2, EndUtterance)} == {1}
    one.hear(Notice("anna", number, "error", engine_us=9))
    assert one.sender.live == ()


@pytest.mark.parametrize("how", ["pong", "welcome", "unknown"])
def test_an_engine_that_was_restarted_is_told_everything_at_the_time_it_had(how):
    one = Desk().ready(instance=1)
    said = one.sender.begin(one.now_s)
    one.sender.append(said, phones(10))
    one.sender.end(said)
    one.until(0.1)
    one.hear(Ack("anna", said, 10, 0, is_ended=1), Notice("anna", said, "started", 20_000, engine_us=100_090_000))
    one.hear(Pong(2, 90_000, 100_095_000, 100_095_000, 1))
    assert one.until(1.0, Phones, Hello, EndUtterance) == []
    if how == "pong":
        one.hear(Pong(9, 990_000, 7_000_000, 7_000_000, 2))
    elif how == "welcome":
        one.hear(Welcome("anna", 7_000_000, instance=2))
    else:
        one.hear(Notice("anna", said, "unknown"), Notice("anna", said, "unknown"))
    sent = one.until(1.5)
    kinds = [type(told) for _, told in sent]
    assert kinds.count(Hello) >= 1
    begin = next(told for _, told in sent if isinstance(told, BeginUtterance))
    assert (begin.anchor, begin.anchor_us) == ("at", pytest.approx(70_000, abs=3_000))
    assert sum(len(told.phones) for _, told in sent if isinstance(told, Phones)) >= 10
    if how == "pong":
        assert one.sender.handshake.clock.engine_s(0.99) == pytest.approx(7.0, abs=0.01)
    assert EndUtterance in kinds


def test_while_it_is_told_again_it_need_not_be_told_again():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(4))
    one.until(0.05)
    one.hear(Ack("anna", number, 4, 0), Notice("anna", number, "unknown", engine_us=1))
    assert one.until(0.07, Phones)
    one.hear(Notice("anna", number, "unknown", engine_us=2))
    assert one.until(0.1, Phones, Hello) == []


def test_phones_are_not_sent_for_ever():
    one = Desk(repeats=0).ready()
    number = one.sender.begin(one.now_s, anchor="audio")
    one.sender.append(number, phones(1))
    assert 50 < len(one.until(25.0, Phones)) <= 61


def test_an_utterance_that_was_never_begun_there_begins_again_alone():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(4))
    one.until(0.05)
    one.hear(Ack("anna", number, 4, 0), Notice("anna", number, "unknown", reason="no begin"))
    sent = one.until(0.1)
    assert {BeginUtterance, Phones} <= {type(told) for _, told in sent}
    assert Hello not in {type(told) for _, told in sent}


def test_events_are_told_once():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    told = [Notice("anna", number, "started", engine_us=5), Notice("anna", number, "late", count=2, engine_us=6)]
    over = [Notice("anna", number, "finished", engine_us=7), Notice("anna", number, "finished", engine_us=8)]
    assert one.hear(*told, *told, *over) == [*told, over[0]]


def test_what_is_for_others_or_no_message_is_left():
    one = Desk()
    assert one.hear(Welcome("berta", 5)) == []
    assert one.sender.handshake.welcome is None
    for packet in (b"", b"zz", osc.message("/fap/1/ack", "s", "anna"), osc.message("/x"), codec.encode(Hello("anna"))):
        assert one.sender.receive(packet, 0.0) == []


def test_positions_of_the_sound_go_at_once_and_tell_when_phones_are_past():
    one = Desk().ready()
    number = one.sender.begin(one.now_s, anchor="audio")
    one.sender.append(number, phones(4))
    one.sender.audio(number, 10.0, one.now_s, at_s=0.02, rate=2.0)
    (_, position), *_ = one.until(0.1, schema.AudioPosition)
    assert position == schema.AudioPosition("anna", number, 20_000, 10_000_000, 2.0)
    assert one.until(1.0, Phones) == []  # they were over 5 s ago
    one.sender.audio(number, 0.3, one.now_s, rate=0.0)
    assert one.until(1.1, schema.AudioPosition)[0][1].rate == 0.0


def test_utterances_of_which_nothing_is_heard_are_forgotten_in_the_end():
    one = Desk(acknowledged=False)
    known = one.sender.begin(0.0, anchor="at", at_s=1.0)
    unknown = one.sender.begin(0.0)
    still = one.sender.begin(0.0)
    for number in (known, unknown, still):
        one.sender.append(number, phones(2))
    one.sender.end(known)
    one.sender.end(unknown)
    one.until(3.0)
    assert one.sender.live == (known, unknown, still)
    one.until(3.3)
    assert one.sender.live == (unknown, still)
    one.now_s = 61.0
    one.until(61.1)
    assert one.sender.live == (still,)


def test_next_s_is_when_there_is_something_to_send():
    one = Desk().ready()
    number = one.sender.begin(one.now_s)
    one.sender.append(number, phones(20))
    one.sender.end(number)
    for _ in range(300):
        wake_s = one.sender.next_s(one.now_s)
        due = one.sender.due(one.now_s)
        assert bool(due) == (wake_s <= one.now_s)
        one.now_s += 0.001


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda one: OscSender(""), "session: got ''"),
        (lambda one: OscSender("a", instance=0), "instance: got 0, expected an int32 other than 0"),
        (lambda one: OscSender("a", instance=1 << 31), "instance: got 2147483648"),
        (lambda one: one.append(5, []), "utterance: got 5, expected one that was begun"),
        (lambda one: one.append(0, [WirePhone("m", -1, 5)]), r"phone 'm': got -1 us, expected 0 to 1800000000"),
        (lambda one: one.append(0, [WirePhone("m", 0, 1 << 40)]), "phone 'm': got 0 us"),
        (lambda one: one.append(0, [WirePhone("m" * 16, 0, 5)]), "expected at most 15 bytes"),
        (lambda one: one.append(0, [WirePhone("m", 0, 5, weight=float("nan"))]), "phone: got 'm'"),
        (lambda one: (one.end(0), one.end(0), one.append(0, [])), "utterance 0: got phones after its end"),
    ],
)
def test_wrong_calls(call, said):
    sender = OscSender("anna")
    sender.begin(0.0)
    with pytest.raises(UsageError, match=said):
        call(sender)


def test_moves_where_it_is_sent_and_tells_everything_there():
    one = Desk(follows=True)
    number = one.sender.begin(0.0)
    one.sender.append(number, phones(3))
    sent = one.until(0.05)
    assert [told.flags for _, told in sent if isinstance(told, Hello)] == [schema.WANT_ACK | schema.FOLLOWS]
    moved = schema.Moved("anna", "", 40_000, 4)
    assert one.hear(schema.Moved("anna", "evil", 1, 5), schema.Moved("ben", "", 1, 4), moved) == [moved]
    one.sender.move(one.now_s, ping_s=0.5)
    sent = one.until(0.1)
    assert [type(told) for _, told in sent if not isinstance(told, Ping)] == [Hello, BeginUtterance, Phones]
    one.hear(Welcome("anna", 5), Ack("anna", number, 3, 0))
    assert len(one.until(3.1, Ping)) == 6 + 5  # of the first ones, and twice a second
    one.sender.move(one.now_s, follows=False)
    assert [told.flags for _, told in one.until(one.now_s + 0.01, Hello)] == [schema.WANT_ACK]


def test_knows_that_nobody_answers():
    one = Desk().ready()
    assert not one.sender.handshake.is_unanswered(one.now_s, 1.0)
    one.until(1.5)  # nothing answers the first pings any more
    assert one.sender.handshake.is_unanswered(one.now_s, 1.0)
    one.hear(Pong(9, 0, 0, 0))
    assert not one.sender.handshake.is_unanswered(one.now_s, 1.0)
    one.until(2.9)
    assert not one.sender.handshake.is_unanswered(one.now_s, 1.0)  # it has not asked for so long
