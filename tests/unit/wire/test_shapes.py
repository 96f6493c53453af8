"""FAPs to shapes: one face followed frame by frame, and many frames at once."""

import numpy as np

from fapengine._resources import profile_files
from fapengine.mpeg4 import fap
from fapengine.profiles import parse_profile
from fapengine.retarget.arkit import approximate_arkit, arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.wire.shapes import ArkitFollower

PHONES = PhoneTrack.from_phones(
    [Phone(label, 0.1 * n, 0.1 * n + 0.1) for n, label in enumerate(["m", "aɪ", "b", "uː", "f"])]
)
JAW, CLOSE = ARKIT_NAMES.index("jawOpen"), ARKIT_NAMES.index("mouthClose")


def test_a_face_that_is_followed_shows_what_a_whole_track_would() -> None:
    profile = parse_profile(profile_files("grid_s1_en"))
    faps = plan(PHONES, profile, rng=np.random.default_rng(0), rate_hz=30).track.values
    follower = ArkitFollower()
    followed = np.array([follower.follow(row) for row in faps])
    at_once = approximate_arkit(faps)
    shapes = arkit_map()
    off = np.abs(shapes.to_faps(followed) - shapes.to_faps(at_once))
    assert off.max() < 20  # FAPU; the gradients of many frames stop a little early
    assert (followed[:, CLOSE] <= followed[:, JAW]).all()
    assert (at_once[:, CLOSE] <= at_once[:, JAW]).all()
    assert followed[:, JAW].max() > 0.1


def test_presets_of_a_face_are_followed_a_little_later() -> None:
    from fapengine.retarget.visemes import SHOWN, VRM1_NAMES, approximate_presets
    from fapengine.wire.shapes import PresetFollower

    faps = np.zeros((30, 68))
    faps[:, fap.column(3)] = np.linspace(0, 300, 30)
    for number in (4, 5, 51, 52):
        faps[:, fap.column(number)] = -np.linspace(0, 200, 30)
    faps[10:15, [fap.column(19), fap.column(20)]] = 900
    follower = PresetFollower()
    found = np.array([follower.follow(row) for row in faps])
    np.testing.assert_allclose(found, approximate_presets(faps)[:, :SHOWN], atol=0.04)
    assert found[12, VRM1_NAMES.index("blink")] > 0.8
    assert found[-1, 5:10].sum() > 0.3
