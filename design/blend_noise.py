"""Study of how much a rig's shapes may answer for each FAP, from which NOISE_MM of blendshape_basis.py comes.

    python -m design.blend_noise data

For each value: how near speech comes back from its FAPs on ICT-FaceKit's face (mm over the whole face), and how far
a FAP alone moves skin 40 mm and more from its own point (a share of that point's motion, mean over the FAPs). The last
row has feature points alone.
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import fapengine.mesh.rig.blendshape_basis as basis
from design.data_files import FOLDER, asked_path
from design.imported_head import write_folder
from fapengine.files.heads.meshes import load_rig
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import deform
from fapengine.mesh.rig.blendshape_mesh import JAW, LEFT, RIGHT
from fapengine.mesh.rig.feature_points import locate
from fapengine.mesh.rig.import_head import import_head
from fapengine.mpeg4 import fap
from fapengine.retarget.rig_weights import choose_blendshapes

FACE, FAR_MM, FRAMES = 9409, 40.0, 30


def main(data: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_folder(data, Path(folder) / "ict")
        rig = load_rig(Path(folder) / "ict")
    moves = {LEFT: rig.dense("eyeBlink_L"), RIGHT: rig.dense("eyeBlink_R"), JAW: rig.dense("jawOpen")}
    standard = build_head()
    points = locate(rig, moves, standard)
    shapes = choose_blendshapes(rig.blendshapes).blended
    speech = np.load(data / "speech_train.npz")
    weights = speech["ict_w"][:: len(speech["ict_w"]) // FRAMES].astype(float)
    names = speech["ict_names"].tolist()
    wanted = [sum(w * rig.dense(name) for w, name in zip(row, names, strict=True) if w) for row in weights]
    print("| noise mm | speech: error mm | 99 % | far from the point |\n|---|---|---|---|")
    for noise in (0.5, 1.0, 1.5, 2.0, 4.0, None):
        if noise is not None:
            basis.NOISE_MM = noise
        head = import_head(rig, shapes if noise else [], points, standard)
        mesh = head.mesh
        kept = np.unique(rig.triangles)
        centred = [place - place.mean(axis=0) for place in (rig.vertices[kept], mesh.vertices_mm)]
        turn = np.linalg.lstsq(*centred, rcond=None)[0]
        asked = basis.coordinates(mesh.feature_points, jaw=True)
        errors, motions = [], []
        for move in wanted:
            there = move[kept] @ turn
            motions.append(np.linalg.norm(there, axis=1)[kept < FACE])
            faps = np.zeros(fap.FAP_COUNT)
            for one in asked:
                shift = there[one.vertex] - (there[mesh.feature_points["2.1"]] if one.number == basis.CHIN_FAP else 0.0)
                faps[fap.column(one.number)] = shift @ one.axis / mesh.fapu.unit(fap.spec(one.number).unit)
            errors.append(np.linalg.norm(deform(mesh, faps) - mesh.vertices_mm - there, axis=1)[kept < FACE])
        far = np.mean([spill(mesh, one) for one in asked if one.number not in basis.JAW_FAPS])
        if noise == 0.5:
            print(f"| (the motion itself) | {np.mean(motions):.3f} | {np.quantile(motions, 0.99):.2f} | |")
        print(f"| {noise or 'points alone'} | {np.mean(errors):.3f} | {np.quantile(errors, 0.99):.2f} | {far:.3f} |")


def spill(mesh, one) -> float:
    """Motion of the skin far from a FAP's point, as a share of the point's."""
    frame = np.zeros(fap.FAP_COUNT)
    frame[fap.column(one.number)] = 100.0
    gone = deform(mesh, frame) - mesh.vertices_mm
    far = cKDTree(mesh.vertices_mm[[one.vertex]]).query(mesh.vertices_mm)[0] > FAR_MM
    return float(np.quantile(np.linalg.norm(gone[far], axis=1), 0.98) / abs(gone[one.vertex] @ one.axis))


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "speech_train.npz"))
