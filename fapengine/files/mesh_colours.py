"""Colours of a mesh as trimesh has read them: a picture and places in it, or a colour for each vertex."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.laboratory.setup import Paint


def find_paint(visual: Any, count: int) -> Paint | None:
    """Find the colours of a mesh of ``count`` vertices; None where the file says nothing about them."""
    texture, uv = _texture(visual, count)
    if texture is not None:
        return Paint(uv=uv, texture=texture)
    albedo = _albedo(visual)
    return None if albedo is None or len(albedo) != count else Paint(albedo=albedo)


def _texture(visual: Any, count: int) -> tuple[NDArray[np.uint8] | None, NDArray[np.float64] | None]:
    """Picture and places in it of a mesh with one material; trimesh counts v from below."""
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is None or uv is None or np.shape(uv) != (count, 2) or not np.isfinite(uv).all():
        return None, None
    return np.asarray(image.convert("RGBA"), np.uint8), np.asarray(uv, np.float64) * [1.0, -1.0] + [0.0, 1.0]


def _albedo(visual: Any) -> NDArray[np.float64] | None:
    """Linear RGB of each vertex; None where the file says nothing about colour."""
    coloured = visual.to_color() if hasattr(visual, "to_color") else visual
    if not getattr(coloured, "defined", False):  # a material whose picture is not there has no colours either
        return None
    srgb = np.asarray(coloured.vertex_colors, np.float64)[:, :3] / 255.0
    if np.ptp(srgb, axis=0).max() == 0.0:
        return None  # one colour for all is a default, not a painting
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
