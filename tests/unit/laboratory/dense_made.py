"""A dense face whose truth is known: our own head in held postures, and takes of markers on it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fapengine.capture.marker_track import MarkerTrack
from fapengine.geometry.rigid import RigidMotion
from fapengine.laboratory.dense_face import DenseFace
from fapengine.laboratory.dense_file import format_dense
from fapengine.laboratory.marker_driver import HeadReference
from fapengine.laboratory.setup import Paint
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.models.dense import fit_dense_modes, fit_estimator
from fapengine.models.missing import fit_gaps
from fapengine.mpeg4 import fap

RATE_HZ = 50.0
SKULL = {"LFHD": (55, 90, 70), "RFHD": (-55, 90, 70), "LBHD": (70, 70, -40), "RBHD": (-70, 70, -40)}
MOVING = {3: 180, 4: -120, 5: -260, 6: 90, 7: 90, 16: 110, 17: 90, 31: 90, 32: 90}
"""FAPs of the made speech, and how far each goes."""


@dataclass(frozen=True)
class MadeFace:
    head: FaceMesh
    used: np.ndarray
    """Vertices of the head that the scans have."""
    dense: DenseFace
    labels: tuple[str, ...]

    def faces_mm(self, amounts: np.ndarray) -> np.ndarray:
        """True dense faces, (T, V, 3) mm, of amounts (T, N) of the FAPs that move."""
        return deform(self.head, faps_of(amounts))[:, self.used]

    def take(self, seconds: float = 1.0, *, gaps: bool = True, seed: int = 5) -> tuple[MarkerTrack, np.ndarray]:
        """A recording with head motion, in a turned room, and its true dense faces."""
        times = np.arange(round(RATE_HZ * seconds)) / RATE_HZ
        rng = np.random.default_rng(seed)
        amounts = np.sin(np.outer(times, rng.uniform(4, 12, len(MOVING)))) * rng.uniform(0.4, 1, len(MOVING))
        truth = self.faces_mm(amounts)
        vertices = [int(np.flatnonzero(self.used == self.head.feature_points[name])[0]) for name in self.labels]
        markers = np.concatenate(
            [truth[:, vertices], np.tile(np.array([*SKULL.values()], float), (len(times), 1, 1))], axis=1
        )
        turn = Rotation.from_rotvec(np.outer(np.sin(2 * times), [0.1, 0.2, 0.05])).as_matrix()
        markers = np.einsum("tij,tmj->tmi", turn, markers) + np.outer(np.sin(times), [10.0, 5.0, -3.0])[:, None]
        markers = markers @ Rotation.from_rotvec([0.4, -1.2, 0.3]).as_matrix().T + [500.0, 100.0, -900.0]
        if gaps:
            markers[10:20, 3] = np.nan
            markers[15:30, 7] = np.nan
        return MarkerTrack(positions_mm=markers, labels=(*self.labels, *SKULL), rate_hz=RATE_HZ), truth

    def write(self, folder: Path) -> Path:
        """A profile's folder, as far as the dense face goes."""
        folder.mkdir(parents=True)
        for name, data in format_dense(self.dense).items():
            (folder / name).write_bytes(data)
        return folder


def faps_of(amounts: np.ndarray) -> np.ndarray:
    faps = np.zeros((len(amounts), fap.FAP_COUNT))
    for column, (number, most) in enumerate(MOVING.items()):
        faps[:, fap.column(number)] = most * amounts[:, column]
    return faps


def make_face(head: FaceMesh) -> MadeFace:
    skin = np.isin(head.material, (Material.SKIN, Material.LIP))
    front = skin & (head.vertices_mm[:, 2] > 20) & (head.vertices_mm[:, 1] > -120)
    triangles = head.triangles[front[head.triangles].all(axis=1)]
    used, corners = np.unique(triangles, return_inverse=True)
    labels = tuple(
        name
        for name, vertex in head.feature_points.items()
        if vertex in used and name.split(".")[0] in ("2", "4", "5", "8", "9")
    )
    at = [int(np.flatnonzero(used == head.feature_points[name])[0]) for name in labels]
    rng = np.random.default_rng(1)
    made = MadeFace(head, used, None, labels)  # type: ignore[arg-type]
    held = np.concatenate([np.zeros((1, len(MOVING))), rng.uniform(-1, 1, (11, len(MOVING)))])
    scans = made.faces_mm(held)
    frames = made.faces_mm(rng.uniform(-1, 1, (90, len(MOVING))))[:, at]
    sparse = fit_gaps(frames, np.ones(frames.shape[:2], bool), len(MOVING))
    marks = scans[:, at]
    scores = sparse.scores(marks, np.ones(marks.shape[:2], bool))
    neutral = head.vertices_mm[used].astype(float)
    colour = np.zeros((8, 8, 4), np.uint8)
    colour[:] = (200, 150, 120, 255)
    dense = DenseFace(
        subject="made", licence="ours", labels=labels, points=labels, neutral_mm=neutral[at],
        reference=HeadReference(
            tuple(SKULL), np.array([*SKULL.values()], float), RigidMotion(np.eye(3), np.zeros(3))
        ),
        sparse=sparse, modes=fit_dense_modes(scans, scores), estimator=fit_estimator(scans, marks, noise_mm=0.01),
        triangles=corners.reshape(-1, 3),
        paint=Paint(uv=np.clip(neutral[:, :2] / 200 + 0.5, 0, 1), texture=colour), noise_mm=0.01,
        left_out_mm=(0.1, 0.1), scan_weights=scores, take_weights={"one": scores[:3]},
    )  # fmt: skip
    return MadeFace(head, used, dense, labels)
