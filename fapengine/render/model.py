"""One head on the GPU: its buffers, and drawing a frame of it into the current target."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Mask
from fapengine._signals import signals_kept
from fapengine.render.context import Programs, moderngl
from fapengine.render.drawing import RenderOptions
from fapengine.render.packing import ATTRIBUTE_SIZES, FrameUniforms, PackedMesh, wire_edges
from fapengine.render.programs import (
    FACE_ATTRIBUTES,
    LIT_AT_VERTICES,
    PAINTED,
    PARTS,
    Part,
)

UNITS = {"u_displacements": 0, "u_normal_deltas": 1, "u_skin": 2}
"""Texture units."""
STILL = "still "
"""Prefix of the names of triangles that no FAP moves."""
WIRE_INK = (0.05, 0.08, 0.12, 0.55)
TRIANGLES, ONE, SRC_ALPHA, ONE_MINUS_SRC_ALPHA = 4, 1, 0x0302, 0x0303  # numbers of OpenGL
OVER: Any = (SRC_ALPHA, ONE_MINUS_SRC_ALPHA, ONE, ONE_MINUS_SRC_ALPHA)
"""Blending of partial coverage; the target keeps premultiplied alpha."""


class Model:
    """A packed mesh on the GPU.

    Stateful.
    """

    def __init__(self, programs: Programs, packed: PackedMesh) -> None:
        self.packed, self._programs, self._context = packed, programs, programs.context
        self._vertices = self._context.buffer(packed.vertices)
        self._indices: dict[str, moderngl.Buffer] = {}
        still = still_vertices(packed)
        for name, triangles in packed.parts.items():
            stays = still[triangles].all(axis=1) & (not PARTS[name].covers_in_part)
            for key, chosen in ((name, ~stays), (STILL + name, stays)):
                if chosen.any():
                    self._indices[key] = self._context.buffer(np.ascontiguousarray(triangles[chosen]))
        self._displacements = self._data_texture(packed.displacements)
        self._normal_deltas = self._data_texture(packed.normal_deltas)
        self._skins: dict[int, moderngl.Texture] = {}
        self._arrays: dict[tuple[str, bool], tuple[list[tuple[str, Any]], moderngl.VertexArray]] = {}

    def release(self) -> None:
        """Free the GPU memory."""
        arrays = [array for _, array in self._arrays.values()]
        textures = [self._displacements, self._normal_deltas, *self._skins.values()]
        resources: list[Any] = [*arrays, self._vertices, *self._indices.values(), *textures]
        for resource in resources:
            resource.release()

    def draw(
        self,
        uniforms: FrameUniforms,
        drawing: RenderOptions,
        *,
        draw_behind: Callable[[], None] | None = None,
        moving: bool = True,
        still: bool = True,
    ) -> None:
        """Draw one frame over the current content; sets depth test, culling and blending.

        ``draw_behind`` fills the area that the head leaves free. It is called before the parts with partial coverage.
        ``moving`` and ``still`` select the parts that FAPs move and those that they do not; the wireframe is in the
        first.
        """
        context, camera, size = self._context, drawing.camera, drawing.drawn_size
        values: dict[str, NDArray[Any]] = {
            "u_channels": uniforms.channels,
            "u_bones": uniforms.bones,
            "u_iris": uniforms.iris,
            "u_iris_albedo": self.packed.iris_albedo,
            "u_lids": uniforms.lids,
            "u_clip_from_world": np.ascontiguousarray(camera.clip_from_world(size[0] / size[1]).T, dtype="f4"),
            "u_eye_position": camera.position_mm.astype("f4"),
        }
        self._displacements.use(UNITS["u_displacements"])
        self._normal_deltas.use(UNITS["u_normal_deltas"])
        if self.packed.skin is not None:
            self._skin(camera.pixels_per_mm(size[1])).use(UNITS["u_skin"])
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        context.front_face = "cw"  # the image is drawn upside down
        context.polygon_offset = (1.0, 1.0) if drawing.wire else (0.0, 0.0)
        at_vertices = self.packed.is_lit_at_vertices(drawing)
        whole = [part for part in self.packed.parts if not PARTS[part].covers_in_part]
        for part in whole:
            for key, is_wanted in ((STILL + part, still), (part, moving)):
                if is_wanted and key in self._indices:
                    self._render(key, at_vertices and PARTS[part].may_be_lit_at_vertices, values)
        if drawing.wire and moving:
            self._draw_wire(values)
        context.disable(moderngl.CULL_FACE)
        if draw_behind is not None:
            draw_behind()
        if not moving:
            return
        context.enable(moderngl.BLEND)
        context.blend_func = OVER
        context.fbo.depth_mask = False
        for part in self.packed.parts.keys() - whole:
            self._render(part, at_vertices and PARTS[part].may_be_lit_at_vertices, values)
        context.fbo.depth_mask = True
        context.disable(moderngl.BLEND)

    def _draw_wire(self, values: dict[str, NDArray[Any]]) -> None:
        context = self._context
        if "wire" not in self._indices:
            self._indices["wire"] = context.buffer(wire_edges(self.packed))
        context.enable(moderngl.BLEND)
        context.blend_func = OVER
        context.depth_func = "<="
        self._render("wire", False, {**values, "u_ink": np.array(WIRE_INK, dtype="f4")}, moderngl.LINES)
        context.depth_func = "<"
        context.disable(moderngl.BLEND)

    def _render(self, part: str, at_vertices: bool, values: dict[str, NDArray[Any]], mode: int = TRIANGLES) -> None:
        if (part, at_vertices) not in self._arrays:
            with signals_kept():
                self._arrays[part, at_vertices] = self._array(part, at_vertices)
        members, array = self._arrays[part, at_vertices]
        for name, member in members:
            member.write(values[name])
        array.render(mode)

    def _array(self, part: str, at_vertices: bool) -> tuple[list[tuple[str, Any]], moderngl.VertexArray]:
        """Bind a part to its program; returns the uniforms that change per frame, and the vertex array."""
        kind = PARTS.get(part.removeprefix(STILL), Part(part))
        painted = kind.may_be_painted and self.packed.skin is not None
        defined = (*(PAINTED,) * painted, *kind.definitions, *(LIT_AT_VERTICES,) * at_vertices)
        program = self._programs.get(kind.program, defined)
        used = [attribute for attribute in FACE_ATTRIBUTES if attribute in program]
        layout = " ".join(
            form if attribute in used else f"{4 * ATTRIBUTE_SIZES[attribute]}x"
            for attribute, form in FACE_ATTRIBUTES.items()
        )
        array = self._context.vertex_array(
            program, [(self._vertices, layout, *used)], index_buffer=self._indices[part], index_element_size=4
        )
        members = []
        for uniform in program:
            if uniform in UNITS:
                program[uniform] = UNITS[uniform]
            elif uniform not in FACE_ATTRIBUTES:
                members.append((uniform, program[uniform]))
        return members, array

    def _data_texture(self, texels: NDArray[np.float32]) -> moderngl.Texture:
        texture = self._context.texture((texels.shape[1], texels.shape[0]), 4, texels, dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def _skin(self, pixels_per_mm: float) -> moderngl.Texture:
        level = self.packed.skin_level(pixels_per_mm)
        if level not in self._skins:
            picture = self.packed.skin_at(level)
            texture = self._context.texture((picture.shape[1], picture.shape[0]), 4, picture)
            texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
            self._skins[level] = texture
        return self._skins[level]


def still_vertices(packed: PackedMesh) -> Mask:
    """(V,): vertices that no entry and no bone moves, the head's included."""
    starts = np.cumsum(list(ATTRIBUTE_SIZES.values()))[:-1]
    columns = dict(zip(ATTRIBUTE_SIZES, np.split(packed.vertices, starts, axis=1), strict=True))
    return (columns["a_bones"][:, 1:] == 0).all(axis=1) & (columns["a_entries"][:, 1] == 0)
