"""TOML into dataclasses: what fits is taken, and what does not is named by file, key, value and expectation."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typing_extensions import TypeAliasType

from fapengine._strict_toml import Between, Checked, check_value, parse_toml, quoted
from fapengine.errors import DataError, ProfileError, UsageError


@dataclass(frozen=True, slots=True)
class Lamp(Checked):
    watts: Annotated[float, Between(0.0, 100.0)]
    name: str = ""
    colour: Literal["warm", "cold"] = "warm"


@dataclass(frozen=True, slots=True)
class Span:
    start_s: float = 0.0
    end_s: float = 1.0

    def __post_init__(self) -> None:
        if self.end_s < self.start_s:
            raise UsageError("span: got an end before its start")
        if self.start_s < 0:
            raise UsageError(f"start_s: got {self.start_s}, expected 0 or more")


@dataclass(frozen=True, slots=True)
class Room:
    schema: int = 1
    lamps: tuple[Lamp, ...] = ()
    span: Span | None = None
    lengths: dict[str, float] = field(default_factory=dict)
    corner: tuple[float, float] = (0.0, 0.0)
    shapes: dict[str, str | dict[str, float]] = field(default_factory=dict)
    is_lit: bool = False


def test_everything_arrives() -> None:
    room = parse_toml(
        b"""
        is_lit = true
        corner = [1, 2.5]
        [[lamps]]
        watts = 40
        [[lamps]]
        watts = 1.5
        name = "desk"
        colour = "cold"
        [span]
        end_s = 2
        [lengths]
        a = 3
        [shapes]
        smile = "mouthSmile"
        blink = { 19 = 1024 }
        """,
        Room,
        "room.toml",
    )
    assert room.lamps == (Lamp(40.0), Lamp(1.5, "desk", "cold"))
    assert room.span == Span(0.0, 2.0)
    assert (room.lengths, room.corner, room.is_lit) == ({"a": 3.0}, (1.0, 2.5), True)
    assert room.shapes == {"smile": "mouthSmile", "blink": {"19": 1024.0}}
    assert parse_toml(b"", Room, "room.toml") == Room()


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        ("x", "room.toml", "is not TOML"),
        ("doors = 1", "room.toml, doors", "key 'doors' is unknown"),
        ("[[lamps]]\nwatts = 1\n[[lamps]]", "room.toml, lamps[1].watts", "key 'watts' is missing"),
        ("[[lamps]]\nwatts = 1\nsocket = 2", "room.toml, lamps[0].socket", "key 'socket' is unknown"),
        ("[[lamps]]\nwatts = 101", "room.toml, lamps[0].watts", "got 101, expected a number, 0 to 100"),
        ("[[lamps]]\nwatts = nan", "room.toml, lamps[0].watts", "got nan, expected a number, 0 to 100"),
        ("[[lamps]]\nwatts = true", "room.toml, lamps[0].watts", "got True, expected a number, 0 to 100"),
        ("[[lamps]]\nwatts = 1\nname = 1", "room.toml, lamps[0].name", "got 1, expected a string"),
        ("[[lamps]]\nwatts = 1\ncolour = 'red'", "room.toml, lamps[0].colour", "got 'red', expected one of warm, cold"),
        ("lamps = 3", "room.toml, lamps", "got 3, expected a list"),
        ("lamps = [3]", "room.toml, lamps[0]", "got 3, expected a table"),
        ("span = 3", "room.toml, span", "got 3, expected a table"),
        ("span = { start_s = -1 }", "room.toml, span.start_s", "got -1.0, expected 0 or more"),
        ("span = { end_s = -1 }", "room.toml, span", "span: got an end before its start"),
        ("lengths = { a = 'long' }", "room.toml, lengths.a", "got 'long', expected a number"),
        (f"lengths = {{ a = {10**400} }}", "room.toml, lengths.a", "expected a number"),
        ("corner = [1]", "room.toml, corner", "got [1], expected a list of 2"),
        ("corner = [1, nan]", "room.toml, corner[1]", "got nan, expected a number"),
        ("shapes = { a = 3 }", "room.toml, shapes.a", "got 3, expected a string or a table"),
        ("is_lit = 1", "room.toml, is_lit", "got 1, expected true or false"),
        ("schema = 2\ndoors = 1", "room.toml, schema", "schema: got 2, expected 1"),
        ("schema = true", "room.toml, schema", "got True, expected a whole number"),
    ],
)
def test_what_does_not_fit_is_named(text: str, where: str, message: str) -> None:
    with pytest.raises(ProfileError) as caught:
        parse_toml(text.encode(), Room, "room.toml", ProfileError, schema=1)
    assert caught.value.where == where
    assert message in str(caught.value)


def test_an_alias_allows_what_its_type_allows() -> None:
    """NumPy 2.5 declares ArrayLike and NDArray so, on Python 3.12 and later: every array was refused."""
    item = TypeVar("item", bound=np.generic)
    arrays = TypeAliasType("arrays", np.ndarray[Any, np.dtype[item]], type_params=(item,))
    check_value("values", np.zeros(2), arrays[np.float64])
    check_value("values", np.zeros(2), TypeAliasType("inner", arrays[np.float64]) | None)
    with pytest.raises(UsageError, match=r"^values: got 'no', expected an array or a whole number$"):
        check_value("values", "no", TypeAliasType("either", arrays[np.float64] | int))


@pytest.mark.parametrize(
    ("value", "kind", "message"),
    [
        ((1.0, np.nan), tuple[float, ...], r"at\[1\]: got nan, expected a number"),
        ([[1.0, 2.0], [3.0, "x"]], Sequence[tuple[float, float]], r"at\[1\]\[1\]: got 'x', expected a number"),
        ([[1.0]], Sequence[tuple[float, float]], r"at\[0\]: got \[1\.0\], expected a list of 2"),
        (np.zeros((300, 2)), float, r"at: got an array of shape \(300, 2\), expected a number"),
        (np.float64(np.nan), float, r"at: got .*nan.*, expected a number"),
    ],
)
def test_items_of_lists_and_arrays_are_named(value: object, kind: object, message: str) -> None:
    with pytest.raises(UsageError, match=f"^{message}$"):
        check_value("at", value, kind)


def test_a_checked_value_cannot_be_wrong_in_python_either() -> None:
    with pytest.raises(UsageError, match=r"^watts: got -1\.0, expected a number, 0 to 100$"):
        Lamp(-1.0)
    with pytest.raises(UsageError, match=r"^name: got None, expected a string$"):
        Lamp(1.0, None)  # type: ignore[arg-type]


@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_bytes_are_a_value_or_a_data_error(data: bytes) -> None:
    with suppress(DataError):
        assert isinstance(parse_toml(data, Room, "room.toml"), Room)


@given(st.text(st.characters(exclude_categories=("Cs",)), max_size=20))
def test_a_quoted_string_reads_back(text: str) -> None:
    room = parse_toml(f"[lengths]\n[shapes]\na = {quoted(text)}".encode(), Room, "room.toml")
    assert room.shapes == {"a": text}
