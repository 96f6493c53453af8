"""The stranger's detector looks at twelve people: a face in every picture, and what it does in 19 of 20."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from design.face_page import CLOSE, EVERYBODY, draw, frame, pose
from fapengine.files.heads.load import load_head
from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.render.camera import preset
from tests.detector.test_a_stranger_sees_a_face import PYTHON, detect

Array = NDArray[np.float64]

# Landmarks of MediaPipe's face mesh, left and right.
EYES_OUT, EYES_IN, BROWS, BROWS_IN = [263, 33], [362, 133], [334, 105], [285, 55]
CORNERS, LIPS, LIDS = [291, 61], [14, 13], [[386, 374], [159, 145]]
STATES = ("joy", "surprise", "anger", "sadness", "u", "ɑ")


def measures(marks: Array) -> dict[str, float]:
    """Lengths as shares of the eyes' outer distance; up is positive."""
    across = np.linalg.norm(np.diff(marks[EYES_OUT, :2], axis=0))

    def above(one: list[int], other: list[int]) -> float:
        return float((marks[other, 1].mean() - marks[one, 1].mean()) / across)

    def apart(pair: list[int]) -> float:
        return float(np.linalg.norm(np.diff(marks[pair, :2], axis=0)) / across)

    return {
        "width": apart(CORNERS),
        "opening": apart(LIPS),
        "corners": above(CORNERS, EYES_OUT),
        "brows": above(BROWS, EYES_OUT),
        "inner brows": above(BROWS_IN, EYES_IN),
        "lids": sum(map(apart, LIDS)) / 2,
    }


def reads(state: str, seen: dict[str, float], rest: dict[str, float]) -> bool:
    """Whether measures say what the face does, beside those of the same face at rest."""
    more = {name: seen[name] - rest[name] for name in rest}
    return {
        "joy": seen["width"] > 1.1 * rest["width"] and more["corners"] > 0,
        "surprise": more["opening"] > 0.08 and more["brows"] > 0.015,
        "anger": more["inner brows"] < -0.02,
        "sadness": more["inner brows"] - more["brows"] > 0.01 and more["corners"] < 0,
        "u": more["width"] < 0,
        "ɑ": more["opening"] > 0.05,
        "blink": seen["lids"] < 0.6 * rest["lids"],
    }[state]


@pytest.mark.skipif(not PYTHON.exists(), reason="face detector absent; make detector")
@pytest.mark.parametrize("names", [EVERYBODY[::4], pytest.param(EVERYBODY, marks=pytest.mark.nightly)], ids=len)
def test_everybody_has_a_face_that_reads(names: tuple[str, ...], tmp_path: Path) -> None:
    profile, still = load_profile("grid_s1_en"), np.zeros(fap.FAP_COUNT)
    faces = {name: pose(profile, name) for name in STATES}
    faces["blink"] = frame(close_t_l_eyelid=1024, close_t_r_eyelid=1024)
    pictures = []
    for name in names:
        head = load_head(f"{name}{',' if ':' in name else ':'}level=coarse")
        pictures += draw(head, [still, *faces.values()], CLOSE, 256)
        pictures += draw(head, [still], preset("three-quarter"), 256)
    found = detect(np.array(pictures), tmp_path)
    assert np.isfinite(found).all()  # a face in every picture
    read = [
        reads(state, measures(marks), measures(row[0]))
        for row in found.reshape(len(names), len(faces) + 2, -1, 3)
        for state, marks in zip(faces, row[1:-1], strict=True)
    ]
    assert np.mean(read) >= 0.95
