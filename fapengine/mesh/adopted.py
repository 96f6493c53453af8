"""Anybody's mesh as a head: a neutral surface and its feature points, moved by every FAP whose point is known.

Theory of operation
-------------------
The mesh is laid onto the standard's face by its feature points (turn, shift, scale), so units and axes of the file do
not matter, and cameras and shading fit. Vertices at one place count as one. The connected part that bears the lips is
the skin, parts around the pupils are eyeballs, other parts below the mouth line inside of the head go with the jaw.

On the skin each feature point has a field that is 1 there, 0 at every other point and far away, and bends least
between (bilaplacian of the mesh). A slit mouth or lid stops it, because the mesh does. So each FAP moves its own point
by exactly its step and no other point at all. Lids turn about the eyeball in piecewise-linear steps; the jaw is a bone
whose weight is continued the same way from chin to lips.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from fapengine._arrays import frozen
from fapengine.geometry.continuation import continue_smoothly
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.adopted_parts import (
    Eyes,
    check,
    find_eyes,
    followers,
    iris_plane,
    materials,
    measure,
    occlusion,
    paint,
    parts,
    place,
    smooth_normals,
)
from fapengine.mesh.basis import Collector
from fapengine.mesh.face_mesh import Bone, Channel, FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REACH_MM = 34.0
"""Skin farther than this from every feature point stands still."""
SMALLEST = 0.004
"""Field values below this move nothing that can be seen."""
CHIN = ("2.1", "2.10", "2.11", "2.12")
LIDS = {19: ("3.1", "3.5"), 20: ("3.2", "3.6"), 21: ("3.3", "3.5"), 22: ("3.4", "3.6")}
LID_KNOTS = {19: (-400.0, 0.0, 200.0, 400.0, 600.0, 800.0, 1000.0, 1100.0), 21: (-400.0, 0.0, 300.0, 600.0)}
BONE_FAPS = (3, 14, 15, 23, 24, 25, 26, 27, 28, 48, 49, 50)
NECK_MM = (45.0, 75.0)
"""Below the chin: where the head's motion begins to fade, and over which length."""


@dataclass(frozen=True, slots=True, eq=False)
class Adopted:
    """A head made of somebody's mesh."""

    mesh: FaceMesh
    moved: tuple[int, ...]
    """FAPs that move it."""
    missing: tuple[int, ...]
    """Low-level FAPs that do not, because their point is unknown."""
    scale: float
    """Millimetres of the standard's face for one unit of the file."""
    notes: tuple[str, ...]
    used: tuple[str, ...] = ()
    """Shapes of the file that FAPs blend."""
    unused: tuple[str, ...] = ()
    """Shapes of the file that nothing asks for."""


def adopt(
    vertices: ArrayLike,
    triangles: ArrayLike,
    points: Mapping[str, int],
    standard: FaceMesh,
    albedo: ArrayLike | None = None,
) -> Adopted:
    """Make a head of a neutral mesh.

    Parameters
    ----------
    vertices : (V, 3) array_like
        In any unit and axes.
    triangles : (F, 3) array_like of int
        Counter-clockwise from outside.
    points : mapping of str to int
        Vertex of each feature point that is known.
    standard : FaceMesh
        Gives scale, axes and what a face without that point has.
    albedo : (V, 3) array_like, optional
        Linear RGB, 0..1; without it the skin is painted.

    Raises
    ------
    DataError
        If too few points are known, two are one vertex, one is no vertex, or left and right are exchanged.
    """
    given = frozen(vertices, "vertices", ("V", 3), np.float64)
    faces = frozen(triangles, "triangles", ("F", 3), np.int64)
    check(points, len(given), faces)
    used, numbered = np.unique(faces, return_inverse=True)  # renderers know vertices of triangles only
    faces = numbered.reshape(-1, 3).astype(np.int64)
    points = {name: int(np.searchsorted(used, index)) for name, index in points.items()}
    painted = None if albedo is None else frozen(albedo, "albedo", (len(given), 3), np.float64)[used]
    given = given[used]
    placed, scale, _ = place(given, points, standard)
    at = {name: placed[index] for name, index in points.items()}
    node, part = parts(placed, faces)
    notes: list[str] = []
    fapu = measure(at, standard, notes)
    skin = np.flatnonzero(part == part[points["8.1"]])
    eyes = find_eyes(placed, part, points, at, skin)
    on_skin = {name: index for name, index in points.items() if part[index] == part[points["8.1"]]}
    fields = point_fields(placed, faces, node, skin, on_skin)
    skin, fields = with_followers(skin, fields, *followers(placed, part, at, skin, eyes, np.zeros(0, np.int64)))
    collector = Collector(len(given))
    moved = move_points(collector, skin, fields, fapu)
    moved += _move_lids(collector, placed, skin, fields, at, eyes, fapu)
    moved += move_tongue(collector.add, placed, part, points, at, fapu)
    skin = skin[part[skin] == part[points["8.1"]]]
    bone, weight = bind_bones(placed, part, points, skin, on_skin, at, eyes, faces, node)
    reached = set(moved) | {number for number in BONE_FAPS if number not in boneless(eyes)}
    low = [row.number for row in fap.FAPS if row.number > 2]
    normals = smooth_normals(placed, faces, node)
    material = materials(placed, eyes)
    centres = [
        eyes[name][1] if name in eyes else standard.eye_pivots_mm[index] for index, name in enumerate(("3.5", "3.6"))
    ]
    mesh = FaceMesh(
        vertices_mm=placed.astype(np.float32),
        normals=normals.astype(np.float32),
        uv=iris_plane(placed, eyes),
        albedo=paint(placed, painted, at, skin, faces, material),
        material=material,
        occlusion=occlusion(placed, normals, faces, material),
        bone=bone,
        bone_weight=weight.astype(np.float32),
        head_weight=smoothstep((placed[:, 1] - at["2.1"][1] + sum(NECK_MM)) / NECK_MM[1]).astype(np.float32),
        triangles=faces.astype(np.int32),
        feature_points=dict(points),
        jaw_pivot_mm=standard.jaw_pivot_mm,
        head_pivot_mm=at.get("7.1", standard.head_pivot_mm),
        eye_pivots_mm=np.stack(centres),
        fapu=fapu,
        basis=collector.basis(),
    )
    missing = tuple(number for number in low if number not in reached)
    return Adopted(mesh, tuple(sorted(reached)), missing, scale, tuple(notes))


Add = Callable[[Channel, Indices, Array], None]
"""Takes a channel, vertices and their displacement (N, 3) mm per FAPU."""
Fields = dict[str, Array]
"""By feature point: (skin vertices,) its share of the point's motion."""


def point_fields(placed: Array, faces: Indices, node: Indices, skin: Indices, on_skin: Mapping[str, int]) -> Fields:
    """Share of each point's motion that the skin around it takes."""
    shares = continued(placed, faces, node, skin, on_skin, np.eye(len(on_skin)))
    shares[np.abs(shares) < SMALLEST] = 0.0
    return dict(zip(on_skin, shares.T, strict=True))


def with_followers(skin: Indices, fields: Fields, vertices: Indices, nearest: Indices) -> tuple[Indices, Fields]:
    """Let vertices take the shares of the skin's nearest."""
    spread = {name: np.concatenate([share, share[nearest]]) for name, share in fields.items()}
    return np.concatenate([skin, vertices]), spread


def continued(
    placed: Array, faces: Indices, node: Indices, skin: Indices, on_skin: Mapping[str, int], values: Array
) -> Array:
    """Continue values of the feature points, (P, C), over the skin; far from all of them they are 0."""
    nodes = np.unique(node[skin])
    local = np.full(node.max() + 1, -1)
    local[nodes] = np.arange(len(nodes))
    place = np.zeros((len(nodes), 3))
    place[local[node[skin]]] = placed[skin]
    corners = local[node[faces]]
    known = np.asarray(cKDTree(placed[list(on_skin.values())]).query(place)[0] > REACH_MM)
    anchors = local[node[list(on_skin.values())]]
    known[anchors] = True
    given = np.zeros((len(nodes), values.shape[1]))
    given[anchors] = values
    whole = continue_smoothly(given, known, corners[(corners >= 0).all(axis=1)])
    return whole[local[node[skin]]]


def move_points(collector: Collector, skin: Indices, fields: Fields, fapu: Fapu) -> list[int]:
    """Add the FAPs that shift a point of the skin along an axis."""
    moved = []
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.number in LIDS or row.number in BONE_FAPS or row.unit is fap.FapUnit.AU:
            continue
        if row.point in fields:
            step = fapu.unit(row.unit) * np.array(axis)
            collector.add(Channel(row.number, -np.inf, np.inf), skin, fields[row.point][:, None] * step)
            moved.append(row.number)
    return moved


def _move_lids(
    collector: Collector, placed: Array, skin: Indices, fields: Fields, at: Mapping[str, Array], eyes: Eyes, fapu: Fapu
) -> list[int]:
    """Turn lids about their eyeball, by as much as lowers (lifts) the margin's middle by each knot."""
    moved = []
    step = fapu.unit(fap.FapUnit.IRISD)
    for number, (point, pupil) in LIDS.items():
        if point not in fields or pupil not in eyes:
            continue
        centre = eyes[pupil][1]
        arm = placed[skin] - centre
        share = np.clip(fields[point], 0.0, 1.0)
        down = 1.0 if number in (19, 20) else -1.0
        y, z = at[point][1:] - centre[1:]
        knots = LID_KNOTS[19 if number in (19, 20) else 21]
        poses = []
        for value in knots:
            wanted = np.clip((y - down * value * step) / np.hypot(y, z), -1.0, 1.0)
            turn = (np.arctan2(y, z) - np.arcsin(wanted)) * share
            sine, cosine = np.sin(turn), np.cos(turn)
            poses.append(
                np.stack(
                    [
                        0 * sine,
                        arm[:, 1] * (cosine - 1) - arm[:, 2] * sine,
                        arm[:, 2] * (cosine - 1) + arm[:, 1] * sine,
                    ],
                    1,
                )
            )
        rest = knots.index(0.0)
        for index in range(len(knots) - 1):
            first, last = (index, index + 1) if index >= rest else (index + 1, index)
            per_unit = (poses[last] - poses[first]) / abs(knots[last] - knots[first])
            collector.add(Channel(number, knots[first], knots[last]), skin, per_unit)
        moved.append(number)
    return moved


def move_tongue(
    add: Add, placed: Array, part: Indices, points: Mapping[str, int], at: Mapping[str, Array], fapu: Fapu,
    without: Sequence[int] = (),
) -> list[int]:  # fmt: skip
    """Move a tongue of its own, most at its tip, not at its root; ``without`` FAPs that move it already."""
    if "6.1" not in points or part[points["6.1"]] == part[points["8.1"]]:
        return []
    tongue = np.flatnonzero(part == part[points["6.1"]])
    back = placed[tongue, 2].min()
    share = np.clip((placed[tongue, 2] - back) / max(at["6.1"][2] - back, 1.0), 0.0, 1.0) ** 1.6
    moved = [number for number in (43, 44, 45) if number not in without]
    for number in moved:
        row = fap.spec(number)
        step = fapu.unit(row.unit) * np.array(fap.HEAD_AXES[row.positive])
        add(Channel(number, -np.inf, np.inf), tongue, share[:, None] * step)
    return moved


def bind_bones(
    placed: Array, part: Indices, points: Mapping[str, int], skin: Indices, on_skin: Mapping[str, int],
    at: Mapping[str, Array], eyes: Eyes, faces: Indices, node: Indices,
) -> tuple[NDArray[np.uint8], Array]:  # fmt: skip
    """Choose what each vertex turns with, and how much."""
    bone, weight = np.zeros(len(placed), np.uint8), np.zeros(len(placed))
    line = (at["8.1"][1] + at["8.2"][1]) / 2
    lower_teeth = {part[points[name]] for name in ("9.9", "9.11", "6.1", "6.2") if name in points} - {part[skin[0]]}
    for one in np.unique(part):
        members = np.flatnonzero(part == one)
        centre = placed[members].mean(axis=0)
        inside = abs(centre[0]) < 45 and at["2.1"][1] - 10 < centre[1] < line and centre[2] > 0
        if one != part[skin[0]] and (one in lower_teeth or inside):
            bone[members], weight[members] = Bone.JAW, 1.0
    turns = np.array([[float(name in CHIN)] for name in on_skin])
    fields = continued(placed, faces, node, skin, on_skin, turns)[:, 0]
    share = np.clip(fields, 0.0, 1.0)
    bone[skin[share > SMALLEST]] = Bone.JAW
    weight[skin] = np.where(share > SMALLEST, share, 0.0)
    for pupil, side in (("3.5", Bone.LEFT_EYE), ("3.6", Bone.RIGHT_EYE)):
        if pupil in eyes and len(eyes[pupil][0]):
            bone[eyes[pupil][0]], weight[eyes[pupil][0]] = side, 1.0
    return bone, weight


def boneless(eyes: Eyes) -> set[int]:
    """FAPs of eye bones that this mesh does not have."""
    without = set()
    for pupil, numbers in (("3.5", (23, 25, 27)), ("3.6", (24, 26, 28))):
        if pupil not in eyes or not len(eyes[pupil][0]):
            without |= set(numbers)
    return without
