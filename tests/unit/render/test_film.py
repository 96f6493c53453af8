"""Ten seconds of a face that speaks, blinks, looks about and sways, as a film: nothing pops, flickers or goes dark."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine._resources import profile_files
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.profiles import parse_profile
from fapengine.render.camera import preset
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from tests.projection import project

Array = NDArray[np.float64]

SIZE = (160, 160)
RATE_HZ, FRAMES = 20.0, 200
SENTENCE = "b ɹ aɪ t s ʌ n ʃ aɪ n p ɑ m i θ u v ɛ l w ɔ k"
PHONE_S, PAUSE_S = 0.085, 0.12
HEAD_MM, SLOW_MM = 110.0, 0.2
"""Distance of the hair from the neck's joint; what counts as slow, mm from frame to frame."""
MUCH = 60
"""Levels of 255 by which a pixel changes much."""
MOUTH_MM, EYES_MM = (-46.0, 46.0, -96.0, -12.0), (-58.0, 58.0, 14.0, 66.0)
"""Places of the head, left, right, bottom, top, where what moves fast is: lips and chin; lids, lashes and brows."""


@pytest.fixture(scope="module", params=["short", "bob", "long"])
def head(request: pytest.FixtureRequest) -> FaceMesh:
    return build_head(HeadStyle(haircut=request.param))


@pytest.fixture(scope="module")
def faps() -> Array:
    """(200, 68): a sentence over and over with all that a face does beside it."""
    phones, now_s = [], 0.4
    while now_s < FRAMES / RATE_HZ:
        for label in SENTENCE.split():
            phones.append(Phone(label, now_s, now_s + PHONE_S))
            now_s += PHONE_S
        now_s += PAUSE_S
    profile = parse_profile(profile_files("grid_s1_en"))
    track = plan(PhoneTrack.from_phones(phones), profile, rng=np.random.default_rng(3), rate_hz=RATE_HZ).track
    return track.values[:FRAMES].astype(np.float64)


@pytest.fixture(scope="module")
def film(head: FaceMesh, faps: Array) -> NDArray[np.int16]:
    with FaceRenderer(head, RenderOptions(size=SIZE)) as renderer:
        return np.array(list(renderer.frames(faps)), dtype=np.int16)


@pytest.fixture(scope="module")
def still() -> NDArray[np.bool_]:
    """(H, W): where neither lips nor eyes are."""
    calm = np.ones(SIZE[::-1], dtype=bool)
    for left, right, bottom, top in (MOUTH_MM, EYES_MM):
        corners = np.array([[left, top, 80.0], [right, bottom, 80.0]])
        (x0, y0), (x1, y1) = np.round(project(preset("front"), corners, SIZE)).astype(int)
        calm[y0:y1, x0:x1] = False
    assert 0.6 < calm.mean() < 0.97
    return calm


def test_the_film_has_speech_blinks_glances_and_a_head_that_moves(faps: Array) -> None:
    def column(number: int) -> Array:
        return faps[:, fap.column(number)]

    assert column(19).max() > 900
    assert np.ptp(column(23)) > 2000
    assert np.ptp(column(5)) > 300
    assert np.ptp(column(49)) > 1000


def test_no_pixel_flickers(film: NDArray[np.int16], still: NDArray[np.bool_]) -> None:
    """Outside of eyes and mouth nothing changes much and comes back in the next frame."""
    before, after = film[1:-1] - film[:-2], film[1:-1] - film[2:]  # of one sign where it comes back
    flicker = np.maximum(np.minimum(before, after), -np.maximum(before, after))
    seen = ((flicker > MUCH).any(axis=-1) & still).sum(axis=(1, 2))
    assert seen.max() <= 4  # of 25,600; 8 while tips of hair were narrower than a pixel, and 151 in all
    assert seen.sum() <= 30


def test_nothing_pops_while_the_head_moves_slowly(
    film: NDArray[np.int16], faps: Array, still: NDArray[np.bool_]
) -> None:
    """Of 25,600 pixels a few, at edges of the hair, may change much; on average they were 5.5."""
    change = np.abs(np.diff(film, axis=0)).max(axis=-1)
    turn_mm = HEAD_MM * AU_RAD * np.abs(np.diff(faps[:, [fap.column(number) for number in (48, 49, 50)]], axis=0))
    slow = turn_mm.max(axis=1) < SLOW_MM
    assert slow.sum() > 30
    popped = ((change > MUCH) & still).sum(axis=(1, 2))[slow]
    assert popped.mean() < 3.5
    assert popped.max() <= 24


def test_no_spot_of_the_cheeks_goes_dark(film: NDArray[np.int16]) -> None:
    grey = film.mean(axis=-1)
    for left, right in ((-46.0, -28.0), (28.0, 46.0)):
        corners = np.array([[left, 4.0, 80.0], [right, -10.0, 80.0]])
        (x0, y0), (x1, y1) = np.round(project(preset("front"), corners, SIZE)).astype(int)
        cheek = grey[:, y0:y1, x0:x1]
        share = cheek / np.median(cheek, axis=0)
        assert share.min() > 0.8
        assert share.max() < 1.2
