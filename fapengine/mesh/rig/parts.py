"""Parts of a placed mesh: eyeballs; lashes, brows and beards that follow the skin; tongue and gums; fields of the skin.

Theory of operation
-------------------
Files often keep tongue and gums as one part. The tongue is found by the distance from its tip (feature point 6.1) along
the surface: a part that extends in front of the tip again is no longer tongue there. Gums belong to a jaw by height.

On the skin each feature point has a field that is 1 there, 0 at every other point and far away, and bends least between
them (bilaplacian of the mesh). It stops at an open mouth or lid, where the mesh has a gap. So each FAP moves its own
point by exactly its step and no other point. Followers of the skin get the weights of the nearest skin vertex.

Surfaces: normals, materials, colours and ambient light, from the file where it has them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay, cKDTree

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import (
    ambient_light,
    average_over_mesh,
    continue_smoothly,
    edges_of,
    mesh_links,
    vertex_normals,
)
from fapengine.mesh import colours
from fapengine.mesh.face_mesh import Material
from fapengine.mesh.rig.placed_mesh import PlacedMesh

EYE_CORNERS = {"3.5": ("3.7", "3.11"), "3.6": ("3.8", "3.12")}
"""Feature points of the outer and the inner corner of each eye, by its pupil."""
EYE_BONES = {"3.5": "left eye", "3.6": "right eye"}
"""Name of each eye's bone, by its pupil."""
EYE_DEPTH_MM = 11.0
"""Distance from the midpoint of the corners of the eye back to the centre of the ball."""
MAX_BALL_MM = 25.0
"""Radius beyond which an eye is not a ball."""
MAX_SHELL_RATIO = 1.2
"""Radii of an eyeball within which a whole part (cornea, tear film, the ball itself) belongs to the eye."""
MIN_BONE_WEIGHT = 0.5
"""Weight of the eye's bone from which a vertex belongs to the eyeball."""
LID_AND_BROW_POINTS = ("3.1", "3.2", "3.3", "3.4", "3.7", "3.8", "3.11", "3.12", *(f"4.{n}" for n in range(1, 7)))
MAX_FOLLOWER_MM = 14.0
"""Distance from lids and brows within which a whole part grows there."""
FOLLOWING_WORDS = ("lash", "brow", "beard", "mustache", "moustache", "stubble")
"""Words in the names of surfaces that follow the skin below them."""


class Eyeball(NamedTuple):
    """One eye of a placed mesh."""

    vertices: Indices
    """(N,), may be empty."""
    centre_mm: Array
    """(3,) mm, head space."""


Eyes = dict[str, Eyeball]
"""Eyeballs by the feature point of their pupil."""


def find_eyes(mesh: PlacedMesh) -> Eyes:
    """Find the eyeballs: by their bones, else around the pupils, else behind the corners of the eyes."""
    eyes = {pupil: eye for pupil in EYE_CORNERS if (eye := _eye_by_shape(mesh, pupil)) is not None}
    for pupil, name in EYE_BONES.items():
        if name in mesh.source.bones:
            bone = mesh.source.bones[name]
            ball = np.flatnonzero(bone.weight[mesh.kept] > MIN_BONE_WEIGHT)
            if len(ball):
                eyes[pupil] = Eyeball(ball, mesh.to_head_space(bone.joint))
    return eyes


def _eye_by_shape(mesh: PlacedMesh, pupil: str) -> Eyeball | None:
    """Find an eyeball around its pupil or behind its corners, with the shells around it; None without such points."""
    part, vertices = mesh.part, mesh.vertices_mm
    corners = [vertices[mesh.points[name]] for name in EYE_CORNERS[pupil] if name in mesh.points]
    if pupil in mesh.points and part[mesh.points[pupil]] != mesh.skin_part:
        ball = np.flatnonzero(part == part[mesh.points[pupil]])
        centre = _sphere_centre(vertices[ball])
        radius = np.linalg.norm(vertices[ball] - centre, axis=1).max()
    elif len(corners) == 2:
        ball, centre = np.zeros(0, np.int64), np.mean(corners, axis=0) - [0.0, 0.0, EYE_DEPTH_MM]
        radius = 1.5 * EYE_DEPTH_MM
    else:
        return None
    near = np.linalg.norm(vertices - centre, axis=1) < MAX_SHELL_RATIO * radius
    shells = [number for number in np.unique(part[near]) if number != mesh.skin_part and near[part == number].all()]
    return Eyeball(np.union1d(ball, np.flatnonzero(np.isin(part, shells))).astype(np.int64), centre)


def _sphere_centre(points: Array) -> Array:
    """Fit a sphere to (N, 3): |p|^2 = 2 c.p + k, linear in centre and k; a cap of the ball is enough."""
    middle = points.mean(axis=0)
    arm = points - middle
    solution, *_ = np.linalg.lstsq(np.column_stack([2 * arm, np.ones(len(arm))]), (arm**2).sum(axis=1), rcond=None)
    return middle + solution[:3]


def turning_share(mesh: PlacedMesh, eye: Eyeball) -> float:
    """Share of a gaze by which an eye turns; below 1 for a flat eye, as VRoid's, whose joint is far behind it."""
    distance = np.linalg.norm(mesh.vertices_mm[eye.vertices] - eye.centre_mm, axis=1)
    return MAX_BALL_MM / max(float(np.median(distance)), MAX_BALL_MM) if len(distance) else 1.0


def find_followers(mesh: PlacedMesh, eyes: Eyes) -> tuple[Indices, Indices]:
    """Find lashes, brows and beards that are not part of the skin, and the skin vertex that each follows.

    They are found by the names of their surfaces, and small parts at lids and brows by their place.

    Returns
    -------
    (M,) int64
        Vertices that follow.
    (M,) int64
        Index in :attr:`PlacedMesh.skin` of the nearest vertex to each.
    """
    vertices, skin = mesh.vertices_mm, mesh.skin
    free = mesh.part != mesh.skin_part
    for eye in eyes.values():
        free[eye.vertices] = False
    follows = free & mesh.source.on_surfaces(FOLLOWING_WORDS)[mesh.kept]
    hair_points = [vertices[index] for name, index in mesh.points.items() if name in LID_AND_BROW_POINTS]
    if hair_points:
        near = cKDTree(np.stack(hair_points)).query(vertices)[0] < MAX_FOLLOWER_MM
        wholly_near = np.bincount(mesh.part, near) == np.bincount(mesh.part)
        follows |= free & wholly_near[mesh.part]
    followers = np.flatnonzero(follows)
    return followers, np.asarray(cKDTree(vertices[skin]).query(vertices[followers])[1], np.int64)


IN_FRONT_MM = 2.0
"""Distance in front of the tip from which a surface is not tongue."""
FRONT_MM, BOTH_JAWS_MM = 10.0, 10.0
"""Depth of the front of a part, and its reach above and below the mouth line from which it belongs to both jaws."""
BETWEEN_JAWS_MM = 6.0
"""Distance from the mouth line at which a part of both jaws follows the lower one fully, or not at all."""
ROOT_SHARE = 0.25
"""Position from root to tip from which a tongue follows the lower jaw fully."""


@dataclass(frozen=True, slots=True, eq=False)
class Tongue:
    """Vertices of a tongue and of connected gums, and the fraction of the tip's motion that they follow."""

    vertices: Indices
    """(N,): those of the part with the tip."""
    share: Array
    """(N,): position from root, 0, to tip, 1; 0 on gums."""


def find_tongue(mesh: PlacedMesh) -> Tongue | None:
    """Find the tongue by its tip; None if that is unknown or on the skin."""
    if "6.1" not in mesh.points or mesh.part[mesh.points["6.1"]] == mesh.skin_part:
        return None
    tip = mesh.points["6.1"]
    vertices = np.flatnonzero(mesh.part == mesh.part[tip])
    distance = _distances(mesh, tip)[vertices]
    in_front = mesh.vertices_mm[vertices, 2] > mesh.vertices_mm[tip, 2] + IN_FRONT_MM
    root = max(float(np.min(distance, where=in_front, initial=distance.max())), 1.0)
    return Tongue(vertices, np.clip(1.0 - distance / root, 0.0, 1.0))


def _distances(mesh: PlacedMesh, start: int) -> Array:
    """(V,) mm: distance along the edges from a vertex; infinite on other parts."""
    place = mesh.nodes_mm
    edges = np.unique(np.sort(edges_of(mesh.node[mesh.triangles])), axis=0)
    long_mm = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1).clip(min=1e-6)
    links = csr_array((long_mm, (edges[:, 0], edges[:, 1])), shape=(len(place), len(place)))
    return dijkstra(links, directed=False, indices=mesh.node[[start]])[0, mesh.node]


def share_of_lower_jaw(mesh: PlacedMesh, tongue: Tongue | None, part: Indices) -> Array | None:
    """(N,) 0..1: fraction by which vertices of a part, (N,), follow the lower jaw; None if it is not of both jaws."""
    place, mouth_line = mesh.vertices_mm[part], mesh.mouth_line_mm
    front = place[place[:, 2] > place[:, 2].max() - FRONT_MM, 1] - mouth_line
    if min(front.max(), -front.min()) < BOTH_JAWS_MM:
        return None
    lower = smoothstep(0.5 + (mouth_line - place[:, 1]) / (2 * BETWEEN_JAWS_MM))
    if tongue is None or tongue.vertices[0] not in part:
        return lower
    return np.maximum(lower, smoothstep(tongue.share / ROOT_SHARE))


MAX_REACH_MM = 34.0
"""Distance from every feature point beyond which skin does not move."""
MIN_SHARE = 0.004
"""Weight below which motion is not visible."""
CHIN_POINTS = ("2.1", "2.10", "2.11", "2.12")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointFields:
    """The skin, its followers, and the weight of each in the motion of every feature point on it."""

    points: dict[str, int]
    """Vertices of the feature points on the skin."""
    skin: Indices
    """(S,): vertices of the skin."""
    followers: Indices
    """(M,): vertices that follow the skin."""
    nearest: Indices
    """(M,): skin vertex that each follows."""
    vertices: Indices
    """(S + M,): those of the skin, then its followers."""
    shares: dict[str, Array]
    """(S + M,) by feature point: 1 at the point, 0 at the others."""
    jaw: Array
    """(S + M,): weight in the chin's motion, 0..1."""


def fit_point_fields(mesh: PlacedMesh, eyes: Eyes) -> PointFields:
    """Extend the motion of each feature point, and of the chin, over the skin of a placed mesh."""
    points = {name: index for name, index in mesh.points.items() if mesh.part[index] == mesh.skin_part}
    skin, (followers, nearest) = mesh.skin, find_followers(mesh, eyes)
    shares = _continued(mesh, points, np.eye(len(points)))
    shares[np.abs(shares) < MIN_SHARE] = 0.0
    at_chin = np.array([[float(name in CHIN_POINTS)] for name in points])
    jaw = np.clip(_continued(mesh, points, at_chin)[:, 0], 0.0, 1.0)
    with_followers = np.concatenate([np.arange(len(skin)), nearest])
    return PointFields(
        points=points, skin=skin, followers=followers, nearest=skin[nearest],
        vertices=np.concatenate([skin, followers]),
        shares={name: share[with_followers] for name, share in zip(points, shares.T, strict=True)},
        jaw=jaw[with_followers],
    )  # fmt: skip


def _continued(mesh: PlacedMesh, points: dict[str, int], values: Array) -> Array:
    """(S, C): values at the feature points, (P, C), extended over the skin; 0 far from all of them."""
    skin, anchors = mesh.skin, list(points.values())
    nodes = np.unique(mesh.node[skin])
    local = np.full(mesh.node.max() + 1, -1)
    local[nodes] = np.arange(len(nodes))
    position = np.zeros((len(nodes), 3))
    position[local[mesh.node[skin]]] = mesh.vertices_mm[skin]
    fixed = np.asarray(cKDTree(mesh.vertices_mm[anchors]).query(position)[0] > MAX_REACH_MM)
    fixed[local[mesh.node[anchors]]] = True
    fixed_values = np.zeros((len(nodes), values.shape[1]))
    fixed_values[local[mesh.node[anchors]]] = values
    corners = local[mesh.node[mesh.triangles]]
    continued = continue_smoothly(fixed_values, fixed, corners[(corners >= 0).all(axis=1)])
    return continued[local[mesh.node[skin]]]


LIP_OUTLINE = ("8.3", "8.5", "8.1", "8.6", "8.4", "8.8", "8.2", "8.7")
LIP_DEPTH_MM = 6.0
"""Distance behind the outline of the lips within which skin is coloured as lip."""
IRIS_COSINE, WHITE_COSINE = 0.93, 0.5
"""Cosines of the angles from the front, about 22 and 60 degrees, at which an iris and the white around it end."""
BALL_TOLERANCE = 0.03
"""Difference of a vertex's distance from the centre of the eye, in radii, above which it is on a lid, a lash or a duct.
"""
MIN_IRIS_CONTRAST = 0.15
"""Colour difference within an eyeball that has an iris; one is drawn on others."""
SURFACE_MATERIALS = (
    (("tooth", "teeth"), Material.TEETH), (("tongue",), Material.TONGUE), (("gum",), Material.GUM),
    (("lash",), Material.LASH), (("hair", "brow", "beard"), Material.HAIR),
    (("cloth", "shirt", "outfit", "dress", "top", "body_suit"), Material.CLOTH),
)  # fmt: skip
"""Words in the names of surfaces, and the material that they mean."""
PAINTS = {
    Material.EYE: colours.EYE, Material.GUM: colours.GUM, Material.TONGUE: colours.TONGUE, Material.LASH: colours.LASH,
    Material.HAIR: np.array([0.055, 0.032, 0.02]), Material.CLOTH: colours.CLOTH,
}  # fmt: skip
"""Linear RGB of materials without colours in the file; other parts next to the skin are taken as teeth."""
MIN_MOUTH_LIGHT = 0.45
"""Least fraction of ambient light inside the mouth: it was computed with the mouth closed."""


def smooth_normals(mesh: PlacedMesh) -> Array:
    """(V, 3): unit normals, smooth over seams."""
    return vertex_normals(mesh.nodes_mm, mesh.node[mesh.triangles])[mesh.node]


def baked_light(mesh: PlacedMesh, normals: Array, material: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(V,): fraction of ambient light that arrives, 0..1."""
    light = average_over_mesh(ambient_light(mesh.vertices_mm, normals), mesh_links(mesh.triangles, len(normals)), 2)
    inside = np.isin(material, (Material.TEETH, Material.TONGUE, Material.GUM))
    light = np.clip(light, 0.0, 1.0)
    return np.asarray(np.where(inside, np.maximum(light, MIN_MOUTH_LIGHT), light), np.float32)


def blank_eyes(mesh: PlacedMesh, eyes: Eyes) -> Eyes:
    """Eyeballs of the mesh without an iris in their colours."""
    return {pupil: eye for pupil, eye in eyes.items() if len(eye.vertices) and not _has_iris(mesh, eye)}


def _has_iris(mesh: PlacedMesh, eye: Eyeball) -> bool:
    """Whether the colours of an eyeball differ between its front and the region around it."""
    source, ball = mesh.source, mesh.kept[eye.vertices]
    arm = mesh.vertices_mm[eye.vertices] - eye.centre_mm
    radius = np.maximum(np.linalg.norm(arm, axis=1), 1e-9)
    on_ball = np.abs(radius / np.median(radius) - 1.0) < BALL_TOLERANCE
    cosine = np.where(on_ball, arm[:, 2] / radius, -1.0)
    iris, white = cosine > IRIS_COSINE, (cosine < IRIS_COSINE) & (cosine > WHITE_COSINE)
    colour = np.ones((len(ball), 3)) if source.albedo is None else source.albedo[ball]
    if source.texture is not None and source.uv is not None:
        height, width = source.texture.shape[:2]
        column, row = (source.uv[ball] * (width, height)).astype(int).clip(0, (width - 1, height - 1)).T
        colour = colour * source.texture[row, column, :3] / 255.0
    # An eye drawn on a flat piece of skin, as VRoid's, turns about a joint far away, so it has no sides to compare.
    if not iris.any() or not white.any() or turning_share(mesh, eye) < 1.0:
        return bool(np.ptp(colour, axis=0).max(initial=0.0) > MIN_IRIS_CONTRAST)
    return bool(np.abs(colour[iris].mean(axis=0) - colour[white].mean(axis=0)).max() > MIN_IRIS_CONTRAST)


def choose_materials(mesh: PlacedMesh, eyes: Eyes, blank: Eyes) -> NDArray[np.uint8]:
    """(V,) :class:`fapengine.mesh.face_mesh.Material`, by the names of surfaces; ``blank`` eyes get an iris drawn."""
    material = np.full(len(mesh.kept), Material.SKIN, np.uint8)
    for words, kind in SURFACE_MATERIALS:
        material[mesh.source.on_surfaces(words)[mesh.kept]] = kind
    for pupil, eye in eyes.items():
        if pupil in blank:
            material[eye.vertices] = Material.EYE
        elif turning_share(mesh, eye) == 1.0:  # a flat eye would be one large highlight
            material[eye.vertices] = Material.BALL
    return material


def texture_coordinates(mesh: PlacedMesh, blank: Eyes) -> Array:
    """(V, 2): coordinates in the file's texture; on ``blank`` eyes the plane for drawing an iris."""
    source = mesh.source
    has_uv = source.uv is not None and (source.texture is not None or _is_painted(mesh))
    uv = source.uv[mesh.kept] if source.uv is not None and has_uv else np.zeros((len(mesh.kept), 2))
    for ball, centre in blank.values():
        arm = mesh.vertices_mm[ball] - centre
        uv[ball] = 0.5 + 0.5 * (arm / np.linalg.norm(arm, axis=1, keepdims=True))[:, :2]
    return uv


def _is_painted(mesh: PlacedMesh) -> bool:
    """Whether the vertex colours of the file differ from one default for all."""
    albedo = mesh.source.albedo
    return albedo is not None and len(albedo) > 0 and bool(np.ptp(albedo, axis=0).max() > 0.0)


def choose_colours(mesh: PlacedMesh, material: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(V, 3) linear RGB: colours of the file; without any, skin, lips and the inside of the mouth are painted."""
    source = mesh.source
    if source.albedo is not None and (source.texture is not None or _is_painted(mesh)):
        return np.asarray(np.clip(source.albedo[mesh.kept], 0, 1), np.float32)
    vertices, knows_lips = mesh.vertices_mm, "8.1" in mesh.points
    skin = mesh.skin if knows_lips else np.flatnonzero(~np.isin(material, (*PAINTS, Material.TEETH)))
    painted = np.broadcast_to(colours.TEETH, vertices.shape).copy()
    for kind, colour in PAINTS.items():
        painted[material == kind] = colour
    painted[skin] = colours.Palette.of().skin(vertices[skin])
    if knows_lips:
        lips = np.zeros(len(vertices))
        lips[_lips(vertices, skin, mesh.positions)] = 1.0
        share = average_over_mesh(lips, mesh_links(mesh.triangles, len(lips)), 2)[:, None]
        painted = np.where(share > 0, painted + share * (colours.LIP - painted), painted)
    return np.asarray(np.clip(painted, 0, 1), np.float32)


def _lips(vertices_mm: Array, skin: Indices, positions: Mapping[str, Array]) -> Indices:
    """Vertices of the skin within the outline of the lips."""
    outline = np.stack([positions[name] for name in LIP_OUTLINE if name in positions])
    front = vertices_mm[skin, 2] > outline[:, 2].min() - LIP_DEPTH_MM
    return skin[(Delaunay(outline[:, :2]).find_simplex(vertices_mm[skin, :2]) >= 0) & front]
