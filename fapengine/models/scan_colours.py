"""Colours of a scan, painted on to our own head: "the texture is reattached" of paper 004.

The head's painting lies over angle and height, the scan's picture wherever its maker put it. For each texel of ours
the place on the head is found, then the nearest place of the scan, then its colour. Where the scan has no skin the
head's own colours go on, in the scan's tone.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import gaussian_filter, zoom

from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import Surface
from fapengine.mesh.default_head import atlas
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.placed_mesh import PlacedMesh
from fapengine.models.adapted_head import on_large_parts

Array = NDArray[np.float64]

STRIDE = 2
"""Texels of the painting, a side, that share one colour of the scan."""
REACH_MM = 4.0
"""Distance from the scan within which the head has its colour."""
MARGIN = 6
"""Texels beside the skin's part of the painting that go on in its last colour."""
BLEND_TEXELS = 5.0
"""Number of coarse texels over which the scan's colours pass into the head's own."""


def has_colours(scan: PlacedMesh) -> bool:
    """Tell whether a scan says anything about colours."""
    source = scan.source
    if source.texture is not None and source.uv is not None:
        return True
    return source.albedo is not None and bool(np.ptp(source.albedo, axis=0).max(initial=0.0) > 0.0)


def paint_from_scan(mesh: FaceMesh, scan: PlacedMesh) -> FaceMesh:
    """Give a head of ours the colours of a scan that it was adapted to.

    Parameters
    ----------
    mesh : FaceMesh
        Made by :func:`fapengine.models.adapted_head.adapt_head`.
    scan : PlacedMesh
        With colours: a picture, or a colour for each vertex.
    """
    if mesh.texture is None or not has_colours(scan):
        return mesh
    skin = np.isin(mesh.material, (Material.SKIN, Material.LIP))
    painted = skin & (mesh.uv[:, 0] > atlas.SKIN_U[0] + 1e-4) & (mesh.uv[:, 0] < atlas.SKIN_U[1] - 1e-4)
    height, width = atlas.SIZE[0] // STRIDE, round(atlas.SKIN_U[1] * atlas.SIZE[1]) // STRIDE
    rows, columns = np.indices((height, width))
    texels = (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * STRIDE / atlas.SIZE[::-1]
    known = LinearNDInterpolator(mesh.uv[painted], np.hstack([mesh.vertices_mm, mesh.albedo])[painted])(texels)
    on_head = np.isfinite(known[:, 0])
    theirs, near = _colours(scan, known[on_head, :3])
    own = _linear(mesh.texture[::STRIDE, : width * STRIDE : STRIDE, :3]).reshape(-1, 3)
    own = own * np.where(on_head[:, None], known[:, 3:], mesh.albedo[painted].mean(axis=0))
    colours, share = np.zeros((len(texels), 3)), np.zeros(len(texels))
    colours[on_head], share[on_head] = theirs, near
    tone = np.ones(3)
    if (share > 0).any():
        tone = np.median(colours[share > 0], axis=0) / np.maximum(np.median(own[share > 0], axis=0), 1e-3)
    covered = share.reshape(height, width)
    inside = covered * smoothstep(2 * gaussian_filter(covered, BLEND_TEXELS) - 1)
    mixed = (own * tone).reshape(height, width, 3)
    mixed += inside[..., None] * (colours.reshape(height, width, 3) - mixed)
    texture = mesh.texture.copy()
    fine = zoom(mixed, (STRIDE, STRIDE, 1), order=1, grid_mode=True, mode="nearest")
    texture[: fine.shape[0], : fine.shape[1], :3] = np.round(255 * np.sqrt(np.clip(fine, 0, 1)))
    end = fine.shape[1]
    texture[:, end : end + MARGIN] = texture[:, end - 1 : end]  # what is read between texels at the edge
    albedo = mesh.albedo.copy()
    on_painting = skin & (mesh.uv[:, 0] < (atlas.SKIN_U[1] + atlas.HAIR_U[0]) / 2)
    albedo[on_painting] = 1.0
    plain = skin & ~on_painting
    albedo[plain] = np.clip(albedo[plain] * tone, 0, 1)
    return replace(mesh, texture=texture, albedo=albedo)


def _linear(texture: NDArray[np.uint8]) -> Array:
    """(..., 3): linear light of a painting of ours, which keeps square roots."""
    return np.asarray((texture / 255.0) ** 2)


def _colours(scan: PlacedMesh, points: Array) -> tuple[Array, Array]:
    """Linear RGB of the scan nearest to points, (N, 3), and whether it is there, (N,) 0 or 1."""
    source, surface = scan.source, Surface(scan.vertices_mm, scan.triangles[on_large_parts(scan)])
    kept = scan.kept
    albedo = np.ones((len(kept), 3)) if source.albedo is None else source.albedo[kept]
    uv = np.zeros((len(kept), 2)) if source.uv is None else source.uv[kept]
    places, colours, at = np.split(surface.carry(np.hstack([scan.vertices_mm, albedo, uv]), points), [3, 6], axis=1)
    if source.texture is not None and source.uv is not None:
        size = np.array(source.texture.shape[1::-1])
        column, row = (at * size).astype(int).clip(0, size - 1).T
        srgb = source.texture[row, column, :3] / 255.0
        colours = colours * np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return colours, (np.linalg.norm(places - points, axis=1) <= REACH_MM).astype(float)
