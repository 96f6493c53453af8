"""Draw ``docs/pictures/phones.jpg``: every viseme and special sounds of languages, mouth from the front and the side.

    python -m design.phones_sheet [-o docs/pictures/phones.jpg]

Each sound lasts 0.4 s between silences; the frame is that of its middle. What is said is the shipped profile's speech
with the phonetic layer, without gestures.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fapengine.files.pictures import contact_sheet
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.render.camera import Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "phones.jpg"
PHONES = {  # the phone, and its viseme or the language that it is special to
    SILENCE: "viseme 0", "p": "viseme 1", "f": "viseme 2", "θ": "viseme 3", "t": "viseme 4", "k": "viseme 5",
    "ʃ": "viseme 6", "s": "viseme 7", "n": "viseme 8", "ɹ": "viseme 9", "ɑ": "viseme 10", "ɛ": "viseme 11",
    "i": "viseme 12", "ɔ": "viseme 13", "u": "viseme 14", "ɪ": "English", "e": "German", "æ": "English", "a": "Spanish",
    "o": "French", "w": "English", "l": "English", "y": "German, Turkish",
    "ø": "German", "œ": "French", "ɥ": "French", "ʎ": "Italian", "x": "Spanish", "ɕ": "Polish",
    "ɨ": "Russian", "ɯ": "Japanese", "ʂ": "Mandarin", "ħ": "Arabic", "ʈ": "Hindi", "ɲ": "French",
}  # fmt: skip
"""Phones of the sheet."""
MOUTH = (0.0, -36.0, 90.0)
VIEWS = (
    Camera(target_mm=MOUTH, distance_mm=500.0, field_deg=9.5),
    Camera(target_mm=(0.0, -36.0, 104.0), distance_mm=500.0, field_deg=9.5, yaw_deg=80.0),
)
TILE = (176, 240)


def pose(*labels: str, at: int = 0) -> NDArray[np.int32]:
    """(68,) FAPU: the middle of one sound, alone or in a word, in which each lasts 0.12 s."""
    each_s = 0.4 if len(labels) == 1 else 0.12
    edges = [0.3 + each_s * index for index in range(len(labels) + 1)]
    spoken = [Phone(label, *span) for label, span in zip(labels, pairwise(edges), strict=True)]
    track = PhoneTrack.from_phones([Phone(SILENCE, 0.0, 0.3), *spoken, Phone(SILENCE, edges[-1], edges[-1] + 0.3)])
    profile = load_profile("grid_s1_en")
    rng = np.random.default_rng(0)
    return plan(track, profile, rng=rng, rate_hz=100.0, style=Style.speech_only()).track.values[
        round(100 * (edges[at] + each_s / 2))
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("-o", "--output", type=Path, default=PICTURE)
    poses = [pose(label) for label in PHONES]
    head, seen = build_head(), []
    for camera in VIEWS:
        with FaceRenderer(head, RenderOptions(size=TILE, camera=camera, samples=4)) as renderer:
            seen.append([renderer.draw(row)[..., :3].copy() for row in poses])
    frames = [np.hstack(both) for both in zip(*seen, strict=True)]
    labels = [("rest" if label == SILENCE else label, note) for label, note in PHONES.items()]
    sheet = contact_sheet(frames, labels, title="Sounds alone, from the front and the side")
    Image.fromarray(sheet).save(parser.parse_args().output, quality=82, optimize=True)


if __name__ == "__main__":
    main()
