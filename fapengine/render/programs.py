"""Shader programs: their files, the header for the context, and the names that Python and GLSL share.

A server that only hands the sources to a browser needs no OpenGL, so this module has none.
"""

from collections.abc import Sequence
from typing import NamedTuple

from fapengine._resources import shader_source

CORE_HEADER = "#version 330 core\n"
ES_HEADER = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"

MAX_CHANNELS = 128
"""Size of ``u_channels``: 32 vectors of four."""

FACE_ATTRIBUTES = {
    "a_position": "3f4",
    "a_normal": "3f4",
    "a_albedo": "3f4",
    "a_surface": "3f4",
    "a_uv": "2f4",
    "a_occlusion": "1f4",
    "a_fold": "1f4",
    "a_bones": "3f4",
    "a_entries": "2f4",
}
"""Per-vertex attributes of ``face.vert`` in buffer order, with moderngl's format."""

MAX_FINE_EDGE_PX = 12.0
"""Median triangle edge, in pixels, up to which light is computed at vertices where that is cheaper;
docs/how-to/render.md shows the difference.
"""
SKIN_LEVEL_BIAS = 0.3
"""Added to log2 of texels per pixel before it is rounded down to the texture level: slightly finer than exact."""

PAINTED, CUT_OUT, STRAND = "PAINTED", "CUT_OUT", "STRAND"
LIT_AT_VERTICES, PICTURE, CHROMA = "LIT_AT_VERTICES", "PICTURE", "CHROMA"
"""Macros that a program may be compiled with. For ``face``: tinted by a texture (then ``u_skin`` is a uniform too),
with holes where the texture's alpha is below one half; single hairs with partial coverage; light computed at
vertices, not at pixels. For ``backdrop``: an image (``u_picture``) instead of a wall. For ``planes``: Cb and Cr instead
of luma.
"""

STAGES = {
    "face": (("lights.glsl", "face.vert"), ("lights.glsl", "face.frag")),
    "eye": (("face.vert",), ("lights.glsl", "eye.frag")),
    "wire": (("face.vert",), ("wire.frag",)),
    "backdrop": (("backdrop.vert",), ("backdrop.frag",)),
    "edges": (("backdrop.vert",), ("neighbours.glsl", "edges.frag")),
    "smooth": (("backdrop.vert",), ("neighbours.glsl", "smooth.frag")),
    "enlarge": (("backdrop.vert",), ("enlarge.frag",)),
    "planes": (("backdrop.vert",), ("planes.frag",)),
}
"""Program to the files of its vertex and its fragment stage, concatenated in this order after the header."""
VARIANTS: dict[str, tuple[tuple[str, ...], ...]] = {
    "face": tuple(
        (*kind, *light)
        for kind in ((), (PAINTED,), (PAINTED, CUT_OUT), (STRAND,))
        for light in ((), (LIT_AT_VERTICES,))
    ),
    "backdrop": ((), (PICTURE,)),
    "planes": ((), (CHROMA,)),
}
"""All sets of macros that a program is compiled with; only the empty one for the others."""


class Part(NamedTuple):
    """One kind of a mesh's triangles, and how it is drawn."""

    program: str
    definitions: tuple[str, ...] = ()
    may_be_lit_at_vertices: bool = False
    may_be_painted: bool = False
    covers_in_part: bool = False
    """Whether it is drawn last, blended over the background."""


PARTS = {
    "face": Part("face", may_be_lit_at_vertices=True, may_be_painted=True),
    "cutout": Part("face", (CUT_OUT,), may_be_lit_at_vertices=True, may_be_painted=True),
    "eyeball": Part("face", may_be_painted=True),
    "eye": Part("eye"),
    "strand": Part("face", (STRAND,), may_be_lit_at_vertices=True, covers_in_part=True),
}
"""Parts of a packed mesh. Paintable ones are compiled with ``PAINTED`` too if the mesh has a texture."""


def stage_source(files: Sequence[str], header: str = CORE_HEADER, defined: Sequence[str] = ()) -> str:
    """Source of one stage, with each of ``defined`` as a ``#define``."""
    definitions = "".join(f"#define {name}\n" for name in defined)
    return header + definitions + "\n".join(shader_source(name) for name in files)
