"""Materials of a glTF file: base colours, their textures packed into one, and what is too translucent to draw.

Each texture, cut off or repeated as its use asks, becomes a tile with a gutter; tiles lie on shelves. Where they do
not fit, the largest are halved until they do. Alpha is made straight 255 where the material is opaque, 0 or 255 where
it is masked.
"""

import io
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fapengine.errors import DataError, UnsupportedError
from fapengine.files.gltf import Budget, Gltf, fetch_uri
from fapengine.files.gltf_json import Item

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

LARGEST = 4096
"""Pixels of the packed texture, each way."""
LARGEST_IMAGE = 2048
"""And of each image in it."""
MOST_PIXELS = 8192 * 8192
"""Of one image; more is refused before it is unpacked."""
MOST_PIXELS_IN_ALL = 1 << 29
"""Of all images and tiles, as they are kept."""
FORMATS = ("PNG", "JPEG", "WEBP")
"""What glTF allows. Others are not tried: for some, such as EPS, Pillow starts a program."""
GUTTER = 4
MOST_REPEATS = 4
BLANK = 8
"""Side of the white tile of parts without a texture."""
CLAMP = 33071
SEEN = 0.5
"""A blended material nowhere so opaque is left out."""
SLACK = 1e-4
"""How far texture coordinates may stick out of a tile."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a part's material says of its colour."""

    name: str = ""
    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear RGB."""
    image: int | None = None
    channel: int = 0
    """Which texture coordinates it takes."""
    matrix: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3): moves texture coordinates (KHR_texture_transform)."""
    clamped: tuple[bool, bool] = (False, False)
    mode: str = "OPAQUE"
    alpha: float = 1.0
    cutoff: float = 0.5
    hidden: bool = False

    def place(self, uv: Array) -> Array:
        """(V, 2): coordinates in the image, 0..1 where it is not repeated."""
        moved = uv @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        for axis, clamped in enumerate(self.clamped):
            if clamped:
                moved[:, axis] = np.clip(moved[:, axis], 0.0, 1.0)
        placed: Array = moved
        return placed


@contextmanager
def opened(data: bytes, formats: tuple[str, ...], where: str) -> Iterator[Image.Image]:
    """Open an image that is not too large to be unpacked.

    Raises
    ------
    UnsupportedError
        If it has more than :data:`MOST_PIXELS`.
    DataError
        If it cannot be read.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked here
            with Image.open(io.BytesIO(data), formats=formats) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise UnsupportedError(
                        f"image: got {image.width}x{image.height} pixels, expected at most {MOST_PIXELS}", where=where
                    )
                yield image
    except DataError:
        raise
    except Exception as error:  # whatever the library trips over, the file is at fault
        raise DataError(f"image: cannot be read ({type(error).__name__}: {error})", where=where) from error


class Atlas:
    """Stateful: the images that were asked for, then all of them in one."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf = gltf
        self._images: dict[int, Picture] = {}
        self._pixels = Budget("pixels of images", MOST_PIXELS_IN_ALL)
        self.notes: list[str] = []

    def material(self, primitive: Item) -> Look:
        """Look of a primitive.

        Raises
        ------
        DataError
            If it names what is not there, or an image cannot be read.
        """
        materials = self._gltf.rows["materials"]
        if "material" not in primitive:
            return Look()
        item = materials[primitive.index("material", len(materials))]
        name = item.string("name", "")
        surface = item.item("pbrMetallicRoughness")
        factor, key = surface.numbers("baseColorFactor", [1.0] * 4), "baseColorTexture"
        old = item.item("extensions").item("KHR_materials_pbrSpecularGlossiness")
        if "diffuseTexture" in old or "diffuseFactor" in old:
            surface, factor, key = old, old.numbers("diffuseFactor", [1.0] * 4), "diffuseTexture"
        mode = item.string("alphaMode", "OPAQUE")
        look = Look(
            name=name, factor=(factor[0], factor[1], factor[2]), mode=mode, alpha=factor[3],
            cutoff=item.number("alphaCutoff", 0.5), hidden=mode == "BLEND" and factor[3] < SEEN,
        )  # fmt: skip
        return self._textured(look, surface.item(key)) if key in surface else look

    def _textured(self, look: Look, info: Item) -> Look:
        textures, images = self._gltf.rows["textures"], self._gltf.rows["images"]
        texture = textures[info.index("index", len(textures))]
        webp = texture.item("extensions").item("EXT_texture_webp")
        if "source" not in texture and "source" not in webp:
            self.notes.append(f"material {look.name!r}: its texture is of a kind that is not read; its colour is kept")
            return look
        image = (webp if "source" in webp else texture).index("source", len(images))
        if image not in self._images:
            self._images[image] = self._decode(images[image])
        samplers = self._gltf.rows["samplers"]
        sampler = samplers[texture.index("sampler", len(samplers))] if "sampler" in texture else Item({}, "")
        change = info.item("extensions").item("KHR_texture_transform")
        channel = info.index("texCoord", 8, 0)
        opaque = float(self._images[image][..., 3].max(initial=0)) / 255.0 * look.alpha
        return Look(
            name=look.name, factor=look.factor, image=image,
            channel=change.index("texCoord", 8, channel), matrix=_transform(change),
            clamped=(sampler.number("wrapS", 0) == CLAMP, sampler.number("wrapT", 0) == CLAMP),
            mode=look.mode, alpha=look.alpha, cutoff=look.cutoff, hidden=look.mode == "BLEND" and opaque < SEEN,
        )  # fmt: skip

    def _decode(self, item: Item) -> Picture:
        if "bufferView" in item:
            data = self._gltf.view(item.index("bufferView", len(self._gltf.views)))
        else:
            data = fetch_uri(item.string("uri"), self._gltf.fetch, item.where)
        with opened(data, FORMATS, item.where) as image:
            factor = math.ceil(max(image.size) / LARGEST_IMAGE)
            self._pixels.take(math.ceil(image.width / factor) * math.ceil(image.height / factor), item.where)
            return _smaller(np.asarray(image.convert("RGBA"), np.uint8), factor)

    def build(self, looks: list[Look], coordinates: list[Array]) -> tuple[Picture | None, Array | None]:
        """Pack what the parts use: the texture (H, W, 4) and coordinates in it (V, 2); None where no part has one."""
        if all(look.image is None for look in looks):
            return None, None
        tiles: dict[tuple[int | None, int, int, str, float, float], Picture] = {}
        keys, local = [], []
        for look, uv in zip(looks, coordinates, strict=True):
            repeats, moved = self._repeats(look, uv)
            key = (look.image, *repeats, look.mode, look.alpha, look.cutoff)
            if key not in tiles:
                tiles[key] = self._tile(look, repeats)
            keys.append(key)
            local.append(moved / repeats)
        packed, places = pack_tiles(list(tiles.values()))
        at = dict(zip(tiles, places, strict=True))
        size = (packed.shape[1], packed.shape[0])
        spread = [(np.array(at[key][:2]) + uv * at[key][2:]) / size for key, uv in zip(keys, local, strict=True)]
        return packed, np.concatenate(spread)

    def _repeats(self, look: Look, uv: Array) -> tuple[tuple[int, int], Array]:
        """How often the image is seen in each direction, and coordinates from its first corner on."""
        if look.image is None or not len(uv):
            return (1, 1), np.full_like(uv, 0.5)
        first = np.floor(uv.min(axis=0) + SLACK)
        count = np.ceil(uv.max(axis=0) - first - SLACK).clip(1)
        if (count > MOST_REPEATS).any():
            self.notes.append(
                f"material {look.name!r}: its texture repeats {count.max():.0f} times, {MOST_REPEATS} are kept"
            )
            count = count.clip(1, MOST_REPEATS)
        return (int(count[0]), int(count[1])), np.clip(uv - first, 0.0, count)

    def _tile(self, look: Look, repeats: tuple[int, int]) -> Picture:
        if look.image is None:
            return np.full((BLANK, BLANK, 4), 255, np.uint8)
        image = self._images[look.image]
        if max(image.shape[:2]) * max(repeats) > LARGEST:
            factor = math.ceil(max(image.shape[:2]) * max(repeats) / LARGEST)
            image = _smaller(image, factor)
        self._pixels.take(image.shape[0] * image.shape[1] * repeats[0] * repeats[1], f"material {look.name!r}")
        tile = np.tile(image, (repeats[1], repeats[0], 1))
        alpha = np.clip(tile[..., 3] * look.alpha, 0.0, 255.0)
        if look.mode == "MASK":
            tile[..., 3] = np.where(alpha >= 255.0 * look.cutoff, 255, 0)
        else:
            tile[..., 3] = np.round(alpha) if look.mode == "BLEND" else 255
        return tile


def _transform(item: Item) -> Array:
    """Multiply translation, rotation and scale, as KHR_texture_transform does."""
    angle = item.number("rotation", 0.0)
    across, down = item.numbers("scale", [1.0, 1.0])
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    matrix[:2, :2] = [[across * cosine, down * sine], [-across * sine, down * cosine]]
    matrix[:2, 2] = item.numbers("offset", [0.0, 0.0])
    return matrix


def _smaller(image: Picture, factor: int) -> Picture:
    if factor == 1:
        return image
    height, width = (max(1, side // factor) for side in image.shape[:2])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX), np.uint8)


def pack_tiles(tiles: list[Picture]) -> tuple[Picture, list[tuple[int, int, int, int]]]:
    """Lay tiles (H, W, 4) on shelves, the largest halved until all fit.

    Returns
    -------
    (H, W, 4) uint8
        Sides are powers of two, at most :data:`LARGEST`.
    list of (x, y, width, height)
        Where each lies, px, without its gutter.

    Raises
    ------
    DataError
        If they are so many that not even a pixel of each fits.
    """
    sizes = list(tiles)
    while True:
        width = _power(max(max(tile.shape[1] for tile in sizes) + 2 * GUTTER, math.isqrt(sum(map(_area, sizes)))))
        places, height = _shelves(sizes, width)
        if width <= LARGEST and height <= LARGEST:
            break
        largest = max(map(_area, sizes))
        if largest == (1 + 2 * GUTTER) ** 2:
            raise DataError(f"textures: got {len(tiles)}, which do not fit into {LARGEST}x{LARGEST} pixels")
        sizes = [_smaller(tile, 2) if _area(tile) == largest else tile for tile in sizes]
    packed = np.zeros((_power(height), width, 4), np.uint8)
    for tile, (x, y, _, _) in zip(sizes, places, strict=True):
        framed = np.pad(tile, ((GUTTER, GUTTER), (GUTTER, GUTTER), (0, 0)), mode="edge")
        packed[y - GUTTER : y - GUTTER + framed.shape[0], x - GUTTER : x - GUTTER + framed.shape[1]] = framed
    return packed, places


def _area(tile: Picture) -> int:
    return int((tile.shape[0] + 2 * GUTTER) * (tile.shape[1] + 2 * GUTTER))


def _power(size: int) -> int:
    return int(1 << max(size - 1, 1).bit_length())


def _shelves(tiles: list[Picture], width: int) -> tuple[list[tuple[int, int, int, int]], int]:
    places: list[tuple[int, int, int, int]] = [(0, 0, 0, 0)] * len(tiles)
    x = y = shelf = 0
    for number in sorted(range(len(tiles)), key=lambda one: (-tiles[one].shape[0], one)):
        tall, wide = tiles[number].shape[:2]
        if x + wide + 2 * GUTTER > width:
            x, y, shelf = 0, y + shelf, 0
        places[number] = (x + GUTTER, y + GUTTER, wide, tall)
        x, shelf = x + wide + 2 * GUTTER, max(shelf, tall + 2 * GUTTER)
    return places, y + shelf
