"""A picture of timed phones: words above, phones below, seconds at the foot; long speech goes on in the next row."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fapengine._late import Late
from fapengine.files.pictures import FAINT, INK, MARGIN, PAPER, Picture, drawable, font
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone, PhoneTrack

if TYPE_CHECKING:
    from PIL import Image, ImageDraw
else:
    Image = Late("PIL.Image", "pillow", "pictures")
    ImageDraw = Late("PIL.ImageDraw", "pillow", "pictures")


WIDTH, PX_PER_S, MAX_ROWS = 1400, 340.0, 40
WORD_HEIGHT, PHONE_HEIGHT, AXIS_HEIGHT, ROW_GAP = 26, 62, 24, 14
SILENT, WORD, UNKNOWN = (236, 235, 230), (224, 228, 234), (240, 204, 92)
LIPS, VOWEL, ROUND, OTHER = (214, 98, 82), (240, 178, 122), (226, 146, 160), (142, 178, 204)
LEGEND = ((LIPS, "lips close or meet the teeth"), (ROUND, "rounded"), (VOWEL, "vowel"), (OTHER, "other"))


def colour(phone: Phone) -> tuple[int, int, int]:
    """Colour by what is seen: lips that touch, rounded lips, other vowels, the rest."""
    if phone.is_silence:
        return SILENT
    sounds = [ipa.SOUNDS[letter] for letter in ipa.letters(phone.label)]
    if not sounds:
        return UNKNOWN
    if max(sound.lips for sound in sounds) >= 0.5:
        return LIPS
    if max(sound.rounding for sound in sounds) >= 0.9:
        return ROUND
    return VOWEL if sounds[0].vowel else OTHER


def draw_timeline(track: PhoneTrack, *, title: str = "") -> Picture:
    """Draw a track as (height, 1400, 3) uint8; what exceeds 40 rows is left out and said."""
    inner = WIDTH - 2 * MARGIN
    scale = max(PX_PER_S, min(inner / track.duration_s, 4 * PX_PER_S)) if track.duration_s else PX_PER_S
    row_s = inner / scale
    wanted = max(1, int(np.ceil(track.duration_s / row_s - 1e-9)))
    rows = min(wanted, MAX_ROWS)
    row_height = WORD_HEIGHT + PHONE_HEIGHT + AXIS_HEIGHT + ROW_GAP
    sheet = Image.new("RGB", (WIDTH, MARGIN + 40 + rows * row_height + MARGIN), PAPER)
    pen = ImageDraw.Draw(sheet)
    cut = f" (the first {rows * row_s:.0f} s of {track.duration_s:.0f} s)" if rows < wanted else ""
    pen.text((MARGIN, MARGIN - 4), title + cut, INK, font=font(22))
    _legend(pen, track)
    for row in range(rows):
        _row(pen, track, row * row_s, row_s, scale, MARGIN + 40 + row * row_height)
    return np.asarray(sheet)


def _legend(pen: ImageDraw.ImageDraw, track: PhoneTrack) -> None:
    x = WIDTH - MARGIN
    for fill, label in () if track.spelled else reversed(LEGEND):
        x -= round(pen.textlength(label, font=font(13)))
        pen.text((x, MARGIN + 4), label, FAINT, font=font(13))
        pen.rounded_rectangle((x - 20, MARGIN + 4, x - 6, MARGIN + 18), 4, fill=fill)
        x -= 38


def _row(pen: ImageDraw.ImageDraw, track: PhoneTrack, start_s: float, row_s: float, scale: float, top: int) -> None:
    def x(time_s: float) -> float:
        return MARGIN + (min(max(time_s, start_s), start_s + row_s) - start_s) * scale

    phones = [phone for phone in track.phones if phone.end_s > start_s and phone.start_s < start_s + row_s]
    for begin_s, end_s, word in () if track.spelled else _words(phones):
        _box(pen, x(begin_s), x(end_s), top, WORD_HEIGHT - 3, WORD, word, 15)
    for phone in phones:
        label = (
            ""
            if phone.is_silence
            else {1: "ˈ", 2: "ˌ"}.get(phone.stress, "") + (phone.label if track.spelled else drawable(phone.label))
        )
        fill = WORD if track.spelled and not phone.is_silence else colour(phone)
        _box(pen, x(phone.start_s), x(phone.end_s), top + WORD_HEIGHT, PHONE_HEIGHT, fill, label, 22)
    foot = top + WORD_HEIGHT + PHONE_HEIGHT
    step_s = 0.1 if scale >= PX_PER_S else 0.2
    last_s = min(start_s + row_s, max(track.duration_s, 0.0))
    for tick in range(int(np.ceil(start_s / step_s - 1e-6)), int(np.floor(last_s / step_s + 1e-6)) + 1):
        whole = tick % 5 == 0
        pen.line((x(tick * step_s), foot + 2, x(tick * step_s), foot + (8 if whole else 5)), fill=FAINT)
        if whole:
            anchor = (
                "ra" if x(tick * step_s) > WIDTH - MARGIN - 24 else "ma" if tick * step_s > start_s + 0.05 else "la"
            )
            pen.text((x(tick * step_s), foot + 8), f"{tick * step_s:.1f} s", FAINT, font=font(12), anchor=anchor)


def _words(phones: list[Phone]) -> list[tuple[float, float, str]]:
    """Join neighbours of one word; a word said twice in a row is parted by nothing and so drawn once."""
    joined: list[tuple[float, float, str]] = []
    for phone in phones:
        if joined and joined[-1][2] == phone.word and joined[-1][1] == phone.start_s:
            joined[-1] = (joined[-1][0], phone.end_s, phone.word)
        else:
            joined.append((phone.start_s, phone.end_s, phone.word))
    return [each for each in joined if each[2]]


def _box(
    pen: ImageDraw.ImageDraw, left: float, right: float, top: int, height: int, fill: tuple[int, int, int], label: str,
    size: int,
) -> None:  # fmt: skip
    """Draw a rounded box with its label, smaller where it would not fit; too narrow ones stay empty."""
    right = max(right - 2, left + 1)
    radius = min(6, (right - left) / 2)
    pen.rounded_rectangle((left, top, right, top + height - 1), radius, fill=fill)
    while size >= 9 and pen.textlength(label, font=font(size)) > right - left - 1:
        size -= 1
    if label and size >= 9:
        pen.text(((left + right) / 2, top + height / 2), label, INK, font=font(size), anchor="mm")
