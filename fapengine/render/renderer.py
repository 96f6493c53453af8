"""FAP frames to pictures on the GPU.

Theory of operation
-------------------
The mesh is uploaded once. A frame sends its channel weights and five bone matrices; the vertex shader does the rest.
Pictures are drawn into a texture and their edges softened: one pass copies and marks edges in the depth buffer, the
next runs where the depth test lets it, on edges alone. They are then copied into one of two pixel buffers;
:meth:`FaceRenderer.frames` reads a buffer only after the next frame has been given to the GPU, so neither waits for
the other.
"""

from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any, cast

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import UsageError
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.context import create_context
from fapengine.render.packing import ATTRIBUTE_SIZES, PackedMesh, frame_uniforms, pack
from fapengine.render.programs import FACE_ATTRIBUTES, build_program

Picture = NDArray[np.uint8]

SIZES = (16, 4096)
ALWAYS, IN_FRONT_OF, BEHIND = "1", ">", "<"
"""Depth functions: which depths that are there already let a new pixel pass."""
WALL = (0.30, 0.36, 0.42)


class FaceRenderer:
    """Stateful: one mesh in one picture size. Use it as a context manager; it holds GPU memory.

    Parameters
    ----------
    mesh : FaceMesh
        Whose face.
    size : (int, int)
        Width and height in pixels, 16..4096.
    camera : Camera, optional
        By default from the front.
    transparent : bool
        No wall behind the head; pictures then have an alpha channel, premultiplied.
    samples : int
        0 softens edges by the second pass; 2, 4 or 8 use multisampling instead (finer and slower).
    context : moderngl.Context, optional
        By default a new one.

    Raises
    ------
    UsageError
        If the size is out of range, or the mesh has too many channels.
    ResourceError
        If there is no OpenGL.
    """

    def __init__(
        self,
        mesh: FaceMesh,
        *,
        size: tuple[int, int] = (512, 512),
        camera: Camera | None = None,
        transparent: bool = False,
        samples: int = 0,
        context: moderngl.Context | None = None,
    ) -> None:
        if not all(SIZES[0] <= side <= SIZES[1] for side in size):
            raise UsageError(f"size: got {size[0]}x{size[1]}, expected sides of {SIZES[0]}..{SIZES[1]} pixels")
        packed = pack(mesh)
        self.mesh, self.size = mesh, size
        self.camera = camera or PRESETS["front"]
        self._components = 4 if transparent else 3
        self._owns_context = context is None
        self._context = context or create_context()
        self._resources: list[Any] = []
        self._upload(packed)
        self._make_targets(samples)

    def __enter__(self) -> "FaceRenderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give all GPU memory back."""
        with self._context:
            while self._resources:
                self._resources.pop().release()
        if self._owns_context:
            self._context.release()

    def draw(self, faps: ArrayLike) -> Picture:
        """Draw one frame.

        Parameters
        ----------
        faps : (68,) array_like, FAPU

        Returns
        -------
        (height, width, 3) uint8
            sRGB, top row first; 4 components if transparent.
        """
        return next(self.frames([faps]))

    def paint(self, faps: ArrayLike) -> moderngl.Texture:
        """Draw one frame and leave it on the GPU, for a window that shares the context.

        Returns
        -------
        moderngl.Texture
            sRGB, top row first; the next frame goes into the same one.
        """
        with self._context:
            self._draw(np.asarray(faps, dtype=np.float64))
        return cast(moderngl.Texture, self._output.color_attachments[0])

    def frames(self, faps: Iterable[ArrayLike]) -> Iterator[Picture]:
        """Draw frames in turn; see :meth:`draw`. The picture before is read while the next is drawn."""
        waiting: moderngl.Buffer | None = None
        for number, frame in enumerate(faps):
            target = self._buffers[number % 2]
            with self._context:  # other renderers may have drawn since
                self._draw(np.asarray(frame, dtype=np.float64))
                self._output.read_into(target, components=self._components, alignment=1)
            if waiting is not None:
                yield self._picture(waiting)
            waiting = target
        if waiting is not None:
            yield self._picture(waiting)

    def _picture(self, buffer: moderngl.Buffer) -> Picture:
        width, height = self.size
        with self._context:
            data = buffer.read()
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width, self._components)

    def _upload(self, packed: PackedMesh) -> None:
        context = self._context
        vertices = context.buffer(packed.vertices)
        self._resources.append(vertices)
        self._backdrop = build_program(context, "backdrop")
        self._softening = [build_program(context, name) for name in ("edges", "smooth")]
        self._parts = [self._part(name, vertices, triangles) for name, triangles in packed.parts.items()]
        self._wall = context.vertex_array(self._backdrop, [])
        self._passes = [context.vertex_array(program, []) for program in self._softening]
        self._moves, self._turns = self._texture(packed.moves), self._texture(packed.turns)
        self._resources += [self._backdrop, *self._softening, self._moves, self._turns]

    def _part(
        self, name: str, vertices: moderngl.Buffer, triangles: NDArray[np.uint32]
    ) -> tuple[Any, moderngl.VertexArray]:
        """Triangles that share a program; its uniforms' kinds are known to GLSL alone."""
        program = build_program(self._context, name)
        used = [attribute for attribute in FACE_ATTRIBUTES if attribute in program]
        layout = " ".join(
            form if attribute in used else f"{4 * ATTRIBUTE_SIZES[attribute]}x"
            for attribute, form in FACE_ATTRIBUTES.items()
        )
        indices = self._context.buffer(triangles)
        array = self._context.vertex_array(
            program, [(vertices, layout, *used)], index_buffer=indices, index_element_size=4
        )
        self._resources += [program, indices, array]
        return program, array

    def _texture(self, texels: NDArray[np.float32]) -> moderngl.Texture:
        texture = self._context.texture((texels.shape[1], texels.shape[0]), 4, texels, dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def _make_targets(self, samples: int) -> None:
        context, size = self._context, self.size

        def framebuffer(samples: int) -> moderngl.Framebuffer:
            colour: moderngl.Renderbuffer | moderngl.Texture
            colour = context.renderbuffer(size, 4, samples=samples) if samples else context.texture(size, 4)
            depth = context.depth_renderbuffer(size, samples=samples)
            made = context.framebuffer([colour], depth)
            self._resources += [colour, depth, made]
            return made

        self._output = framebuffer(0)
        self._canvas = framebuffer(samples)
        canvas = self._canvas.color_attachments[0]
        self._unsoftened = canvas if isinstance(canvas, moderngl.Texture) else None
        self._buffers = [context.buffer(reserve=size[0] * size[1] * self._components) for _ in range(2)]
        self._resources += self._buffers

    def _draw(self, faps: NDArray[np.float64]) -> None:
        context, uniforms = self._context, frame_uniforms(self.mesh, faps)
        clip = np.ascontiguousarray(self.camera.clip_from_world(self.size[0] / self.size[1]).T, dtype="f4")
        for program, _ in self._parts:
            program["u_channels"].write(uniforms.channels)
            program["u_bones"].write(uniforms.bones)
            program["u_clip_from_world"].write(clip)
            program["u_eye_position"] = tuple(self.camera.position_mm)
            program["u_moves"], program["u_turns"] = 0, 1
            if "u_iris" in program:
                program["u_iris"].write(uniforms.iris)
        self._moves.use(0)
        self._turns.use(1)

        self._canvas.use()
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        context.front_face = "cw"  # the picture is drawn upside down
        self._canvas.clear(0.0, 0.0, 0.0, 0.0)
        for _, array in self._parts:
            array.render()
        context.disable(moderngl.CULL_FACE)
        if self._components == 3:
            self._backdrop["u_wall"], self._backdrop["u_alpha"] = WALL, 1.0
            self._wall.render(moderngl.TRIANGLES, vertices=3)
        if self._unsoftened is not None:
            self._soften(self._unsoftened)
        else:
            context.copy_framebuffer(self._output, self._canvas)

    def _soften(self, picture: moderngl.Texture) -> None:
        self._output.use()
        picture.use(0)
        for program, array, passes in zip(self._softening, self._passes, (ALWAYS, IN_FRONT_OF), strict=True):
            program["u_picture"] = 0
            self._context.depth_func = passes
            array.render(moderngl.TRIANGLES, vertices=3)
        self._context.depth_func = BEHIND
