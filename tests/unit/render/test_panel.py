"""The controls, without a window."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.render.panel import LINE, MARGIN, MAX_LINES, MAX_TEXT, WIDTH, Moved, Panel, Pressed, Said, Slider


def panel(**changes: object) -> Panel:
    made = Panel(
        [Slider("joy", "Joy"), Slider("yaw", "Look", 0.0, -1.0, 1.0)], ("Pause", "Blink", "Stop"), True,
        status=("one", "two"),
    )  # fmt: skip
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def centre(box: tuple[int, int, int, int]) -> tuple[float, float]:
    return (box[0] + box[2]) / 2, (box[1] + box[3]) / 2


def test_sliders_follow_the_pointer_and_stop_at_their_ends() -> None:
    one = panel()
    (_, joy), (_, yaw) = one._slider_boxes()
    assert one.press(WIDTH / 2, centre(joy)[1]) == [Moved("joy", 0.5)]
    assert one.drag(WIDTH) == [Moved("joy", 1.0)]
    assert one.drag(-50) == [Moved("joy", 0.0)]
    one.release()
    assert one.drag(WIDTH / 2) == []
    assert one.press(MARGIN, centre(yaw)[1]) == [Moved("yaw", -1.0)]
    assert [slider.value for slider in one.sliders] == [0.0, -1.0]


def test_a_slider_that_is_held_is_not_moved_by_program() -> None:
    one = panel()
    one.set("joy", 9.0)
    assert one.sliders[0].value == 1.0
    one.press(WIDTH / 2, centre(one._slider_boxes()[0][1])[1])
    one.set("joy", 0.0)
    assert one.sliders[0].value == 0.5
    with pytest.raises(UsageError, match="slider: got 'grin', expected one of joy, yaw"):
        one.set("grin", 1.0)


def test_buttons_lie_apart_and_are_pressed() -> None:
    one = panel()
    boxes = one._button_boxes()
    assert [one.press(*centre(box)) for _, box in boxes] == [[Pressed("Pause")], [Pressed("Blink")], [Pressed("Stop")]]
    every = [box for _, box in (*boxes, *one._slider_boxes())] + [one._text_box()]
    for number, a in enumerate(every):
        assert all(a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1] for b in every[number + 1 :])
    assert one.press(WIDTH / 2, 5) == []


@pytest.mark.parametrize("height", [160, 300, 440, 560, 620, 640])
def test_nothing_lies_under_the_line_of_text(height: int) -> None:
    """In a low window what has no room is left out, from below."""
    sliders = [Slider(name, name) for name in "abcdefghi"]
    one = Panel(sliders, ("1", "2", "3", "4", "Pause", "Stop", "Blink"), has_text=True, height=height)
    text = one._text_box()
    boxes = [*one._slider_boxes(), *one._button_boxes()]
    assert all(box[3] <= text[1] for _, box in boxes)
    assert [thing for thing, _ in boxes] == [*one.sliders, *one.buttons][: len(boxes)]
    assert (len(boxes) == 16) == (height >= 640)
    assert one.press(*centre(text)) == []
    assert one.is_typing
    assert one.picture()[0].shape == (height, WIDTH, 4)
    one.has_text = False
    assert len([*one._slider_boxes(), *one._button_boxes()]) == 16


def test_text_is_typed_only_where_it_is_wanted() -> None:
    one = panel()
    one.type("x")
    assert one.text == ""
    assert one.press(*centre(one._text_box())) == []
    for character in "Hi\n there ":
        one.type(character)
    assert one.text == "Hi there "
    one.erase()
    assert one.enter() == [Said("Hi there")]
    assert one.enter() == []
    for _ in range(MAX_TEXT + 5):
        one.type("a")
    assert len(one.text) == MAX_TEXT
    one.press(5, 5)
    assert not one.is_typing
    mute = panel(has_text=False)
    mute.press(*centre(mute._text_box()))
    assert not mute.is_typing


def test_it_is_drawn_anew_only_when_something_changes() -> None:
    one = panel()
    first, is_new = one.picture()
    assert is_new
    assert first.shape == (512, WIDTH, 4)
    assert (first[..., 3] == 255).all()
    assert not one.picture()[1]
    for change in (
        lambda: one.set("joy", 0.7), lambda: one.type("a"), lambda: setattr(one, "status", ("three",)),
        lambda: setattr(one, "lit", frozenset({"Pause"})), lambda: setattr(one, "height", 600),
    ):  # fmt: skip
        one.is_typing = True
        one.picture()
        before = one.picture()[0]
        change()
        after, is_new = one.picture()
        assert is_new
        assert not np.array_equal(before, after)
    assert one.picture(2.0)[0].shape == (1200, 2 * WIDTH, 4)


def test_a_long_line_of_status_goes_on_below_and_pushes_the_controls_down() -> None:
    short = panel(status=("one", "two"))
    text = "37 fps, 17.5 ms a frame at 35 %, coarser head, and nobody answers at 127.0.0.1:22990"
    long = panel(status=(text, "w" * 60))
    lines = [line for line, _ in long._lines()]
    assert len(lines) == 6
    assert f"{' '.join(lines[:3])}{''.join(lines[3:])}" == f"{text}{'w' * 60}"  # even a word that is wider than a line
    assert [is_first for _, is_first in long._lines()] == [True] * 3 + [False] * 3
    tops = [one._slider_boxes()[0][1][1] for one in (short, long)]
    assert tops[1] == tops[0] + 3 * LINE
    margin = long.picture()[0][:120, WIDTH - MARGIN :, :3]
    assert (margin == margin[0, 0]).all()
    assert len(panel(status=("word " * 500,))._lines()) == MAX_LINES


def test_long_text_shows_its_end() -> None:
    one = panel(is_typing=True, text="a" * 400 + "b")
    left = one.picture()[0]
    one.text = "c" + one.text[1:]
    np.testing.assert_array_equal(one.picture()[0], left)


@pytest.mark.parametrize(("value", "low", "high"), [(2.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_refuses_a_slider_outside_its_range(value: float, low: float, high: float) -> None:
    with pytest.raises(UsageError, match="slider x: got"):
        Slider("x", "X", value, low, high)
