"""Paper 004 on tracked speech and the dense face of the same frames; the points are good to about 0.7 mm."""

import csv

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fapengine.models.estimator import fit_estimator, fit_estimator_to_motion

RATE_HZ = 25.0
POSTURES = ("sil", "AY", "IY", "UW", "OW", "B", "F", "EH")
LIPS_MM = 6.0
"""Vertices so near to a lip marker are lips: 1290 of them."""


@pytest.fixture(scope="module")
def face(shared, speech):
    data = np.load(shared / "data" / "dense_face.npz")
    with (shared / "data" / "markers.csv").open() as file:
        rows = list(csv.DictReader(file))
    lips = [int(row["vertex"]) for row in rows if row["layout"] == "berger209"]
    lips = np.array(lips)[speech.is_lip[:209]]
    vertices = data["vertices"][:14062].astype(np.float64)
    fields = data["expr"][:, :14062].astype(np.float64)
    near = cKDTree(vertices[lips]).query(vertices)[0] < LIPS_MM
    marked = np.array([int(row["vertex"]) for row in rows if row["layout"] == "optotrak18"])
    return vertices[near], fields[:, near], vertices[marked], fields[:, marked]


def lip_error(estimator, speech, face):
    rest, fields, marked, _ = face
    frames = np.flatnonzero(~speech.training)[::5]
    points = marked + speech.motion_mm[frames][:, speech.columns["optotrak18"]]
    truth = rest + np.tensordot(speech.weights[frames], fields, axes=1)
    return np.linalg.norm(estimator.faces_mm(points) - truth, axis=-1).mean()


@pytest.mark.shared
def test_eight_postures_as_in_the_paper(speech, face):
    rest, fields, marked, marked_fields = face
    assert len(rest) > 1000
    mean = []
    for label in POSTURES:
        tokens = speech.phones[speech.phones[:, 3] == speech.labels.index(label)]
        tokens = tokens[~np.isin(tokens[:, 0], speech.held_out)]
        frames = 75 * tokens[:, 0] + np.minimum(np.round((0.7 * tokens[:, 1] + 0.3 * tokens[:, 2]) * RATE_HZ), 74)
        mean.append(frames.astype(int))
    weights = np.stack([speech.weights[frames].mean(axis=0) for frames in mean])
    scans = rest + np.tensordot(weights, fields, axes=1)
    on_scans = marked + np.tensordot(weights, marked_fields, axes=1)
    recorded = marked + np.stack([speech.motion_mm[f][:, speech.columns["optotrak18"]].mean(axis=0) for f in mean])
    literal = lip_error(fit_estimator(scans, on_scans), speech, face)
    tempered = lip_error(fit_estimator(scans, on_scans, noise_mm=0.7), speech, face)
    better = lip_error(fit_estimator(scans, recorded, noise_mm=0.3), speech, face)
    assert tempered < 0.851
    assert better < 0.7 < tempered < literal


@pytest.mark.shared
@pytest.mark.parametrize(("modes", "limit_mm"), [(7, 0.310), (15, 0.215)])
def test_all_frames(speech, face, modes, limit_mm):
    rest, fields, marked, _ = face
    points = marked + speech.motion_mm[speech.training][:, speech.columns["optotrak18"]]
    weights = speech.weights[speech.training]
    estimator = fit_estimator_to_motion(points, weights, fields, rest, mode_count=modes)
    assert lip_error(estimator, speech, face) < limit_mm
