"""Hair: layers of strands (:mod:`.strands`), or cropped hair as a cap on the scalp."""

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.faces import hairline, normal, position
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, resampled, strand_uv
from fapengine.mesh.default_head.strands import build_strands
from fapengine.mesh.default_head.style import HeadStyle, palette_of
from fapengine.mesh.face_mesh import Material

CAP_ROWS = (0.0, 0.03, 0.06, 0.10, 0.155, 0.22, 0.32, 0.42, 0.525, 0.63, 0.72, 0.82, 0.89, 0.95)
CAP_FROM_MM, CAP_TOP_MM = 3.5, 144.0
"""Height of the edge of the cap above the hairline, where the skin has the hair's colour, and of its crown."""
CAP_MM, SUNK_MM = 2.6, 0.6
"""Thickness of cropped hair, and depth of its edge in the skin."""
CAP_LIGHT = 1.25
"""Light on cropped hair, which makes up for the dark between painted strands."""


def build_hair(builder: MeshBuilder, style: HeadStyle, detail: float) -> Indices:
    """Add hair; returns its indices, (N,), and last that of its top."""
    build = _build_cap if style.haircut == "cropped" else build_strands
    return build(builder, style, palette_of(style), detail)


def _strips(columns: int) -> Array:
    """(C,): place across the painted strands of each column, to and fro in uneven steps."""
    place, places = 0.5, []
    for number in range(columns):
        places.append(place)
        wild = float(golden(number))
        back = place > 0.62 or (place > 0.38 and wild > 0.5)
        place += (0.22 + 0.14 * wild) * (-1 if back else 1)
    return np.array(places)


def _build_cap(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    angle = np.linspace(-np.pi, np.pi, 2 * round(22 * detail) + 1)[:-1]
    share = resampled(CAP_ROWS, detail)
    line = hairline(angle) + CAP_FROM_MM
    y = line + share[:, None] * (CAP_TOP_MM - line)
    base, out = position(angle, y, style), normal(angle, y, style)
    depth = (y - line)[..., None]
    points = base + (CAP_MM * smoothstep(depth / 24.0) - SUNK_MM * smoothstep((6.0 - depth) / 6.0)) * out
    # Skin shows between the hairs, most where they begin.
    bare = 0.06 + 0.52 * smoothstep((19.0 - depth) / 19.0)
    albedo = CAP_LIGHT * palette.hair + bare * (palette.skin(base) - palette.hair)
    # To and fro in either direction, so that painted strands are short.
    uv = strand_uv(_strips(len(angle)), np.where(np.arange(len(share)) % 2, 0.4, 0.6)[:, None])
    grid = builder.add(points, albedo=albedo, material=Material.HAIR, uv=uv)
    builder.quads(grid, closed=True)
    top = points[-1].mean(axis=0)
    crown = builder.add(top, albedo=albedo[-1].mean(axis=0), material=Material.HAIR, uv=strand_uv(0.5, 0.5))
    builder.fan(grid[-1], int(crown))
    return np.append(grid.ravel(), crown)
