"""Materials of a glTF file: base colours, textures packed into one image, and parts too translucent to draw.

Each texture, cropped or repeated as its use requires, becomes a tile with a gutter; tiles are placed on shelves. If
they do not fit, the largest are halved until they do. Alpha becomes 255 where the material is opaque, and 0 or 255
where it is masked.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError
from fapengine.files.gltf.document import Budget, Gltf, Item, fetch_uri
from fapengine.files.pictures import Picture, opened, shrink

MAX_TEXTURE_PX = 4096
"""Longest side of the packed texture, pixels."""
GUTTER_PX = 4
MAX_IMAGE_PX = 2048
"""Longest side of an image in the packed texture, pixels."""
MAX_PIXELS_IN_ALL = 1 << 29
"""Pixels of all images and tiles that are kept."""
FORMATS = ("PNG", "JPEG", "WEBP")
"""Formats that glTF allows. Pillow starts a program for some others, such as EPS."""
BASIS = "KHR_texture_basisu"
"""Extension for textures of Basis Universal, in KTX2 files."""
MAX_REPEATS = 4
BLANK_PX = 8
"""Side of the white tile of parts without a texture."""
CLAMP_TO_EDGE = 33071
"""Value of ``wrapS`` and ``wrapT`` (glTF 2.0, 5.26): texture coordinates end at the edge."""
MIN_OPACITY = 0.5
"""Largest opacity of a blended material below which it is left out."""
UV_SLACK = 1e-4
"""Distance of texture coordinates outside of a tile that counts as rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Colour of a part, from its material."""

    name: str = ""
    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear RGB."""
    image: int | None = None
    channel: int = 0
    """Index of the texture coordinates that it uses."""
    matrix: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3): transform of texture coordinates (KHR_texture_transform)."""
    clamped: tuple[bool, bool] = (False, False)
    mode: str = "OPAQUE"
    alpha: float = 1.0
    cutoff: float = 0.5
    hidden: bool = False
    """Whether it is too translucent to draw."""

    def place(self, uv: Array) -> Array:
        """(V, 2): coordinates in the image, 0 to 1 where it does not repeat."""
        moved = uv @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        for axis, clamped in enumerate(self.clamped):
            if clamped:
                moved[:, axis] = np.clip(moved[:, axis], 0.0, 1.0)
        return moved


class Atlas:
    """Images of the materials in use, packed into one at the end. Stateful."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf = gltf
        self._images: dict[int, Picture] = {}
        self._pixels = Budget("pixels of images", MAX_PIXELS_IN_ALL)
        self.notes: list[str] = []

    def material(self, primitive: Item) -> Look:
        """Return the look of a primitive.

        Raises
        ------
        DataError
            If it refers to something missing, or an image cannot be read.
        """
        if "material" not in primitive:
            return Look()
        item = self._gltf.row(primitive, "material", "materials")
        surface = item.item("pbrMetallicRoughness")
        factor, key = surface.numbers("baseColorFactor", [1.0] * 4), "baseColorTexture"
        old = item.item("extensions").item("KHR_materials_pbrSpecularGlossiness")
        if "diffuseTexture" in old or "diffuseFactor" in old:
            surface, factor, key = old, old.numbers("diffuseFactor", [1.0] * 4), "diffuseTexture"
        mode = item.string("alphaMode", "OPAQUE")
        look = Look(
            name=item.string("name", ""), factor=(factor[0], factor[1], factor[2]), mode=mode, alpha=factor[3],
            cutoff=item.number("alphaCutoff", 0.5), hidden=mode == "BLEND" and factor[3] < MIN_OPACITY,
        )  # fmt: skip
        return self._textured(look, surface.item(key)) if key in surface else look

    def _textured(self, look: Look, info: Item) -> Look:
        texture = self._gltf.row(info, "index", "textures")
        webp = texture.item("extensions").item("EXT_texture_webp")
        if "source" not in texture and "source" not in webp:
            self.notes.append(f"material {look.name!r}: its texture is {_unread(texture)}; its colour is kept")
            return look
        image = self._gltf.index(webp if "source" in webp else texture, "source", "images")
        if image not in self._images:
            self._images[image] = self._decode(self._gltf.rows["images"][image])
        sampler = self._gltf.row(texture, "sampler", "samplers") if "sampler" in texture else Item({}, "")
        change = info.item("extensions").item("KHR_texture_transform")
        channel = info.index("texCoord", 8, 0)
        opaque = float(self._images[image][..., 3].max(initial=0)) / 255.0 * look.alpha
        return replace(
            look, image=image, channel=change.index("texCoord", 8, channel), matrix=_transform(change),
            clamped=(sampler.number("wrapS", 0) == CLAMP_TO_EDGE, sampler.number("wrapT", 0) == CLAMP_TO_EDGE),
            hidden=look.mode == "BLEND" and opaque < MIN_OPACITY,
        )  # fmt: skip

    def _decode(self, item: Item) -> Picture:
        if "bufferView" in item:
            data = self._gltf.view(item)
        else:
            data = fetch_uri(item.string("uri"), self._gltf.fetch, item.where)
        with opened(data, FORMATS, item.where) as image:
            factor = math.ceil(max(image.size) / MAX_IMAGE_PX)
            self._pixels.take(math.ceil(image.width / factor) * math.ceil(image.height / factor), item.where)
            return shrink(np.asarray(image.convert("RGBA"), np.uint8), factor)

    def build(self, looks: list[Look], coordinates: list[Array]) -> tuple[Picture | None, Array | None]:
        """Pack the images of all parts: texture (H, W, 4), coordinates in it (V, 2); None without any image."""
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
        """Repetitions of the image in each direction, and coordinates from the corner of the first one."""
        if look.image is None or not len(uv):
            return (1, 1), np.full_like(uv, 0.5)
        first = np.floor(uv.min(axis=0) + UV_SLACK)
        count = np.ceil(uv.max(axis=0) - first - UV_SLACK).clip(1)
        if (count > MAX_REPEATS).any():
            self.notes.append(
                f"material {look.name!r}: its texture repeats {count.max():.0f} times, {MAX_REPEATS} are kept"
            )
            count = count.clip(1, MAX_REPEATS)
        return (int(count[0]), int(count[1])), np.clip(uv - first, 0.0, count)

    def _tile(self, look: Look, repeats: tuple[int, int]) -> Picture:
        if look.image is None:
            return np.full((BLANK_PX, BLANK_PX, 4), 255, np.uint8)
        image = self._images[look.image]
        if max(image.shape[:2]) * max(repeats) > MAX_TEXTURE_PX:
            factor = math.ceil(max(image.shape[:2]) * max(repeats) / MAX_TEXTURE_PX)
            image = shrink(image, factor)
        self._pixels.take(image.shape[0] * image.shape[1] * repeats[0] * repeats[1], f"material {look.name!r}")
        tile = np.tile(image, (repeats[1], repeats[0], 1))
        alpha = np.clip(tile[..., 3] * look.alpha, 0.0, 255.0)
        if look.mode == "MASK":
            tile[..., 3] = np.where(alpha >= 255.0 * look.cutoff, 255, 0)
        else:
            tile[..., 3] = np.round(alpha) if look.mode == "BLEND" else 255
        return tile


def _unread(texture: Item) -> str:
    """Say why a texture is not read, and how to convert it."""
    if BASIS in texture.item("extensions"):
        return (
            f"KTX2 ({BASIS}), which is not read (npx @gltf-transform/cli ktxdecompress IN.glb OUT.glb makes PNG of it)"
        )
    return f"of a kind that is not read ({', '.join(texture.item('extensions')) or 'it names no image'})"


def _transform(item: Item) -> Array:
    """(3, 3): translation, rotation and scale of KHR_texture_transform, multiplied."""
    angle = item.number("rotation", 0.0)
    across, down = item.numbers("scale", [1.0, 1.0])
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    matrix[:2, :2] = [[across * cosine, down * sine], [-across * sine, down * cosine]]
    matrix[:2, 2] = item.numbers("offset", [0.0, 0.0])
    return matrix


def pack_tiles(tiles: list[Picture]) -> tuple[Picture, list[tuple[int, int, int, int]]]:
    """Place tiles (H, W, 4) on shelves; the largest are halved until all fit.

    Returns
    -------
    (H, W, 4) uint8
        Sides are powers of two, at most :data:`MAX_TEXTURE_PX`.
    list of (x, y, width, height)
        Place of each tile, px, without its gutter.

    Raises
    ------
    DataError
        If not even one pixel of each fits.
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
    """Places (x, y, width, height) of tiles on shelves of one width, px, tallest first, and the total height."""
    places: list[tuple[int, int, int, int]] = [(0, 0, 0, 0)] * len(tiles)
    x = y = shelf = 0
    for index in sorted(range(len(tiles)), key=lambda index: (-tiles[index].shape[0], index)):
        tall, wide = tiles[index].shape[:2]
        if x + wide + 2 * GUTTER_PX > width:
            x, y, shelf = 0, y + shelf, 0
        places[index] = (x + GUTTER_PX, y + GUTTER_PX, wide, tall)
        x, shelf = x + wide + 2 * GUTTER_PX, max(shelf, tall + 2 * GUTTER_PX)
    return places, y + shelf
