"""The points that shapes show, and the poses that FAPs give back, on a real face and on its kin: ICT-FaceKit's."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import deform
from fapengine.mesh.rig.blendshape_basis import coordinates
from fapengine.mesh.rig.blendshape_mesh import JAW, LEFT, RIGHT, Blendshape, BlendshapeMesh
from fapengine.mesh.rig.feature_points import locate
from fapengine.mesh.rig.import_head import ImportedHead, import_head
from fapengine.mpeg4 import fap
from fapengine.retarget.rig_weights import choose_blendshapes

FACE = 9409
"""Vertices of the face with its ears come first."""


@dataclass(frozen=True)
class Dense:
    vertices: np.ndarray
    triangles: np.ndarray
    names: list[str]
    fields: np.ndarray
    surface: np.ndarray
    surfaces: list[str]
    identity: np.ndarray
    marked: dict[str, int]
    speech: np.ndarray


@pytest.fixture(scope="module")
def dense(shared: Path) -> Dense:
    data = np.load(shared / "data" / "dense_face.npz")
    names = data["region_names"].tolist()
    surface = np.zeros(len(data["vertices"]), int)
    for number, (first, last) in enumerate(data["region_ranges"]):
        if names[number] != "face_narrow":
            surface[first:last] = number
    unseen = [number for number, name in enumerate(names) if name.startswith(("eye_occ", "eye_blend", "lacrimal"))]
    with (shared / "data" / "markers.csv").open() as file:
        marked = {row["marker"]: int(row["vertex"]) for row in csv.DictReader(file) if row["layout"] == "mpeg4"}
    triangles = data["triangles"]
    return Dense(
        data["vertices"].astype(float), triangles[~np.isin(surface[triangles[:, 0]], unseen)],
        data["expr_names"].tolist(), data["expr"].astype(float), surface, names, data["identity"][:20].astype(float),
        marked, np.load(shared / "data" / "speech_train.npz")["ict_w"][:6000:400].astype(float),
    )  # fmt: skip


def rig_of(dense: Dense, vertices: np.ndarray) -> BlendshapeMesh:
    shapes = {}
    for name, field in zip(dense.names, dense.fields, strict=True):
        kept = np.flatnonzero(np.abs(field).max(axis=1) > 0.003)
        shapes[name] = Blendshape(kept, field[kept])
    return BlendshapeMesh(
        vertices=vertices, triangles=dense.triangles, blendshapes=shapes, surfaces=tuple(dense.surfaces),
        surface=dense.surface,
    )  # fmt: skip


def located(rig: BlendshapeMesh) -> dict[str, int]:
    moves = {LEFT: rig.dense("eyeBlink_L"), RIGHT: rig.dense("eyeBlink_R"), JAW: rig.dense("jawOpen")}
    return locate(rig, moves, build_head())


@pytest.mark.shared
def test_points_are_found_on_three_people(dense: Dense) -> None:
    rng = np.random.default_rng(1)
    means = []
    for person in range(3):
        vertices = dense.vertices.copy()
        if person:
            vertices[: dense.identity.shape[1]] += np.tensordot(rng.normal(size=20), dense.identity, axes=1)
        found = located(rig_of(dense, vertices))
        off = {
            name: np.linalg.norm(vertices[found[name]] - vertices[at])
            for name, at in dense.marked.items()
            if name in found
        }
        assert len(off) >= 56
        for name in ("2.2", "2.3", "2.4", "2.5", "3.1", "3.2", "3.3", "3.4", "8.3", "8.4"):
            assert off[name] < 5.0, (person, name)  # mm
        means.append(np.mean(list(off.values())))
    assert np.mean(means) < 3.2
    assert max(means) < 3.8


@pytest.fixture(scope="module")
def imported(dense: Dense) -> tuple[BlendshapeMesh, ImportedHead]:
    rig = rig_of(dense, dense.vertices)
    choice = choose_blendshapes(rig.blendshapes)
    return rig, import_head(rig, choice.blended, located(rig), build_head())


@pytest.mark.shared
def test_speech_comes_back_to_a_quarter_of_a_millimetre(
    dense: Dense, imported: tuple[BlendshapeMesh, ImportedHead]
) -> None:
    rig, head = imported
    mesh = head.mesh
    there = cKDTree(rig.vertices).query(
        (mesh.vertices_mm - mesh.point_mm("8.1")) / head.scale + rig.vertices[located(rig)["8.1"]]
    )
    assert np.median(there[0]) < 2.0  # nearly in its own axes already
    kept = np.unique(rig.triangles)
    assert len(kept) == len(mesh.vertices_mm)
    face = np.flatnonzero(kept < FACE)
    turn = np.linalg.lstsq(
        rig.vertices[kept] - rig.vertices[kept].mean(axis=0),
        mesh.vertices_mm - mesh.vertices_mm.mean(axis=0),
        rcond=None,
    )[0]
    errors, motions = [], []
    for weights in dense.speech:
        moves = np.tensordot(weights, dense.fields[:, kept], axes=1) @ turn
        faps = np.zeros(68)
        for one in coordinates(mesh.feature_points, jaw=True):
            shift = moves[one.vertex] - (moves[mesh.feature_points["2.1"]] if one.number == 18 else 0.0)
            faps[fap.column(one.number)] = shift @ one.axis / mesh.fapu.unit(fap.spec(one.number).unit)
        errors.append(np.linalg.norm(deform(mesh, faps) - mesh.vertices_mm - moves, axis=1)[face])
        motions.append(np.linalg.norm(moves, axis=1)[face])
    assert np.mean(errors) < 0.25  # mm, of the whole face with its ears
    assert np.mean(errors) < 0.33 * np.mean(motions)
    assert np.quantile(errors, 0.99) < 1.2
