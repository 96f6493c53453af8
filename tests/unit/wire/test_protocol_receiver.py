"""The robust mode: what the engine is told, and what senders are answered."""

from math import inf, pi, radians

import numpy as np
import pytest

from fapengine.engine.commands import (
    VOICE_UTTERANCES,
    Append,
    Audio,
    Begin,
    Blink,
    Cancel,
    End,
    Express,
    Look,
    Pause,
    Resume,
    Seek,
    SetParameter,
    TurnHead,
)
from fapengine.engine.session import Limits
from fapengine.expressions import Expression
from fapengine.speech.phone_track import Phone
from fapengine.wire import osc
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.peers import WireLimits
from fapengine.wire.speech_osc.schema import (
    Ack,
    AudioPosition,
    BeginUtterance,
    CancelUtterance,
    EndUtterance,
    Hello,
    Nack,
    Notice,
    Phones,
    Ping,
)
from tests.unit.wire.protocol_double import Wire, phones

HELLO = Hello("anna", flags=schema.WANT_ACK, instance=5)
FOUR = phones()
WHOLE = EndUtterance("anna", 1, 4, 450_000, schema.checksum(FOUR))


def anna(command):
    return schema.SessionCommand("anna", command)


def four(first=0, stop=4, sequence=0, revision=None):
    return Phones("anna", 1, sequence, first, FOUR[first:stop], revision)


def told(answers, kind):
    return [answer for _, answer in answers if isinstance(answer, kind)]


def test_an_utterance_reaches_the_engine_in_ipa_and_seconds():
    one = Wire()
    one.send(Hello("anna", 1, "arpabet"), BeginUtterance("anna", 1))
    one.send(Phones("anna", 1, 0, 0, (schema.WirePhone("M", 0, 80_000), schema.WirePhone("AA1", 80_000, 120_000))))
    one.send(EndUtterance("anna", 1, 2, 300_000))
    begin, append, end = one.faces.commands()
    assert begin == Begin(0, "now")
    assert append == Append(0, 0, (Phone("m", 0.0, 0.08), Phone("ɑ", 0.08, 0.2, 1)))
    assert end == End(0, 2, 0.3)
    assert one.faces.open_sessions == ["anna"]


def test_hello_is_welcomed():
    one = Wire(instance=9, engine_limits=Limits(utterances=7))
    ((peer, welcome),) = one.send(HELLO)
    assert peer == "a"
    assert welcome == schema.Welcome("anna", 50_000_000, 500_000, 1200, 7, 9)


@pytest.mark.parametrize(
    ("hello", "reason"),
    [
        (Hello("anna", token="wrong"), "token"),
        (Hello("anna"), "token"),
        (Hello("anna", 2, token="key"), "protocol 1"),
        (Hello("anna", 1, "klingon", token="key"), "phone set"),
    ],
)
def test_a_hello_that_is_refused_says_why(hello, reason):
    one = Wire(token="key")
    ((_, notice),) = one.send(hello)
    assert (notice.kind, notice.reason, notice.utterance) == ("error", reason, -1)
    assert one.counts.refused == 1
    assert one.faces.open_sessions == []


def test_without_the_token_nothing_is_heard_but_hello_and_ping():
    one = Wire(token="key")
    assert one.send(BeginUtterance("anna", 1), four(), anna(Blink())) == []
    one.say("/phoneme", "s", "m")
    assert one.faces.told == []
    assert one.counts.refused == 4
    assert told(one.send(Ping(1, 5)), schema.Pong)
    one.send(Hello("anna", token="key"), BeginUtterance("anna", 1))
    one.say("/phoneme", "s", "m")
    assert len(one.faces.commands(Begin)) == 2
    one.send(anna(Blink()), peer="another")
    assert one.faces.commands(Blink) == []


def test_sessions_have_a_limit_that_is_told():
    one = Wire(most=1)
    one.send(HELLO)
    for message in (
        Hello("b"),
        BeginUtterance("b", 1),
        schema.SessionCommand("b", Blink()),
        AudioPosition("anna", 0, 0, 0),
    ):
        answers = one.send(message)
        assert answers[0][1].kind in ("error", "unknown")
    assert one.counts.refused == 4
    one.say("/phoneme", "s", "m")
    assert one.counts.refused == 5
    assert one.faces.told == []


def test_ping_is_answered_with_the_engines_clock():
    one = Wire(instance=4)
    assert one.send(Ping(3, 1_000), at_s=51.5) == [("a", schema.Pong(3, 1_000, 51_500_000, 51_500_000, 4))]


def test_times_at_are_of_the_senders_clock():
    one = Wire()
    one.send(Ping(1, 7_000_000), at_s=107.002)
    one.send(BeginUtterance("anna", 1, 0, "at", 8_500_000))
    assert one.faces.commands(Begin)[0].at_s == pytest.approx(108.502)
    one.send(Ping(2, 8_000_000, 100_500_000, 0.0, 4_000))
    one.send(BeginUtterance("anna", 2, 0, "at", 9_000_000))
    assert one.faces.commands(Begin)[1] == Begin(1, "at", pytest.approx(109.5))


def test_without_a_common_clock_at_means_now_and_an_unknown_anchor_nothing():
    one = Wire()
    one.send(BeginUtterance("anna", 1, 0, "at", 8_500_000), BeginUtterance("anna", 2, 0, "audio"))
    one.send(BeginUtterance("anna", 3, 0, "later"))
    assert one.faces.commands(Begin) == [Begin(0, "now"), Begin(1, "audio")]
    assert one.counts.malformed == 1


def test_a_phone_set_that_is_not_known_is_counted_and_the_sessions_is_taken():
    one = Wire()
    one.send(Hello("anna", 1, "arpabet"), BeginUtterance("anna", 1, phone_set="klingon"))
    one.send(Phones("anna", 1, 0, 0, phones(["HH"])))
    assert one.faces.commands(Append)[0].phones[0].label == "h"
    assert one.counts.refused == 1


def test_an_utterance_for_which_there_is_no_place_is_refused():
    one = Wire()
    one.faces.is_full = True
    (notice,) = told(one.send(HELLO, BeginUtterance("anna", 1), four(), WHOLE), Notice)
    assert (notice.utterance, notice.kind, notice.reason) == (1, "error", "utterances")
    assert one.counts.refused == 1
    assert [type(command) for command in one.faces.commands()] == [Begin]


def test_repeats_change_nothing_and_are_counted():
    one = Wire()
    for _ in range(3):
        one.send(HELLO, BeginUtterance("anna", 1), four(), WHOLE)
    assert [type(command) for command in one.faces.commands()] == [Begin, Append, End]
    assert one.counts.repeated == 6


def test_phones_that_overtake_their_begin_wait_for_it():
    one = Wire()
    one.send(HELLO, four(2, 4, 1), WHOLE, four(0, 1, 0))
    assert one.faces.told == []
    one.send(BeginUtterance("anna", 1, phone_set="x-sampa"))
    assert [type(command) for command in one.faces.commands()] == [Begin, Append, Append, End]
    assert [command.first_index for command in one.faces.commands(Append)] == [0, 2]


def test_an_utterance_that_was_never_begun_is_asked_for():
    one = Wire()
    one.send(HELLO, four(), at_s=50.0)
    assert told(one.tick(50.2), Notice) == []
    (notice,) = told(one.tick(50.31), Notice)
    assert (notice.utterance, notice.kind, notice.reason) == (1, "unknown", "no begin")
    one.send(BeginUtterance("anna", 1))
    assert told(one.tick(51.0), Notice) == []


def test_a_session_that_is_not_known_is_said_now_and_then():
    one = Wire()
    answers = [one.send(AudioPosition("anna", 3, 0, 0), at_s=50 + n / 10) for n in range(11)]
    kinds = [[notice.kind for notice in told(answer, Notice)] for answer in answers]
    assert kinds.count(["unknown"]) == 2
    assert kinds[0] == ["unknown"]


# Acknowledgements -----------------------------------------------------------------------------------------------------


def test_what_came_within_20_ms_is_acknowledged_at_once():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(0, 1), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.send(four(1, 2, 1), four(3, 4, 2), at_s=50.01)
    assert one.tick(50.019) == []
    (ack,) = told(one.tick(50.021), Ack)
    assert ack == Ack("anna", 1, 2, 0b1, 0, 0, 0)
    assert told(one.tick(50.03), Ack) == []


def test_the_slack_is_how_early_the_latest_phones_are():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.faces.utterances["anna", 0].add(Append(0, 0, (Phone("m", 0.0, 0.1),)))
    (ack,) = told(one.tick(50.1), Ack)
    assert ack.slack_us == pytest.approx(400_000, abs=2)


def test_an_ack_knows_64_phones_behind_the_gap():
    one = Wire()
    many = phones("a" * 80)
    one.send(HELLO, BeginUtterance("anna", 1), Phones("anna", 1, 0, 1, many[1:65]))
    (ack,) = told(one.tick(51.0), Ack)
    assert (ack.next_index, ack.bitmap64) == (0, -1)
    one.send(Phones("anna", 1, 0, 0, many[:1]), EndUtterance("anna", 1, 65))
    (ack,) = told(one.tick(52.0), Ack)
    assert (ack.next_index, ack.bitmap64, ack.is_ended) == (65, 0, 1)


def test_a_sender_is_told_why_its_phones_are_refused(monkeypatch):
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1))
    monkeypatch.setattr(one.faces, "apply", lambda session, command, now_s: "phones: too many")
    (notice,) = told(one.send(four(0, 4)), Notice)
    assert (notice.utterance, notice.kind, notice.reason) == (1, "error", "phones: too many")


def test_who_did_not_ask_gets_no_acknowledgement():
    one = Wire()
    one.send(Hello("anna"), BeginUtterance("anna", 1), four(2, 4))
    assert one.tick(51.0) == []


def test_gaps_are_asked_for_until_they_are_filled():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(0, 1), four(3, 4, 1), at_s=50.0)
    assert told(one.tick(50.029), Nack) == []
    assert told(one.tick(50.031), Nack) == [Nack("anna", 1, 1, 3)]
    assert told(one.tick(50.1), Nack) == []
    assert told(one.tick(50.14), Nack) == [Nack("anna", 1, 1, 3)]
    one.send(four(1, 3, 2))
    assert told(one.tick(51.0), Nack) == []
    one.send(EndUtterance("anna", 1, 6), at_s=51.0)
    assert told(one.tick(51.05), Nack) == [Nack("anna", 1, 4, 6)]


def test_what_may_wait_unread_is_not_asked_for():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(0, 1), four(3, 4, 1), at_s=50.0)
    behind = one.read(one.receiver.tick(50.05, lambda peer: peer == "a"))
    assert [type(answer) for _, answer in behind] == [Ack]
    assert told(one.tick(50.1), Nack) == []
    assert told(one.tick(50.16), Nack) == [Nack("anna", 1, 1, 3)]


def test_a_gap_that_is_never_filled_is_not_asked_for_for_ever():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(3, 4), at_s=50.0)
    asked = sum(len(told(one.tick(50 + n / 20), Nack)) for n in range(400))
    assert asked == 30
    one.send(four(3, 4, 1))
    assert told(one.tick(71.0), Nack) == []


def test_a_wrong_checksum_is_an_error_that_a_revision_mends():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(), EndUtterance("anna", 1, 4, -1, 12345), at_s=50.0)
    assert one.counts.checksums == 1
    (notice,) = told(one.tick(50.1), Notice)
    assert (notice.kind, notice.reason) == ("error", "checksum")
    one.send(BeginUtterance("anna", 1, 1), four(revision=1), EndUtterance("anna", 1, 4, 450_000, WHOLE.checksum, 1))
    assert told(one.tick(51.0), Notice) == []
    assert one.faces.commands(Append)[-1].revision == 1
    assert one.faces.commands(End)[-1] == End(0, 4, 0.45, 1)
    assert one.counts.checksums == 1


def test_phones_of_an_old_revision_are_left():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(0, 2), four(0, 1, 1, revision=2), four(1, 2, 2, revision=1))
    assert [command.revision for command in one.faces.commands(Append)] == [0, 2]
    assert one.counts.repeated == 1
    one.send(BeginUtterance("anna", 1, 1), EndUtterance("anna", 1, 2, -1, 0, 1))
    assert one.counts.repeated == 3
    assert one.faces.commands(End) == []


def test_an_end_may_come_without_a_duration_or_be_shorter_than_its_phones():
    one = Wire()
    one.send(BeginUtterance("anna", 1), four(), EndUtterance("anna", 1, 4))
    one.send(BeginUtterance("anna", 2), Phones("anna", 2, 0, 0, FOUR), EndUtterance("anna", 2, 4, 100))
    assert [end.duration_s for end in one.faces.commands(End)] == [pytest.approx(0.4), pytest.approx(0.4)]
    one.send(BeginUtterance("anna", 3), EndUtterance("anna", 3, -1), EndUtterance("anna", 3, 20_001))
    one.send(Phones("anna", 3, 0, 19_998, FOUR))  # more than the engine takes
    assert one.counts.refused == 3
    assert len(one.faces.commands(Append)) == 2


def test_what_is_missing_before_a_far_end_is_asked_for_in_one_piece():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(), EndUtterance("anna", 1, 20_000))
    (_, asked) = one.tick(50.5)
    assert (asked[1].first, asked[1].stop) == (4, 20_000)


def test_what_is_never_begun_is_told_of_ten_times_and_only_to_who_said_hello():
    one = Wire()
    one.send(HELLO, four())
    one.send(Phones("berta", 1, 0, 0, FOUR), peer="b")
    told_s = [at_s for at_s in np.arange(50.0, 60.0, 0.1) for _ in told(one.tick(at_s), Notice)]
    assert len(told_s) == 10
    assert told_s[-1] < 53.5
    one.send(BeginUtterance("anna", 1), four())
    assert len(one.faces.commands(Append)) == 1


def test_of_a_bundle_only_so_many_messages_are_obeyed():
    one = Wire(limits=WireLimits(messages=5))
    blink = osc.message("/blink")
    one.send(b"#bundle\0" + bytes(8) + (len(blink).to_bytes(4, "big") + blink) * 12)
    assert (one.counts.messages, one.counts.refused) == (5, 7)


def test_phones_behind_the_end_are_left():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(), EndUtterance("anna", 1, 2), four(2, 4, 1))
    (ack,) = told(one.tick(51.0), Ack)
    assert (ack.next_index, ack.is_ended) == (2, 1)
    assert one.counts.repeated == 1


def test_lost_datagrams_are_counted_and_overtaken_ones_taken_back():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1))
    for sequence in (0, 1, 4, 3, 4, 6):
        one.send(four(sequence=sequence))
    assert one.counts.lost == 2
    one.send(four(sequence=2**31 - 1))
    assert one.counts.lost <= 2 + 64


# Cancel, pause, sound -------------------------------------------------------------------------------------------------


def test_a_cancel_stops_one_and_what_comes_behind_it_is_left():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(0, 2), CancelUtterance("anna", 1, fade_ms=300))
    assert one.faces.commands(Cancel) == [Cancel(0, None, 0.3)]
    one.send(four(2, 4, 1), WHOLE)
    assert len(one.faces.commands(Append)) == 1
    one.faces.happen("anna", 0, "cancelled", 50.1)
    assert [notice.kind for notice in told(one.tick(50.1), Notice)] == ["cancelled"]
    assert [notice.kind for notice in told(one.send(CancelUtterance("anna", 1)), Notice)] == ["cancelled"]
    assert len(one.faces.commands(Cancel)) == 1


def test_a_cancel_before_its_utterance_stops_it_too():
    one = Wire()
    (answer,) = told(one.send(HELLO, CancelUtterance("anna", 3), at_s=50.0), Notice)
    assert (answer.utterance, answer.kind) == (3, "cancelled")
    one.send(BeginUtterance("anna", 3), Phones("anna", 3, 0, 0, FOUR), EndUtterance("anna", 3, 4), at_s=50.5)
    assert one.faces.told == []
    one.send(BeginUtterance("anna", 4))
    assert one.faces.commands(Begin) == [Begin(1, "now")]


def test_a_repeated_cancel_of_all_does_not_stop_what_was_begun_meanwhile():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), CancelUtterance("anna"), at_s=50.0)
    one.send(BeginUtterance("anna", 2), CancelUtterance("anna"), at_s=50.06)
    assert one.faces.commands(Cancel) == [Cancel(0), Cancel(None)]
    one.send(CancelUtterance("anna"), at_s=51.0)
    assert one.faces.commands(Cancel)[2:] == [Cancel(1), Cancel(None)]


def test_a_cancel_of_all_below_a_number_spares_the_others_whenever_it_comes():
    one = Wire()
    cancel = CancelUtterance("anna", below=3, number=8)
    answers = one.send(HELLO, BeginUtterance("anna", 3), BeginUtterance("anna", 1), cancel)
    stopped = [Cancel(1), Cancel(first=VOICE_UTTERANCES)]
    assert one.faces.commands(Cancel) == stopped
    (answer,) = told(answers, Notice)
    assert (answer.utterance, answer.kind, answer.count) == (-1, "cancelled", 8)
    one.send(BeginUtterance("anna", 2), Phones("anna", 2, 0, 0, FOUR))  # had been under way
    assert len(one.faces.commands(Begin)) == 2
    assert told(one.tick(50.5), Notice) == []  # and is not asked for
    assert told(one.send(cancel, at_s=51.0), Notice)[0].count == 8
    assert one.faces.commands(Cancel) == stopped


def test_a_cancel_at_a_place_of_the_utterance():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.send(CancelUtterance("anna", 1, 200_000, 5))
    (cancel,) = one.faces.commands(Cancel)
    assert cancel.at_s == pytest.approx(50.7)
    assert cancel.fade_s == 0.01
    one.send(four(0, 4, 1))  # it is still being said
    assert one.counts.repeated == 1


def test_a_cancel_of_all_at_a_place_stops_nothing_at_once():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), four(), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.send(CancelUtterance("anna", -1, 200_000))
    assert [cancel.at_s for cancel in one.faces.commands(Cancel)] == [pytest.approx(50.7)]


def test_pause_resume_and_seek():
    one = Wire()
    one.send(
        HELLO,
        BeginUtterance("anna", 1),
        anna(Pause(0.15)),
        anna(Resume()),
    )
    one.send(schema.SeekUtterance("anna", 1, 2_000_000))
    assert one.faces.commands()[1:] == [Pause(0.15), Resume(), Seek(0, 2.0)]
    one.send(schema.SeekUtterance("anna", 1, -1), schema.SeekUtterance("anna", 9, 1))
    assert one.counts.refused == 2


def test_positions_of_the_sound():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1, 0, "audio"), AudioPosition("anna", 1, 5, 40_000), at_s=50.0)
    assert one.faces.commands(Audio) == [Audio(0, 50.0, pytest.approx(0.04), 1.0)]
    one.send(Ping(1, 1_000_000, 49_000_000, 0.0, 100), AudioPosition("anna", 1, 990_000, 60_000, 9.0))
    assert one.faces.commands(Audio)[1] == Audio(0, pytest.approx(49.99), pytest.approx(0.06), 4.0)
    one.send(AudioPosition("anna", 1, 500_000, 60_000))
    assert one.counts.odd_times == 1
    assert len(one.faces.commands(Audio)) == 2
    one.faces.happen("anna", 0, "finished", 50.5)
    one.tick(50.5)
    one.send(AudioPosition("anna", 1, 1_000_000, 60_000))
    assert len(one.faces.commands(Audio)) == 2


def test_a_report_of_the_sound_outranks_the_clock_for_two_seconds():
    one = Wire()
    one.send(HELLO, Ping(1, 0, 50_000_000, 0.0, 100), BeginUtterance("anna", 1, 0, "at", 500_000), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.tick(51.6)
    one.send(Ping(2, 2_000_000, 49_990_000, 0.0, 100), AudioPosition("anna", 1, 2_610_000, 2_100_000), at_s=52.6)
    reported = Audio(0, pytest.approx(52.6), pytest.approx(2.1))
    assert one.faces.commands(Audio) == [reported]
    for at_s in (52.7, 53.8):  # the clock says 10 ms more, but the sound was heard where it was reported
        one.tick(at_s)
    assert one.faces.commands(Audio) == [reported]
    one.tick(54.9)  # no report for 2 s
    assert one.faces.commands(Audio) == [reported, Audio(0, 54.9, pytest.approx(4.41))]


def test_an_utterance_at_a_time_follows_the_senders_clock_until_it_is_moved_by_hand():
    one = Wire()
    one.send(HELLO, Ping(1, 0, 50_000_000, 0.0, 100), BeginUtterance("anna", 1, 0, "at", 500_000), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.tick(51.6)
    assert one.faces.commands(Audio) == []
    one.send(Ping(2, 2_000_000, 49_990_000, 0.0, 100))
    one.tick(52.7)
    (audio,) = one.faces.commands(Audio)
    assert audio == Audio(0, 52.7, pytest.approx(2.21))
    one.send(anna(Pause()))
    one.tick(54.0)
    assert len(one.faces.commands(Audio)) == 1


# Sessions and senders -------------------------------------------------------------------------------------------------


def test_events_reach_all_who_joined_and_are_told_again():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), at_s=50.0)
    one.send(Hello("anna", flags=schema.TCP, instance=5), peer="tcp")
    one.faces.settle("anna", 0, 50.1)
    one.faces.happen("anna", 0, "started", 50.12)
    one.faces.happen("anna", 0, "late", 50.12, 3)
    first = one.tick(50.12)
    assert [(peer, notice.kind, notice.count) for peer, notice in first] == [
        ("a", "started", 1), ("tcp", "started", 1), ("a", "late", 3), ("tcp", "late", 3),
    ]  # fmt: skip
    assert (first[0][1].position_us, first[0][1].engine_us) == (20_000, 50_120_000)
    assert one.tick(50.2) == [first[0]]
    assert one.tick(50.6) == [first[0]]
    assert one.tick(51.0) == []


def test_events_of_others_utterances_are_not_told():
    one = Wire()
    one.send(HELLO)
    one.faces.happen("anna", 1 << 30, "started", 50.0)
    one.faces.happen("berta", 0, "started", 50.0)
    assert one.tick(50.1) == []


def test_a_restarted_sender_counts_anew_and_its_old_speech_is_cancelled():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 0), CancelUtterance("anna", below=5, number=1), BeginUtterance("anna", 5))
    one.send(Hello("anna", instance=6), BeginUtterance("anna", 0), peer="b")
    assert [type(command) for command in one.faces.commands()] == [Begin, Cancel, Cancel, Begin, Cancel, Begin]
    assert one.faces.commands(Begin)[-1].utterance == 2
    assert one.counts.resets == 1
    one.faces.happen("anna", 2, "finished", 51.0)
    assert [(peer, notice.utterance) for peer, notice in one.tick(51.0)] == [("b", 0)]


def test_the_clock_of_a_sender_that_was_restarted_is_unknown():
    one = Wire()
    one.send(HELLO, Ping(1, 7_000_000), at_s=107.0)
    one.send(Hello("anna", instance=6), BeginUtterance("anna", 1, 0, "at", 8_000_000))
    assert one.faces.commands(Begin) == [Begin(0, "now")]


def test_the_same_hello_again_and_one_without_an_instance_reset_nothing():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 0), HELLO, Hello("anna", instance=0), HELLO)
    assert one.faces.commands(Cancel) == []
    assert one.counts.resets == 0


def test_numbers_may_be_used_again_by_a_sender_that_says_no_hello():
    one = Wire()
    one.send(BeginUtterance("anna", 1), four(), at_s=50.0)
    one.faces.happen("anna", 0, "finished", 51.0)
    one.tick(51.0)
    one.send(BeginUtterance("anna", 1), four(sequence=1), at_s=52.0)  # a late repeat
    assert len(one.faces.commands(Begin)) == 1
    one.send(BeginUtterance("anna", 1), four(sequence=2), at_s=53.5)
    assert one.faces.commands(Begin)[1:] == [Begin(1, "now")]
    assert len(one.faces.commands(Append)) == 2


def test_a_session_that_others_closed_is_opened_again():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1))
    one.faces.close("anna", 51.0)
    one.tick(51.0)
    one.send(BeginUtterance("anna", 1))
    assert one.faces.open_sessions == ["anna"]
    assert one.faces.commands(Begin) == [Begin(0, "now"), Begin(1, "now")]


def test_what_is_begun_after_a_bye_is_new_to_the_engine():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1), schema.Bye("anna"), HELLO, BeginUtterance("anna", 1))
    assert one.faces.commands(Begin) == [Begin(0, "now"), Begin(1, "now")]


def test_bye_cancels_and_is_answered():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1))
    (notice,) = told(one.send(schema.Bye("anna")), Notice)
    assert (notice.kind, notice.reason, notice.utterance) == ("cancelled", "bye", -1)
    assert one.faces.commands(Cancel) == [Cancel()]
    one.send(schema.Bye("anna"), schema.Bye("nobody"))
    assert one.counts.repeated == 2


def test_who_stays_after_anothers_bye_is_told_what_was_cancelled_and_still_answered():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1))
    one.send(Hello("anna", flags=schema.WANT_ACK, instance=5), peer="b")

    def cancel(session, command, now_s):
        if isinstance(command, Cancel):
            one.faces.happen(session, 0, "cancelled", now_s)

    one.faces.told_too = cancel
    answers = one.send(schema.Bye("anna"), peer="b")
    assert [(peer, notice.utterance) for peer, notice in answers] == [("a", 1), ("a", -1), ("b", -1)]
    one.send(BeginUtterance("anna", 1), four())
    assert {peer for peer, answer in one.tick(50.1) if isinstance(answer, Ack)} == {"a"}


def test_who_said_hello_is_answered_still_when_an_idle_session_was_closed_meanwhile():
    one = Wire()
    one.send(HELLO)
    one.send(Hello("anna", flags=schema.WANT_ACK, instance=5), peer="gone")
    one.faces.close("anna", 51.0)
    one.tick(51.0)
    one.receiver.forget("gone")
    one.send(BeginUtterance("anna", 1), four(), at_s=300.0)
    assert [(peer, ack.next_index) for peer, ack in one.tick(300.1)] == [("a", 4)]
    one.faces.happen("anna", 0, "finished", 301.0)
    assert [(peer, notice.kind) for peer, notice in one.tick(301.0)] == [("a", "finished")]


def test_so_many_closed_sessions_are_remembered():
    one = Wire(limits=WireLimits(peers=2))
    for name in ("anna", "berta", "clara"):
        one.send(Hello(name, flags=schema.WANT_ACK))
        one.faces.close(name, 51.0)
        one.tick(51.0)
    for name, answers in (("anna", 0), ("berta", 1), ("clara", 1)):
        one.send(BeginUtterance(name, 1), Phones(name, 1, 0, 0, FOUR))
        assert len(one.tick(one.now_s + 0.1)) == answers


def test_a_peer_whose_connection_ends_hears_no_more():
    one = Wire()
    one.send(HELLO, BeginUtterance("anna", 1))
    one.send(anna(Blink()), peer="stranger")
    for name in ("a", "stranger", "nobody"):
        one.receiver.forget(name)
    one.faces.happen("anna", 0, "finished", 51.0)
    assert one.tick(51.0) == []
    assert not one.peers


def test_a_session_has_at_most_eight_listeners_and_a_receiver_so_many_peers():
    one = Wire(limits=WireLimits(peers=12))
    for number in range(30):
        one.send(HELLO if number % 2 else anna(Blink()), peer=number)
    assert len(one.peers) == 8 + 12
    assert one.receiver.counts.refused == 15 - 8
    one.send(BeginUtterance("anna", 1), peer=29)
    one.faces.happen("anna", 0, "started", 50.1)
    assert len(one.tick(50.1)) == 8


def test_old_utterances_are_forgotten():
    one = Wire(limits=WireLimits(utterances=4))
    for number in range(10):
        one.send(BeginUtterance("anna", number), Phones("anna", number, 0, 0, FOUR))
    assert [begin.utterance for begin in one.faces.commands(Begin)] == list(range(10))
    for number in range(10):
        one.faces.happen("anna", number, "finished", 50.0)
    one.send(Hello("anna"))
    assert sorted(notice.utterance for _, notice in one.tick(50.0)) == [6, 7, 8, 9]


def test_cancels_are_remembered_for_a_while_and_no_more():
    one = Wire(limits=WireLimits(utterances=4))
    one.send(HELLO)
    for number in range(1, 20):
        one.send(CancelUtterance("anna", number=number))
    before = len(one.faces.commands(Cancel))
    one.send(CancelUtterance("anna", number=19))
    assert len(one.faces.commands(Cancel)) == before
    one.send(CancelUtterance("anna", number=1))
    assert len(one.faces.commands(Cancel)) == before + 1


def test_what_was_forgotten_is_not_acknowledged():
    one = Wire(limits=WireLimits(utterances=2))
    one.send(HELLO, BeginUtterance("anna", 1), four(), BeginUtterance("anna", 2), BeginUtterance("anna", 3))
    assert told(one.tick(51.0), Ack) == []


def test_a_sender_whose_clock_was_set_is_not_followed():
    one = Wire()
    one.send(HELLO, Ping(1, 0, 50_000_000, 0.0, 100), BeginUtterance("anna", 1, 0, "at", 500_000), at_s=50.0)
    one.faces.settle("anna", 0, 50.5)
    one.send(Ping(2, 1_000_000, 49_940_000, 0.0, 100))
    one.send(Ping(3, 1_000_000, 49_800_000, 0.0, 100))  # a step, which may have been the sender's own
    for second in range(52, 60):
        one.tick(float(second))
    assert one.faces.commands(Audio) == []
    assert one.counts.clock_steps == 1


# Gestures and texts ---------------------------------------------------------------------------------------------------


def test_gestures():
    one = Wire()
    one.send(anna(Express(Expression.JOY, 0.5, 0.25, 1e-6, 2.0, 3e-6)), at_s=50.0)
    one.send(anna(Express(Expression.FEAR)))
    one.send(
        anna(Look(pi, -pi / 2, 0.2)),
        anna(Blink()),
        anna(SetParameter("jaw", 2.0)),
    )
    one.send(anna(TurnHead(roll_rad=radians(1), pitch_rad=radians(2), yaw_rad=pi, over_s=0.3)))
    joy, fear, look, blink, jaw, turn = one.faces.commands()
    assert joy == Express(Expression.JOY, 0.5, 50.25, 1e-6, 2.0, pytest.approx(3e-6))
    assert fear == Express(Expression.FEAR, 1.0, None, 0.35, inf, 0.5)
    assert look == Look(pytest.approx(3.14159, abs=1e-5), pytest.approx(-1.5708, abs=1e-5), 0.2)
    assert blink == Blink()
    assert jaw == SetParameter("jaw", 2.0)
    angles = (turn.pitch_rad, turn.yaw_rad, turn.roll_rad)
    assert isinstance(turn, TurnHead)
    assert angles == pytest.approx((0.0349, 3.1416, 0.01745), abs=1e-4)
    assert turn.over_s == 0.3


def test_neutral_takes_all_expressions_away():
    one = Wire()
    one.send(anna(Express(Expression.NEUTRAL, attack_s=0.2)))
    assert {(wish.expression, wish.level, wish.attack_s) for wish in one.faces.commands(Express)} == {
        (expression, 0.0, 0.2) for expression in Expression if expression
    }


def test_names_that_there_are_not_are_counted():
    one = Wire()
    one.send(
        osc.message("/fap/1/expr", "ss", "anna", "hungry"), osc.message("/fap/1/param", "ssf", "anna", "colour", 1.0)
    )
    assert one.faces.told == []
    assert one.counts.malformed == 2


def test_texts_are_handed_out_once_and_have_limits():
    one = Wire(limits=WireLimits(texts=2))
    one.send(schema.SpeakText("anna", "hello", "en"), schema.SpeakText("anna", "  "))
    one.say("/tts/text", "s", "and you")
    answers = one.send(schema.SpeakText("anna", "too many"))
    assert told(answers, Notice)[0].reason == "text"
    taken = one.receiver.texts()
    assert [(text.session, text.text, text.voice, text.peer) for text in taken] == [
        ("anna", "hello", "en", "a"), ("face", "and you", "", "a"),
    ]  # fmt: skip
    assert one.receiver.texts() == []
    assert told(one.send(schema.SpeakText("anna", "x" * 4001)), Notice)[0].reason == "text"


def test_words_are_handed_out_in_order_once_and_with_their_end():
    one = Wire()
    hi, you = schema.WireWord("Hi", 100_000, 200_000), schema.WireWord("you", 300_000, 100_000)
    first, second = schema.WordTimes("anna", 7, 0, (hi,), "en-gb"), schema.WordTimes("anna", 7, 1, (you,))
    one.send(Hello("anna"), first, first, second)  # it needs no begin
    assert one.faces.commands() == [Begin(0, "now")]
    one.send(EndUtterance("anna", 7, 2, 900_000), EndUtterance("anna", 7, 2), schema.WordTimes("anna", 7, 2, (you,)))
    requests = [(one.utterance, one.words, one.voice, one.is_last, one.duration_s) for one in one.receiver.words()]
    assert requests == [
        (0, (("Hi", 0.1, 0.3),), "en-gb", False, 0.0),
        (0, (("you", 0.3, 0.4),), "en-gb", False, 0.0),
        (0, (), "en-gb", True, 0.9),
    ]
    assert one.receiver.words() == []
    assert one.counts.repeated >= 2
    one.send(Phones("anna", 7, 0, 0, FOUR))  # phones and words do not mix
    assert one.counts.refused == 1
    assert told(one.tick(0.2), Nack) == []  # no phone is missed
    one.send(BeginUtterance("anna", 8, anchor="audio"), schema.WordTimes("anna", 8, 0, (hi,)))
    one.send(CancelUtterance("anna", 8), schema.WordTimes("anna", 8, 1, (you,)))
    assert [request.utterance for request in one.receiver.words()] == [1]


def test_words_are_acknowledged_to_who_asks_as_often_as_they_come():
    one = Wire()
    hi, you = schema.WireWord("Hi", 100_000, 200_000), schema.WireWord("you", 300_000, 100_000)
    first, second = schema.WordTimes("anna", 7, 0, (hi,)), schema.WordTimes("anna", 7, 1, (you,))
    one.send(Hello("anna", flags=schema.WANT_ACK), first)
    acks = [told(one.tick(one.now_s + 0.03), Ack) for _ in range(2)]
    assert [[(ack.utterance, ack.next_index, ack.is_ended) for ack in each] for each in acks] == [[(7, 1, 0)], []]
    one.send(first)  # the acknowledgement was lost
    assert [ack.next_index for ack in told(one.tick(one.now_s + 0.03), Ack)] == [1]
    one.send(second, EndUtterance("anna", 7, 2))
    assert [(ack.next_index, ack.is_ended) for ack in told(one.tick(one.now_s + 0.03), Ack)] == [(2, 1)]
    one.send(second, EndUtterance("anna", 7, 2))
    assert [(ack.next_index, ack.is_ended) for ack in told(one.tick(one.now_s + 0.03), Ack)] == [(2, 1)]
    assert [request.is_last for request in one.receiver.words()] == [False, False, True]
    silent = Wire()
    silent.send(Hello("anna"), first)
    assert told(silent.tick(0.1), Ack) == []


def test_simple_senders_that_ask_are_told_of_events():
    one = Wire()
    one.say("/tts/events", "i", 1)
    one.faces.settle("face", 3, 0.0)
    one.faces.happen("face", 3, "started", 0.25)
    heard = [osc.parse_packet(packet)[0] for _, packet in one.receiver.tick(one.now_s)]
    assert [(message.address, message.arguments) for message in heard] == [("/tts/event", ("started", 0.25, 3))]
    one.say("/tts/events", "i", 0)
    one.faces.happen("face", 3, "finished", 0.5)
    assert one.receiver.tick(one.now_s) == []


def test_a_stop_and_a_cancel_of_all_stop_the_voice_too():
    one = Wire()
    one.say("/tts/text", "s", "hello")
    one.send(schema.SpeakText("anna", "and you"))
    one.say("/tts/stop")
    assert one.faces.commands(Cancel) == [Cancel(first=VOICE_UTTERANCES)]
    assert [text.session for text in one.receiver.texts()] == ["anna"]  # the other was not handed to it yet
    one.send(schema.SpeakText("anna", "and you"), CancelUtterance("anna", below=3, number=8))
    assert one.faces.commands(Cancel)[1:] == [Cancel(None, None, 0.2, VOICE_UTTERANCES)]
    assert one.receiver.texts() == []
    one.send(schema.SpeakText("anna", "and you"), CancelUtterance("anna", at_us=10_000_000))
    assert len(one.receiver.texts()) == 1
    one.send(schema.SpeakText("anna", "and you"), schema.Bye("anna"))
    assert one.receiver.texts() == []


# What is not understood -----------------------------------------------------------------------------------------------


def test_what_is_not_understood_is_counted():
    one = Wire(limits=WireLimits(packet=2000))
    packets = [
        *(b"nonsense", b"", b"/x\0\0,i\0\0", bytes(2001)),
        osc.message("/nobody/knows", "i", 1),
        osc.message("/fap/1/blink", "sii", "anna", 1, 2),
        osc.message("/fap/1/blink", "i", 1),
    ]
    one.send(*packets, peer="b")
    counts = one.counts
    assert (counts.packets, counts.messages, counts.malformed, counts.unknown, counts.surplus) == (7, 3, 5, 1, 2)
    assert counts.bytes == sum(map(len, packets))


def test_a_wrong_message_spoils_no_other_of_its_bundle():
    one = Wire()
    parts = [osc.message("/fap/1/blink", "i", 1), osc.message("/fap/1/blink", "s", "anna"), osc.message("/zzz")]
    one.send(osc.bundles(parts, limit=1000)[0])
    assert one.faces.commands() == [Blink()]
    assert (one.counts.malformed, one.counts.unknown, one.counts.messages) == (1, 1, 3)


def test_a_session_that_is_elsewhere_is_not_opened_and_its_sender_told():
    one = Wire(elsewhere=lambda session: 9110 if session == "anna" else None)
    assert told(one.send(HELLO), schema.Moved) == [schema.Moved("anna", "", 9110, HELLO.instance)]
    assert [notice.kind for notice in told(one.send(BeginUtterance("anna", 1), four()), Notice)] == ["unknown"]
    one.send(schema.SpeakText("anna", "Hello."), schema.Bye("anna"), anna(Blink()))
    assert one.faces.open_sessions == []
    assert one.receiver.texts() == []
    assert one.counts.moved == 1
    assert told(one.send(Hello("ben")), schema.Welcome)
    assert one.faces.open_sessions == ["ben"]
