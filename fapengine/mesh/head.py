"""The default head: our own model, made by this code from proportions; the same every time.

Head space: +x the subject's left, +y up, +z out of the face, mm.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh import colours, parts
from fapengine.mesh.basis import build_basis
from fapengine.mesh.eyes import build_lids
from fapengine.mesh.face_mesh import Bone, DeformationBasis, FaceMesh, Material
from fapengine.mesh.head_parts import HeadParts
from fapengine.mesh.mouth import build_mouth
from fapengine.mesh.patch import MeshBuilder, bake_occlusion, smooth_over_mesh, vertex_normals
from fapengine.mesh.points import locate
from fapengine.mesh.rings import Block
from fapengine.mesh.surface import HeadShape, position
from fapengine.mpeg4.fapu import Fapu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

JAW_PIVOT = np.array([0.0, 2.0, 18.0])
HEAD_PIVOT = np.array([0.0, -45.0, -5.0])
FRONT_STEP_DEG, FRONT_COLUMNS, ROW_STEP = 1.6, 30, 2.6
ROW_ZERO = -35.0 + 0.4  # a row on the mouth line gives the mouth's corners


def _columns() -> Array:
    front = np.arange(FRONT_COLUMNS + 1) * FRONT_STEP_DEG
    side = front[-1] + (180 - front[-1]) * (np.arange(1, 15) / 14) ** 1.3
    positive = np.deg2rad(np.concatenate([front, side]))
    return np.concatenate([-positive[:0:-1], positive[:-1]])


def _rows() -> Array:
    face = ROW_ZERO + ROW_STEP * np.arange(-22, 38)
    neck = face[0] - np.array([46.0, 36, 27, 19, 12, 6.5, 2.8])
    top = face[-1] + (142.0 - face[-1]) * (np.arange(1, 13) / 12) ** 0.8
    return np.concatenate([neck, face, top])


def _blocks(rows: Array, columns: Array) -> tuple[Block, Block, Block]:
    def row(steps: int) -> int:
        return int(np.abs(rows - (ROW_ZERO + steps * ROW_STEP)).argmin())

    middle = int(np.abs(columns).argmin())
    mouth = Block(bottom=row(-11), top=row(7), corner=row(0), left=middle - 16, right=middle + 16)
    eyes = [
        Block(bottom=row(20), top=row(33), corner=row(26), left=middle + left, right=middle + right)
        for left, right in ((4, 22), (-22, -4))
    ]
    return mouth, eyes[0], eyes[1]


def build_head(shape: HeadShape | None = None) -> FaceMesh:
    """Build the head.

    Parameters
    ----------
    shape : HeadShape, optional
        Proportions; by default an average adult's.

    Returns
    -------
    FaceMesh
        About 11,000 vertices, every FDP feature point, and the deformation basis.
    """
    shape = shape or HeadShape()
    builder = MeshBuilder()
    grid, crown, (mouth_block, *eye_blocks) = _build_skin(builder, shape)

    def border(block: Block) -> Indices:
        rows, columns = block.border()
        return grid[rows, columns]

    mouth = build_mouth(builder, border(mouth_block), mouth_block, shape)
    left, right = (
        build_lids(builder, border(block), block, shape, side)
        for block, side in zip(eye_blocks, (1.0, -1.0), strict=True)
    )
    head = HeadParts(
        grid=grid,
        mouth=mouth,
        eyes=(left, right),
        brows=(parts.build_brow(builder, shape, 1.0), parts.build_brow(builder, shape, -1.0)),
        ears=(parts.build_ear(builder, 1.0), parts.build_ear(builder, -1.0)),
        upper_teeth=parts.build_teeth(builder, upper=True),
        lower_teeth=parts.build_teeth(builder, upper=False),
        tongue=parts.build_tongue(builder),
        hair=parts.build_hair(builder, shape),
        crown=crown,
        pivot=int(builder.add(HEAD_PIVOT, albedo=colours.SKIN)),
    )
    parts.build_shirt(builder)
    return _finish(builder, head)


def _build_skin(builder: MeshBuilder, shape: HeadShape) -> tuple[Indices, int, tuple[Block, Block, Block]]:
    rows, columns = _rows(), _columns()
    y, angle = np.meshgrid(rows, columns, indexing="ij")
    points = position(angle, y, shape)
    points = _nostrils(points)
    # The neck leans forward less than the sections' axis suggests; it follows the head and comes to rest at the collar.
    head_weight = np.maximum(smoothstep((y + 138.0) / 62.0), smoothstep((points[..., 2] - 55.0) / 25.0))
    grid = builder.add(points, albedo=colours.skin(points) * _skin_shade(points)[..., None], head_weight=head_weight)
    blocks = _blocks(rows, columns)
    keep = np.ones((len(rows) - 1, len(columns)), dtype=bool)
    for block in blocks:
        keep[block.bottom : block.top, block.left : block.right] = False
    keep &= ~_under_hair(y, angle)
    builder.quads(grid, closed=True, keep=keep)
    crown = int(builder.add(points[-1].mean(axis=0) * [0, 1, 1] + [0, 3.0, 0], albedo=colours.SKIN))
    return grid, crown, blocks


def _under_hair(y: Array, angle: Array) -> NDArray[np.bool_]:
    """(rows - 1, columns): cells of the grid that hair covers wholly; drawing them would be for nothing."""
    covered = y > parts.hairline(angle) + 9.0
    beside = np.roll(covered, -1, axis=1)
    return covered[:-1] & covered[1:] & beside[:-1] & beside[1:]


def _nostrils(points: Array) -> Array:
    """Wings of the nose and the nostrils below them."""
    x, y, z = np.abs(points[..., 0]), points[..., 1], points[..., 2]
    front = z > 80
    wing = np.exp(-(((x - 14.5) / 4.0) ** 2) - (((y + 3.5) / 6.5) ** 2)) * front
    crease = np.exp(-(((x - 20.0) / 2.4) ** 2) - (((y + 2.0) / 9.0) ** 2)) * front
    hole = np.exp(-(((x - 7.0) / 3.4) ** 2) - (((y + 6.6) / 2.6) ** 2)) * front
    out = points.copy()
    out[..., 0] += np.sign(points[..., 0]) * (2.6 * wing)
    out[..., 2] += 1.8 * wing - 1.2 * crease - 3.5 * hole
    out[..., 1] += 2.0 * hole
    return out


def _skin_shade(points: Array) -> Array:
    x, y = np.abs(points[..., 0]), points[..., 1]
    front = points[..., 2] > 80
    hole = np.exp(-(((x - 7.2) / 3.0) ** 2) - (((y + 5.4) / 1.9) ** 2)) * front
    shade: Array = 1 - 0.85 * hole
    return shade


def _soften(points: Array, triangles: Indices, head: HeadParts) -> Array:
    """Even out the skin where the rings round mouth and eyes meet the grid."""
    weight = np.zeros(len(points))
    weight[head.grid] = 1.0
    for rings, edge in ((head.mouth, 1.15), *((eye.lids, 1.5) for eye in head.eyes)):
        weight[rings.indices] = smoothstep((rings.level[:, None] - edge) / 0.25)
    near = np.zeros(len(points))
    for rings in (head.mouth, *(eye.lids for eye in head.eyes)):
        near[rings.indices] = 1.0
    near = np.clip(3.0 * smooth_over_mesh(near, triangles, 6), 0, 1)
    blend = weight * near
    softened = np.stack([smooth_over_mesh(points[:, axis], triangles, 6) for axis in range(3)], axis=-1)
    # Quads are cut along one diagonal, which pulls to one side: keep what both halves of the face agree on.
    mirror = np.array([-1.0, 1.0, 1.0])
    skin = np.flatnonzero(weight)
    twin = skin[cKDTree(points[skin]).query(points[skin] * mirror)[1]]
    softened[skin] = (softened[skin] + softened[twin] * mirror) / 2
    blend[skin] = (blend[skin] + blend[twin]) / 2
    return points + blend[:, None] * (softened - points)


def _finish(builder: MeshBuilder, head: HeadParts) -> FaceMesh:
    triangles = builder.triangles()
    points = _soften(builder.column("points_mm"), triangles, head)
    normals = vertex_normals(points, triangles)
    occlusion = smooth_over_mesh(bake_occlusion(points, normals), triangles, 2)
    # Teeth are seen only when the lips part, and then light falls on them: the neutral face's shadow would be wrong.
    lit = builder.column("material") == Material.TEETH
    occlusion = np.where(lit, np.maximum(occlusion, 0.72), occlusion)
    feature_points = locate(points, head)
    centres = {"3.5": head.eyes[0].centre, "3.6": head.eyes[1].centre}
    fapu = Fapu.measure({name: points[index] for name, index in feature_points.items()} | centres)
    jaw_weight, basis = build_basis(points, head, feature_points, fapu)
    on_jaw = jaw_weight > 0

    # The grid's vertices inside the openings and under the hair belong to no triangle: leave them out.
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    used[list(feature_points.values())] = True
    number = np.cumsum(used) - 1
    vertex_of_entry = np.repeat(np.arange(len(points)), np.diff(basis.offsets))
    kept = used[vertex_of_entry]
    return FaceMesh(
        vertices_mm=points[used].astype(np.float32),
        normals=normals[used].astype(np.float32),
        uv=builder.column("uv")[used],
        albedo=np.clip(builder.column("albedo"), 0, 1)[used].astype(np.float32),
        material=builder.column("material")[used],
        occlusion=np.clip(occlusion, 0, 1)[used].astype(np.float32),
        bone=np.where(on_jaw, Bone.JAW, builder.column("bone"))[used],
        bone_weight=np.where(on_jaw, jaw_weight, builder.column("bone_weight"))[used],
        head_weight=builder.column("head_weight")[used],
        triangles=number[triangles].astype(np.int32),
        feature_points={name: int(number[index]) for name, index in feature_points.items()},
        jaw_pivot_mm=JAW_PIVOT,
        head_pivot_mm=HEAD_PIVOT,
        eye_pivots_mm=np.stack([eye.centre for eye in head.eyes]),
        fapu=fapu,
        basis=DeformationBasis(
            channels=basis.channels,
            offsets=np.concatenate([[0], np.cumsum(np.diff(basis.offsets)[used])]),
            entry_channels=basis.entry_channels[kept],
            entry_mm=basis.entry_mm[kept],
        ),
    )
