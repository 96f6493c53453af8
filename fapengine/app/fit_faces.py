"""Faces for the report of a fit: what each component does, sparse and dense, and the built-in head before and after."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fapengine._arrays import Array
from fapengine.app.dense_film import MOVED_BONES, dotted_mesh, fitting
from fapengine.app.inspection.faces import PICTURE_PX, draw_mouths, faps_of_weights
from fapengine.files.heads.built import load_built
from fapengine.files.pictures import Picture, contact_sheet
from fapengine.geometry.surface import Surface
from fapengine.laboratory.dense_face import DenseFace, make_dense_head, mode_names, moved_by_modes
from fapengine.laboratory.densify import DenseStudy
from fapengine.laboratory.fit import Fitted
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.blendshape_basis import ROW_FAPU
from fapengine.render.drawing import RenderOptions
from fapengine.render.native import open_crowd_renderer, open_renderer

FACE = RenderOptions(size=(PICTURE_PX, PICTURE_PX), rest=0.0)
SCANS = 8
"""Scans drawn at most: as many as in figure 2 of paper 004."""
SHOWN, FAR = 8, 3.0
"""Components drawn at most, and their distance from the mean, in standard deviations."""


def draw_faces(fitted: Fitted, adapted: FaceMesh | None = None) -> Mapping[str, Picture]:
    """Draw the faces of a fit, by caption. Raises ResourceError if there is no renderer."""
    pictures = {"The mean of all takes, and 3 standard deviations of each component to either side.": _sparse(fitted)}
    if fitted.dense is not None:
        head, dense = _dense(fitted.dense.face)
        pictures["The mean of all scans, and 3 standard deviations of each dense mode to either side."] = dense
        before, after = _registration(fitted.dense)
        pictures["Scans with the markers' model fitted to them, the reference first."] = before
        pictures["The same scans registered: all have the reference's vertices."] = after
        if adapted is not None:
            faces = [_still(mesh) for mesh in (load_built(MEASURED), adapted, head)]
            labels = [("built-in head", ""), ("adapted", ""), ("dense face", "")]
            pictures["The built-in head before and after it was fitted to the dense face."] = contact_sheet(
                faces, labels
            )
    return pictures


def _sparse(fitted: Fitted) -> Picture:
    space, prepared = fitted.space.space, fitted.prepared
    weights = space.to_space(prepared.pick(space.markers, *prepared.takes))
    shown, mean, spread = min(SHOWN, space.mode_count), weights.mean(axis=0), weights.std(axis=0)
    steps = FAR * np.diag(spread)[:shown]
    poses = np.concatenate([mean[None], *(mean + sign * step[None] for step in steps for sign in (-1, 1))])
    names = [name.name.removeprefix("mixed, most like ") for name in fitted.space.names]
    labels = [("mean", ""), *_labels([f"{n + 1}" for n in range(shown)], names)]
    return contact_sheet(draw_mouths(faps_of_weights(fitted.profile, poses)), labels)


def _labels(numbers: list[str], names: list[str]) -> list[tuple[str, str]]:
    return [(f"{n} {sign}3 sd", name) for n, name in zip(numbers, names, strict=False) for sign in ("−", "+")]


def _dense(face: DenseFace) -> tuple[FaceMesh, Picture]:
    imported, rig = make_dense_head(face, load_built(MEASURED))
    count = len(rig.modes_mm)
    shown = min(SHOWN, count)
    steps = FAR * ROW_FAPU * np.eye(count)[:shown]
    mean = -ROW_FAPU * face.estimator.coefficients(face.neutral_mm) / face.deviations_mm  # weights count from neutral
    rows = [mean, *(mean + sign * step for step in steps for sign in (-1, 1))]
    with open_crowd_renderer([moved_by_modes(imported.mesh, rig)], FACE, columns=1) as crowd:
        pictures = list(crowd.frames([Pose(row, MOVED_BONES)] for row in rows))
    return imported.mesh, contact_sheet(pictures, [("mean", ""), *_labels(mode_names(count)[:shown], [""] * shown)])


def _registration(study: DenseStudy) -> list[Picture]:
    """Draw scans with their fitted markers, before and after registration; of many those evenly spread."""
    count = len(study.registration)
    shown = [study.registration[index] for index in np.linspace(0, count - 1, min(count, SCANS)).astype(int)]
    labels = [(Path(name).stem, "") for name, *_ in shown]
    return [contact_sheet([_dotted(each[way], each[3]) for each in shown], labels) for way in (1, 2)]


def _dotted(surface: Surface, markers_mm: Array) -> Picture:
    scale, shift = fitting(surface.vertices_mm)
    still = [(scale * places + shift, np.zeros((1, *places.shape))) for places in (surface.vertices_mm, markers_mm)]
    mesh = dotted_mesh(still[0], surface.triangles, still[1], np.zeros(len(markers_mm), bool))
    with open_crowd_renderer([mesh], FACE, columns=1) as crowd:
        return crowd.draw([Pose(np.zeros(1), MOVED_BONES)])


def _still(mesh: FaceMesh) -> Picture:
    with open_renderer(mesh, FACE) as renderer:
        return renderer.draw(np.zeros(68))
