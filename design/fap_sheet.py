"""Draw all 66 low-level FAPs on the built-in head, each at a typical value and its negative.

    python -m design.fap_sheet [--head default] [--scale 1] [-o out/faps.png]

Each FAP is drawn alone, without the resting pose; the camera shows its part of the face. Of FAPs that go one way only,
the negative is left out.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from fapengine.files.heads.load import load_head
from fapengine.files.pictures import contact_sheet
from fapengine.mpeg4 import fap
from fapengine.render.camera import Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer

FACE = Camera(target_mm=(0.0, 8.0, 60.0), distance_mm=900.0, field_deg=12.5)
MOUTH = Camera(target_mm=(0.0, -36.0, 90.0), distance_mm=500.0, field_deg=9.5)
EYES = Camera(target_mm=(0.0, 42.0, 80.0), distance_mm=700.0, field_deg=9.5)
NOSE = Camera(target_mm=(0.0, -4.0, 90.0), distance_mm=500.0, field_deg=8.0)
TYPICAL = {2: 200, 3: 500, 4: 200, 5: 150, 6: 300, 7: 25_000, 8: 200, 9: 80, 10: 200}
"""FAPU by FAP group."""
OTHERS = {3: 500, 14: 150, 15: 150} | dict.fromkeys((23, 24, 25, 26), 25_000) | {27: 40, 28: 40, 45: 600}
"""FAPU of FAPs that differ from their group."""
VIEWS = {2: MOUTH, 3: EYES, 4: EYES, 5: FACE, 6: MOUTH, 7: FACE, 8: MOUTH, 9: NOSE, 10: FACE}
SIZE = (320, 320)


def values(each: fap.FapSpec, scale: float = 1.0) -> list[float]:
    """Values of a FAP on the sheet, FAPU: the positive one first."""
    value = scale * OTHERS.get(each.number, TYPICAL[each.group])
    return [value, -value] if each.bidirectional else [value]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--head", default="default")
    parser.add_argument("--scale", type=float, default=1.0, help="multiply all values")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/faps.png"))
    given = parser.parse_args()
    head, frames, labels = load_head(given.head), [], []
    for group, camera in VIEWS.items():  # FAPs are sorted by group
        with FaceRenderer(head, RenderOptions(size=SIZE, camera=camera)) as renderer:
            for each in (each for each in fap.FAPS if each.group == group):
                for value in values(each, given.scale):
                    faps = np.zeros(fap.FAP_COUNT)
                    faps[fap.column(each.number)] = value
                    frames.append(renderer.draw(faps)[..., :3].copy())
                    labels.append((f"{each.number}", f"{each.name} {value:+g}"))
    sheet = contact_sheet(frames, labels, title=f"FAPs of {given.head}, each alone")
    given.output.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(sheet).save(given.output)
    print(f"{given.output}: {len(frames)} tiles")


if __name__ == "__main__":
    main()
