"""The controls beside the face: sliders, buttons, a line of text and a few of status, drawn into a picture.

It knows no window: pointer and keys come in as calls, what they mean comes out as values, and :meth:`Panel.picture`
draws it anew only when something has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import UsageError

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont
else:
    Image = Late("PIL.Image", "pillow", "pictures")
    ImageDraw = Late("PIL.ImageDraw", "pillow", "pictures")
    ImageFont = Late("PIL.ImageFont", "pillow", "pictures")
font_source_sans_pro = Late("font_source_sans_pro", "font-source-sans-pro", "labels of pictures")


WIDTH = 260
"""Width of the panel in points; a point is a pixel, or more on a dense display."""
MARGIN, ROW, BAR, BUTTON, TEXT = 16, 37, 4, 30, 34
"""Points: border, height of a slider, of its bar, of a button, and of the text line."""
BUTTONS_A_ROW = 2
LINE, LINES, MAX_LINES, STATUS = 20, 3, 6, 14
"""Points of a line of status, lines that have room (more push the controls down), most lines, and points of
their letters."""
PAPER, INK, FAINT, GROUND, ACCENT = (30, 33, 38), (238, 238, 234), (150, 155, 164), (58, 63, 71), (255, 176, 92)
MAX_TEXT = 500
"""Characters of the text line."""


@dataclass(slots=True)
class Slider:
    """A number that can be pulled."""

    key: str
    label: str
    value: float = 0.0
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high or self.low == self.high:
            raise UsageError(f"slider {self.key}: got {self.value}, expected {self.low}..{self.high}")

    @property
    def share(self) -> float:
        """Value as a share of the range, 0..1."""
        return (self.value - self.low) / (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Moved:
    """A slider was pulled."""

    key: str
    value: float


@dataclass(frozen=True, slots=True)
class Pressed:
    """A button, or a key that stands for it."""

    key: str


@dataclass(frozen=True, slots=True)
class Said:
    """The line of text was sent."""

    text: str


Event = Moved | Pressed | Said
Box = tuple[int, int, int, int]
"""Left, top, right, bottom in points."""


@dataclass(slots=True)
class Panel:
    """Controls and what is typed into them.

    Stateful.

    Parameters
    ----------
    sliders : sequence of Slider
    buttons : sequence of str
        Their names; what is pressed comes back by it.
    has_text : bool
        Whether there is a line to type into.
    """

    sliders: Sequence[Slider] = ()
    buttons: Sequence[str] = ()
    has_text: bool = False
    text: str = ""
    is_typing: bool = False
    lit: frozenset[str] = frozenset()
    """Buttons that are shown as on."""
    status: tuple[str, ...] = ()
    """Lines at the top."""
    height: int = 512
    """Height in points."""
    _held: Slider | None = None
    _drawn: tuple[object, ...] = ()
    _picture: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0, 4), np.uint8))

    # What comes in -------------------------------------------------------------------------------------------------

    def press(self, x: float, y: float) -> list[Event]:
        """Take a press of the pointer, points from the top left corner."""
        self.is_typing = self.has_text and _inside(self._text_box(), x, y)
        for name, box in self._button_boxes():
            if _inside(box, x, y):
                return [Pressed(name)]
        for slider, box in self._slider_boxes():
            if _inside(box, x, y):
                self._held = slider
                return self.drag(x)
        return []

    def drag(self, x: float) -> list[Event]:
        """Pull the slider that is held."""
        if self._held is None:
            return []
        share = min(max((x - MARGIN) / (WIDTH - 2 * MARGIN), 0.0), 1.0)
        self._held.value = self._held.low + share * (self._held.high - self._held.low)
        return [Moved(self._held.key, self._held.value)]

    def release(self) -> None:
        """Let it go."""
        self._held = None

    def type(self, character: str) -> None:
        """Add to the line of text."""
        if self.is_typing and character.isprintable():
            self.text = (self.text + character)[:MAX_TEXT]

    def erase(self) -> None:
        """Take the last character away."""
        self.text = self.text[:-1]

    def enter(self) -> list[Event]:
        """Send the line of text."""
        said, self.text = self.text.strip(), ""
        return [Said(said)] if said else []

    def set(self, key: str, value: float) -> None:
        """Move a slider by program; what is out of its range stops at its ends.

        Raises
        ------
        UsageError
            If there is none of that key.
        """
        for slider in self.sliders:
            if slider.key == key:
                if slider is not self._held:
                    slider.value = min(max(value, slider.low), slider.high)
                return
        raise UsageError(f"slider: got {key!r}, expected one of {', '.join(slider.key for slider in self.sliders)}")

    # Where things are ----------------------------------------------------------------------------------------------

    def _top(self) -> int:
        return MARGIN + LINE * max(len(self._lines()), LINES) + 10

    def _lines(self) -> list[tuple[str, bool]]:
        """Lines of status, as long as there is room across, and whether each is of the first."""
        room = WIDTH - 2 * MARGIN
        lines = [(part, index == 0) for index, text in enumerate(self.status) for part in _broken(text, room)]
        return lines[:MAX_LINES]

    def _has_room(self, bottom: int) -> bool:
        """Whether the line of text leaves it free; in a low window what would lie under it is left out."""
        return not self.has_text or bottom <= self._text_box()[1]

    def _slider_boxes(self) -> list[tuple[Slider, Box]]:
        top = self._top()
        return [
            (slider, (MARGIN - 8, top + ROW * row, WIDTH - MARGIN + 8, top + ROW * (row + 1)))
            for row, slider in enumerate(self.sliders)
            if self._has_room(top + ROW * (row + 1))
        ]

    def _button_boxes(self) -> list[tuple[str, Box]]:
        top = self._top() + ROW * len(self.sliders) + (10 if self.sliders else 0)
        wide = (WIDTH - 2 * MARGIN - 8 * (BUTTONS_A_ROW - 1)) // BUTTONS_A_ROW
        boxes = []
        for row, names in enumerate(_rows(self.buttons)):
            for column, name in enumerate(names):
                left, upper = MARGIN + column * (wide + 8), top + row * (BUTTON + 8)
                if self._has_room(upper + BUTTON):
                    boxes.append((name, (left, upper, left + wide, upper + BUTTON)))
        return boxes

    def _text_box(self) -> Box:
        return (MARGIN, self.height - MARGIN - TEXT, WIDTH - MARGIN, self.height - MARGIN)

    # What goes out -------------------------------------------------------------------------------------------------

    def picture(self, scale: float = 1.0) -> tuple[NDArray[np.uint8], bool]:
        """Draw it, if it has changed.

        Parameters
        ----------
        scale : float
            Pixels a point.

        Returns
        -------
        picture : (height, width, 4) uint8
            sRGB, premultiplied.
        is_new : bool
            Whether it differs from the last one.
        """
        values = tuple(round(slider.share, 3) for slider in self.sliders)
        state = (values, self.text, self.is_typing, self.lit, self.status, self.height, scale)
        if state == self._drawn:
            return self._picture, False
        self._drawn = state
        self._picture = self._draw(scale)
        return self._picture, True

    def _draw(self, scale: float) -> NDArray[np.uint8]:
        size = (round(WIDTH * scale), round(self.height * scale))
        image = Image.new("RGBA", size, (*PAPER, 255))
        pen = _Pen(ImageDraw.Draw(image), scale)
        for line, (text, is_first) in enumerate(self._lines()):
            pen.text((MARGIN, MARGIN + LINE * line), text, 14, INK if is_first else FAINT)
        for slider, (_, top, _, _) in self._slider_boxes():
            self._draw_slider(pen, slider, top)
        for name, box in self._button_boxes():
            is_lit = name in self.lit
            pen.box(box, ACCENT if is_lit else GROUND, 6)
            pen.text(((box[0] + box[2]) / 2, (box[1] + box[3]) / 2), name, 14, PAPER if is_lit else INK, "mm")
        if self.has_text:
            self._draw_text(pen)
        return np.asarray(image)

    def _draw_slider(self, pen: _Pen, slider: Slider, top: int) -> None:
        left, right, bar = MARGIN, WIDTH - MARGIN, top + 25
        pen.text((left, top), slider.label, 14, INK)
        pen.text((right, top), f"{slider.value:.2f}", 14, FAINT, "ra")
        pen.box((left, bar, right, bar + BAR), GROUND, 2)
        zero = min(max(-slider.low / (slider.high - slider.low), 0.0), 1.0)
        at, origin = (left + (right - left) * share for share in (slider.share, zero))
        if abs(at - origin) >= 1:
            pen.box((min(at, origin), bar, max(at, origin), bar + BAR), ACCENT, 2)
        pen.box((at - 6, bar + 2 - 6, at + 6, bar + 2 + 6), INK, 6)

    def _draw_text(self, pen: _Pen) -> None:
        left, top, right, bottom = self._text_box()
        pen.box((left, top, right, bottom), GROUND, 6, ACCENT if self.is_typing else None)
        shown = self.text + "|" if self.is_typing else self.text or "Type what to say, then Enter"
        while len(shown) > 1 and pen.width(shown, 14) > right - left - 20:
            shown = shown[1:]
        pen.text((left + 10, (top + bottom) / 2), shown, 14, INK if self.text or self.is_typing else FAINT, "lm")


@dataclass(frozen=True, slots=True)
class _Pen:
    """Draws in points."""

    to: ImageDraw.ImageDraw
    scale: float

    def text(
        self, at: tuple[float, float], text: str, size: int, colour: tuple[int, int, int], anchor: str = "la"
    ) -> None:
        corner = (at[0] * self.scale, at[1] * self.scale)
        self.to.text(corner, text, fill=colour, font=_font(round(size * self.scale)), anchor=anchor)

    def width(self, text: str, size: int) -> float:
        return self.to.textlength(text, font=_font(round(size * self.scale))) / self.scale

    def box(
        self,
        box: tuple[float, float, float, float],
        colour: tuple[int, int, int],
        radius: float,
        outline: tuple[int, int, int] | None = None,
    ) -> None:
        corners = tuple(round(edge * self.scale) for edge in box)
        self.to.rounded_rectangle(corners, radius * self.scale, fill=colour, outline=outline)


def _rows(names: Sequence[str]) -> list[tuple[str, ...]]:
    return [tuple(names[n : n + BUTTONS_A_ROW]) for n in range(0, len(names), BUTTONS_A_ROW)]


def _broken(text: str, room: float) -> list[str]:
    """Break a text into lines at its blanks; a word that is longer than a line is cut."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".lstrip(" ")
        if _font(STATUS).getlength(longer) <= room or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
        while _font(STATUS).getlength(lines[-1]) > room:
            kept = len(lines[-1])
            while _font(STATUS).getlength(lines[-1][:kept]) > room:
                kept -= 1
            lines[-1:] = [lines[-1][:kept], lines[-1][kept:]]
    return lines


def _inside(box: Box, x: float, y: float) -> bool:
    return box[0] <= x < box[2] and box[1] <= y < box[3]


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """Source Sans, which has the letters of the IPA."""
    return ImageFont.truetype(font_source_sans_pro.SourceSansProSemibold, size)
