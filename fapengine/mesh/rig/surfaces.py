"""Surfaces of an imported head: normals, materials, colours and ambient light, from the file where it has them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from fapengine._arrays import Array, Indices
from fapengine.geometry.surface import ambient_light, average_over_mesh, vertex_normals
from fapengine.mesh import colours
from fapengine.mesh.face_mesh import Material
from fapengine.mesh.rig.parts import Eyeball, Eyes, turning_share
from fapengine.mesh.rig.placed_mesh import PlacedMesh

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
    light = average_over_mesh(ambient_light(mesh.vertices_mm, normals), mesh.triangles, 2)
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
        share = average_over_mesh(lips, mesh.triangles, 2)[:, None]
        painted = np.where(share > 0, painted + share * (colours.LIP - painted), painted)
    return np.asarray(np.clip(painted, 0, 1), np.float32)


def _lips(vertices_mm: Array, skin: Indices, positions: Mapping[str, Array]) -> Indices:
    """Vertices of the skin within the outline of the lips."""
    outline = np.stack([positions[name] for name in LIP_OUTLINE if name in positions])
    front = vertices_mm[skin, 2] > outline[:, 2].min() - LIP_DEPTH_MM
    return skin[(Delaunay(outline[:, :2]).find_simplex(vertices_mm[skin, :2]) >= 0) & front]
