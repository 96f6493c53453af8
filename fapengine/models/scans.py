"""A model and scans of a face: a model of few points fitted to a scan, and the scan's colours on a head.

Theory of operation
-------------------
Paper 003, section 4.2: find the rigid motion and the weights ``z`` for which the model's points
``R (mean + sum z_k u_k) + t`` lie on the scan. Each step pairs every point with its closest place on the scan and
solves one linear system (Gauss-Newton) for all unknowns at once, minimising

    sum_i w_i (n_i . off_i)^2 / noise^2  +  sum_landmarks |off|^2 / landmark_noise^2  +  |z|^2.

* Distances are measured along the scan's normal, so that points may slide while the motion is still wrong.
* Sliding leaves no trace in the surface residual: half a millimetre of it can hide seven along the skin. The landmarks
  stop it, and ``|z|^2``, the modes' own distribution, keeps faces plausible where the scan has holes.
* A posture that the modes do not reach leaves a residual at the landmarks. It is spread over the points near them, the
  less the more it is of the size of the landmarks' own noise.
* Points that pair with the rim of a hole, or are far off, lose their weight (Tukey's, with a scale from the median).

Colours ("the texture is reattached", paper 004): the head's texture is laid out over angle and height, the scan's in
any way. For each texel of the head its place is found, then the nearest place of the scan, then its colour. Where the
scan has no skin, the head keeps its own colours, in the scan's tone.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import gaussian_filter, zoom
from scipy.spatial.transform import Rotation

from fapengine._arrays import Array, freeze, frozen
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import RigidMotion, fit_rigid
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import Surface
from fapengine.mesh.colours import linear_rgb
from fapengine.mesh.default_head.mesh_builder import HAIR_U, SKIN_U, TEXTURE_SIZE
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.placed_mesh import PlacedMesh
from fapengine.models.adapted_head import on_large_parts
from fapengine.models.generic_mesh import spread
from fapengine.models.missing import GapModel

MIN_LANDMARKS = 3
"""Landmarks to start from; six or more hold the fit (see the theory of operation)."""
LANDMARK_REACH_MM = 20.0
"""Distance in which the landmarks' residual falls to 1/e."""
TUKEY = 4.685
MAX_STEPS, LAST_STEP_MM = 40, 1e-4
SETTLED_MM = 0.02
"""Longest last step of a fit that has settled. A point at an edge may be paired with either facet in turn: 12 um."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScanFit:
    """Pose of a scan, and the face of the model that it shows. Arrays are read-only."""

    scan_from_model: RigidMotion
    scores: Array
    """(K,): weights, in the modes' standard deviations."""
    points_mm: Array
    """(M, 3): the model's points in the model's space, moved by what the weights leave at the landmarks."""
    surface_rms_mm: float
    """Root mean square of the trusted points' distances along the normal. It does not show sliding."""
    landmark_rms_mm: float
    """Root mean square of the distances to the landmarks; it shows sliding too."""
    settled: bool
    """True if the last step moved no point by :data:`SETTLED_MM`."""

    def __post_init__(self) -> None:
        freeze(self, scores=("K",), points_mm=("M", 3))


def fit_scan(
    model: GapModel,
    scan: Surface,
    landmarks: ArrayLike,
    landmarks_mm: ArrayLike,
    *,
    noise_mm: float = 0.5,
    landmark_noise_mm: float = 1.0,
) -> ScanFit:
    """Find motion and weights that fit ``model`` to ``scan``.

    Parameters
    ----------
    scan : Surface
        In any pose.
    landmarks : (L,) array_like of int
        Points of the model that were found on the scan; at least 3, not on one line, better 6 and spread.
    landmarks_mm : (L, 3) array_like, mm
        Where they were found.
    noise_mm, landmark_noise_mm : float
        Standard deviations of the scan's surface (the model's own noise adds) and of the landmarks.
    """
    marks = np.asarray(landmarks, dtype=np.intp)
    mark_points = frozen(landmarks_mm, "landmarks_mm", (len(marks), 3), np.float64)
    count = len(model.mean_mm)
    if len(marks) < MIN_LANDMARKS or len(set(marks.tolist())) < len(marks) or marks.min() < 0 or marks.max() >= count:
        raise UsageError(
            f"landmarks: must be at least {MIN_LANDMARKS} different points 0 to {count - 1}, got {marks.tolist()}"
        )
    if not (noise_mm > 0 and landmark_noise_mm > 0):
        raise UsageError(f"noise_mm, landmark_noise_mm: got {noise_mm}, {landmark_noise_mm}, expected positive lengths")
    noise = np.hypot(noise_mm, model.noise_mm)
    motion = fit_rigid(model.mean_mm[marks], mark_points)
    scores = np.zeros(len(model.modes_mm))
    points, step_mm = motion.apply(model.mean_mm), np.inf
    for _ in range(MAX_STEPS):
        pairs = _pair(points, scan, noise)
        motion, scores = _step(model, motion, scores, pairs, marks, mark_points, noise, landmark_noise_mm)
        before, points = points, motion.apply(model.rebuild(scores))
        step_mm = float(np.abs(points - before).max())
        if step_mm < LAST_STEP_MM:
            break
    pairs = _pair(points, scan, noise)
    off = ((points - pairs.places) * pairs.normals).sum(-1)
    left = mark_points - points[marks]
    square = float((left**2).sum(-1).mean())
    moved = spread(points[marks], left, points, LANDMARK_REACH_MM, landmark_noise_mm**2 / max(square, 1e-12))
    return ScanFit(
        scan_from_model=motion,
        scores=scores,
        points_mm=motion.inverse().apply(points + moved),
        surface_rms_mm=float(np.sqrt((pairs.trust * off**2).sum() / pairs.trust.sum())),
        landmark_rms_mm=float(np.sqrt(square)),
        settled=step_mm < SETTLED_MM,
    )


class _Pairs(NamedTuple):
    places: Array  # (M, 3)
    normals: Array  # (M, 3)
    trust: Array  # (M,)


def _pair(points: Array, scan: Surface, noise: float) -> _Pairs:
    places, normals, on_rim = scan.closest(points)
    distance = np.linalg.norm(points - places, axis=1)
    scale = max(1.4826 * float(np.median(distance[~on_rim])) if (~on_rim).any() else 0.0, noise)
    trust = np.where(on_rim, 0.0, np.maximum(1.0 - (distance / (TUKEY * scale)) ** 2, 0.0) ** 2)
    return _Pairs(places, normals, trust)


def _step(
    model: GapModel,
    motion: RigidMotion,
    scores: Array,
    pairs: _Pairs,
    marks: NDArray[np.intp],
    mark_points: Array,
    noise: float,
    landmark_noise: float,
) -> tuple[RigidMotion, Array]:
    """One Gauss-Newton step in (turn about the centroid, shift, weights)."""
    unknowns = 6 + len(scores)
    if (pairs.trust > 0).sum() + 3 * len(marks) < unknowns:
        raise DataError(
            f"scan: needs at least {unknowns - 3 * len(marks)} points that find it, got {(pairs.trust > 0).sum()}"
        )
    points = motion.apply(model.rebuild(scores))
    centre = points.mean(axis=0)
    arms = points - centre
    modes = np.einsum("ab,kmb->mak", motion.rotation, model.modes_mm)  # (M, 3, K)
    turn = np.zeros((len(points), 3, 3))  # d point / d turn = -[arm]x
    turn[:, 0, 1], turn[:, 0, 2], turn[:, 1, 2] = arms[:, 2], -arms[:, 1], arms[:, 0]
    turn -= np.swapaxes(turn, 1, 2)
    jacobian = np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape), modes], axis=2)
    weight = np.sqrt(pairs.trust) / noise
    rows = weight[:, None] * np.einsum("ma,mau->mu", pairs.normals, jacobian)
    left = weight * ((points - pairs.places) * pairs.normals).sum(-1)
    mark_rows = jacobian[marks].reshape(-1, unknowns) / landmark_noise
    mark_left = (points[marks] - mark_points).ravel() / landmark_noise
    normal = rows.T @ rows + mark_rows.T @ mark_rows
    right = rows.T @ left + mark_rows.T @ mark_left
    normal[range(6, unknowns), range(6, unknowns)] += 1.0
    right[6:] += scores
    change = -np.linalg.solve(normal, right)
    rotation = Rotation.from_rotvec(change[:3]).as_matrix()
    shift = rotation @ (motion.translation_mm - centre) + centre + change[3:6]
    return RigidMotion(rotation @ motion.rotation, shift), scores + change[6:]


STRIDE = 2
"""Side of the square of texels that gets one colour of the scan."""
REACH_MM = 4.0
"""Distance from the scan within which the head gets its colour."""
MARGIN = 6
"""Texels next to the skin's part of the texture that continue its last colour."""
BLEND_TEXELS = 5.0
"""Number of coarse texels over which the scan's colours blend into the head's own."""


def has_colours(scan: PlacedMesh) -> bool:
    """Whether a scan has colours."""
    source = scan.source
    has_texture = source.texture is not None and source.uv is not None
    return has_texture or (source.albedo is not None and bool(np.ptp(source.albedo, axis=0).max(initial=0.0) > 0.0))


def paint_from_scan(mesh: FaceMesh, scan: PlacedMesh) -> FaceMesh:
    """Paint a head with the colours of the scan that it was adapted to.

    Parameters
    ----------
    mesh : FaceMesh
        Made by :func:`fapengine.models.adapted_head.adapt_head`.
    scan : PlacedMesh
        With colours: a texture, or a colour for each vertex.
    """
    if mesh.texture is None or not has_colours(scan):
        return mesh
    skin = np.isin(mesh.material, (Material.SKIN, Material.LIP))
    painted = skin & (mesh.uv[:, 0] > SKIN_U[0] + 1e-4) & (mesh.uv[:, 0] < SKIN_U[1] - 1e-4)
    height, width = TEXTURE_SIZE[0] // STRIDE, round(SKIN_U[1] * TEXTURE_SIZE[1]) // STRIDE
    rows, columns = np.indices((height, width))
    texels = (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * STRIDE / TEXTURE_SIZE[::-1]
    known = LinearNDInterpolator(mesh.uv[painted], np.hstack([mesh.vertices_mm, mesh.albedo])[painted])(texels)
    on_head = np.isfinite(known[:, 0])
    theirs, near = _colours(scan, known[on_head, :3])
    own = (mesh.texture[::STRIDE, : width * STRIDE : STRIDE, :3].reshape(-1, 3) / 255.0) ** 2  # it has square roots
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
    on_painting = skin & (mesh.uv[:, 0] < (SKIN_U[1] + HAIR_U[0]) / 2)
    albedo[on_painting] = 1.0
    plain = skin & ~on_painting
    albedo[plain] = np.clip(albedo[plain] * tone, 0, 1)
    return replace(mesh, texture=texture, albedo=albedo)


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
        colours = colours * linear_rgb(source.texture[row, column, :3] / 255.0)
    return colours, (np.linalg.norm(places - points, axis=1) <= REACH_MM).astype(float)
