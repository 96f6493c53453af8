import csv

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.geometry.rigid import fit_rigid
from fapengine.geometry.surface import Surface
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import PEOPLE, HeadStyle
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.models.generic_mesh import adapt_mesh, lip_nodes, sample_contour

SQUARE = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]])


def test_samples_share_the_length():
    around = sample_contour(SQUARE, 8, closed=True)
    np.testing.assert_allclose(around[:, :2], [[0, 0], [2, 0], [4, 0], [4, 2], [4, 4], [2, 4], [0, 4], [0, 2]])
    along = sample_contour(SQUARE, 4, closed=False)
    np.testing.assert_allclose(along, SQUARE, atol=1e-12)


def ellipse(a, b, z=0.0, count=100):
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([a * np.cos(turn), b * np.sin(turn), np.full(count, z)], axis=1)


def deform(points):
    """A smooth change from one face to another, mm."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([1.1 * x, 1.05 * y + 3 * np.cos(x / 40), z + 4 * np.sin(y / 50)], axis=-1)


def test_the_mesh_follows_contours_and_markers(mask):
    vertices, _, _ = mask()
    truth = deform(vertices)
    at = np.arange(41 * 41).reshape(41, 41)
    lines = [at[4, 4:37], at[36, 4:37], at[20, 4:37], at[4:37, 20]]
    contours = [(vertices[line], truth[line], False) for line in lines]
    markers = at[8:36:9, 8:36:9].ravel()
    adapted = adapt_mesh(vertices, contours, (vertices[markers], truth[markers]))
    inner = at[5:36, 5:36].ravel()
    assert np.linalg.norm(adapted - truth, axis=1)[inner].mean() < 0.5  # of 7 mm
    np.testing.assert_allclose(adapted[markers], truth[markers], atol=1e-6)


LIPS = ["8.4", "8.6", "8.9", "8.1", "8.10", "8.5", "8.3", "8.7", "8.2", "8.8"]
EYE = ["3.11", "3.1", "3.7", "3.3"]


def tried_on(head: FaceMesh, scan: Surface, goals: dict[str, np.ndarray]) -> None:
    """Adapt a head to a scan by two thirds of its feature points; nothing may come to lie farther off than before."""
    skin = (head.material == Material.SKIN) | (head.material == Material.LIP)
    names = [
        name for name in head.feature_points
        if name in goals and skin[head.feature_points[name]] and name[:2] in ("2.", "3.", "4.", "5.", "8.", "9.")
    ]  # fmt: skip
    ours, theirs = (np.stack([np.asarray(at(name), float) for name in names]) for at in (head.point_mm, goals.get))
    turn = fit_rigid(ours, theirs)
    ours, vertices = turn.apply(ours), turn.apply(head.vertices_mm.astype(float))
    near, _, on_rim = scan.closest(vertices)
    vertices = vertices[skin & ~on_rim & (np.linalg.norm(vertices - near, axis=1) < 15)]
    where = dict(zip(names, range(len(names)), strict=True))
    contours = []
    for line in (LIPS, EYE):
        at = [where[name] for name in line if name in where]
        if len(at) >= 3:
            contours.append((ours[at], theirs[at], True))
    free = [at for name, at in where.items() if name not in (*LIPS, *EYE)]
    for third in range(3):
        out = free[third::3]
        kept = [at for at in free if at not in out]
        points = np.concatenate([vertices, ours[out]])
        before = np.linalg.norm(points - scan.closest(points)[0], axis=1)[: len(vertices)].mean()
        moved = adapt_mesh(points, contours, (ours[kept], theirs[kept]))
        after = np.linalg.norm(moved - scan.closest(moved)[0], axis=1)[: len(vertices)].mean()
        held_out = [
            np.linalg.norm(places - theirs[out], axis=1).mean() for places in (ours[out], moved[len(vertices) :])
        ]
        assert held_out[1] < held_out[0]
        assert after < before


@pytest.mark.parametrize("person", ["man", "child"])
def test_a_head_comes_nearer_to_another_one(person):
    other = build_head(PEOPLE[person])
    skin = (other.material == Material.SKIN) | (other.material == Material.LIP)
    scan = Surface(other.vertices_mm.astype(float), other.triangles[skin[other.triangles].all(axis=1)])
    goals = {name: np.asarray(other.point_mm(name), float) for name in other.feature_points}
    tried_on(build_head(), scan, goals)


@pytest.mark.shared
def test_our_head_comes_nearer_to_a_measured_one(shared):
    face = np.load(shared / "data" / "dense_face.npz")
    vertices, triangles = face["vertices"].astype(float), face["triangles"]
    scan = Surface(vertices[:9409], triangles[(triangles < 9409).all(axis=1)])  # without sockets and eyes
    with (shared / "data" / "markers.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["layout"] == "mpeg4"]
    plain = build_head(HeadStyle(charm=0))  # whoever stylises a face moves it away from measured ones
    tried_on(plain, scan, {row["marker"]: vertices[int(row["vertex"])] for row in rows})


def test_points_named_twice_at_one_place_do_not_tear_the_mesh(mask):
    vertices, _, _ = mask()
    some = vertices[::40]
    goals = some + np.array([1.0, 0, 0])
    doubled = np.concatenate([some, some[:1] + 0.08]), np.concatenate([goals, goals[:1] + np.array([3.0, 0, 0])])
    moved = adapt_mesh(vertices, [], doubled) - vertices
    assert np.linalg.norm(moved, axis=1).max() < 4.0


def test_lips_bulge_with_the_scan():
    x, y = np.meshgrid(np.linspace(-40, 40, 41), np.linspace(-30, 30, 41))
    at = np.arange(41 * 41).reshape(41, 41)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    scan = Surface(
        np.stack([x, y, np.full(x.shape, 5.0)], -1).reshape(-1, 3), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    )
    outer, inner = (sample_contour(ellipse(*size), 40, closed=True) for size in ((25, 12), (20, 4)))
    heights = lip_nodes(outer, inner, scan)[..., 2]
    np.testing.assert_allclose(heights[[0, 7, 14]], np.array([[0.0], [5], [0]]) * np.ones(40), atol=1e-9)
    assert (np.diff(heights[:8], axis=0) > 0).all()


def test_bad_input_is_refused():
    for points, count in ((SQUARE[:1], 5), (SQUARE, 1)):
        with pytest.raises(UsageError, match="at least 2 of each"):
            sample_contour(points, count, closed=True)
    with pytest.raises(UsageError, match="one point repeated"):
        sample_contour(SQUARE[[0, 0]], 3, closed=False)
    nothing = (np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(UsageError, match="not all in one plane"):
        adapt_mesh(SQUARE, [(SQUARE, SQUARE + 1, True)], nothing)
    with pytest.raises(UsageError, match=r"anchors: needs at least 4, .*got 3"):
        adapt_mesh(SQUARE, [], (np.eye(3), np.eye(3)))
