"""Shader programs: their files, the header that suits the context, and the names that Python and GLSL share."""

from typing import TYPE_CHECKING

from fapengine._resources import shader_source

if TYPE_CHECKING:  # a server that only hands the sources to a browser needs no OpenGL
    import moderngl

CORE_HEADER = "#version 330 core\n"
ES_HEADER = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"

MAX_CHANNELS = 128
"""Room in ``u_channels``: 32 vectors of four."""

FACE_ATTRIBUTES = {
    "a_position": "3f4",
    "a_normal": "3f4",
    "a_albedo": "3f4",
    "a_surface": "3f4",
    "a_uv": "2f4",
    "a_occlusion": "1f4",
    "a_bones": "3f4",
    "a_entries": "2f4",
}
"""Per-vertex attributes of ``face.vert`` in buffer order, with moderngl's format."""
MOTION_UNIFORMS = ("u_moves", "u_turns", "u_channels", "u_bones", "u_clip_from_world")
"""Uniforms of ``face.vert``."""
FACE_UNIFORMS = (*MOTION_UNIFORMS, "u_eye_position")
EYE_UNIFORMS = (*FACE_UNIFORMS, "u_iris")
BACKDROP_UNIFORMS = ("u_wall", "u_alpha")
EDGES_UNIFORMS = SMOOTH_UNIFORMS = ("u_picture",)

STAGES = {
    "face": (("face.vert",), ("lights.glsl", "face.frag")),
    "eye": (("face.vert",), ("lights.glsl", "eye.frag")),
    "backdrop": (("backdrop.vert",), ("backdrop.frag",)),
    "edges": (("backdrop.vert",), ("neighbours.glsl", "edges.frag")),
    "smooth": (("backdrop.vert",), ("neighbours.glsl", "smooth.frag")),
}
"""Program to the files of its vertex and its fragment stage, joined in this order behind the header."""


def stage_source(files: tuple[str, ...], header: str = CORE_HEADER) -> str:
    """Text of one stage."""
    return header + "\n".join(shader_source(name) for name in files)


def build_program(context: "moderngl.Context", name: str) -> "moderngl.Program":
    """Compile and link one of :data:`STAGES`."""
    vertex, fragment = (stage_source(files) for files in STAGES[name])
    return context.program(vertex_shader=vertex, fragment_shader=fragment)
