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
from typing import Any

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import UsageError
from fapengine.mesh.deform import bone_transforms, channel_weights
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.patch import vertex_normals
from fapengine.mpeg4 import fap
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.context import create_context
from fapengine.render.programs import FACE_ATTRIBUTES, MAX_CHANNELS, build_program

Picture = NDArray[np.uint8]

SURFACES: dict[Material, tuple[float, float, float]] = {
    # specular strength, gloss, softness of the terminator
    Material.SKIN: (0.20, 18.0, 0.45),
    Material.LIP: (0.42, 42.0, 0.40),
    Material.EYE: (1.30, 420.0, 0.20),
    Material.TEETH: (0.50, 60.0, 0.30),
    Material.GUM: (0.50, 40.0, 0.40),
    Material.TONGUE: (0.35, 30.0, 0.45),
    Material.HAIR: (0.16, 14.0, 0.15),
    Material.LASH: (0.05, 10.0, 0.10),
    Material.MOUTH: (0.02, 10.0, 0.10),
    Material.CLOTH: (0.03, 6.0, 0.25),
}
EYEBALL_RADIUS_MM = 14.2
PUPIL_SHARE = 0.42
"""Pupil to iris in room light."""
TEXTURE_WIDTH = 1024
PROBE_FAPU = 300.0
"""How far a channel is moved to see how it turns normals."""
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
        If the size is out of range.
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
        if len(mesh.basis.channels) > MAX_CHANNELS:
            raise UsageError(f"mesh: got {len(mesh.basis.channels)} channels, expected at most {MAX_CHANNELS}")
        self.mesh, self.size = mesh, size
        self.camera = camera or PRESETS["front"]
        self._components = 4 if transparent else 3
        self._owns_context = context is None
        self._context = context or create_context()
        self._resources: list[Any] = []
        self._upload(mesh)
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

    def _upload(self, mesh: FaceMesh) -> None:
        context, basis = self._context, mesh.basis
        counts = np.diff(basis.offsets)
        surface = np.array([SURFACES[kind] for kind in Material])[mesh.material]
        columns = {
            "a_position": mesh.vertices_mm,
            "a_normal": mesh.normals,
            "a_albedo": mesh.albedo,
            "a_surface": surface,
            "a_uv": mesh.uv,
            "a_occlusion": mesh.occlusion,
            "a_bones": np.stack([mesh.bone, mesh.bone_weight, mesh.head_weight], axis=-1),
            "a_entries": np.stack([basis.offsets[:-1], counts], axis=-1),
        }
        packed = np.concatenate(
            [np.asarray(columns[name], dtype="f4").reshape(len(counts), -1) for name in FACE_ATTRIBUTES], axis=1
        )
        vertices = context.buffer(np.ascontiguousarray(packed))
        self._resources.append(vertices)
        self._backdrop = build_program(context, "backdrop")
        self._softening = [build_program(context, name) for name in ("edges", "smooth")]
        on_eye = mesh.material[mesh.triangles[:, 0]] == Material.EYE
        self._parts = [
            self._part("face", vertices, mesh.triangles[~on_eye]),
            self._part("eye", vertices, mesh.triangles[on_eye]),
        ]
        self._wall = context.vertex_array(self._backdrop, [])
        self._passes = [context.vertex_array(program, []) for program in self._softening]
        self._moves = self._texture(np.concatenate([basis.entry_mm, basis.entry_channels[:, None]], axis=1))
        self._turns = self._texture(np.pad(normal_turns(mesh), ((0, 0), (0, 1))))
        self._resources += [self._backdrop, *self._softening, self._moves, self._turns]

    def _part(
        self, name: str, vertices: moderngl.Buffer, triangles: NDArray[np.int32]
    ) -> tuple[Any, moderngl.VertexArray]:
        """Triangles that share a program; its uniforms' kinds are known to GLSL alone."""
        program = build_program(self._context, name)
        used = [attribute for attribute in FACE_ATTRIBUTES if attribute in program]
        layout = " ".join(
            form if attribute in used else f"{4 * int(form[0])}x" for attribute, form in FACE_ATTRIBUTES.items()
        )
        indices = self._context.buffer(triangles.astype("i4"))
        array = self._context.vertex_array(
            program, [(vertices, layout, *used)], index_buffer=indices, index_element_size=4
        )
        self._resources += [program, indices, array]
        return program, array

    def _texture(self, entries: NDArray[np.floating]) -> moderngl.Texture:
        rows = max(1, -(-len(entries) // TEXTURE_WIDTH))
        padded = np.zeros((rows * TEXTURE_WIDTH, 4), dtype="f4")
        padded[: len(entries)] = entries
        texture = self._context.texture((TEXTURE_WIDTH, rows), 4, padded.tobytes(), dtype="f4")
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
        context, mesh = self._context, self.mesh
        weights = np.zeros(MAX_CHANNELS, dtype="f4")
        weights[: len(mesh.basis.channels)] = channel_weights(mesh.basis, faps)
        bones = np.ascontiguousarray(bone_transforms(mesh, faps).transpose(0, 2, 1), dtype="f4")
        clip = np.ascontiguousarray(self.camera.clip_from_world(self.size[0] / self.size[1]).T, dtype="f4")
        iris = mesh.fapu.irisd0_mm / 2 / EYEBALL_RADIUS_MM
        dilation = faps[fap.column(29)] + faps[fap.column(30)]
        pupil = iris * float(np.clip(PUPIL_SHARE + dilation / 2 / 1024, 0.15, 0.85))
        for program, _ in self._parts:
            program["u_channels"].write(weights.tobytes())
            program["u_bones"].write(bones.tobytes())
            program["u_clip_from_world"].write(clip.tobytes())
            program["u_eye_position"] = tuple(self.camera.position_mm)
            program["u_moves"], program["u_turns"] = 0, 1
            if "u_iris" in program:
                program["u_iris"] = (iris, pupil)
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


def normal_turns(mesh: FaceMesh) -> NDArray[np.float32]:
    """(N, 3) float32: how each entry of the basis turns its vertex's normal, per FAPU.

    Measured by moving one channel at a time by :data:`PROBE_FAPU`; the shader adds the turns up linearly.
    """
    basis = mesh.basis
    vertex = np.repeat(np.arange(len(mesh.vertices_mm)), np.diff(basis.offsets))
    rest = mesh.vertices_mm.astype(np.float64)
    at_rest = vertex_normals(rest, mesh.triangles)
    turns = np.zeros((len(vertex), 3), dtype=np.float32)
    for channel in range(len(basis.channels)):
        mine = np.flatnonzero(basis.entry_channels == channel)
        moved_vertices = vertex[mine]
        touched = np.isin(mesh.triangles, moved_vertices).any(axis=1)
        if not touched.any():
            continue
        around = mesh.triangles[np.isin(mesh.triangles, mesh.triangles[touched]).any(axis=1)]
        names, local = np.unique(around, return_inverse=True)
        points = rest[names]
        points[np.searchsorted(names, moved_vertices)] += PROBE_FAPU * basis.entry_mm[mine]
        normals = vertex_normals(points, local.reshape(around.shape))
        change = normals[np.searchsorted(names, moved_vertices)] - at_rest[moved_vertices]
        turns[mine] = change / PROBE_FAPU
    return turns
