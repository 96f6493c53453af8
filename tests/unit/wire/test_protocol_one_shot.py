"""The simple mode: one message a phone."""

from itertools import pairwise

import pytest

from fapengine.engine.commands import (
    VOICE_UTTERANCES,
    Append,
    Begin,
    Blink,
    Cancel,
    End,
    Express,
    Look,
    SetParameter,
    TurnHead,
)
from fapengine.speech.phone_track import SILENCE
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.clock import time_tag
from fapengine.wire.speech_osc.one_shot import DELAY_S, FIRST_S, GRACE_S, QUIET_S, TURN_S
from tests.unit.wire.protocol_double import WALL_S, Wire


def shown(one: Wire) -> list[tuple[str, float, float]]:
    """(label, start, end) of all phones in engine time, as far as their utterance has a time."""
    zeros = {begin.utterance: begin.at_s for begin in one.faces.commands(Begin)}
    return [
        (
            phone.label,
            round(phone.start_s + zeros[append.utterance], 6),
            round(phone.end_s + zeros[append.utterance], 6),
        )
        for append in one.faces.commands(Append)
        for phone in append.phones
    ]


def ticked(one: Wire, until_s: float) -> None:
    while one.now_s < until_s:
        one.tick(one.now_s + 0.02)


def test_a_phone_is_shown_when_it_comes_a_little_late():
    one = Wire()
    one.say("/phoneme", "s", "m", at_s=50.0)
    one.say("/phoneme", "s", "ɑ", at_s=50.1)
    assert one.faces.open_sessions == ["face"]
    assert one.faces.commands(Begin) == [Begin(0, "at", 50.0 + DELAY_S)]
    assert shown(one) == [("m", 50.04, 50.21), ("ɑ", 50.14, 50.31)]
    assert [append.first_index for append in one.faces.commands(Append)] == [0, 1]


def test_a_phone_with_a_duration_is_not_held():
    one = Wire()
    one.say("/phoneme", "sf", "m", 0.25, at_s=50.0)
    ticked(one, 50.6)
    assert shown(one) == [("m", 50.04, pytest.approx(50.29 + GRACE_S))]


def test_a_phone_without_one_is_held_on_and_not_for_ever():
    one = Wire()
    one.say("/phoneme", "s", "ɑ", at_s=50.0)
    ticked(one, 50.4)
    phones = shown(one)
    assert phones[0] == ("ɑ", 50.04, 50.04 + FIRST_S)
    assert 50.4 < phones[-1][2] < 50.65
    assert all(before[2] == after[1] for before, after in pairwise(phones))
    ticked(one, 53.0)
    assert QUIET_S <= shown(one)[-1][2] - 50.04 < QUIET_S + 2 * FIRST_S
    assert one.faces.commands(End)[0].duration_s == pytest.approx(shown(one)[-1][2] - 50.04)
    assert {label for label, _, _ in shown(one)} == {"ɑ"}


def test_a_phone_that_comes_just_when_the_one_before_is_held_on_is_whole():
    one = Wire()
    one.say("/phoneme", "s", "ɑ", at_s=50.0)
    one.tick(50.165)
    one.say("/phoneme", "s", "m", at_s=50.168)
    assert shown(one) == [("ɑ", 50.04, 50.21), ("ɑ", 50.21, 50.38), ("m", 50.208, 50.378)]


def test_silence_ends_what_is_held():
    one = Wire()
    one.say("/phoneme", "s", "ɑ", at_s=50.0)
    one.say("/viseme", "s", "sil", at_s=50.1)
    ticked(one, 50.9)
    assert shown(one) == [("ɑ", 50.04, 50.21), (SILENCE, 50.14, 50.31)]


def test_an_utterance_ends_after_a_second_without_messages():
    one = Wire()
    one.say("/phoneme", "sf", "m", 0.1, at_s=50.0)
    ticked(one, 50.9)
    assert one.faces.commands(End) == []
    ticked(one, 51.2)
    assert one.faces.commands(End) == [End(0, 1, pytest.approx(0.1 + GRACE_S))]
    one.say("/phoneme", "s", "m", at_s=51.3)
    assert one.faces.commands(Begin)[1] == Begin(1, "at", 51.3 + DELAY_S)


def test_a_long_talk_is_several_utterances():
    one = Wire()
    for n in range(700):
        one.say("/phoneme", "s", "mɑ"[n % 2], at_s=50.0 + n / 10)
    begins = one.faces.commands(Begin)
    assert len(begins) == 70 // TURN_S + 1
    assert len(one.faces.commands(End)) == len(begins) - 1
    starts = [start for _, start, _ in shown(one)]
    assert starts == pytest.approx([50.04 + n / 10 for n in range(700)])


def test_phones_with_start_and_duration_are_an_utterance_behind_what_is_said():
    one = Wire()
    for n in range(4):
        one.say("/phoneme", "sff", "mɑmɑ"[n], n / 10, 0.1, at_s=50.0)
    ticked(one, 51.2)
    assert one.faces.commands(Begin) == [Begin(0, "now")]
    assert [append.phones[0].start_s for append in one.faces.commands(Append)] == pytest.approx([0, 0.1, 0.2, 0.3])
    assert one.faces.commands(End) == [End(0, 4, pytest.approx(0.4))]
    one.say("/phoneme", "sff", "m", 0.0, 0.1, at_s=60.0)
    assert one.faces.commands(Begin)[1] == Begin(1, "now")


def test_a_start_behind_the_last_end_goes_on_in_the_same_time():
    one = Wire()
    one.say("/phoneme", "sff", "m", 0.0, 0.1, at_s=50.0)
    one.faces.settle("face", 0, 50.0)
    ticked(one, 51.5)
    one.say("/phoneme", "sff", "ɑ", 2.5, 0.1, at_s=52.0)
    assert one.faces.commands(Begin)[1] == Begin(1, "at", pytest.approx(50.0))
    (phone,) = one.faces.commands(Append)[1].phones
    assert (phone.label, phone.start_s, phone.end_s) == ("ɑ", 2.5, pytest.approx(2.6))


def test_start_gives_the_time_and_stop_ends_speech():
    one = Wire()
    one.say("/tts/start", "s", "id", at_s=50.0)
    one.say("/phoneme", "sff", "ɑ", 0.2, 5.0)
    one.say("/phoneme", "s", "m", at_s=50.1)
    assert one.faces.commands(Begin) == [Begin(0, "at", 50.0 + DELAY_S)]
    assert shown(one) == [("ɑ", 50.24, 55.24), ("m", 50.14, 50.24)]  # the script goes on at 50.24
    one.say("/tts/stop", at_s=51.0)
    assert one.faces.commands(End) == [End(0, 2, pytest.approx(5.2))]
    assert one.faces.commands(Cancel) == [Cancel(0, 51.0 + DELAY_S, 0.15)]
    one.say("/tts/stop", at_s=52.0)
    assert one.faces.commands(Cancel)[1:] == [Cancel(first=VOICE_UTTERANCES)]  # nothing of its own


def test_a_stop_ends_a_script_of_which_nothing_was_told_for_long():
    one = Wire()
    one.say("/tts/start", at_s=50.0)
    one.say("/phoneme", "sff", "ɑ", 0.0, 20.0)
    one.faces.settle("face", 0, 50.04)
    one.faces.utterances["face", 0].duration_s = 20.0
    ticked(one, 55.0)
    assert len(one.faces.commands(End)) == 1
    one.say("/tts/stop", at_s=55.0)
    one.say("/tts/stop", at_s=55.1)
    assert one.faces.commands(Cancel) == [Cancel(0, 55.0 + DELAY_S, 0.15), Cancel(first=VOICE_UTTERANCES)]


@pytest.mark.parametrize("tags", ["s", "sff"])
def test_after_a_cancel_by_others_the_next_phone_begins_anew(tags):
    one = Wire()
    times = (0.5, 0.2)[: len(tags) - 1]
    one.say("/phoneme", tags, "m", *times, at_s=50.0)
    one.faces.happen("face", 0, "cancelled", 50.05)
    one.say("/phoneme", tags, "ɑ", *times, at_s=50.1)
    assert [begin.utterance for begin in one.faces.commands(Begin)] == [0, 1]
    assert one.faces.commands(Append)[-1].utterance == 1


@pytest.mark.parametrize("address", ["/phoneme", "/viseme"])
def test_names_of_any_length_are_not_remembered(address):
    one = Wire()
    one.say(address, "s", "m" * 65)
    assert (one.counts.malformed, one.faces.told) == (1, [])


def test_a_stop_when_all_is_said_cancels_nothing():
    one = Wire()
    one.say("/phoneme", "sf", "m", 0.1, at_s=50.0)
    one.faces.settle("face", 0, 50.04)
    one.say("/tts/stop", at_s=50.5)
    assert one.faces.commands(Cancel) == []
    assert len(one.faces.commands(End)) == 1


def test_a_start_while_something_is_said_begins_anew():
    one = Wire()
    one.say("/phoneme", "s", "m", at_s=50.0)
    one.say("/tts/start", at_s=50.3)
    one.say("/tts/start", at_s=50.4)
    assert len(one.faces.commands(End)) == 2
    assert len(one.faces.commands(Begin)) == 3
    assert [cancel.utterance for cancel in one.faces.commands(Cancel)] == [0, 1]


def test_phones_that_overtake_their_start_are_its_own():
    one = Wire()
    one.say("/phoneme", "sff", "ɑ", 0.0, 20.0, at_s=50.0)
    ticked(one, 52.0)
    one.say("/phoneme", "sff", "m", 0.1, 0.1, at_s=52.0)
    one.say("/tts/start", at_s=52.003)
    one.say("/phoneme", "sff", "ɑ", 0.0, 0.1, at_s=52.004)
    assert [append.utterance for append in one.faces.commands(Append)] == [0, 1, 1]
    assert [cancel.utterance for cancel in one.faces.commands(Cancel)] == [0]
    one.say("/tts/start", at_s=53.0)
    assert [cancel.utterance for cancel in one.faces.commands(Cancel)] == [0, 1]


def test_from_phone_by_phone_to_a_script_and_back():
    one = Wire()
    one.say("/phoneme", "s", "m", at_s=50.0)
    one.say("/phoneme", "sff", "ɑ", 0.0, 0.1, at_s=50.2)
    one.say("/phoneme", "s", "m", at_s=50.4)
    assert one.faces.commands(Begin) == [Begin(0, "at", 50.04), Begin(1, "now"), Begin(2, "at", pytest.approx(50.44))]
    assert len(one.faces.commands(End)) == 2


def test_tags_say_when():
    one = Wire()
    one.say("/phoneme", "s", "ɑ", at_s=50.0, tag=time_tag(WALL_S + 50.3))
    one.say("/phoneme", "s", "m", at_s=50.0, tag=time_tag(WALL_S + 50.22))  # overtaken: what begins later ends it
    assert shown(one) == [("ɑ", 50.34, 50.51), ("m", 50.26, 50.34)]
    one.say("/phoneme", "s", "m", at_s=50.0, tag=time_tag(WALL_S + 3600))
    assert one.counts.clamped == 1


def test_what_is_tagged_ahead_is_held_from_its_time_on():
    one = Wire()
    one.say("/phoneme", "s", "ɑ", at_s=50.0, tag=time_tag(WALL_S + 53.0))
    ticked(one, 56.0)
    assert shown(one)[0][1] == pytest.approx(53.04)
    assert QUIET_S <= shown(one)[-1][2] - 53.04 < QUIET_S + 2 * FIRST_S


def test_what_is_remembered_of_an_utterance_has_a_limit():
    one = Wire()
    for n in range(3000):
        one.say("/phoneme", "sff", "m", n / 10, 0.1)
    assert len(one.faces.commands(Begin)) == 1
    assert len(one.receiver._simple._open.starts_s) == 64


def test_labels_are_of_the_set_that_the_others_are_of():
    one = Wire()
    for label in ("HH", "EH1", "L", "OW", "P"):
        one.say("/phoneme", "s", label)
    assert [label for label, _, _ in shown(one)] == ["h", "ɛ", "l", "oʊ", "p"]
    for label in ("p", "{", "t", "@"):
        one.say("/phoneme", "s", label, peer="x")
    assert [label for label, _, _ in shown(one)][5:] == ["p", "æ", "t", "ə"]
    one.say("/phoneme", "s", "x-sampa:S")
    assert shown(one)[-1][0] == "ʃ"
    one.send(schema.Hello("face", 1, "x-sampa"))
    one.say("/phoneme", "s", "T")
    assert shown(one)[-1][0] == "θ"


VISEMES = [
    ("s", "PP", "p"),
    ("i", 1, "p"),
    ("f", 1.0, "p"),
    ("s", "az:21", "p"),
    ("s", "rh:A", "p"),
    ("h", 10, "ɑː"),
]


@pytest.mark.parametrize(("tag", "value", "label"), VISEMES)
def test_visemes_by_name_and_number(tag, value, label):
    one = Wire()
    one.say("/viseme", tag, value)
    assert shown(one)[0][0] == label


def test_a_viseme_with_weight_and_duration():
    one = Wire()
    one.say("/viseme", "sff", "PP", 1.0, 0.2, at_s=50.0)
    one.say("/viseme", "sff", "aa", 0.05, 0.2)
    assert shown(one) == [("p", 50.04, 50.24 + GRACE_S)]


def test_of_a_stream_of_weights_the_strongest_is_shown_when_it_changes():
    one = Wire()
    names = ("sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou")
    for frame in range(60):
        strong = ("aa", "PP", "sil")[frame // 20]
        for name in names:
            weight = 0.8 if name == strong else 0.15 if name in ("aa", "E") else 0.0
            one.say("/viseme", "sf", name, weight, at_s=50.0 + frame / 60)
        one.tick(one.now_s)
    labels = [label for label, _, _ in shown(one)]
    changes = [label for n, label in enumerate(labels) if n == 0 or label != labels[n - 1]]
    assert changes[-2:] == ["p", SILENCE]
    assert changes[:-2] in (["ɑ"], ["ɑ", "ɛ", "ɑ"])
    assert len(labels) < 16


def test_a_viseme_is_held_as_long_as_its_weight_is_told():
    one = Wire()
    for frame in range(180):
        one.say("/viseme", "sf", "aa", 0.8, at_s=50.0 + frame / 60)
        one.tick(one.now_s)
    assert len(one.faces.commands(Begin)) == 1
    assert shown(one)[-1][2] > 53.0
    assert one.faces.commands(End) == []


def test_a_weight_of_nothing_opens_nothing():
    one = Wire()
    one.say("/viseme", "sf", "aa", 0.0)
    assert one.faces.told == []


@pytest.mark.parametrize(
    ("address", "tags", "values"),
    [
        ("/phoneme", "", ()),
        ("/phoneme", "i", (1,)),
        ("/phoneme", "ss", ("m", "x")),
        ("/phoneme", "sf", ("m", float("nan"))),
        ("/phoneme", "sff", ("m", -1.0, 0.1)),
        ("/phoneme", "sff", ("m", 1e6, 0.1)),
        ("/viseme", "", ()),
        ("/viseme", "T", (True,)),
        ("/viseme", "sf", ("PP", float("inf"))),
        ("/viseme", "b", (b"x",)),
        ("/gaze", "f", (1.0,)),
    ],
)
def test_what_cannot_be_meant_is_counted(address, tags, values):
    one = Wire()
    one.say(address, tags, *values)
    assert one.counts.malformed == 1
    assert one.faces.told == []


def test_surplus_arguments_are_counted():
    one = Wire()
    one.say("/phoneme", "sffis", "m", 0.0, 0.1, 3, "x")
    assert one.counts.surplus == 2
    assert len(one.faces.commands(Append)) == 1


def test_gestures_without_a_session_are_of_the_simple_one():
    one = Wire()
    one.say("/expr", "sf", "joy", 0.5)
    one.say("/gaze", "ff", 10.0, 5.0)
    one.say("/blink")
    one.say("/head", "fff", 1.0, 2.0, 3.0)
    one.say("/param", "sf", "jaw", 1.2)
    assert [type(command) for command in one.faces.commands(session="face")] == [
        Express,
        Look,
        Blink,
        TurnHead,
        SetParameter,
    ]


def test_when_the_session_is_closed_by_others_the_next_phone_begins_anew():
    one = Wire()
    one.say("/phoneme", "s", "m", at_s=50.0)
    one.faces.close("face", 50.1)
    one.tick(50.2)
    one.say("/phoneme", "s", "m", at_s=50.3)
    assert one.faces.commands(Begin) == [Begin(0, "at", 50.04), Begin(1, "at", pytest.approx(50.34))]
    ticked(one, 52.0)
    one.faces.close("face", 52.0)
    one.tick(52.1)
    one.send(schema.BeginUtterance("face", 8), schema.BeginUtterance("face", 9))
    one.say("/phoneme", "s", "m")
    assert [begin.utterance for begin in one.faces.commands(Begin)[2:]] == [2, 3, 4]  # no number twice
