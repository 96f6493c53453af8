"""Lay our template over scanned faces: ``fapengine/mesh/default_head/faces.npz``.

    python -m design.learn_faces data

The template is drawn to the dense face's mean by springs between its vertices, which grow weaker from round to round,
and by the nearest points of that face whose normals agree (Amberg, Romdhani and Vetter 2007); the feature points that
both have tell it where lips and nose are. Its lids stay on their balls and its lips stay level and closed, as the
standard's neutral face has them. Each vertex then lies on a triangle of the dense face and follows that face's identity
modes, each of variance 1, turned and scaled so that 68 landmarks lie best on the mean's, with the eyes kept in place.
The principal components of what is left are kept. All is made symmetric. The data are not part of the project.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import LinearNDInterpolator
from scipy.sparse.linalg import cg, splu
from scipy.spatial import cKDTree

from design.data_files import FOLDER, asked_path, save_table
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.eyes import CENTRE
from fapengine.mesh.default_head.faces import STEP_MM
from fapengine.mesh.default_head.head import build_parts
from fapengine.mesh.default_head.mesh_builder import Rings
from fapengine.mesh.default_head.points import locate
from fapengine.mesh.default_head.style import LEVELS, MODES, HeadStyle
from fapengine.mesh.face_mesh import Material

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TABLES = Path(__file__).resolve().parent.parent / "fapengine" / "mesh" / "default_head"
SKIN = 11248
"""Vertices of face, head and neck in the dense face."""
SPRINGS = (30, 30, 10, 10, 4, 4, 2, 2, 1, 1, 0.5, 0.5, 0.25, 0.25)
SAME_POINTS = ("8.1", "8.2", "8.5", "8.6", "8.7", "8.8", "8.9", "8.10", "9.1", "9.2", "9.4", "9.5", "9.15")
ABOUT_THERE = ("9.3", "9.12", "9.13", "9.14")
LEVEL = ("2.2", "2.3", "2.4", "2.5", "8.3", "8.4")
"""Feature points of the line between the lips, whose height is the template's."""
MARKS = 20.0
"""Weight of a feature point, in those of a vertex."""
IDENTITIES = 60
EYE_MM = (15.5, 11.5)
ANGLES_DEG = (*range(49), *range(52, 101, 4), 105, *range(110, 181, 10))
HEIGHTS_MM = (*range(-138, -84, 6), *np.arange(-84, 62.1, 1.5).tolist(), *range(67, 143, 5))
MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Template:
    """Skin of our template."""

    points: Array
    places: Array
    triangles: Indices
    marks: dict[str, int]
    rim: tuple[Indices, Indices]
    """The line between the lips: vertices of the upper and of the lower lip in pairs."""
    lids: Indices
    """Vertices that stay."""


@dataclass(frozen=True)
class Dense:
    """Skin of the dense face."""

    points: Array
    triangles: Indices
    marks: dict[str, int]


def main(data: Path) -> None:
    face = np.load(data / "dense_face.npz")
    with (data / "markers.csv").open(encoding="utf-8") as file:
        marks = {row["marker"]: int(row["vertex"]) for row in csv.DictReader(file) if row["layout"] == "mpeg4"}
    dense, ours = read_dense(face, marks), read_template()
    mean, sure = registered(ours, dense)
    triangle, share, _ = nearest(ours.points + mean, dense)
    landmarks, skin = face["multipie68"], face["vertices"][:SKIN].astype(float)
    twin = cKDTree(ours.points).query(ours.points * MIRROR)[1]
    filled = fill(ours, sure)
    moves = []
    for mode in face["identity"][:IDENTITIES, :SKIN].astype(float):
        move = placed(skin + mode, landmarks, skin[landmarks]) - skin
        own = np.einsum("vc,vca->va", share, move[dense.triangles[triangle]])
        own = (own + own[twin] * MIRROR) / 2
        moves.append(filled(with_still_eyes(own, ours)))
    _, size, found = np.linalg.svd(np.array(moves).reshape(len(moves), -1), full_matrices=False)
    print(f"{(size[:MODES] ** 2).sum() / (size**2).sum():.3f} of the variance in {MODES} modes")
    modes = (size[:MODES, None] * found[:MODES]).reshape(MODES, *mean.shape)
    modes *= np.where(modes[:, ours.marks["9.3"], 2] < 0, -1, 1)[:, None, None]
    write(on_grid(ours.places, mean, ANGLES_DEG, HEIGHTS_MM),
          np.array([on_grid(ours.places, mode, ANGLES_DEG[::2], HEIGHTS_MM[::2]) for mode in modes]))  # fmt: skip


def read_dense(face: "np.lib.npyio.NpzFile", marks: dict[str, int]) -> Dense:
    points, triangles = face["vertices"][:SKIN].astype(float), face["triangles"]
    triangles = triangles[(triangles < SKIN).all(axis=1)]
    around = np.arctan2(np.abs(points[:, 0]), points[:, 2] - 10.0)
    x, y = np.abs(points[:, 0]), points[:, 1]
    ear = (x > 76) & (around > np.deg2rad(72)) & (y > -40) & (y < 60)
    return Dense(points, triangles[~ear[triangles].any(axis=1)], marks)


def read_template() -> Template:
    # What hangs on the skin is built with the table, which may not exist yet: for the template it is zero.
    angles, heights = np.deg2rad(ANGLES_DEG), np.array(HEIGHTS_MM)
    empty = faces.FaceTable(angles, heights, np.zeros((len(angles), len(heights), 3)), np.zeros((0, 0, 0, 3)))
    faces.face_table = lambda: empty
    builder, head = build_parts(HeadStyle(hair=False), LEVELS["normal"])
    points, places, triangles = builder.column("points_mm"), builder.column("place"), builder.triangles()
    on_skin = np.isfinite(places[:, 0]) & (builder.column("material") != Material.STRAND)
    on_skin[head.mouth.indices[head.mouth.level < 0]] = False
    on_skin[head.mouth.indices.max() + 1] = False  # the mouth's end
    triangles = triangles[on_skin[triangles].all(axis=1)]
    used = np.unique(triangles)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    marks = {name: int(number[index]) for name, index in locate(points, head).items() if number[index] >= 0}
    lids = [eye.lids.indices[(eye.lids.level < 1.45) & (eye.lids.level >= 1.0)].ravel() for eye in head.eyes]
    upper, lower = rim_pairs(head.mouth)
    return Template(points[used], places[used], number[triangles], marks,
                    (number[upper], number[lower]), number[np.concatenate(lids)])  # fmt: skip


def rim_pairs(mouth: Rings) -> tuple[Indices, Indices]:
    rim = mouth.indices[np.flatnonzero(mouth.level == 0.0)[0]]
    lower = np.flatnonzero(~mouth.upper)
    upper = np.flatnonzero(mouth.upper)
    near = np.abs(mouth.t[lower, None] - mouth.t[upper]).argmin(axis=1)
    return rim[upper[near]], rim[lower]


def confidence(template: Template) -> Array:
    """(V,): 0 where the dense face has what is ours: eyes, ears, and the shoulders."""
    angle, height = template.places.T
    eye = np.hypot((np.abs(template.points[:, 0]) - CENTRE[0]) / EYE_MM[0], (height - CENTRE[1]) / EYE_MM[1])
    degrees = np.rad2deg(np.abs(angle))
    ear = smoothstep((degrees - 68) / 8) * smoothstep((125 - degrees) / 10)
    ear *= smoothstep((66 - height) / 10) * smoothstep((height + 45) / 10)
    sure: Array = smoothstep((eye - 1.0) / 0.5) * (1 - ear) * smoothstep((height + 112) / 10)
    return sure


def springs(template: Template) -> sparse.csr_matrix:
    """(V, V): their energy is the product with displacements from both sides."""
    corners = template.triangles
    edges = np.unique(np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])), axis=0)
    length = np.linalg.norm(template.points[edges[:, 0]] - template.points[edges[:, 1]], axis=1)
    stiff = 1 / np.maximum(length, 0.4)
    row = np.arange(len(edges))
    ends = sparse.csr_matrix(
        (np.concatenate([stiff, -stiff]), (np.tile(row, 2), edges.T.ravel())), (len(edges), len(template.points))
    )
    return (ends.T @ ends).tocsr()


def registered(template: Template, dense: Dense) -> tuple[Array, Array]:
    """(V, 3) mm from the template to the dense face; (V,) how sure it is."""
    sure, stiff, count = confidence(template), springs(template), len(template.points)
    twin = cKDTree(template.points).query(template.points * MIRROR)[1]
    normals = vertex_normals(dense.points, dense.triangles)
    still = np.zeros(count)
    still[template.lids] = 200.0
    still += 200.0 * (template.places[:, 1] < -126)
    upper, lower = template.rim
    pairs = sparse.csr_matrix(
        (np.tile([1.0, -1.0], len(upper)), (np.repeat(np.arange(len(upper)), 2), np.stack([upper, lower], 1).ravel())),
        (len(upper), count),
    )
    closed = 500.0 * pairs.T @ pairs
    level = np.zeros(count)
    level[np.concatenate([upper, lower, [template.marks["8.3"], template.marks["8.4"]]])] = 1000.0
    move = np.zeros((count, 3))
    for weak in SPRINGS:
        triangle, share, distance = nearest(template.points + move, dense)
        goal = np.einsum("vc,vca->va", share, dense.points[dense.triangles[triangle]])
        out = np.einsum("vc,vca->va", share, normals[dense.triangles[triangle]])
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        agree = (vertex_normals(template.points + move, template.triangles) * out).sum(axis=1)
        weight = sure * smoothstep((agree - 0.25) / 0.4) * (distance < 14.0) * (level == 0)
        pull = weight[:, None, None] * (out[:, :, None] * out[:, None, :] + 0.12 * np.eye(3))
        force = np.einsum("vab,vb->va", pull, goal - template.points)
        pull += (still + 1e-4)[:, None, None] * np.eye(3)
        pull[:, 1, 1] += level
        for name in (*SAME_POINTS, *ABOUT_THERE, *LEVEL):
            at, strong = template.marks[name], MARKS * (0.15 if name in ABOUT_THERE else 1.0)
            told = np.array([1.0, name not in LEVEL, 1.0])
            pull[at] += strong * np.diag(told)
            force[at] += strong * told * (dense.points[dense.marks[name]] - template.points[at])
        system = sparse.kron(weak * stiff + closed, sparse.eye(3)) + sparse.block_diag(pull, format="csr")
        solved = cg(
            system, force.ravel(), x0=move.ravel(), rtol=1e-6, maxiter=800, M=sparse.diags(1 / system.diagonal())
        )
        move = solved[0].reshape(count, 3)
        move = (move + move[twin] * MIRROR) / 2
    distance = nearest(template.points + move, dense)[2][sure > 0.5]
    print(f"off the dense face by {np.median(distance):.2f} mm, 95 % of the vertices by less than "
          f"{np.percentile(distance, 95):.2f} mm")  # fmt: skip
    return move, sure


def nearest(points: Array, dense: Dense) -> tuple[Indices, Array, Array]:
    """Nearest of the dense face's triangles, (V,), shares of its corners in the nearest point, (V, 3), distance."""
    corners = dense.points[dense.triangles]
    candidates = cKDTree(corners.mean(axis=1)).query(points, k=10)[1]
    best, triangle, share = np.full(len(points), np.inf), candidates[:, 0].copy(), np.zeros((len(points), 3))
    for candidate in candidates.T:
        shares = nearest_in_triangle(points, corners[candidate])
        distance = np.linalg.norm(points - np.einsum("vc,vca->va", shares, corners[candidate]), axis=1)
        better = distance < best
        best[better], triangle[better], share[better] = distance[better], candidate[better], shares[better]
    return triangle, share, best


def nearest_in_triangle(points: Array, corners: Array) -> Array:
    """(V, 3): shares of the corners, (V, 3, 3), in the point of each triangle nearest to each point."""
    shares, best = np.zeros((len(points), 3)), np.full(len(points), np.inf)
    a, edge, other = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    gram = np.stack([np.stack([(edge * edge).sum(1), (edge * other).sum(1)], 1),
                     np.stack([(edge * other).sum(1), (other * other).sum(1)], 1)], 1)  # fmt: skip
    right = np.stack([((points - a) * edge).sum(1), ((points - a) * other).sum(1)], 1)
    inside = np.linalg.solve(gram + 1e-12 * np.eye(2), right[..., None])[..., 0]
    candidates = [np.column_stack([1 - inside.sum(1), inside])]
    for first, second in ((0, 1), (1, 2), (2, 0)):
        along = corners[:, second] - corners[:, first]
        share = np.clip(((points - corners[:, first]) * along).sum(1) / np.maximum((along**2).sum(1), 1e-12), 0, 1)
        candidate = np.zeros((len(points), 3))
        candidate[:, first], candidate[:, second] = 1 - share, share
        candidates.append(candidate)
    for candidate in candidates:
        distance = np.linalg.norm(points - np.einsum("vc,vca->va", candidate, corners), axis=1)
        better = (distance < best - 1e-9) & (candidate >= -1e-9).all(axis=1)
        shares[better], best[better] = candidate[better], distance[better]
    return shares


def placed(person: Array, marks: Indices, onto: Array) -> Array:
    """(V, 3): turned, moved and scaled so that landmarks lie best on others (Umeyama 1991)."""
    seen, middle = person[marks], onto.mean(axis=0)
    centred = seen - seen.mean(axis=0)
    left, size, right = np.linalg.svd(centred.T @ (onto - middle))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    scale = (size * [1.0, 1.0, np.linalg.det(left @ right)]).sum() / (centred**2).sum()
    return np.asarray(scale * (person - seen.mean(axis=0)) @ turn + middle)


def with_still_eyes(move: Array, template: Template) -> Array:
    """(V, 3): less each eye's own motion, which fades with the distance from it."""
    still = move.copy()
    for side in (1.0, -1.0):
        away = np.linalg.norm(template.points - CENTRE * [side, 1, 1], axis=1)
        near = np.exp(-((away / 16.0) ** 4))
        still -= np.exp(-((away / 38.0) ** 2))[:, None] * (near @ move / near.sum())
    return still


def fill(template: Template, sure: Array, hold: float = 10.0) -> Callable[[Array], Array]:
    """Return what keeps displacements where they are sure, the more the greater ``hold``, and is smooth between."""
    held = hold * sure
    held[template.lids] = 100.0
    held += 100.0 * (template.places[:, 1] < -126)
    solver = splu((springs(template) + sparse.diags(held)).tocsc())

    def filled(move: Array) -> Array:
        smooth: Array = solver.solve(hold * sure[:, None] * move)
        return smooth

    return filled


def on_grid(places: Array, moves: Array, angles_deg: tuple[float, ...], heights_mm: tuple[float, ...]) -> Array:
    """Displacements at the knots, (A, Y, 3)."""
    found = LinearNDInterpolator(places * [100.0, 1.0], moves)
    angle, height = np.meshgrid(np.deg2rad(np.minimum(angles_deg, 179.9)), heights_mm, indexing="ij")
    inside = np.clip(height, places[:, 1].min() + 0.01, places[:, 1].max() - 0.01)
    grid: Array = found(np.stack([100.0 * angle, inside], axis=-1))
    return grid


def write(mean: Array, modes: Array) -> None:
    mean[[0, -1], :, 0] = modes[:, [0, -1], :, 0] = 0.0  # the middle stays in the middle
    write_table("faces.npz", ANGLES_DEG, HEIGHTS_MM, mean=mean, modes=modes)


def write_table(name: str, angles_deg: tuple[float, ...], heights_mm: tuple[float, ...], **moves_mm: Array) -> None:
    """Write knots and displacements as :mod:`fapengine.mesh.default_head.faces` reads them."""
    steps = {key: np.round(values / STEP_MM).astype("<i2") for key, values in moves_mm.items()}
    knots = {"angles_deg": np.array(angles_deg, "<f8"), "heights_mm": np.array(heights_mm, "<f8")}
    save_table(TABLES / name, knots | steps)


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "dense_face.npz", "markers.csv"))
