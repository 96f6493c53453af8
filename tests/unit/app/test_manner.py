"""How a face speaks, as a person writes it: expressions with their times, generators to leave out."""

import pytest

from fapengine.app.manner import check_expressions, manner_of, moods_of, parse_expression
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.speaking import MannerOptions
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import Mood
from fapengine.trajectory.style import Style

PHONES = PhoneTrack.from_phones([Phone("h", 0.5, 0.6, word="hi"), Phone("aɪ", 0.6, 0.8, word="hi")])


def test_expressions_with_and_without_times() -> None:
    moods = moods_of(["joy", "Fear:0.3@0.5-1.25", "anger:0.2@hi", Mood(Expression.JOY, 0.1)], PHONES)
    assert moods[:2] == [Mood(Expression.JOY), Mood(Expression.FEAR, 0.3, 0.5, 1.25)]
    assert (moods[2].expression, moods[2].strength) == (Expression.ANGER, 0.2)
    assert moods[2].start_s == pytest.approx(0.15)
    assert moods[3] == Mood(Expression.JOY, 0.1)


def test_expressions_by_name() -> None:
    assert moods_of({"joy": 0.4, "Fear": 1.0}, PHONES) == [Mood(Expression.JOY, 0.4), Mood(Expression.FEAR)]
    assert moods_of({Expression.ANGER: 0.2}, PHONES) == [Mood(Expression.ANGER, 0.2)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("happy", "expressions: got 'happy', expected one of joy"),
        ("neutral", "expressions: got 'neutral', expected one of joy"),
        ("joy:much", "got strength 'much'"),
        ("joy@3-1", "expected 0 <= start < stop"),
        ("joy@1.2.3-4", "got '1.2.3-4', expected seconds"),
        ("joy@bye", "got word 'bye'"),
    ],
)
def test_refuses_expressions(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        moods_of([text], PHONES)


@pytest.mark.parametrize("expressions", [["glee"], ["joy:much"], {"glee": 1.0}, {"joy": 3.0}])
def test_refuses_before_the_phones_are_known(expressions: object) -> None:
    check_expressions(["joy:0.4@word", Mood(Expression.JOY)])
    check_expressions({"joy": 0.4})
    with pytest.raises(UsageError, match=r"glee|much|strength 3"):
        check_expressions(expressions)


def test_texts_are_read_without_phones() -> None:
    assert parse_expression("joy:0.4@word") == (Expression.JOY, 0.4, "word")


def options(
    jaw: float = 1.0, lips: float = 1.0, loudness: float = 0.0, method: str = "context", *without: str
) -> Style:
    return manner_of(MannerOptions(jaw=jaw, lips=lips, loudness=loudness, method=method, without=without)).style


def test_options_make_a_style() -> None:
    style = options(0.5, 2.0, 6.0, "paper", "head-motion", "blinks")
    assert style == Style(1.0, 0.5, 2.0, 6.0, "paper", blinks=False, head_motion=False)
    assert options(1.0, 1.0, 0.0, "context", "all") == Style.speech_only()


@pytest.mark.parametrize(
    ("method", "without", "jaw", "message"),
    [
        (
            "magic",
            [],
            1.0,
            "method: unknown value 'magic'; use one of context, paper, published, minimum-jerk, dominance",
        ),
        (
            "paper",
            ["ears"],
            1.0,
            "without: unknown value 'ears'; use one of blinks, head-motion, gaze, idle, emphasis, all",
        ),
        ("paper", [], 7.0, "jaw: got 7.0, expected a number, 0 to 3"),
    ],
)
def test_refuses_manners(method: str, without: list[str], jaw: float, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        options(jaw, 1.0, 0.0, method, *without)
