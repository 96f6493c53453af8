"""The built-in head fitted to a scan: paper 004, "Face and lip mesh adaptation", for a head that FAPs move.

Theory of operation
-------------------
The scan lies on the standard's face already (:func:`fapengine.mesh.rig.placed_mesh.place_mesh`). Then

1. feature points, and the contours of lips and eyes through them, move the head (:func:`.generic_mesh.adapt_mesh`); far
   from all points the motion fades, so back of the head and shoulders stay;
2. the skin is fitted to the scan where the scan has skin: each vertex is drawn to the nearest place with a similar
   normal, neighbours are held together (a biharmonic membrane, stiff at first), and parts without a scan follow;
3. eyeballs keep their size and go with their lids, which keep their height above the ball, so that they slide on it;
   teeth and tongue go with the lips, brows, lashes, ears and hair with the skin below.

The deformation basis is then built on the new shape, as for every built-in head: all FAPs move it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices, Mask
from fapengine.errors import DataError, as_data_error
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import Surface, edges_of, vertex_normals
from fapengine.mesh.default_head.eyes import Eye, moved_eye
from fapengine.mesh.default_head.head import build_reshaped
from fapengine.mesh.default_head.points import HeadParts
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.placed_mesh import PlacedMesh
from fapengine.models.generic_mesh import adapt_mesh, lip_nodes, spline_contour

LIPS = ("8.4", "8.6", "8.9", "8.1", "8.10", "8.5", "8.3", "8.7", "8.2", "8.8")
INNER_LIPS = ("2.5", "2.7", "2.2", "2.6", "2.4", "2.8", "2.3", "2.9")
LIP_SAMPLES, LIP_ROWS = 400, 15
"""Places along a contour of the lips that are tried for a column of nodes; rows of nodes, as in the paper."""
LIP_BORDER = 1.6
"""Level of the rings round the mouth at which the skin no longer follows the lip mesh."""
LEFT_EYE, RIGHT_EYE = ("3.11", "3.1", "3.7", "3.3"), ("3.8", "3.2", "3.12", "3.4")
CONTOURS = (LIPS, LEFT_EYE, RIGHT_EYE)
"""Closed contours by their feature points, in order."""
GROUPS = ("2.", "3.", "4.", "5.", "8.", "9.")
BESIDE_SKIN = ("3.5", "3.6", "9.8", "9.9", "9.10", "9.11")
"""Feature points of these groups that are not on the skin: pupils and teeth."""
NEAR_MM, FAR_MM = 50.0, 150.0
"""Distances from the nearest feature point between which the motion fades."""
STIFFNESS = (30.0, 5.0, 1.0)
"""Strength with which neighbours hold together while the skin is laid, round by round."""
REACHES_MM = (15.0, 10.0, 8.0)
"""Distance to the scan within which a vertex is drawn to it, round by round."""
LOOSE = 0.01
"""Pull on parts that are missing in the scan, as a fraction of the scan's pull."""
MIN_COSINE = 0.5
"""Cosine between normals of head and scan below which two places do not correspond."""
TOUCH_MM = 1.0
"""Distance below which upper and lower lip touch, and move together."""
SUNK_MM = 0.8
"""Farthest that skin round an eye may come nearer to the ball's centre than it was."""
NECK_MM = 30.0
"""Distance below the chin from which skin is neck, and is not laid."""
EAR_MM = 10.0
"""Skin nearer to an ear follows its neighbours: ears are not laid."""
PART_SHARE = 0.1
"""Fraction of a scan's area from which a part is a large one."""
FRONT_COSINE, MEASURED_MM = 0.3, 15.0
"""The front of the face: normals that look forwards, within this distance of the scan before it is adapted."""
PARTS, MIN_LEFT_OUT = 3, 6
"""Number of parts in which points off the contours are left out in turn, and least number of such points."""


@dataclass(frozen=True, slots=True)
class Nearness:
    """Distances before and after, mean, mm of the standard face."""

    front_mm: tuple[float, float]
    """Distance from the front of the face's skin to the scan."""
    left_out_mm: tuple[float, float] | None
    """Distance of feature points that were left out, a third at a time, from their places; None with too few points."""
    left_out: int
    """Number of points that were left out."""


def on_large_parts(scan: PlacedMesh) -> Mask:
    """(F,): triangles of the skin and of other large parts; not of eyeballs, lashes and teeth."""
    a, b, c = np.moveaxis(scan.vertices_mm[scan.triangles], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    part = scan.part[scan.triangles[:, 0]]
    areas = np.bincount(part, area)
    return np.asarray((areas[part] >= PART_SHARE * area.sum()) | (part == scan.skin_part))


def scan_surface(scan: PlacedMesh) -> Surface:
    """Make a surface of a scan; vertices at one place, as along the seams of a texture, become one."""
    first = np.zeros(scan.node.max() + 1, np.int64)
    first[scan.node] = np.arange(len(scan.node))
    return Surface(scan.vertices_mm[first], scan.node[scan.triangles[on_large_parts(scan)]])


def adapt_head(scan: Surface, points_mm: Mapping[str, Array]) -> tuple[FaceMesh, Nearness]:
    """Fit the average built-in head to a scan.

    Parameters
    ----------
    scan : Surface
        In head space, laid onto the standard's face. The mouth may be closed; holes are allowed.
    points_mm : mapping of str to (3,), mm
        Its feature points; those of eyeballs, teeth, tongue, ears and hair are not used.
    """
    nearness: list[Nearness] = []

    def reshape(
        points: Array, triangles: Indices, head: HeadParts, feature_points: dict[str, int]
    ) -> tuple[Array, HeadParts]:
        names = [
            name for name in feature_points if name in points_mm and name.startswith(GROUPS) and name not in BESIDE_SKIN
        ]
        goals = {name: np.asarray(points_mm[name], np.float64) for name in names}
        fit = _Fit(scan, points, triangles, head, feature_points, names)
        moved = fit.laid(goals)
        nearness.append(fit.measure(moved, goals))
        return _with_parts(points, moved, head, fit.skin)

    with as_data_error("feature points: "):
        mesh = build_reshaped(HeadStyle(), reshape)
    return mesh, nearness[0]


class _Fit:
    """The head's skin while it moves to the scan."""

    def __init__(
        self,
        scan: Surface,
        points: Array,
        triangles: Indices,
        head: HeadParts,
        feature_points: dict[str, int],
        known: list[str],
    ) -> None:
        self.scan, self.points, self.feature_points = scan, points, feature_points
        rings = (head.mouth, *(eye.lids for eye in head.eyes))
        self.skin = np.unique(np.concatenate([head.grid.ravel(), *(ring.indices.ravel() for ring in rings)]))
        outside = np.zeros(len(points), bool)
        outside[head.grid] = True
        for ring, inner in zip(rings, (0.3, 1.0, 1.0), strict=True):
            outside[ring.indices[ring.level < inner]] = False
            outside[ring.indices[ring.level >= inner]] = True
        shown = np.zeros(len(points), bool)
        shown[triangles] = True
        seen = (outside & shown)[self.skin]
        ears = np.concatenate([ear.ravel() for ear in head.ears])
        off_ears = cKDTree(points[ears]).query(points[self.skin])[0] > EAR_MM
        lowest = min((points[feature_points[name], 1] for name in known), default=0.0) - NECK_MM
        self.laid_on = seen & off_ears & (points[self.skin, 1] > lowest)
        number = np.full(len(points), -1)
        number[self.skin] = np.arange(len(self.skin))
        self.own_triangles = number[triangles[(number[triangles] >= 0).all(axis=1)]]
        rims = number[head.mouth.indices[np.abs(head.mouth.level) < 0.6]]
        upper, lower = rims[:, head.mouth.upper].ravel(), rims[:, ~head.mouth.upper].ravel()
        self.mouth, self.skin_surface = head.mouth, Surface(points[self.skin], self.own_triangles)
        self.bending = _bending(points[self.skin], self.own_triangles, upper, lower)

    def laid(self, goals: Mapping[str, Array]) -> Array:
        """(V, 3) mm: all vertices moved by feature points, the skin of them laid onto the scan."""
        contours, markers = _anchors(goals)
        ours = {name: self.points[self.feature_points[name]] for name in goals}
        lines = [(_stack(ours, names), _stack(goals, names), True) for names in contours]
        moved = adapt_mesh(self.points, lines, (_stack(ours, markers), _stack(goals, markers)))
        far_mm = np.asarray(cKDTree(_stack(ours, goals)).query(self.points)[0])
        fade = 1 - np.asarray(smoothstep((far_mm - NEAR_MM) / (FAR_MM - NEAR_MM)))
        moved = self._with_lips(self.points + fade[:, None] * (moved - self.points), goals)
        skin = moved[self.skin]
        for stiffness, reach_mm in zip(STIFFNESS, REACHES_MM, strict=True):
            places, theirs, on_rim = self.scan.closest(skin)
            cosine = (vertex_normals(skin, self.own_triangles) * theirs).sum(axis=1)
            near = self.laid_on & ~on_rim & (np.linalg.norm(places - skin, axis=1) <= reach_mm)
            inside_out = cosine[near].sum() < 0  # a file whose triangles run clockwise
            drawn = near & ((-cosine if inside_out else cosine) >= MIN_COSINE)
            pull = np.where(drawn, 1.0, LOOSE)
            pulled = np.where(drawn[:, None], places - skin, 0.0)
            solver = splu((diags_array(pull) + stiffness * self.bending).tocsc())
            skin = skin + solver.solve(pull[:, None] * pulled)
        moved[self.skin] = skin
        return np.asarray(moved, np.float64)

    def _with_lips(self, moved: Array, goals: Mapping[str, Array]) -> Array:
        """Move the lips by a mesh of splines that is known on the head's lips and on the scan's: paper 004's lip mesh.

        So a place between two feature points moves with the contour, not only with the points.
        """
        rings, level, mouth = self.mouth.indices, self.mouth.level, self.mouth
        ours, theirs = [], []
        for names, corner, row in ((LIPS, 6, 1.0), (INNER_LIPS, 4, 0.0)):
            own = np.stack([self.points[self.feature_points[name]] for name in names])
            goal = np.stack([goals.get(name, moved[self.feature_points[name]]) for name in names])
            at = np.linspace(0.0, len(names), LIP_SAMPLES + 1)
            ring = self.points[rings[np.abs(level - row).argmin()]]
            place = np.empty(len(ring))
            for side, half in ((mouth.upper, at <= corner), (~mouth.upper, at >= corner)):
                nearest = cKDTree(spline_contour(own, corner, at[half])).query(ring[side])[1]
                place[side] = at[half][nearest]
            ours.append(spline_contour(own, corner, place))
            theirs.append(spline_contour(goal, corner, place))
        there = lip_nodes(theirs[0], theirs[1], self.scan, rows=LIP_ROWS)
        shift = there - lip_nodes(ours[0], ours[1], self.skin_surface, rows=LIP_ROWS)
        lips = (level >= 0.0) & (level <= 1.0)
        row_of = (1.0 - level[lips]) * (LIP_ROWS - 1)
        low = np.minimum(row_of.astype(int), LIP_ROWS - 2)
        part = (row_of - low)[:, None, None]
        off = np.zeros((*rings.shape, 3))
        off[lips] = self.points[rings[lips]] + (1 - part) * shift[low] + part * shift[low + 1] - moved[rings[lips]]
        border, rim = np.flatnonzero(lips)[[0, -1]]
        fade = 1 - np.asarray(smoothstep((level - 1.0) / (LIP_BORDER - 1.0)))
        off[level > 1.0] = fade[level > 1.0, None, None] * off[border]
        off[level < 0.0] = off[rim]
        carried = moved.copy()
        carried[rings] += off
        return carried

    def measure(self, moved: Array, goals: Mapping[str, Array]) -> Nearness:
        """Distances of the head to the scan, and of left-out points to their places."""
        before, after = self.points[self.skin], moved[self.skin]
        places, _, on_rim = self.scan.closest(before)
        far_mm = np.linalg.norm(places - before, axis=1)
        normals = vertex_normals(before, self.own_triangles)
        front = self.laid_on & ~on_rim & (far_mm <= MEASURED_MM) & (normals[:, 2] >= FRONT_COSINE)
        if not front.any():
            raise DataError("scan: must be within 15 mm of the face; its points are not on a face")
        after_mm = np.linalg.norm(self.scan.closest(after[front])[0] - after[front], axis=1).mean()
        free = _anchors(goals)[1]
        misses: list[tuple[float, float]] = []
        for part in range(PARTS if len(free) >= MIN_LEFT_OUT else 0):
            out = free[part::PARTS]
            guess = self.laid({name: goal for name, goal in goals.items() if name not in out})
            for name in out:
                at = self.feature_points[name]
                was, now = (float(np.linalg.norm(where[at] - goals[name])) for where in (self.points, guess))
                misses.append((was, now))
        left_out = np.mean(misses, axis=0) if misses else None
        return Nearness(
            (float(far_mm[front].mean()), float(after_mm)),
            None if left_out is None else (float(left_out[0]), float(left_out[1])),
            len(misses),
        )


def _anchors(goals: Mapping[str, Array]) -> tuple[list[list[str]], list[str]]:
    """Contours with at least three known points, by name, and the points on none of them."""
    contours = [[name for name in line if name in goals] for line in CONTOURS]
    contours = [line for line in contours if len(line) >= 3]
    on_contour = {name for line in contours for name in line}
    return contours, [name for name in goals if name not in on_contour]


def _stack(places: Mapping[str, Array], names: Sequence[str] | Mapping[str, Array]) -> Array:
    return np.array([places[name] for name in names], np.float64).reshape(-1, 3)


def _bending(points: Array, triangles: Indices, upper: Indices, lower: Indices) -> csr_array:
    """(S, S): squared bending of a displacement over the skin; where the lips touch they count as one piece."""
    distance, nearest = cKDTree(points[lower]).query(points[upper])
    touching = np.stack([upper, lower[nearest]], axis=1)[distance < TOUCH_MM]
    edges = np.concatenate([edges_of(triangles), touching])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    degree = np.bincount(rows, minlength=len(points))
    around = csr_array((1.0 / degree[rows], (rows, columns)), shape=(len(points), len(points)))
    bend = diags_array((degree > 0).astype(float)) - around
    return csr_array(bend.T @ bend)


def _with_parts(before: Array, moved: Array, head: HeadParts, skin: Indices) -> tuple[Array, HeadParts]:
    """Move everything that is not skin with it, and slide lids on their eyeballs."""
    after = moved.copy()
    rest = np.setdiff1d(np.arange(len(before)), skin)
    distance, nearest = map(np.asarray, cKDTree(before[skin]).query(before[rest], k=8))
    weight = 1.0 / (distance + 1.0) ** 2
    shifts = (moved - before)[skin][nearest]
    after[rest] = before[rest] + (weight[..., None] * shifts).sum(axis=1) / weight.sum(axis=1)[:, None]
    lips = head.mouth.indices[np.abs(head.mouth.level - 1.0).argmin()]
    for part in (head.upper_teeth, head.lower_teeth, head.tongue):
        after[part] = before[part] + (moved - before)[lips].mean(axis=0)
    left, right = (_with_eye(before, after, eye) for eye in head.eyes)
    return after, replace(head, eyes=(left, right))


def _with_eye(before: Array, after: Array, eye: Eye) -> Eye:
    """Move the ball with its lids, and fit the lids to it; changes ``after``."""
    rings, level = eye.lids.indices, eye.lids.level
    rim = np.flatnonzero(level == 1.0)[0]
    shift = (after - before)[rings[rim]].mean(axis=0)
    centre = eye.centre + shift
    inner = level < 1.0
    after[rings[inner]] = before[rings[inner]] + (after - before)[rings[rim]]
    height = np.linalg.norm(before[rings] - eye.centre, axis=-1)
    arm = after[rings] - centre
    reached = np.linalg.norm(arm, axis=-1)
    on_ball = 1 - smoothstep((level - 1.1) / 0.4)[:, None]
    wanted = height * on_ball + (1 - on_ball) * np.maximum(reached, height - SUNK_MM)
    laid = centre + arm * (wanted / reached)[..., None]
    after[rings[1:]] = laid[1:]  # the first ring is the border of the skin around
    after[eye.ball] = before[eye.ball] + shift
    after[eye.lashes] = before[eye.lashes] + (after - before)[rings[rim][eye.lash_roots]][:, None]
    return moved_eye(eye, centre, before[rings[rim]], after[rings[rim]])
