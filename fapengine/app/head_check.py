"""Checks of a head: a contact sheet of each FAP, phone and expression, and remarks on lips that do not open or meet."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.files.pictures import contact_sheet, save_png
from fapengine.files.profiles import load_profile
from fapengine.mesh.deform import POSE_AU, POSE_FAPU, deform, single_fap
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import VISEMES
from fapengine.mpeg4.track import to_codable
from fapengine.render.drawing import Drawing
from fapengine.render.renderer import FaceRenderer
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.trajectory.faps import displacements_to_faps

PICTURE_PX = 384
LIPS = "2.2", "2.3"
"""Feature points: the middle of the inner upper and lower lip."""
AH = {3: 400.0, 4: -40.0, 5: -450.0}
"""FAPs of a wide ah: jaw, upper and lower lip, FAPU."""
OPENING_MM, APART_MM = (4.0, 30.0), 2.5
"""Plausible openings of an ah, 8 to 20 mm for an adult, and gap of lips that do not meet at rest."""
MNS_SHARE = 0.15, 0.6
"""Plausible distance of mouth and nose (MNS0), as a share of that of the eyes (ES0)."""


def draw_check(mesh: FaceMesh, path: Path, *, title: str) -> int:
    """Draw every pose into a contact sheet (.png), and return how many there are.

    Raises
    ------
    UsageError
        If the name does not end with .png.
    ResourceError
        If it cannot be written, or there is no OpenGL.
    """
    if path.suffix != ".png":
        raise UsageError(f"path: got {path}, expected a name that ends with .png")
    rows, labels = poses()
    with FaceRenderer(mesh, Drawing(size=(PICTURE_PX, PICTURE_PX), samples=0, rest=0.0)) as renderer:
        pictures = list(renderer.frames(to_codable(rows)))
    title = f"{title}: FAPs at {POSE_FAPU} FAPU (angles at {POSE_AU / 1e5:g} rad), phones"
    save_png(path, contact_sheet(pictures, labels, title=title))
    return len(pictures)


def lip_remarks(mesh: FaceMesh) -> tuple[str, ...]:
    """Remark on a head whose lips do not open, do not meet, or are measured wrongly; none if it has no such points."""
    if not set(LIPS) <= set(mesh.feature_points):
        return ()
    pose = np.zeros((2, fap.FAP_COUNT))
    for number, value in AH.items():
        pose[1, fap.column(number)] = value
    upper, lower = (deform(mesh, pose)[:, mesh.feature_points[name]] for name in LIPS)
    gap_mm = upper[:, 1] - lower[:, 1]
    opening_mm, share = float(gap_mm[1] - gap_mm[0]), mesh.fapu.mns0_mm / mesh.fapu.es0_mm
    remarks = []
    if not OPENING_MM[0] <= opening_mm <= OPENING_MM[1]:
        remarks.append(f"lips: they open by {opening_mm:.1f} mm on a wide ah, expected 8 to 20 mm")
    if gap_mm[0] > APART_MM:
        remarks.append(f"lips: they do not meet, and are {gap_mm[0]:.1f} mm apart at rest; close the mouth of the mesh")
    if not MNS_SHARE[0] <= share <= MNS_SHARE[1]:
        remarks.append(
            f"lips: mouth and nose are {mesh.fapu.mns0_mm:.1f} mm apart, {share:.2f} of the eyes' distance, expected"
            f" {MNS_SHARE[0]:g} to {MNS_SHARE[1]:g}; points=FILE sets 8.1 and 9.15"
        )
    return tuple(remarks)


def poses() -> tuple[NDArray[np.float64], list[tuple[str, str]]]:
    """Return the neutral pose, each FAP, each phone and each expression.

    Returns
    -------
    rows : (N, 68) float64, FAPU
    labels : list of (str, str)
        Name and kind of each row.
    """
    rows, labels = [np.zeros(fap.FAP_COUNT)], [("rest", "")]
    for number in range(3, fap.FAP_COUNT + 1):
        rows.append(single_fap(number))
        labels.append((str(number), fap.spec(number).name))
    profile = load_profile(DEFAULT_PROFILE)
    spelling = str.maketrans("rɒʊe", "ɹɔuɛ")  # the table's phonemes in the nearest spelling of the profile
    visemes = {
        phoneme.rstrip("ː").translate(spelling): f"viseme {row.number}" for row in VISEMES for phoneme in row.phonemes
    }
    for spoken, phone in profile.phones.items():
        moved_mm = profile.space.to_points_mm(phone.targets[:1])
        rows.append(displacements_to_faps(moved_mm, profile.space.points, profile.fapu)[0])
        labels.append((spoken, visemes.get(spoken, "phone")))
    for expression, face in profile.expressions.items():
        moved_mm = profile.space.to_points_mm(face.target[None])
        rows.append(displacements_to_faps(moved_mm, profile.space.points, profile.fapu)[0] + face.fap)
        labels.append((expression.label, "expression"))
    return np.stack(rows), labels
