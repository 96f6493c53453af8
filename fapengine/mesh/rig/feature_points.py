"""Feature points of a mesh with blendshapes, found from the vertices that the blendshapes move.

Theory of operation
-------------------
Left eye, right eye and mouth are where blinks and the open jaw move the mesh; they define the axes and size of the
head. A *seam* is where two vertices coincide but move apart: lips when the jaw opens, and lids, in their closed pose.
Seams give the inner lips, the corners of mouth and eyes, and the lid margins. Nose tip and chin are the extreme points
of the middle line between them. The points of the standard head are then warped onto these anchors (thin plate spline),
and each takes the nearest vertex of the skin that moves with its own lip and faces the same way.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices, Mask
from fapengine.errors import DataError
from fapengine.geometry.rigid import fit_rigid
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.blendshape_mesh import JAW, LEFT, RIGHT, ROLES, BlendshapeMesh, face_axes
from fapengine.mesh.rig.placed_mesh import find_parts

MAX_SEAM_GAP_MM = 4.0
"""Largest distance between the two sides of a seam."""
EXTENT_QUANTILE = {"lids": 0.9, "lips": 0.7}
"""Quantile of the motion of moved skin that counts as its extent; the largest motion may be hidden in the mouth."""
MIN_SEAM_TEAR = {"lids": (0.3, 0.1), "lips": (0.03, 0.06)}
"""Difference between the motions of the sides of a seam, relative to the extent, and more for each mm between them:
skin stretches.
"""
MIN_LIP_OPENING = 0.4
"""Opening of the middle of the lips, and of their halves, relative to the widest."""
SEAM_END_MM = 1.5
"""Distance from its last vertex within which a seam ends."""
PROFILE_STEP_MM = 3.0
"""Height of a step of the profile."""
MIN_LID_MOTION = 0.6
"""Least fraction of the extent that the middle of an upper lid margin moves."""
NO_SKIN_WORDS = (
    "lash", "hair", "brow", "teeth", "tooth", "tongue", "tear", "eyeball", "cornea", "occlusion", "glass",
)  # fmt: skip
"""Words in the names of surfaces that are not skin, though they may touch it."""
MAX_BENDING_ERROR_MM = 9.0
"""Largest distance from a warped point of the standard head to its vertex; points without one are left out."""
MIN_NORMAL_COSINE = 0.2
"""Least cosine between the normals of a point and of its vertex."""
LOWER_POINTS = ("2.3", "2.8", "2.9", "8.2", "8.7", "8.8", "2.1", "2.10", "2.11", "2.12")
UPPER_POINTS = ("2.2", "2.6", "2.7", "8.1", "8.5", "8.6", "8.9", "8.10", "9.3", "9.15", "9.1", "9.2", "9.4", "9.5")
FAR_GROUPS = ("10.", "11.")
"""Groups of feature points too far from all anchors for warping."""
NOSE_BASE = "9.15"
"""Feature point that may be confused with a nostril."""
POINTS_OFF_SKIN = (
    "3.5", "3.6", "6.1", "6.2", "6.3", "6.4", "7.1", "9.8", "9.9", "9.10", "9.11", "11.4", "11.5", "11.6",
)  # fmt: skip
EYEBALL_MM = (10.0, 45.0)
"""Bounds of an eyeball's width and height."""


class NoSlitError(DataError):
    """The mouth opens, but no lips part on the skin: it is drawn, or a mesh of its own."""


@dataclass(slots=True)
class _Face:
    """A mesh approximately in the standard's axes, and the anchors found on it.

    Stateful.
    """

    vertices: Array
    """(V, 3) mm."""
    triangles: Indices
    moves: Mapping[str, Array]
    """(V, 3) mm at full weight, by role."""
    part: Indices
    """(V,): number of the connected part."""
    skin: Indices
    """(S,): vertices of the skin."""
    normals: Array
    """(V, 3)."""
    anchors: dict[str, int] = field(default_factory=dict)
    """Vertices of the feature points found so far."""

    def amount(self, role: str) -> Array:
        """(V,): motion of each vertex, relative to :meth:`extent`."""
        return np.linalg.norm(self.moves[role], axis=1) / self.extent(role)

    def extent(self, role: str) -> float:
        """Motion of the moved skin, mm, at :data:`EXTENT_QUANTILE`."""
        length = np.linalg.norm(self.moves[role][self.skin], axis=1)
        moved = length[length > 0.1 * length.max(initial=0.0)]
        quantile = EXTENT_QUANTILE["lips" if role == JAW else "lids"]
        return max(float(np.quantile(moved, quantile)), 1e-9) if len(moved) else 1e-9


def locate(mesh: BlendshapeMesh, moves: Mapping[str, Array], standard: FaceMesh) -> dict[str, int]:
    """Find the feature points.

    Parameters
    ----------
    mesh : BlendshapeMesh
    moves : mapping of str to (V, 3) array
        Motion that closes the lids of each eye and opens the mouth, by
        :data:`~fapengine.mesh.rig.blendshape_mesh.ROLES` (or :data:`~fapengine.mesh.rig.blendshape_mesh.BOTH` for the
        lids of both eyes), in the mesh's unit and axes. A rig with eye bones may have none for the lids.
    standard : FaceMesh
        Has the points to find.

    Returns
    -------
    dict of str to int
        Vertex by feature point.

    Raises
    ------
    DataError
        If a role is missing or its blendshape moves nothing, if left and right are exchanged, or no seam of lips is
        found.
    """
    moves, (centre, axes, scale), amounts = face_axes(mesh, moves, float(standard.fapu.es0_mm))
    vertices = scale * (mesh.vertices - centre) @ axes.T + standard.eye_pivots_mm.mean(axis=0)
    turned = {role: scale * moves[role] @ axes.T for role in ROLES if role in moves}
    face = _face(vertices, mesh.triangles, ~mesh.on_surfaces(NO_SKIN_WORDS)[mesh.triangles[:, 0]], turned, amounts)
    for _ in range(2):  # the second time in better axes
        face.anchors = _anchors(face, mesh)
        face = _turned_to(face, standard)
    return _bent(face, standard) | _tongue(face, mesh)


def _face(
    vertices: Array, triangles: Indices, may_be_skin: Mask, moves: Mapping[str, Array], amounts: Mapping[str, Array]
) -> _Face:
    """Choose the part that lids and jaw move most."""
    part, whole = find_parts(vertices, triangles[may_be_skin])[1], find_parts(vertices, triangles)[1]
    used = np.unique(triangles[may_be_skin])
    score = np.zeros(part.max() + 1)
    for amount in amounts.values():
        score += np.bincount(part[used], amount[used] > 0.1 * amount.max(), len(score)) / max(1, len(used))
    skin = used[part[used] == score.argmax()]
    return _Face(vertices, triangles, moves, whole, skin, vertex_normals(vertices, triangles))


def _seam(face: _Face, vertices: Array, role: str) -> tuple[Indices, Indices, Array]:
    """Pairs of skin vertices that coincide and separate: those that move more, the others, and their distances."""
    amount, skin = face.amount(role), face.skin
    moves = face.moves[role] / face.extent(role)
    min_tear, tear_per_mm = MIN_SEAM_TEAR["lips" if role == JAW else "lids"]
    movers = skin[amount[skin] > min_tear]
    neighbours = np.asarray(
        cKDTree(vertices[skin]).query_ball_point(vertices[movers], MAX_SEAM_GAP_MM), object
    ).tolist()
    moving = np.repeat(movers, [len(others) for others in neighbours])
    still = skin[np.concatenate([*neighbours, []]).astype(np.int64)]
    gap = np.linalg.norm(vertices[moving] - vertices[still], axis=1)
    torn = np.linalg.norm(moves[moving] - moves[still], axis=1) > min_tear + tear_per_mm * gap
    torn &= amount[moving] > amount[still]
    return moving[torn], still[torn], gap[torn]


def _anchors(face: _Face, mesh: BlendshapeMesh) -> dict[str, int]:
    anchors = _lips(face)
    for role, upper, lower, inner, outer in ((LEFT, "3.1", "3.3", "3.11", "3.7"), (RIGHT, "3.2", "3.4", "3.8", "3.12")):
        if role in face.moves:
            anchors |= _lids(face, role, (upper, lower, inner, outer))
    return anchors | _middle_line(face, anchors) | _pupils(face, mesh, anchors)


def _lips(face: _Face) -> dict[str, int]:
    """Inner lips: the front of the seam that opens with the jaw."""
    vertices = face.vertices
    lower, upper, gap = _seam(face, vertices, JAW)
    if not len(lower):
        raise NoSlitError("lips: no slit opens with the jaw; give the feature points instead")
    lean = vertices[lower] - vertices[upper]
    opening = np.linalg.norm(face.moves[JAW][lower] - face.moves[JAW][upper], axis=1)
    upright = (np.abs(lean[:, 0]) < MAX_SEAM_GAP_MM / 2) & (opening > MIN_LIP_OPENING * opening.max())
    front = (vertices[lower, 2] + vertices[upper, 2]) / 2 - gap
    across = vertices[lower, 0]

    def foremost(x: float, width: float) -> int | None:
        off = np.abs(across - x)
        inside = np.flatnonzero(upright & (off < width))
        return int(inside[(front - off / 2)[inside].argmax()]) if len(inside) else None

    centres = (foremost(0.0, 3.0), foremost(float(np.median(across)), MAX_SEAM_GAP_MM), int(front.argmax()))
    centre = next(pair for pair in centres if pair is not None)
    points = {"2.2": int(upper[centre]), "2.3": int(lower[centre])}
    line = np.flatnonzero(front > front[centre] - 30.0)
    for corner, sign in (("2.4", 1.0), ("2.5", -1.0)):
        outermost = line[sign * across[line] > (sign * across[line]).max() - SEAM_END_MM]
        points[corner] = int(upper[outermost[front[outermost].argmax()]])
    for above, below, corner in (("2.6", "2.8", "2.4"), ("2.7", "2.9", "2.5")):
        half = foremost(0.6 * vertices[points[corner], 0] + 0.4 * vertices[points["2.2"], 0], 3.0)
        if half is not None:
            points[above], points[below] = int(upper[half]), int(lower[half])
    return _distinct(points)


def _lids(face: _Face, role: str, names: tuple[str, str, str, str]) -> dict[str, int]:
    """Margins of the lids where they meet in the closed pose, and their ends."""
    moving, still, gap = _seam(face, face.vertices + face.moves[role], role)
    if not len(moving):
        return {}
    near = np.flatnonzero(gap < np.maximum(1.0, 2.0 * np.median(gap)))
    along = (1.0 if role == LEFT else -1.0) * face.vertices[moving, 0]
    inner, outer = near[along[near].argmin()], near[along[near].argmax()]
    off_middle = np.abs(along - (along[inner] + along[outer]) / 2)
    top = np.where(face.amount(role)[moving] > MIN_LID_MOTION, off_middle + gap, np.inf).argmin()
    points = zip(names, (moving[top], still[top], still[inner], still[outer]), strict=True)
    return _distinct({name: int(vertex) for name, vertex in points})


def _middle_line(face: _Face, anchors: Mapping[str, int]) -> dict[str, int]:
    """Nose tip, nose base and chin: the extreme points of the profile."""
    vertices, skin = face.vertices, face.skin
    lip = vertices[anchors["2.2"]]
    lower_lids = vertices[[anchors[name] for name in ("3.3", "3.4") if name in anchors]]
    eye_height = float(lower_lids[:, 1].max()) if len(lower_lids) else lip[1] + 65.0
    strip = skin[(np.abs(vertices[skin, 0] - lip[0]) < 5.0) & (face.normals[skin, 2] > -0.5)]
    height, tall = vertices[strip, 1], eye_height - lip[1]
    nose = strip[(height > lip[1] + 0.15 * tall) & (height < lip[1] + 0.8 * tall)]
    below_lip = (height < lip[1] - 0.25 * tall) & (height > lip[1] - 1.1 * tall)
    below_lip &= vertices[strip, 2] > lip[2] - 40.0
    chin = strip[below_lip & (face.amount(JAW)[strip] > 0.3)]
    points = _nose(face, nose, lip) if len(nose) else {}
    if len(chin):
        points["2.1"] = int(chin[(vertices[chin] @ np.array([0.0, -0.75, 0.66])).argmax()])
        points["2.10"] = int(chin[(vertices[chin] @ np.array([0.0, -0.06, 1.0])).argmax()])
    return _distinct(points)


def _nose(face: _Face, strip: Indices, lip: Array) -> dict[str, int]:
    """Tip of the nose, and its base: the deepest point of the profile between tip and upper lip."""
    vertices = face.vertices
    tip = int(strip[vertices[strip, 2].argmax()])
    in_middle = (np.abs(vertices[strip, 0] - lip[0]) < 3.5) & (face.normals[strip, 2] > 0.15)
    under = _front(vertices, strip[in_middle & (vertices[strip, 1] < vertices[tip, 1] - 2.0)])
    if not len(under):
        return {"9.3": tip}
    chord = vertices[tip, 1:] - lip[1:]
    outwards = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    depth = (lip[1:] - vertices[under, 1:]) @ outwards - 0.5 * np.abs(vertices[under, 0] - lip[0])
    return {"9.3": tip, NOSE_BASE: int(under[depth.argmax()])}


def _front(vertices: Array, strip: Indices) -> Indices:
    """Foremost vertices of a strip at each height; none inside the nose."""
    band = np.floor(vertices[strip, 1] / PROFILE_STEP_MM)
    order = np.lexsort((-vertices[strip, 2], band))
    first = np.flatnonzero(np.diff(band[order], prepend=np.nan) != 0)
    return strip[order[first]]


def _distinct(points: Mapping[str, int]) -> dict[str, int]:
    """Keep the first of two names for one vertex."""
    names: dict[int, str] = {}
    for name, vertex in points.items():
        names.setdefault(vertex, name)
    return {name: vertex for vertex, name in names.items()}


def _turned_to(face: _Face, standard: FaceMesh) -> _Face:
    """Rotate and scale the face to the standard by the anchors found so far."""
    ours = face.vertices[[*face.anchors.values()]]
    theirs = np.stack([standard.point_mm(name) for name in face.anchors]).astype(np.float64)
    spread = float(np.linalg.norm(ours - ours.mean(axis=0)))
    scale = float(np.linalg.norm(theirs - theirs.mean(axis=0)) / max(spread, 1e-9))
    motion = fit_rigid(scale * ours, theirs)
    moves = {role: scale * move @ motion.rotation.T for role, move in face.moves.items()}
    vertices = motion.apply(scale * face.vertices)
    return replace(face, vertices=vertices, moves=moves, normals=vertex_normals(vertices, face.triangles))


def _bent(face: _Face, standard: FaceMesh) -> dict[str, int]:
    """Warp the standard's points onto the anchors, and find the vertex of each."""
    face.anchors = _without_nostril(face, standard)
    shift = _shift(face.vertices, face.anchors, standard)
    amount = face.amount(JAW)
    between_lips = 0.5 * (amount[face.anchors["2.2"]] + amount[face.anchors["2.3"]])
    points = dict(face.anchors)
    for name, index in standard.feature_points.items():
        if name in points or name in POINTS_OFF_SKIN or name.startswith(FAR_GROUPS):
            continue
        position = standard.vertices_mm[index].astype(np.float64)
        goal = position + shift(position[None])[0]
        fits = face.normals[face.skin] @ standard.normals[index] > MIN_NORMAL_COSINE
        if name in LOWER_POINTS:
            fits &= amount[face.skin] > between_lips
        if name in UPPER_POINTS:
            fits &= amount[face.skin] < between_lips
        candidates = np.setdiff1d(face.skin[fits], list(points.values()))
        if not len(candidates):
            continue
        distance = np.linalg.norm(face.vertices[candidates] - goal, axis=1)
        if distance.min() < MAX_BENDING_ERROR_MM:
            points[name] = int(candidates[distance.argmin()])
    return points


def _without_nostril(face: _Face, standard: FaceMesh) -> dict[str, int]:
    """Anchors without the nose base if it is far from where the others warp it to: then it is a nostril."""
    others = {name: vertex for name, vertex in face.anchors.items() if name != NOSE_BASE}
    if NOSE_BASE not in face.anchors:
        return others
    position = standard.point_mm(NOSE_BASE).astype(np.float64)
    goal = position + _shift(face.vertices, others, standard)(position[None])[0]
    distance = np.linalg.norm(face.vertices[face.anchors[NOSE_BASE]] - goal)
    return others if distance > MAX_BENDING_ERROR_MM else face.anchors


def _shift(vertices: Array, anchors: Mapping[str, int], standard: FaceMesh) -> RBFInterpolator:
    """Displacement of the face from the standard's, interpolated between the anchors."""
    sources = np.stack([standard.point_mm(name) for name in anchors]).astype(np.float64)
    return RBFInterpolator(sources, vertices[[*anchors.values()]] - sources, kernel="linear", degree=0, smoothing=1.0)


def _pupils(face: _Face, mesh: BlendshapeMesh, anchors: Mapping[str, int]) -> dict[str, int]:
    """Front of each eyeball: of the vertices of the eye's bone, or of the ball behind its lids."""
    used, points = np.unique(face.triangles), {}
    for pupil, bone, lids in (("3.5", "left eye", ("3.1", "3.3")), ("3.6", "right eye", ("3.2", "3.4"))):
        lid_points = [face.vertices[anchors[name]] for name in lids if name in anchors]
        ball = used[mesh.bones[bone].weight[used] > 0.5] if bone in mesh.bones else used[:0]
        if not len(ball) and lid_points:
            ball = _ball_behind(face, used, np.mean(lid_points, axis=0))
        if len(ball):
            front = ball[face.vertices[ball, 2] > np.quantile(face.vertices[ball, 2], 0.7)]
            off_axis = np.linalg.norm(face.vertices[front, :2] - face.vertices[ball, :2].mean(axis=0), axis=1)
            points[pupil] = int(front[(face.vertices[front, 2] - 3.0 * off_axis).argmax()])
    return points


def _ball_behind(face: _Face, used: Indices, lids: Array) -> Indices:
    """Vertices of the largest part near a place between lids that is an eyeball; none without one."""
    near = used[np.linalg.norm(face.vertices[used] - lids, axis=1) < 12.0]
    numbers = [number for number in np.unique(face.part[near]) if number != face.part[face.skin[0]]]
    parts = [used[face.part[used] == number] for number in numbers]
    return max((part for part in parts if _is_ball(face.vertices[part], lids)), key=len, default=used[:0])


def _is_ball(vertices: Array, lids: Array) -> bool:
    """Whether a part is about as large as an eyeball and lies behind the lids."""
    width, middle = np.ptp(vertices, axis=0)[:2].max(), (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    behind = np.linalg.norm((middle - lids)[:2]) < 10.0 and middle[2] < lids[2] + 2.0
    return bool(EYEBALL_MM[0] < width < EYEBALL_MM[1] and behind)


def _tongue(face: _Face, mesh: BlendshapeMesh) -> dict[str, int]:
    """Tip of the tongue: of the parts with that name, the one that reaches farthest back along the middle."""
    used = np.unique(face.triangles)
    named = mesh.on_surfaces(("tongue",)) & ~mesh.on_surfaces(("gum",))  # one grown to the gums would take them along
    tongues = used[named[used] & (face.part[used] != face.part[face.skin[0]])]
    middle = tongues[np.abs(face.vertices[tongues, 0] - face.vertices[face.anchors["2.2"], 0]) < MAX_SEAM_GAP_MM]
    if not len(middle):
        return {}
    parts = [middle[face.part[middle] == number] for number in np.unique(face.part[middle])]
    tongue = max(parts, key=lambda part: float(np.ptp(face.vertices[part, 2])))
    return {"6.1": int(tongue[face.vertices[tongue, 2].argmax()])}
