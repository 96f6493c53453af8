"""Textures: scaled down, and packed into one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError

if TYPE_CHECKING:
    from PIL import Image
else:
    Image = Late("PIL.Image", "pillow", "pictures")


Picture = NDArray[np.uint8]


def shrink(image: Picture, factor: int) -> Picture:
    """(H / factor, W / factor, C) uint8: an image made smaller by a whole factor, each pixel the mean of its own."""
    if factor == 1:
        return image
    height, width = (max(1, side // factor) for side in image.shape[:2])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX), np.uint8)


MAX_TEXTURE_PX = 4096
"""Pixels of the packed texture, each way."""
GUTTER_PX = 4


def pack_tiles(tiles: list[Picture]) -> tuple[Picture, list[tuple[int, int, int, int]]]:
    """Lay tiles (H, W, 4) on shelves, the largest halved until all fit.

    Returns
    -------
    (H, W, 4) uint8
        Sides are powers of two, at most :data:`MAX_TEXTURE_PX`.
    list of (x, y, width, height)
        Place of each, px, without its gutter.

    Raises
    ------
    DataError
        If they are so many that not even a pixel of each fits.
    """
    sizes = list(tiles)
    while True:
        width = _power(max(max(tile.shape[1] for tile in sizes) + 2 * GUTTER_PX, math.isqrt(sum(map(_area, sizes)))))
        places, height = _shelves(sizes, width)
        if width <= MAX_TEXTURE_PX and height <= MAX_TEXTURE_PX:
            break
        largest = max(map(_area, sizes))
        if largest == (1 + 2 * GUTTER_PX) ** 2:
            raise DataError(f"textures: got {len(tiles)}, expected what fits into {MAX_TEXTURE_PX} pixels each way")
        sizes = [shrink(tile, 2) if _area(tile) == largest else tile for tile in sizes]
    packed = np.zeros((_power(height), width, 4), np.uint8)
    for tile, (x, y, _, _) in zip(sizes, places, strict=True):
        framed = np.pad(tile, ((GUTTER_PX, GUTTER_PX), (GUTTER_PX, GUTTER_PX), (0, 0)), mode="edge")
        packed[y - GUTTER_PX : y - GUTTER_PX + framed.shape[0], x - GUTTER_PX : x - GUTTER_PX + framed.shape[1]] = (
            framed
        )
    return packed, places


def _area(tile: Picture) -> int:
    return int((tile.shape[0] + 2 * GUTTER_PX) * (tile.shape[1] + 2 * GUTTER_PX))


def _power(size: int) -> int:
    return int(1 << max(size - 1, 1).bit_length())


def _shelves(tiles: list[Picture], width: int) -> tuple[list[tuple[int, int, int, int]], int]:
    """Places (x, y, width, height) of tiles on shelves of one width, px, tallest first, and the height of all."""
    places: list[tuple[int, int, int, int]] = [(0, 0, 0, 0)] * len(tiles)
    x = y = shelf = 0
    for index in sorted(range(len(tiles)), key=lambda index: (-tiles[index].shape[0], index)):
        tall, wide = tiles[index].shape[:2]
        if x + wide + 2 * GUTTER_PX > width:
            x, y, shelf = 0, y + shelf, 0
        places[index] = (x + GUTTER_PX, y + GUTTER_PX, wide, tall)
        x, shelf = x + wide + 2 * GUTTER_PX, max(shelf, tall + 2 * GUTTER_PX)
    return places, y + shelf
