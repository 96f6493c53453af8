"""Images in files: opened if they are not too large, and made smaller."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, UnsupportedError

if TYPE_CHECKING:
    import PIL
    from PIL import Image
else:
    PIL = Late("PIL", "pillow", "pictures")
    Image = Late("PIL.Image", "pillow", "pictures")


Picture = NDArray[np.uint8]

MAX_PIXELS = 8192 * 8192
"""Pixels of one image; more is refused before it is unpacked."""


@contextmanager
def opened(data: bytes, formats: tuple[str, ...], where: str) -> Iterator[Image.Image]:
    """Open an image that is not too large to be unpacked.

    Raises
    ------
    UnsupportedError
        If it has more than :data:`MAX_PIXELS`.
    DataError
        If it cannot be read.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked here
            with Image.open(io.BytesIO(data), formats=formats) as image:
                if image.width * image.height > MAX_PIXELS:
                    raise UnsupportedError(
                        f"image: got {image.width}x{image.height} pixels, expected at most {MAX_PIXELS}", where=where
                    )
                yield image
    except DataError:
        raise
    except PIL.UnidentifiedImageError as error:
        raise DataError(f"image: got no {' or '.join(formats)}", where=where) from error
    except Exception as error:  # whatever the library trips over, the file is at fault
        raise DataError(f"image: cannot be read ({type(error).__name__}: {error})", where=where) from error


def shrink(image: Picture, factor: int) -> Picture:
    """(H / factor, W / factor, C) uint8: an image made smaller by a whole factor, each pixel the mean of its own."""
    if factor == 1:
        return image
    height, width = (max(1, side // factor) for side in image.shape[:2])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX), np.uint8)
