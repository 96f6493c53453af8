"""Draw the six expressions and the phones of a profile at full strength: ``docs/pictures/faces.jpg``, to be looked at.

python design/face_sheet.py
"""

from pathlib import Path

import numpy as np
from PIL import Image

from fapengine.files.pictures import contact_sheet
from fapengine.files.profiles import load_profile
from fapengine.mesh.head import build_head
from fapengine.render.renderer import FaceRenderer
from fapengine.trajectory.closures import close_lips
from fapengine.trajectory.faps import displacements_to_faps

PHONES = ("m", "f", "θ", "t", "s", "ʃ", "k", "ɹ", "w", "u", "oʊ", "i", "ɛ", "æ", "ɑ", "aɪ", "ɔ", "ʌ")
PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "faces.jpg"


def main() -> None:
    profile = load_profile("grid_s1_en")
    poses = [(name.name.lower(), pose.target, pose.fap) for name, pose in profile.expressions.items()]
    poses += [(name, profile.phones[name].targets[0], np.zeros(68)) for name in PHONES]
    pictures = []
    with FaceRenderer(build_head()) as renderer:
        for _, target, beyond in poses:
            moved = profile.space.to_points_mm(target[None])
            faps = displacements_to_faps(moved, profile.space.points, profile.fapu) + beyond
            pictures.append(renderer.draw(close_lips(faps, np.zeros(1), [])[0]))
    sheet = contact_sheet(pictures, [(name, "") for name, _, _ in poses], title="Expressions and phones of grid_s1_en")
    Image.fromarray(sheet).save(PICTURE, quality=86)


if __name__ == "__main__":
    main()
