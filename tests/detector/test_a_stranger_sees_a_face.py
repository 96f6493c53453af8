"""A detector made by strangers for photographs of people looks at our pictures: MediaPipe's face mesh, in its own
environment (make detector), because it wants an older numpy. It needs no file beside its wheel.
"""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.expressions import EXPRESSIONS as ALL_EXPRESSIONS
from fapengine.expressions import STANDARD_EXPRESSIONS, Expression
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.profiles import Profile
from fapengine.render.camera import Camera, preset
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.trajectory.closures import close_lips
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.planner import plan
from fapengine.voices.espeak import EspeakVoice
from tests.projection import project

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
PYTHON = HERE.parent.parent / ".venv" / "detector" / "bin" / "python"
SENTENCE = "Bright sunshine shimmers on the ocean, and my baby moves a big yellow boat."
SIZE = (320, 320)
VIEWS = (preset("front"), Camera(yaw_deg=25.0), Camera(yaw_deg=-25.0, pitch_deg=8.0), Camera(pitch_deg=-12.0))
SMALL = (200, 200)
"""A face in a chat window."""
TURNS_DEG = tuple((yaw, pitch) for yaw in (-6.0, 0.0, 6.0) for pitch in (-3.0, 0.0, 3.0))
"""Turns of a head that speaks; what they do to landmarks is what an expression must exceed."""
EXPRESSIONS = tuple(expression.label for expression in STANDARD_EXPRESSIONS)
ON_ONE_SIDE = tuple(expression.label for expression in ALL_EXPRESSIONS if expression.mix)
# Landmarks of MediaPipe's face mesh, by the feature points that they lie on.
LANDMARKS = {
    "8.4": 61, "8.3": 291, "2.2": 13, "2.3": 14, "3.7": 263, "3.12": 33, "3.11": 362, "3.8": 133, "9.3": 4, "2.1": 152,
    "3.5": 473, "3.6": 468, "4.3": 334, "4.4": 105,
}  # fmt: skip


class Sight:
    """What the detector saw: speech, expressions from several sides, a blink."""

    def __init__(self, head: FaceMesh, folder: Path) -> None:
        profile = load_profile("grid_s1_en")
        speech = plan(EspeakVoice("en-us").speak(SENTENCE).phones, profile, rng=np.random.default_rng(3)).track
        self.speech_faps = speech.values[::2].astype(np.float64)
        poses = {"neutral": np.zeros(68), **_expressions(profile)}
        blink = np.zeros(68)
        blink[[fap.column(19), fap.column(20)]] = 1024
        poses["blink"] = blink
        pictures = _draw(head, self.speech_faps, VIEWS[0])
        for view in VIEWS:
            pictures += _draw(head, np.array(list(poses.values())), view)
        found = detect(np.array(pictures), folder)
        self.speech = found[: len(self.speech_faps)]
        seen = found[len(self.speech_faps) :].reshape(len(VIEWS), len(poses), -1, 3)
        self.poses = {name: seen[:, number] for number, name in enumerate(poses)}
        faint = {"neutral": np.zeros(68), **_expressions(profile, 0.6)}
        turned = [_turned(pose, *turn) for pose in faint.values() for turn in TURNS_DEG]
        small = detect(np.array(_draw(head, np.array(turned), VIEWS[0], SMALL)), folder)
        self.faint = dict(zip(faint, small.reshape(len(faint), len(TURNS_DEG), -1, 3), strict=True))


def _expressions(profile: Profile, strength: float = 1.0) -> dict[str, Array]:
    poses = {}
    for name, pose in profile.expressions.items():
        moved = profile.space.to_points_mm(pose.target[None])
        faps = displacements_to_faps(moved, profile.space.points, profile.fapu) + pose.fap
        poses[name.label] = close_lips(strength * faps, np.zeros(1), [])[0]
    for name in ON_ONE_SIDE:
        poses[name] = strength * expression_faps(profile)[:, ALL_EXPRESSIONS.index(Expression[name.upper()])]
    return poses


def _turned(faps: Array, yaw_deg: float, pitch_deg: float) -> Array:
    turned = faps.copy()
    turned[[fap.column(49), fap.column(48)]] = np.deg2rad([yaw_deg, pitch_deg]) / AU_RAD
    return turned


def _draw(head: FaceMesh, faps: Array, view: Camera, size: tuple[int, int] = SIZE) -> list[NDArray[np.uint8]]:
    with FaceRenderer(head, RenderOptions(size=size, camera=view, samples=0)) as renderer:
        return list(renderer.frames(faps))


def detect(pictures: NDArray[np.uint8], folder: Path) -> Array:
    """Landmarks of the face in each picture, (N, 478, 3) pixels; NaN where none is found."""
    np.save(folder / "pictures.npy", pictures)
    command = [PYTHON, HERE / "landmarks.py", folder / "pictures.npy", folder / "landmarks.npy"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    landmarks: Array = np.load(folder / "landmarks.npy")
    return landmarks


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


@pytest.fixture(scope="module")
def sight(head: FaceMesh, tmp_path_factory: pytest.TempPathFactory) -> Sight:
    if not PYTHON.exists():
        pytest.skip("face detector absent; make detector")
    return Sight(head, tmp_path_factory.mktemp("detector"))


def apart(landmarks: Array, one: str, other: str) -> Array:
    """Distance of two feature points as a share of that of the outer eye corners."""
    points = {name: landmarks[..., LANDMARKS[name], :2] for name in (one, other, "3.7", "3.12")}
    return np.linalg.norm(points[one] - points[other], axis=-1) / np.linalg.norm(
        points["3.7"] - points["3.12"], axis=-1
    )


def test_it_finds_the_face_in_speech(sight: Sight) -> None:
    found = ~np.isnan(sight.speech[:, 0, 0])
    assert len(found) >= 60
    assert found.mean() >= 0.99


@pytest.mark.parametrize("name", ["neutral", *EXPRESSIONS, *ON_ONE_SIDE, "blink"])
def test_it_finds_every_expression_from_every_side(sight: Sight, name: str) -> None:
    assert not np.isnan(sight.poses[name][..., 0]).any()


def test_its_mouth_opens_as_ours(sight: Sight, head: FaceMesh) -> None:
    moved = deform(head, sight.speech_faps)
    upper, lower = (moved[:, head.feature_points[name]] for name in ("2.2", "2.3"))
    ours = np.linalg.norm(upper - lower, axis=1)
    theirs = apart(sight.speech, "2.2", "2.3")
    assert ours.max() > 8  # mm: the sentence does open the mouth
    assert np.corrcoef(ours, theirs)[0, 1] >= 0.9


def test_it_sees_the_parts_where_they_are(sight: Sight, head: FaceMesh) -> None:
    landmarks = sight.poses["neutral"][0]
    names = [name for name in LANDMARKS if not name.startswith("4.")]
    places = project(VIEWS[0], np.array([head.point_mm(name) for name in names]), SIZE)
    off = np.linalg.norm(landmarks[[LANDMARKS[name] for name in names], :2] - places, axis=1)
    across = abs(places[names.index("3.7"), 0] - places[names.index("3.12"), 0])
    assert off.max() / across < 0.09, dict(zip(names, (off / across).round(3), strict=True))
    assert np.median(off) / across < 0.045


def test_it_sees_joy_as_a_smile(sight: Sight) -> None:
    joy, neutral = sight.poses["joy"][0], sight.poses["neutral"][0]
    assert apart(joy, "8.3", "8.4") > 1.06 * apart(neutral, "8.3", "8.4")  # the mouth is wider
    for corner in ("8.3", "8.4"):  # and its corners have come nearer to the eyes
        eye = {"8.3": "3.7", "8.4": "3.12"}[corner]
        assert apart(joy, corner, eye) < 0.97 * apart(neutral, corner, eye)


def test_it_sees_surprise_as_open_mouth_and_raised_brows(sight: Sight) -> None:
    surprise, neutral = sight.poses["surprise"][0], sight.poses["neutral"][0]
    assert apart(surprise, "2.2", "2.3") > apart(neutral, "2.2", "2.3") + 0.1
    for brow, eye in (("4.3", "3.11"), ("4.4", "3.8")):
        assert apart(surprise, brow, eye) > 1.07 * apart(neutral, brow, eye)


def test_it_sees_a_blink(sight: Sight) -> None:
    def opening(landmarks: Array) -> Array:
        lids = landmarks[..., 386, :2] - landmarks[..., 374, :2]
        corners = landmarks[..., 263, :2] - landmarks[..., 362, :2]
        return np.linalg.norm(lids, axis=-1) / np.linalg.norm(corners, axis=-1)

    assert opening(sight.poses["blink"][0]) < 0.5 * opening(sight.poses["neutral"][0])


def above(landmarks: Array, upper: tuple[int, int], lower: tuple[int, int]) -> Array:
    """Height of landmarks over others, both sides, as a share of that of the outer eye corners."""
    eyes = np.linalg.norm(landmarks[:, 263, :2] - landmarks[:, 33, :2], axis=-1)
    return (landmarks[:, lower, 1] - landmarks[:, upper, 1]).mean(axis=-1) / eyes


def inner_brows(landmarks: Array) -> Array:
    return above(landmarks, (55, 285), (133, 362))


def slant(landmarks: Array) -> Array:
    """Inner ends of the brows higher than the outer ones."""
    return inner_brows(landmarks) - above(landmarks, (46, 276), (33, 263))


def mouth_corners(landmarks: Array) -> Array:
    return above(landmarks, (61, 291), (13, 13))


@pytest.mark.parametrize(
    ("name", "measure", "deviations"),
    [
        ("anger", inner_brows, -3.5), ("sadness", slant, 2.5), ("sadness", mouth_corners, -3.0),
        ("surprise", inner_brows, 4.0),
    ],
)  # fmt: skip
def test_it_tells_an_expression_of_six_tenths_from_neutral_at_200_pixels(
    sight: Sight, name: str, measure, deviations: float
) -> None:
    """In standard deviations of what turns of the head do to a neutral face.

    Anger is -4.1 below a fringe of locks. The slant of sadness is 2.4, and 3.7 with charm=0. Without charm and a face
    at rest these were -5.5, 5.0, -4.9 and 4.9, and -2.9, 1.7, -2.7 and 5.1 before
    brows of anger and sadness were as large as they are.
    """
    neutral, felt = measure(sight.faint["neutral"]), measure(sight.faint[name])
    assert not np.isnan(felt).any()
    shift = (felt.mean() - neutral.mean()) / neutral.std()
    assert shift / deviations > 1.0, shift


def raised_left(landmarks: Array) -> Array:
    """How much higher the lips' left corner lies than the right, as a share of that of the outer eye corners."""
    left, right, one, other = (landmarks[..., LANDMARKS[name], :2] for name in ("8.3", "8.4", "3.7", "3.12"))
    eyes, lips = one - other, left - right  # y goes down
    return (eyes[..., 1] * lips[..., 0] - eyes[..., 0] * lips[..., 1]) / (eyes**2).sum(axis=-1)


def test_it_sees_which_half_smiles_and_a_faint_contempt(sight: Sight) -> None:
    for seen, least in ((sight.poses, 0.04), (sight.faint, 0.02)):
        level = raised_left(seen["neutral"])
        left, right, contempt = (raised_left(seen[name]) - level for name in ON_ONE_SIDE)
        assert left.min() > least
        assert right.max() < -least
        assert np.all((contempt > 0.4 * least) & (contempt < 0.85 * left))
