"""A contact sheet of each FAP, phone and expression of a head."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.files.pictures import contact_sheet, save_png
from fapengine.files.profiles import load_profile
from fapengine.mesh.deform import POSE_AU, POSE_FAPU, single_fap
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import VISEMES
from fapengine.mpeg4.track import to_codable
from fapengine.render.drawing import Drawing
from fapengine.render.renderer import FaceRenderer
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.trajectory.faps import displacements_to_faps

PICTURE_PX = 384


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
    with FaceRenderer(mesh, Drawing(size=(PICTURE_PX, PICTURE_PX), samples=0)) as renderer:
        pictures = list(renderer.frames(to_codable(rows)))
    title = f"{title}: FAPs at {POSE_FAPU} FAPU (angles at {POSE_AU / 1e5:g} rad), phones"
    save_png(path, contact_sheet(pictures, labels, title=title))
    return len(pictures)


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
