"""Pictures: PNG files, and contact sheets of labelled frames."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import read_bytes, replacing
from fapengine.speech import ipa

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont
else:
    Image = Late("PIL.Image", "pillow", "pictures")
    ImageDraw = Late("PIL.ImageDraw", "pillow", "pictures")
    ImageFont = Late("PIL.ImageFont", "pillow", "pictures")
font_source_sans_pro = Late("font_source_sans_pro", "font-source-sans-pro", "labels of pictures")


Picture = NDArray[np.uint8]

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "PPM")
"""Formats that are read; others would call programs, or load what they name."""
MAX_PIXELS = 50_000_000
"""Size of a picture that is read; a small file may unpack to any."""
TILE = 192
"""Side of a frame on a contact sheet, in pixels."""
LABEL_HEIGHT, GAP, MARGIN = 34, 8, 16
PAPER, INK, FAINT = (250, 249, 246), (32, 34, 38), (120, 124, 132)


def straight(picture: Picture) -> Picture:
    """Undo what alpha did to the colours of a (height, width, 4) picture, as files want it; of 3 components, nothing.

    Renderers hand colours over multiplied with alpha; where alpha is 0 they are black.
    """
    if picture.shape[2] == 3:
        return picture
    alpha = picture[..., 3:].astype(np.float32)
    colours = np.minimum(picture[..., :3] * (255 / np.maximum(alpha, 1)), 255) * (alpha > 0)
    return np.concatenate([np.round(colours).astype(np.uint8), picture[..., 3:]], axis=2)


def save_png(path: Path, picture: Picture) -> None:
    """Write (height, width, 3 or 4) uint8, sRGB, colours not multiplied with alpha.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    with replacing(path) as new:
        Image.fromarray(picture).save(new, format="PNG")


def load_picture(path: Path) -> Picture:
    """Read a picture as (height, width, 3) uint8, sRGB.

    Raises
    ------
    DataError
        If it is no picture, damaged, or larger than :data:`MAX_PIXELS`.
    UsageError
        If it is not there.
    """
    data = read_bytes(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # ours is the lower limit
            with Image.open(io.BytesIO(data), formats=FORMATS) as image:
                width, height = image.size
                if width * height > MAX_PIXELS:
                    raise DataError(f"{path}: got {width}x{height} pixels, expected at most {MAX_PIXELS:,} in all")
                return np.asarray(image.convert("RGB"))
    except DataError:
        raise
    except Exception as error:
        raise DataError(f"{path}: cannot be read as a picture ({_in_a_line(error)})") from error


def _in_a_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def contact_sheet(frames: Sequence[Picture], labels: Sequence[tuple[str, str]], *, title: str = "") -> Picture:
    """Put frames side by side, each over its label and a fainter note.

    Parameters
    ----------
    frames : sequence of (height, width, 3 or 4) uint8
        At least one; each fitted into a square. With alpha (colours not multiplied with it) they lie on the paper.
    labels : sequence of (str, str)
        Label and note of each frame; IPA is fine.
    title : str
        Above all.

    Raises
    ------
    UsageError
        If there is no frame, or not one label a frame.
    """
    if not frames or len(frames) != len(labels):
        raise UsageError(
            f"contact sheet: got {len(frames)} frames and {len(labels)} labels, expected as many, 1 or more"
        )
    columns = min(len(frames), max(4, round((len(frames) * 1.6) ** 0.5)))
    rows = -(-len(frames) // columns)
    top = MARGIN + (40 if title else 0)
    sheet_width = 2 * MARGIN + columns * (TILE + GAP) - GAP
    sheet = Image.new("RGB", (sheet_width, top + rows * (TILE + LABEL_HEIGHT + GAP) + MARGIN - GAP), PAPER)
    pen = ImageDraw.Draw(sheet)
    if title:
        pen.text((MARGIN, MARGIN), title, INK, font=font(22))
    for index, (frame, (label, note)) in enumerate(zip(frames, labels, strict=True)):
        x = MARGIN + index % columns * (TILE + GAP)
        y = top + index // columns * (TILE + LABEL_HEIGHT + GAP)
        scale = TILE / max(frame.shape[:2])
        width, height = max(1, round(frame.shape[1] * scale)), max(1, round(frame.shape[0] * scale))
        small = Image.fromarray(frame).resize((width, height), Image.Resampling.LANCZOS)
        mask = small if small.mode == "RGBA" else None
        sheet.paste(small, (x + (TILE - width) // 2, y + (TILE - height) // 2), mask)
        pen.text((x + 2, y + TILE + 3), drawable(label), INK, font=font(21))
        pen.text((x + TILE - 2, y + TILE + 10), note, FAINT, font=font(13), anchor="ra")
    return np.asarray(sheet)


CHART = (960, 300)
BAR_INK, MARKED_INK, GRID_INK = (86, 128, 176), (200, 84, 60), (222, 222, 218)


def bar_chart(values: Sequence[float], *, title: str, marked: Sequence[bool], first: str, last: str) -> Picture:
    """Draw one bar a value from 0 up, marked ones in another colour, with the labels of the first and last below.

    Raises
    ------
    UsageError
        If there is no value, or not one mark a value.
    """
    if not values or len(values) != len(marked):
        raise UsageError(f"bar chart: got {len(values)} values and {len(marked)} marks, expected one each")
    chart = Image.new("RGB", CHART, PAPER)
    pen = ImageDraw.Draw(chart)
    left, right, top, bottom = 64, CHART[0] - 24, 48, CHART[1] - 34
    highest = max(*values, 1e-9)
    pen.text((MARGIN, 10), title, INK, font=font(19))
    for share in (0.0, 0.5, 1.0):
        y = bottom - share * (bottom - top)
        pen.line((left, y, right, y), fill=GRID_INK)
        pen.text((left - 8, y), f"{share * highest:.0f}", FAINT, font=font(13), anchor="rm")
    width = (right - left) / len(values)
    for index, (value, is_marked) in enumerate(zip(values, marked, strict=True)):
        x = left + index * width
        box = (x, bottom - value / highest * (bottom - top), max(x + width * 0.85, x + 1), bottom)
        pen.rectangle(box, fill=MARKED_INK if is_marked else BAR_INK)
    pen.text((left, bottom + 6), first, FAINT, font=font(13))
    pen.text((right, bottom + 6), last, FAINT, font=font(13), anchor="ra")
    return np.asarray(chart)


def under_each_other(pictures: Sequence[Picture]) -> Picture:
    """Join pictures of one width, the first on top."""
    return np.concatenate(pictures, axis=0)


@cache
def drawable(label: str) -> str:
    """Spell an IPA label with letters that the font has: one that it lacks becomes the likest that it has.

    Examples
    --------
    >>> drawable("tʃ"), drawable("ɫ"), drawable("ᵻ")
    ('tʃ', 'l', 'ɪ')
    """
    letters = font(21)
    missing = bytes(letters.getmask("\uffff"))

    def known(letter: str) -> bool:
        return bytes(letters.getmask(letter)) != missing

    def instead(letter: str) -> str:
        heard = ipa.letters(letter)
        fallbacks = tuple(filter(known, ipa.SOUNDS))
        likes = [sound if known(sound) else ipa.nearest(sound, fallbacks) for sound in heard]
        return "".join(likes) or "?"

    return "".join(letter if known(letter) else instead(letter) for letter in label)


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """Source Sans Pro (SIL Open Font Licence), which has IPA; Pillow's own font has not."""
    return ImageFont.truetype(font_source_sans_pro.SourceSansProSemibold, size)
