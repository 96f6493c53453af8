"""Where the feature points lie on a mesh that has shapes: found by what the shapes move.

Theory of operation
-------------------
Left eye, right eye and mouth are where blinks and the open jaw move the mesh; they give the head's axes and its size.
A *seam* is where two vertices lie together but move apart: lips when the jaw opens, and lids, seen in their closed
pose. Seams give the inner lips, the corners of mouth and eyes, and the lids' margins. Nose tip and chin are the
outermost places of the middle line between them. The standard head's points are then bent onto these anchors (thin
plate spline), and each takes the nearest vertex of the skin that moves with its own lip and faces the same way.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from fapengine.errors import DataError
from fapengine.geometry.rigid import fit_rigid
from fapengine.mesh.adopted_parts import parts
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.morphs import MorphMesh
from fapengine.mesh.morphs_axes import JAW, LEFT, RIGHT, ROLES, face_axes
from fapengine.mesh.patch import vertex_normals

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TOGETHER_MM = 4.0
"""Two sides of a seam lie nearer than this."""
WELL = {"lids": 0.9, "lips": 0.7}
"""Share of the moved skin that moves less than it does where it moves well."""
APART = {"lids": (0.3, 0.1), "lips": (0.03, 0.06)}
"""And differ in their motion by more than this share of its extent, and more for each mm between: skin stretches."""
ENDING_MM = 1.5
"""How near to its last vertex a seam ends."""
PROFILE_MM = 3.0
"""Height of a step of the profile."""
CLOSING = 0.6
"""Share of the largest motion that the middle of an upper lid's margin has at least."""
NO_SKIN = ("lash", "hair", "brow", "teeth", "tooth", "tongue", "tear", "eyeball", "cornea", "occlusion", "glass")
"""Surfaces named so are not the skin, though they may touch it."""
REACH_MM = 9.0
"""A point of the standard head without a vertex so near is left out."""
SAME_WAY = 0.2
"""Least cosine between the normals of a point and of its vertex."""
INNER_LIPS = ("2.2", "2.3", "2.4", "2.5", "2.6", "2.7", "2.8", "2.9")
LOWER = ("2.3", "2.8", "2.9", "8.2", "8.7", "8.8", "2.1", "2.10", "2.11", "2.12")
UPPER = ("2.2", "2.6", "2.7", "8.1", "8.5", "8.6", "8.9", "8.10", "9.3", "9.15", "9.1", "9.2", "9.4", "9.5")
FAR = ("10.", "11.")
"""Groups that lie so far from all anchors that bending says little."""
DOUBTED = "9.15"
OFF_SKIN = ("3.5", "3.6", "6.1", "6.2", "6.3", "6.4", "7.1", "9.8", "9.9", "9.10", "9.11", "11.4", "11.5", "11.6")


@dataclass(slots=True)
class Face:
    """Stateful: the mesh in the standard's axes, nearly, and what was found on it."""

    place: Array
    """(V, 3) mm."""
    triangles: Indices
    moves: Mapping[str, Array]
    """By role: (V, 3) mm at full weight."""
    part: Indices
    skin: Indices
    normals: Array
    anchors: dict[str, int] = field(default_factory=dict)

    def amount(self, role: str) -> Array:
        """(V,): how far each vertex moves, as a share of :meth:`extent`."""
        share: Array = np.linalg.norm(self.moves[role], axis=1) / self.extent(role)
        return share

    def extent(self, role: str) -> float:
        """How far the skin moves in mm where it moves well; what moves farthest may hide in the mouth."""
        length = np.linalg.norm(self.moves[role][self.skin], axis=1)
        moved = length[length > 0.1 * length.max(initial=0.0)]
        return max(float(np.quantile(moved, WELL["lips" if role == JAW else "lids"])), 1e-9) if len(moved) else 1e-9


def locate(mesh: MorphMesh, moves: Mapping[str, Array], standard: FaceMesh) -> dict[str, int]:
    """Find feature points.

    Parameters
    ----------
    mesh : MorphMesh
    moves : mapping of str to (V, 3) array
        What closes each eye's lids and opens the mouth, by :data:`ROLES` (or :data:`BOTH` for the lids of both eyes),
        in the mesh's unit and axes. A rig with eye bones may lack the lids'.
    standard : FaceMesh
        Whose points are looked for.

    Returns
    -------
    dict of str to int
        Vertex by feature point.

    Raises
    ------
    DataError
        If a role is missing or its shape moves nothing, if left and right are exchanged, or no seam of lips is found.
    """
    moves, (centre, axes, scale), shown = face_axes(mesh, moves, float(standard.fapu.es0_mm))
    place = scale * (mesh.vertices - centre) @ axes.T + standard.eye_pivots_mm.mean(axis=0)
    turned = {role: scale * moves[role] @ axes.T for role in ROLES if role in moves}
    face = _face(place, mesh.triangles, ~mesh.named(NO_SKIN)[mesh.triangles[:, 0]], turned, shown)
    for _ in range(2):  # the second time in better axes
        face.anchors = _anchors(face, mesh)
        face = _turned_to(face, standard)
    found = _bent(face, standard)
    return found | _tongue(face, mesh)


def _face(
    place: Array, triangles: Indices, bare: NDArray[np.bool_], moves: Mapping[str, Array], shown: Mapping[str, Array]
) -> Face:
    """Choose the part that lids and jaw move most."""
    part, whole = parts(place, triangles[bare])[1], parts(place, triangles)[1]
    used = np.unique(triangles[bare])
    score = np.zeros(part.max() + 1)
    for length in shown.values():
        score += np.bincount(part[used], length[used] > 0.1 * length.max(), len(score)) / max(1, len(used))
    skin = used[part[used] == score.argmax()]
    return Face(place, triangles, moves, whole, skin, vertex_normals(place, triangles))


def _seam(face: Face, place: Array, role: str) -> tuple[Indices, Indices, Array]:
    """Pairs of skin vertices that lie together and part: those that move more, the others, and their distances."""
    amount, skin = face.amount(role), face.skin
    moves = face.moves[role] / face.extent(role)
    least, per_mm = APART["lips" if role == JAW else "lids"]
    more = skin[amount[skin] > least]
    found = np.asarray(cKDTree(place[skin]).query_ball_point(place[more], TOGETHER_MM), object).tolist()
    moving = np.repeat(more, [len(others) for others in found])
    still = skin[np.concatenate([*found, []]).astype(np.int64)]
    gap = np.linalg.norm(place[moving] - place[still], axis=1)
    torn = np.linalg.norm(moves[moving] - moves[still], axis=1) > least + per_mm * gap
    torn &= amount[moving] > amount[still]
    return moving[torn], still[torn], gap[torn]


def _anchors(face: Face, mesh: MorphMesh) -> dict[str, int]:
    found = _lips(face)
    for role, upper, lower, inner, outer in (
        (LEFT, "3.1", "3.3", "3.11", "3.7"),
        (RIGHT, "3.2", "3.4", "3.8", "3.12"),
    ):
        if role in face.moves:
            found |= _lids(face, role, (upper, lower, inner, outer))
    return found | _middle_line(face, found) | _eyeballs(face, mesh, found)


def _lips(face: Face) -> dict[str, int]:
    """Inner lips: the front of the seam that opens with the jaw."""
    place = face.place
    lower, upper, gap = _seam(face, place, JAW)
    if not len(lower):
        raise DataError("lips: got no slit that opens with the jaw, expected one; give the feature points instead")
    lean = place[lower] - place[upper]
    good = np.abs(lean[:, 0]) < TOGETHER_MM / 2
    front = (place[lower, 2] + place[upper, 2]) / 2 - gap
    found: dict[str, int] = {}
    across = place[lower, 0]

    def best(at: float, width: float) -> int | None:
        inside = np.flatnonzero(good & (np.abs(across - at) < width))
        return int(inside[front[inside].argmax()]) if len(inside) else None

    tried = (best(0.0, 3.0), best(float(np.median(across)), TOGETHER_MM), int(front.argmax()))
    centre = next(one for one in tried if one is not None)
    found["2.2"], found["2.3"] = int(upper[centre]), int(lower[centre])
    line = np.flatnonzero(front > front[centre] - 30.0)
    for name, sign in (("2.4", 1.0), ("2.5", -1.0)):
        outermost = line[sign * across[line] > (sign * across[line]).max() - ENDING_MM]
        end = outermost[front[outermost].argmax()]
        found[name] = int(upper[end])
    for high, low, corner in (("2.6", "2.8", "2.4"), ("2.7", "2.9", "2.5")):
        half = best(0.6 * place[found[corner], 0] + 0.4 * place[found["2.2"], 0], 3.0)
        if half is not None:
            found[high], found[low] = int(upper[half]), int(lower[half])
    return _distinct(found)


def _lids(face: Face, role: str, names: tuple[str, str, str, str]) -> dict[str, int]:
    """Margins of the lids where they meet in the closed pose, and its ends."""
    moving, still, gap = _seam(face, face.place + face.moves[role], role)
    if not len(moving):
        return {}
    near = np.flatnonzero(gap < np.maximum(1.0, 2.0 * np.median(gap)))
    along = (1.0 if role == LEFT else -1.0) * face.place[moving, 0]
    inner, outer = near[along[near].argmin()], near[along[near].argmax()]
    off_middle = np.abs(along - (along[inner] + along[outer]) / 2)
    top = np.where(face.amount(role)[moving] > CLOSING, off_middle + gap, np.inf).argmin()
    found = dict(zip(names, (moving[top], still[top], still[inner], still[outer]), strict=True))
    return _distinct({name: int(vertex) for name, vertex in found.items()})


def _middle_line(face: Face, found: Mapping[str, int]) -> dict[str, int]:
    """Nose tip and chin, the outermost places of the profile."""
    place, skin = face.place, face.skin
    lip, eyes = place[found["2.2"]], face.place[[found[name] for name in ("3.3", "3.4") if name in found]]
    height = float(eyes[:, 1].max()) if len(eyes) else lip[1] + 65.0
    strip = skin[(np.abs(place[skin, 0] - lip[0]) < 5.0) & (face.normals[skin, 2] > -0.5)]
    tall = height - lip[1]
    nose = strip[(place[strip, 1] > lip[1] + 0.15 * tall) & (place[strip, 1] < lip[1] + 0.8 * tall)]
    chin = strip[
        (place[strip, 1] < lip[1] - 0.25 * tall)
        & (place[strip, 1] > lip[1] - 1.1 * tall)
        & (face.amount(JAW)[strip] > 0.3)
        & (place[strip, 2] > lip[2] - 40.0)
    ]
    more: dict[str, int] = {}
    if len(nose):
        tip = int(nose[place[nose, 2].argmax()])
        more["9.3"] = tip
        bare = (np.abs(place[nose, 0] - lip[0]) < 3.5) & (face.normals[nose, 2] > 0.15)
        under = _front(place, nose[bare & (place[nose, 1] < place[tip, 1] - 2.0)])
        chord = place[tip, 1:] - lip[1:]
        outwards = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
        depth = (lip[1:] - place[under, 1:]) @ outwards - 0.5 * np.abs(place[under, 0] - lip[0])
        if len(under):
            more["9.15"] = int(under[depth.argmax()])
    if len(chin):
        more["2.1"] = int(chin[(place[chin] @ np.array([0.0, -0.75, 0.66])).argmax()])
        more["2.10"] = int(chin[(place[chin] @ np.array([0.0, -0.06, 1.0])).argmax()])
    return _distinct(more)


def _front(place: Array, strip: Indices) -> Indices:
    """Of a strip of vertices those that lie foremost at their height: nothing inside the nose."""
    band = np.floor(place[strip, 1] / PROFILE_MM)
    order = np.lexsort((-place[strip, 2], band))
    first = np.flatnonzero(np.diff(band[order], prepend=np.nan) != 0)
    foremost: Indices = strip[order[first]]
    return foremost


def _distinct(found: dict[str, int]) -> dict[str, int]:
    """Keep the first of two names for one vertex."""
    seen: dict[int, str] = {}
    for name, vertex in found.items():
        seen.setdefault(vertex, name)
    return {name: vertex for vertex, name in seen.items()}


def _turned_to(face: Face, standard: FaceMesh) -> Face:
    """Turn the face to the standard's axes and size, by the anchors found so far."""
    names = list(face.anchors)
    ours, theirs = face.place[[face.anchors[name] for name in names]], np.stack([standard.point_mm(n) for n in names])
    theirs = theirs.astype(np.float64)
    spread = float(np.linalg.norm(ours - ours.mean(axis=0)))
    scale = float(np.linalg.norm(theirs - theirs.mean(axis=0)) / max(spread, 1e-9))
    motion = fit_rigid(scale * ours, theirs)
    moves = {role: scale * move @ motion.rotation.T for role, move in face.moves.items()}
    place = motion.apply(scale * face.place)
    return Face(place, face.triangles, moves, face.part, face.skin, vertex_normals(place, face.triangles), face.anchors)


def _bent(face: Face, standard: FaceMesh) -> dict[str, int]:
    """Bend the standard's points onto the anchors; each takes a vertex."""
    if DOUBTED in face.anchors:  # a nostril may pass for the nose's base
        others = {name: vertex for name, vertex in face.anchors.items() if name != DOUBTED}
        there = standard.point_mm(DOUBTED).astype(np.float64)
        goal = there + _shift(face.place, others, standard)(there[None])[0]
        if np.linalg.norm(face.place[face.anchors[DOUBTED]] - goal) > REACH_MM:
            face.anchors = others
    shift = _shift(face.place, face.anchors, standard)
    amount = face.amount(JAW)
    lip = 0.5 * (amount[face.anchors["2.2"]] + amount[face.anchors["2.3"]])
    taken = dict(face.anchors)
    for name, index in standard.feature_points.items():
        if name in taken or name in OFF_SKIN or name.startswith(FAR):
            continue
        there = standard.vertices_mm[index].astype(np.float64)
        goal = there + shift(there[None])[0]
        fits = face.normals[face.skin] @ standard.normals[index] > SAME_WAY
        if name in LOWER:
            fits &= amount[face.skin] > lip
        if name in UPPER:
            fits &= amount[face.skin] < lip
        candidates = np.setdiff1d(face.skin[fits], list(taken.values()))
        if not len(candidates):
            continue
        distance = np.linalg.norm(face.place[candidates] - goal, axis=1)
        if distance.min() < REACH_MM:
            taken[name] = int(candidates[distance.argmin()])
    return taken


def _shift(place: Array, anchors: Mapping[str, int], standard: FaceMesh) -> RBFInterpolator:
    """How far the face lies from the standard's, continued from the anchors."""
    sources = np.stack([standard.point_mm(name) for name in anchors]).astype(np.float64)
    return RBFInterpolator(sources, place[[*anchors.values()]] - sources, kernel="linear", degree=0, smoothing=1.0)


def _eyeballs(face: Face, mesh: MorphMesh, lids_found: Mapping[str, int]) -> dict[str, int]:
    """Pupils: the front of what hangs on the eyes' bones, or of the ball behind each eye's lids."""
    found = {}
    for pupil, limb, lids in (("3.5", "left eye", ("3.1", "3.3")), ("3.6", "right eye", ("3.2", "3.4"))):
        known = [face.place[lids_found[name]] for name in lids if name in lids_found]
        used = np.unique(face.triangles)
        if limb in mesh.limbs and (mesh.limbs[limb].weight[used] > 0.5).any():
            ball = used[mesh.limbs[limb].weight[used] > 0.5]
        elif not known:
            continue
        else:
            middle = np.mean(known, axis=0)
            away = np.linalg.norm(face.place[used] - middle, axis=1)
            near = [one for one in np.unique(face.part[used[away < 12.0]]) if one != face.part[face.skin[0]]]
            balls = [part for one in near if _is_ball(face.place[part := used[face.part[used] == one]], middle)]
            if not balls:
                continue
            ball = max(balls, key=len)
        flat = np.linalg.norm(face.place[ball, :2] - face.place[ball, :2].mean(axis=0), axis=1)
        front = ball[face.place[ball, 2] > np.quantile(face.place[ball, 2], 0.7)]
        centre = face.place[ball, :2].mean(axis=0)
        flat = np.linalg.norm(face.place[front, :2] - centre, axis=1)
        found[pupil] = int(front[(face.place[front, 2] - 3.0 * flat).argmax()])
    return found


def _is_ball(place: Array, lids: Array) -> bool:
    """Whether a part is about as large as an eyeball and lies behind the lids."""
    extent, middle = np.ptp(place, axis=0), (place.max(axis=0) + place.min(axis=0)) / 2
    return bool(
        10.0 < extent[:2].max() < 45.0 and np.linalg.norm((middle - lids)[:2]) < 10.0 and middle[2] < lids[2] + 2.0
    )


def _tongue(face: Face, mesh: MorphMesh) -> dict[str, int]:
    """Tip of the tongue: of the parts called so, the one that reaches farthest back along the middle."""
    used = np.unique(face.triangles)
    alone = mesh.named(("tongue",)) & ~mesh.named(("gum",))  # a tongue grown to the gums would take them along
    called = used[alone[used] & (face.part[used] != face.part[face.skin[0]])]
    middle = called[np.abs(face.place[called, 0] - face.place[face.anchors["2.2"], 0]) < TOGETHER_MM]
    if not len(middle):
        return {}
    part = max(
        np.unique(face.part[middle]), key=lambda one: float(np.ptp(face.place[middle[face.part[middle] == one], 2]))
    )
    tongue = middle[face.part[middle] == part]
    return {"6.1": int(tongue[face.place[tongue, 2].argmax()])}
