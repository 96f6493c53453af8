"""Images: PNG files, contact sheets of labelled frames, bar charts, and timelines of phones."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, UnsupportedError, UsageError
from fapengine.files.paths import read_bytes, replacing
from fapengine.files.provenance import PNG_KEY, SYNTHETIC, sign, xmp
from fapengine.speech import ipa
from fapengine.speech.marks import words_of
from fapengine.speech.phone_track import Phone, PhoneTrack

if TYPE_CHECKING:
    import PIL
    from PIL import Image, ImageDraw, ImageFont
else:
    PIL = Late("PIL", "pillow", "pictures")
    Image = Late("PIL.Image", "pillow", "pictures")
    ImageDraw = Late("PIL.ImageDraw", "pillow", "pictures")
    ImageFont = Late("PIL.ImageFont", "pillow", "pictures")
font_source_sans_pro = Late("font_source_sans_pro", "font-source-sans-pro", "labels of pictures")


Picture = NDArray[np.uint8]

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "PPM")
"""Formats that are read; others would call programs, or load files that they name."""
MAX_PIXELS = 8192 * 8192
"""Largest image that is read; a small file may unpack to any size."""
MAX_PIXELS_WEBP = 1 << 24
"""The same of WebP, which takes 16 bytes a pixel to unpack: four copies. Larger ones are scaled down in any case."""
MAX_FILE = 1 << 28
"""Largest file of an image, bytes."""
PNG_MARK = ("Software", "fapengine")
"""Key and text that name the software in a PNG file."""
PNG_LEVEL = 4
"""Of zlib, 0 to 9: in less than half of the default's time, for a tenth more bytes."""
MAX_SIDE = 4096
"""Longer side of an image after reading; larger ones are scaled down."""
TILE = 192
"""Side of a frame on a contact sheet, in pixels."""
LABEL_HEIGHT, GAP, MARGIN = 34, 8, 16
PAPER, INK, FAINT = (250, 249, 246), (32, 34, 38), (120, 124, 132)


def straight(picture: Picture) -> Picture:
    """Undo premultiplied alpha in a (height, width, 4) image, as files need it; images with 3 components are unchanged.

    Renderers return premultiplied colours; where alpha is 0 they are black.
    """
    if picture.shape[2] == 3:
        return picture
    alpha = picture[..., 3:].astype(np.float32)
    colours = np.minimum(picture[..., :3] * (255 / np.maximum(alpha, 1)), 255) * (alpha > 0)
    return np.concatenate([np.round(colours).astype(np.uint8), picture[..., 3:]], axis=2)


def save_png(path: Path, picture: Picture, *, source: str | None = SYNTHETIC) -> None:
    """Write (height, width, 3 or 4) uint8, sRGB, with straight alpha; the file names fapengine as its software.

    It also states its ``source``, a term of :mod:`fapengine.files.provenance`; None for diagrams.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    image = Image.fromarray(picture)
    from PIL.PngImagePlugin import PngInfo

    metadata = PngInfo()
    metadata.add_text(*PNG_MARK)
    if source and (packet := xmp(source)):
        metadata.add_itxt(PNG_KEY, packet.decode())
    with replacing(path) as new:
        image.save(new, format="PNG", pnginfo=metadata, compress_level=PNG_LEVEL)
        if source:
            sign(new, ".png", source)


def format_png(picture: Picture, compress_level: int = -1) -> bytes:
    """Return (height, width, 3 or 4) uint8, sRGB, as a PNG file; ``compress_level`` is zlib's."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", compress_level=compress_level)
    return buffer.getvalue()


def load_picture(path: Path) -> Picture:
    """Read an image as (height, width, 3) uint8, sRGB, scaled down to a longer side of :data:`MAX_SIDE` or less.

    Raises
    ------
    DataError
        If it is not an image, damaged, or larger than :data:`MAX_PIXELS` or :data:`MAX_PIXELS_WEBP`.
    UsageError
        If it does not exist.
    """
    with opened(read_bytes(path, MAX_FILE), FORMATS, str(path)) as image:
        image.draft("RGB", (MAX_SIDE, MAX_SIDE))
        image.thumbnail((MAX_SIDE, MAX_SIDE))
        return np.asarray(image.convert("RGB"))


@contextmanager
def opened(data: bytes, formats: tuple[str, ...], where: str) -> Iterator[Image.Image]:
    """Open an image that is not too large to be unpacked.

    Raises
    ------
    UnsupportedError
        If it has more pixels than :data:`MAX_PIXELS`, or than :data:`MAX_PIXELS_WEBP` as WebP.
    DataError
        If it cannot be read, also inside the block.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked here
            with Image.open(io.BytesIO(data), formats=formats) as image:
                most, name = (MAX_PIXELS_WEBP, " of WebP") if image.format == "WEBP" else (MAX_PIXELS, "")
                if image.width * image.height > most:
                    got = f"{image.width}x{image.height} pixels{name}"
                    raise UnsupportedError(f"image: got {got}, expected at most {most}", where=where)
                yield image
    except DataError:
        raise
    except PIL.UnidentifiedImageError as error:
        raise DataError(f"image: got no {' or '.join(formats)}", where=where) from error
    except Exception as error:  # whatever the library fails with, the file is at fault
        text = " ".join(str(error).split())[:200]
        raise DataError(f"image: cannot be read ({type(error).__name__}: {text})", where=where) from error


def shrink(image: Picture, factor: int) -> Picture:
    """Scale an image, (H, W, C), down by a whole factor; each pixel becomes the mean of those that it replaces."""
    if factor == 1:
        return image
    height, width = (max(1, side // factor) for side in image.shape[:2])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX), np.uint8)


def contact_sheet(frames: Sequence[Picture], labels: Sequence[tuple[str, str]], *, title: str = "") -> Picture:
    """Arrange frames in rows, each above its label and a fainter note.

    Parameters
    ----------
    frames : sequence of (height, width, 3 or 4) uint8
        At least one; each fitted into a tile that is square or, for frames side by side, wider. With (straight) alpha
        they are placed on the paper.
    labels : sequence of (str, str)
        Label and note of each frame; may contain IPA.
    title : str
        Above all frames.

    Raises
    ------
    UsageError
        If there is no frame, or not one label per frame.
    """
    if not frames or len(frames) != len(labels):
        raise UsageError(
            f"contact sheet: got {len(frames)} frames and {len(labels)} labels, expected as many, 1 or more"
        )
    tile = round(TILE * min(8.0, max(1.0, *(frame.shape[1] / frame.shape[0] for frame in frames))))
    columns = min(len(frames), max(round(4 * TILE / tile), round((len(frames) * 1.6 * TILE / tile) ** 0.5), 1))
    rows = -(-len(frames) // columns)
    top = MARGIN + (40 if title else 0)
    sheet_width = 2 * MARGIN + columns * (tile + GAP) - GAP
    sheet = Image.new("RGB", (sheet_width, top + rows * (TILE + LABEL_HEIGHT + GAP) + MARGIN - GAP), PAPER)
    pen = ImageDraw.Draw(sheet)
    if title:
        pen.text((MARGIN, MARGIN), title, INK, font=font(22))
    for index, (frame, (label, note)) in enumerate(zip(frames, labels, strict=True)):
        x = MARGIN + index % columns * (tile + GAP)
        y = top + index // columns * (TILE + LABEL_HEIGHT + GAP)
        scale = min(tile / frame.shape[1], TILE / frame.shape[0])
        width, height = max(1, round(frame.shape[1] * scale)), max(1, round(frame.shape[0] * scale))
        small = Image.fromarray(frame).resize((width, height), Image.Resampling.LANCZOS)
        mask = small if small.mode == "RGBA" else None
        sheet.paste(small, (x + (tile - width) // 2, y + (TILE - height) // 2), mask)
        pen.text((x + 2, y + TILE + 3), drawable(label), INK, font=font(21))
        pen.text((x + tile - 2, y + TILE + 10), note, FAINT, font=font(13), anchor="ra")
    return np.asarray(sheet)


CHART = (960, 300)
BAR_INK, MARKED_INK, GRID_INK = (86, 128, 176), (200, 84, 60), (222, 222, 218)


def bar_chart(values: Sequence[float], *, title: str, marked: Sequence[bool], first: str, last: str) -> Picture:
    """Draw one bar per value from 0 up, (H, W, 3), marked ones in another colour, with labels below the first and last.

    Raises
    ------
    UsageError
        If there is no value, or not one mark per value.
    """
    if not values or len(values) != len(marked):
        raise UsageError(f"bar chart: got {len(values)} values and {len(marked)} marks, expected one each")
    chart = Image.new("RGB", CHART, PAPER)
    pen = ImageDraw.Draw(chart)
    left, right, top, bottom = 64, CHART[0] - 24, 48, CHART[1] - 34
    highest = max(*values, 1e-9)
    pen.text((MARGIN, 10), title, INK, font=font(19))
    for fraction in (0.0, 0.5, 1.0):
        y = bottom - fraction * (bottom - top)
        pen.line((left, y, right, y), fill=GRID_INK)
        pen.text((left - 8, y), f"{fraction * highest:.0f}", FAINT, font=font(13), anchor="rm")
    width = (right - left) / len(values)
    for index, (value, is_marked) in enumerate(zip(values, marked, strict=True)):
        x = left + index * width
        box = (x, bottom - value / highest * (bottom - top), max(x + width * 0.85, x + 1), bottom)
        pen.rectangle(box, fill=MARKED_INK if is_marked else BAR_INK)
    pen.text((left, bottom + 6), first, FAINT, font=font(13))
    pen.text((right, bottom + 6), last, FAINT, font=font(13), anchor="ra")
    return np.asarray(chart)


@cache
def drawable(label: str) -> str:
    """Write an IPA label with symbols of the font; each missing symbol is replaced by the most similar phone.

    Examples
    --------
    >>> drawable("tʃ"), drawable("ɫ"), drawable("ᵻ")
    ('tʃ', 'l', 'ɪ')
    """
    glyphs = font(21)
    missing = bytes(glyphs.getmask("\uffff"))

    def is_known(symbol: str) -> bool:
        return bytes(glyphs.getmask(symbol)) != missing

    def drawn(symbol: str) -> str:
        if is_known(symbol):
            return symbol
        known = tuple(filter(is_known, ipa.SOUNDS))
        return "".join(phone if phone in known else ipa.nearest(phone, known) for phone in ipa.letters(symbol)) or "?"

    return "".join(map(drawn, label))


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """Source Sans Pro (SIL Open Font Licence), which has IPA; Pillow's own font does not."""
    return ImageFont.truetype(font_source_sans_pro.SourceSansProSemibold, size)


WIDTH, PX_PER_S, MAX_ROWS = 1400, 340.0, 40
WORD_HEIGHT, PHONE_HEIGHT, AXIS_HEIGHT, ROW_GAP = 26, 62, 24, 14
SILENT, WORD, UNKNOWN = (236, 235, 230), (224, 228, 234), (240, 204, 92)
LIPS, VOWEL, ROUND, OTHER = (214, 98, 82), (240, 178, 122), (226, 146, 160), (142, 178, 204)
LEGEND = ((LIPS, "lips close or meet the teeth"), (ROUND, "rounded"), (VOWEL, "vowel"), (OTHER, "other"))


def colour(phone: Phone, *, spelled: bool = False) -> tuple[int, int, int]:
    """Colour by visible articulation: lips that touch, rounded lips, other vowels, the rest."""
    if phone.is_silence:
        return SILENT
    if spelled:
        return WORD
    symbols = [ipa.SOUNDS[symbol] for symbol in ipa.letters(phone.label)]
    if not symbols:
        return UNKNOWN
    if max(symbol.lips for symbol in symbols) >= 0.5:
        return LIPS
    if max(symbol.rounding for symbol in symbols) >= 0.9:
        return ROUND
    return VOWEL if symbols[0].vowel else OTHER


def draw_timeline(track: PhoneTrack, *, title: str = "") -> Picture:
    """Draw a track as (height, 1400, 3) uint8: words above, phones below, seconds at the bottom; long speech wraps.

    At most 40 rows are drawn; the title says so if there is more.
    """
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
    for word, begin_s, end_s in () if track.spelled else words_of(phones):
        _box(pen, x(begin_s), x(end_s), top, WORD_HEIGHT - 3, WORD, word, 15)
    for phone in phones:
        label = ""
        if not phone.is_silence:
            label = ipa.STRESS_MARKS[phone.stress] + (phone.label if track.spelled else drawable(phone.label))
        left, right = x(phone.start_s), x(phone.end_s)
        _box(pen, left, right, top + WORD_HEIGHT, PHONE_HEIGHT, colour(phone, spelled=track.spelled), label, 22)
    foot = top + WORD_HEIGHT + PHONE_HEIGHT
    step_s = 0.1 if scale >= PX_PER_S else 0.2
    last_s = min(start_s + row_s, max(track.duration_s, 0.0))
    for tick in range(int(np.ceil(start_s / step_s - 1e-6)), int(np.floor(last_s / step_s + 1e-6)) + 1):
        time_s, at = tick * step_s, x(tick * step_s)
        has_label = tick % 5 == 0
        pen.line((at, foot + 2, at, foot + (8 if has_label else 5)), fill=FAINT)
        if has_label:
            anchor = "ra" if at > WIDTH - MARGIN - 24 else "ma" if time_s > start_s + 0.05 else "la"
            pen.text((at, foot + 8), f"{time_s:.1f} s", FAINT, font=font(12), anchor=anchor)


def _box(
    pen: ImageDraw.ImageDraw, left: float, right: float, top: int, height: int, fill: tuple[int, int, int], label: str,
    size: int,
) -> None:  # fmt: skip
    """Draw a rounded box with its label, in a smaller font if needed; boxes that are too narrow stay empty."""
    right = max(right - 2, left + 1)
    radius = min(6, (right - left) / 2)
    pen.rounded_rectangle((left, top, right, top + height - 1), radius, fill=fill)
    while size >= 9 and pen.textlength(label, font=font(size)) > right - left - 1:
        size -= 1
    if label and size >= 9:
        pen.text(((left + right) / 2, top + height / 2), label, INK, font=font(size), anchor="mm")
