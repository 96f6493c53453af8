"""The compiled parts of fapengine: here what draws talking heads without OpenGL, in ``codec`` the loops of its codec.

fapengine uses both if they are installed (``fapengine.render.native``, ``fapengine.codec.kernels``). Classes and
functions are for it alone, and may change with each version.
"""

import ctypes
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine_native._library import library

PARTS = ("face", "cutout", "eyeball", "eye", "strand")
"""Kinds of triangles, in the library's order."""
FORMATS = {"rgb": 0, "rgba": 1, "i420": 2}
UNIFORMS = 238
"""Floats of a frame: 128 channels, 5 x 16 bones, 2 iris, 4 lids, 3 albedo of the iris, 16 clip from world, 3 eye, 2
depth; bones and clip column by column. The depth gives w from the depth z in the picture: second / (first - z)."""


def select(name: str = "") -> str:
    """Choose the instructions for faces that are opened later, such as ``"x86-64-v3"``; by default the fastest.

    Every choice draws the same bytes. Returns its name.

    Raises
    ------
    ValueError
        If this processor does not have them.
    """
    chosen = library.fapengine_native_select(name.encode())
    if chosen is None:
        raise ValueError(f"instructions: got {name!r}, which this processor does not have")
    return str(chosen.decode())


def resized(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Scale an image, (H, W, 4), to a width and a height, linearly as OpenGL does."""
    picture = np.ascontiguousarray(picture, np.uint8)
    if picture.ndim != 3 or picture.shape[2] != 4 or min(picture.shape[:2], default=0) < 1 or min(size) < 1:
        raise ValueError(f"picture: got shape {picture.shape} and size {size}, expected (H, W, 4) and pixels")
    made = np.empty((size[1], size[0], 4), np.uint8)
    height, width = picture.shape[:2]
    library.fapengine_native_resize(picture.ctypes.data, width, height, made.ctypes.data, *size)
    return made


class Face:
    """A packed mesh and a picture to draw it into. Stateful; threads wait for each other.

    Parameters
    ----------
    vertices : (V, 21) float32
    displacements, normal_deltas : (R, 1024, 4) float32
    parts : mapping of a name in PARTS to (F, 3) uint32
        As ``fapengine.render.packing.PackedMesh``.

    Raises
    ------
    ValueError
        If an array has the wrong shape, or a number in it indexes nothing; in methods too, also after ``close``.
    MemoryError
        In methods too, if the library gets no memory.
    """

    def __init__(self, vertices: Any, displacements: Any, normal_deltas: Any, parts: Any) -> None:
        self._face: int | None = None
        self._lock = threading.Lock()
        self.size = (0, 0)
        vertices = np.ascontiguousarray(vertices, np.float32)
        entries = [np.ascontiguousarray(each, np.float32) for each in (displacements, normal_deltas)]
        triangles = [np.ascontiguousarray(parts.get(name, np.zeros((0, 3))), np.uint32) for name in PARTS]
        if vertices.ndim != 2 or vertices.shape[1] != 21:
            raise ValueError(f"vertices: got shape {vertices.shape}, expected (V, 21)")
        if entries[0].shape != entries[1].shape or entries[0].shape[-1:] != (4,):
            raise ValueError(
                f"entries: got shapes {entries[0].shape} and {entries[1].shape}, expected (R, 1024, 4) twice"
            )
        if unknown := set(parts) - set(PARTS):
            raise ValueError(f"parts: got {', '.join(sorted(unknown))}, expected of {', '.join(PARTS)}")
        for name, each in zip(PARTS, triangles, strict=True):
            if each.ndim != 2 or each.shape[1] != 3:
                raise ValueError(f"parts: {name}: got shape {each.shape}, expected (F, 3)")
        pointers = (ctypes.c_void_p * len(PARTS))(*(each.ctypes.data for each in triangles))
        counts = (ctypes.c_int * len(PARTS))(*map(len, triangles))
        self._face = library.fapengine_native_open(
            vertices.ctypes.data, len(vertices), *(each.ctypes.data for each in entries[:1]),
            entries[1].ctypes.data, entries[0].size // 4, pointers, counts,
        )  # fmt: skip
        if self._face is None:
            raise ValueError("mesh: a vertex, an entry, a bone or a channel does not exist")

    def canvas(self, size: tuple[int, int], background: NDArray[np.uint8] | None = None) -> None:
        """Begin pictures of a width and a height, 1 to 4096, over (height, width, 4) sRGB; None: transparent."""
        if not all(1 <= side <= 4096 for side in size):
            raise ValueError(f"size: got {size}, expected a width and a height of 1 to 4096")
        if background is not None:
            background = np.ascontiguousarray(background, np.uint8)
            if background.shape != (size[1], size[0], 4):
                raise ValueError(f"background: got shape {background.shape}, expected {(size[1], size[0], 4)}")
        pixels = None if background is None else background.ctypes.data
        with self._lock:
            self.size = (0, 0)  # if there is no memory
            if not library.fapengine_native_canvas(self._opened(), *size, pixels):
                raise MemoryError(f"canvas of {size}")
            self.size = size

    def skin(self, texels: NDArray[np.uint8]) -> None:
        """Paint with a texture, (H, W, 4): sRGB, and the coverage or the light of folds."""
        texels = np.ascontiguousarray(texels, np.uint8)
        if texels.ndim != 3 or texels.shape[2] != 4 or not 1 <= min(texels.shape) <= max(texels.shape) <= 32768:
            raise ValueError(f"skin: got shape {texels.shape}, expected (H, W, 4), of 1 to 32768 texels a side")
        with self._lock:
            height, width = texels.shape[:2]
            if not library.fapengine_native_skin(self._opened(), width, height, texels.ctypes.data):
                raise MemoryError(f"skin of {texels.shape}")

    def draw(
        self, uniforms: NDArray[np.float32], *, at_vertices: bool, soft: bool = True, form: str = "rgb"
    ) -> NDArray[np.uint8]:
        """Draw a frame; see UNIFORMS. Returns (H, W, 3), (H, W, 4), or for I420 the bytes of its planes.

        Releases Python's lock while it draws.
        """
        uniforms = np.ascontiguousarray(uniforms, np.float32)
        if uniforms.shape != (UNIFORMS,):
            raise ValueError(f"uniforms: got shape {uniforms.shape}, expected ({UNIFORMS},)")
        if form not in FORMATS:
            raise ValueError(f"form: got {form!r}, expected one of {', '.join(FORMATS)}")
        with self._lock:
            face, (width, height) = self._opened(), self.size
            if not width:
                raise ValueError("size: got none, expected a canvas first")
            count = width * height + 2 * ((width + 1) // 2) * ((height + 1) // 2)
            made = np.empty(count if form == "i420" else (height, width, FORMATS[form] + 3), np.uint8)
            if not library.fapengine_native_draw(
                face, uniforms.ctypes.data, at_vertices, soft, FORMATS[form], made.ctypes.data
            ):
                raise MemoryError("frame")
        return made

    def _opened(self) -> int:
        if self._face is None:
            raise ValueError("face: it is closed")
        return self._face

    def close(self) -> None:
        """Free the memory; the face cannot be used any more."""
        with self._lock:
            face, self._face = self._face, None
            if face is not None:
                library.fapengine_native_close(face)

    def __del__(self) -> None:
        if getattr(self, "_face", None) is not None:
            self.close()
