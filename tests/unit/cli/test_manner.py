"""Options of ``say`` and ``animate`` that say how the face speaks."""

import pytest

from fapengine.cli.talk import manner_of, parse_expressions, parse_wish
from fapengine.errors import UsageError
from fapengine.mpeg4.visemes import Expression
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import Mood
from fapengine.trajectory.style import Style

PHONES = PhoneTrack.of([Phone("h", 0.5, 0.6, word="hi"), Phone("aɪ", 0.6, 0.8, word="hi")])


def test_wishes_with_and_without_times() -> None:
    moods = parse_expressions(["joy", "Fear:0.3@0.5-1.25", "anger:0.2@hi"], PHONES)
    assert moods[:2] == [Mood(Expression.JOY), Mood(Expression.FEAR, 0.3, 0.5, 1.25)]
    assert (moods[2].expression, moods[2].strength) == (Expression.ANGER, 0.2)
    assert moods[2].start_s == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ("happy", "got 'happy', expected one of joy"),
        ("joy:much", "got strength 'much'"),
        ("joy@3-1", "expected 0 <= start < stop"),
        ("joy@1.2.3-4", "got '1.2.3-4', expected seconds"),
        ("joy@bye", "got word 'bye'"),
    ],
)
def test_refuses_wishes(wish: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_expressions([wish], PHONES)


def test_wishes_are_read_without_phones() -> None:
    assert parse_wish("joy:0.4@word") == (Expression.JOY, 0.4, "word")


def test_manner() -> None:
    style = manner_of(1.0, 0.5, 2.0, 6.0, "paper", ["head-motion", "blinks"])
    assert style == Style(1.0, 0.5, 2.0, 6.0, "paper", blinks=False, head_motion=False)
    assert manner_of(1.0, 1.0, 1.0, 0.0, "context", ["all"]) == Style.still()


@pytest.mark.parametrize(
    ("method", "without", "jaw", "message"),
    [
        ("magic", [], 1.0, "--method: got 'magic', expected one of context, paper, minimum-jerk, dominance"),
        ("paper", ["ears"], 1.0, "--without: got 'ears', expected one of blinks, head-motion"),
        ("paper", [], 7.0, "jaw: got 7.0, expected 0..3"),
    ],
)
def test_refuses_manners(method: str, without: list[str], jaw: float, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        manner_of(1.0, jaw, 1.0, 0.0, method, without)
