"""What is what on somebody's mesh: its place, parts, eyes and colours; for :mod:`fapengine.mesh.adopted`."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import fit_rigid
from fapengine.mesh import colours
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.patch import bake_occlusion, smooth_over_mesh, vertex_normals
from fapengine.mpeg4.fapu import Fapu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NEEDED = ("8.1", "8.2", "8.3", "8.4", "2.1")
LEAST_POINTS = 8
MIRROR_RATIO = 0.6
MERGED_MM, SAME_SIDE = 1e-3, 0.3
"""Vertices nearer than this are one if the cosine between their normals exceeds the second number."""
SMALLEST_SIZE = 1e-9
LIP_OUTLINE = ("8.3", "8.5", "8.1", "8.6", "8.4", "8.8", "8.2", "8.7")
CORNERS = {"3.5": ("3.7", "3.11"), "3.6": ("3.8", "3.12")}
EYE_DEPTH_MM = 11.0
"""From the middle of the eye's corners back to the ball's centre."""
SHELL = 1.2
"""Parts wholly within so many radii of an eyeball (cornea, tear film, the ball itself) are eye too."""

PAINTS = {
    Material.EYE: colours.EYE, Material.GUM: colours.GUM, Material.TONGUE: colours.TONGUE, Material.LASH: colours.LASH,
    Material.HAIR: np.array([0.055, 0.032, 0.02]), Material.CLOTH: colours.CLOTH,
}  # fmt: skip
"""Linear RGB of what a file gives no colour; anything else beside the skin is taken for teeth."""
LEAST_LIGHT = 0.45
"""What is in the mouth gets at least so much light: it was measured with the mouth shut."""
AT_LIDS_AND_BROWS = ("3.1", "3.2", "3.3", "3.4", "3.7", "3.8", "3.11", "3.12", *(f"4.{n}" for n in range(1, 7)))
BESIDE_MM = 14.0
"""A part nowhere farther than this from lids and brows grows there."""

Eyes = dict[str, tuple[Indices, Array]]
"""By pupil: the ball's vertices, possibly none, and its centre."""


def check(points: Mapping[str, int], count: int, faces: Indices) -> None:
    """Refuse too few points, points of one vertex, and vertices that are not there."""
    lacking = [name for name in NEEDED if name not in points]
    if lacking or len(points) < LEAST_POINTS:
        raise DataError(
            f"feature points: got {len(points)} ({', '.join(sorted(points))}), expected at least {LEAST_POINTS} with"
            f" {', '.join(NEEDED)} among them"
        )
    if not len(faces) or faces.min() < 0 or faces.max() >= count:
        raise DataError(f"triangles: got {len(faces)}, expected vertices 0..{count - 1} in at least one")
    for name, index in points.items():
        if not 0 <= index < count or not (faces == index).any():
            raise DataError(f"feature point {name}: got vertex {index}, expected one of a triangle, 0..{count - 1}")
        other = next((one for one, same in points.items() if same == index and one != name), None)
        if other is not None:
            raise DataError(f"feature points {name} and {other}: got one vertex for both, {index}")


def place(given: Array, points: Mapping[str, int], standard: FaceMesh) -> tuple[Array, float, Array]:
    """Lay the mesh onto the standard's face: where it lies, mm for one unit, and the rotation."""
    common = [name for name in points if name in standard.feature_points]
    ours = given[[points[name] for name in common]]
    theirs = np.stack([standard.point_mm(name) for name in common]).astype(np.float64)
    centre, goal = ours.mean(axis=0), theirs.mean(axis=0)
    ours, theirs = ours - centre, theirs - goal
    size = float(np.sqrt((ours**2).sum()))
    if not size > SMALLEST_SIZE:
        raise DataError(f"feature points: got all within {size:.3g} units, expected a face")
    scale = float(np.sqrt((theirs**2).sum())) / size

    def fit(one: Array) -> tuple[Array, float]:
        try:
            motion = fit_rigid(scale * one, theirs)
        except UsageError as error:
            raise DataError(f"feature points: {error}") from error
        return motion.rotation, float(np.linalg.norm(motion.apply(scale * one) - theirs))

    rotation, off = fit(ours)
    if fit(ours * [-1.0, 1.0, 1.0])[1] < MIRROR_RATIO * off:
        raise DataError("feature points: left and right are exchanged (left is the subject's)")
    return scale * (given - centre) @ rotation.T + goal, scale, rotation


def parts(placed: Array, faces: Indices) -> tuple[Indices, Indices]:
    """For each vertex the number of its place, and of the connected part that it belongs to.

    Copies along a seam are one place; lips or lids that touch are not, because they face each other.
    """
    _, first, spot = np.unique(
        np.round(placed / MERGED_MM).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    normals = vertex_normals(placed, faces)
    apart = (normals * normals[first[spot.ravel()]]).sum(axis=1) < SAME_SIDE
    node = np.unique(2 * spot.ravel() + apart, return_inverse=True)[1].ravel()
    corners = node[faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    count = int(node.max()) + 1
    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return node, connected_components(links, directed=False)[1][node].astype(np.int64)


def measure(at: Mapping[str, Array], standard: FaceMesh, notes: list[str]) -> Fapu:
    """Measure the face's units; a face that lacks their points has the standard's, and a note."""
    try:
        return Fapu.measure(at)
    except UsageError as error:
        notes.append(f"FAPU: {error}; the standard face's, with this mouth's width")
        own = standard.fapu
        return Fapu(
            irisd0_mm=own.irisd0_mm, es0_mm=own.es0_mm, ens0_mm=own.ens0_mm, mns0_mm=own.mns0_mm,
            mw0_mm=float(at["8.3"][0] - at["8.4"][0]),
        )  # fmt: skip


def find_eyes(placed: Array, part: Indices, points: Mapping[str, int], at: Mapping[str, Array], skin: Indices) -> Eyes:
    """Find the eyeballs: around the pupils, or behind the corners of the eyes."""
    eyes: Eyes = {}
    for pupil, corners in CORNERS.items():
        known = [at[name] for name in corners if name in at]
        if pupil in points and part[points[pupil]] != part[skin[0]]:
            ball = np.flatnonzero(part == part[points[pupil]])
            centre = _sphere_centre(placed[ball])
        elif len(known) == 2:
            ball, centre = np.zeros(0, np.int64), np.mean(known, axis=0) - [0.0, 0.0, EYE_DEPTH_MM]
        else:
            continue
        radius = np.linalg.norm(placed[ball] - centre, axis=1).max() if len(ball) else 1.5 * EYE_DEPTH_MM
        near = np.linalg.norm(placed - centre, axis=1) < SHELL * radius
        shells = [one for one in np.unique(part[near]) if one != part[skin[0]] and near[part == one].all()]
        eyes[pupil] = (np.union1d(ball, np.flatnonzero(np.isin(part, shells))).astype(np.int64), centre)
    return eyes


def followers(
    placed: Array, part: Indices, at: Mapping[str, Array], skin: Indices, eyes: Eyes, called: Indices
) -> tuple[Indices, Indices]:
    """Find lashes, brows and beards that are no part of the skin, and what of it each follows.

    Parameters
    ----------
    placed : (V, 3) mm
    part : (V,)
    at : dict of str to (3,) mm
        Feature points.
    skin : (S,)
        Its vertices.
    eyes : Eyes
        What is no follower.
    called : (N,)
        Vertices that are known to follow, by their name; small parts at lids and brows are found besides.

    Returns
    -------
    (M,) int64
        Vertices.
    (M,) int64
        Which of the skin's, 0..S-1, is nearest to each.
    """
    free = np.ones(len(placed), bool)
    free[skin] = False
    for ball, _ in eyes.values():
        free[ball] = False
    beside = [place for name, place in at.items() if name in AT_LIDS_AND_BROWS]
    found = np.zeros(len(placed), bool)
    if beside:
        near = cKDTree(np.stack(beside)).query(placed)[0] < BESIDE_MM
        whole = np.bincount(part, near) == np.bincount(part)
        found = whole[part] & free
    found[called] = free[called]
    vertices = np.flatnonzero(found)
    return vertices, np.asarray(cKDTree(placed[skin]).query(placed[vertices])[1], np.int64)


def _sphere_centre(ball: Array) -> Array:
    """Fit a sphere: |p|^2 = 2 c.p + k, linear in centre and k; a cap of the ball is enough."""
    middle = ball.mean(axis=0)
    arm = ball - middle
    found, *_ = np.linalg.lstsq(np.column_stack([2 * arm, np.ones(len(arm))]), (arm**2).sum(axis=1), rcond=None)
    centre: Array = middle + found[:3]
    return centre


def smooth_normals(placed: Array, faces: Indices, node: Indices) -> Array:
    """Take normals that are smooth over seams."""
    first = np.zeros(node.max() + 1, np.int64)
    first[node] = np.arange(len(node))
    normals: Array = vertex_normals(placed[first], node[faces])[node]
    return normals


def occlusion(placed: Array, normals: Array, faces: Indices, material: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Share of the ambient light that arrives."""
    light = np.clip(smooth_over_mesh(bake_occlusion(placed, normals), faces, 2), 0.0, 1.0)
    inside = np.isin(material, (Material.TEETH, Material.TONGUE, Material.GUM))
    return np.asarray(np.where(inside, np.maximum(light, LEAST_LIGHT), light), np.float32)


def iris_plane(placed: Array, eyes: Eyes) -> NDArray[np.float32]:
    """Give eyeballs the plane that their shader draws the iris on."""
    uv: NDArray[np.float32] = np.zeros((len(placed), 2), np.float32)
    for ball, centre in eyes.values():
        if len(ball):
            arm = placed[ball] - centre
            uv[ball] = 0.5 + 0.5 * (arm / np.linalg.norm(arm, axis=1, keepdims=True))[:, :2]
    return uv


def materials(placed: Array, eyes: Eyes) -> NDArray[np.uint8]:
    """Tell skin from eyes."""
    material = np.full(len(placed), Material.SKIN, np.uint8)
    for ball, _ in eyes.values():
        material[ball] = Material.EYE
    return material


def paint(
    placed: Array, albedo: Array | None, at: Mapping[str, Array], skin: Indices, faces: Indices,
    material: NDArray[np.uint8],
) -> NDArray[np.float32]:  # fmt: skip
    """Take the file's colours, or paint skin and lips, and what is inside of the mouth."""
    if albedo is not None:
        return np.asarray(np.clip(albedo, 0, 1), np.float32)
    painted = np.broadcast_to(colours.TEETH, placed.shape).copy()
    for kind, colour in PAINTS.items():
        painted[material == kind] = colour
    painted[skin] = colours.skin(placed[skin])
    outline = [at[name] for name in LIP_OUTLINE if name in at]
    hull = Delaunay(np.stack(outline)[:, :2])
    near = placed[skin, 2] > min(point[2] for point in outline) - 6.0
    lips = skin[(hull.find_simplex(placed[skin, :2]) >= 0) & near]
    mask = np.zeros(len(placed))
    mask[lips] = 1.0
    share = smooth_over_mesh(mask, faces, 2)[:, None]
    painted = np.where(share > 0, painted + share * (colours.LIP - painted), painted)
    return np.asarray(np.clip(painted, 0, 1), np.float32)
