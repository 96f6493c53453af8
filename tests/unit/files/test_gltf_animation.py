"""Motion of a face out of glTF: curves by hand, names of several sets, heads, and what is refused."""

import numpy as np
import pytest

from fapengine.errors import DataError
from fapengine.files.gltf.animation import parse_animation, sample
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import to_codable
from fapengine.retarget.blend_tracks import shape_set
from tests.unit.files.glb import Builder

KEYS = np.array([0.0, 1.0, 3.0])
TIMES = np.array([-1.0, 0.5, 1.0, 2.0, 9.0])


def test_curves_are_those_of_the_specification() -> None:
    values = np.array([0.0, 2.0, 4.0]).reshape(3, 1, 1)
    assert sample((KEYS, values, "LINEAR"), TIMES)[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert sample((KEYS, values, "STEP"), TIMES)[:, 0].tolist() == [0.0, 0.0, 2.0, 2.0, 4.0]
    cubic = np.array([[9.0, 0.0, 1.0], [3.0, 2.0, 0.0], [0.0, 4.0, 9.0]]).reshape(3, 3, 1)  # slope before, value, after
    # at a half: the mean of both values, and an eighth of the step times the difference of the slopes
    assert sample((KEYS, cubic, "CUBICSPLINE"), TIMES)[:, 0].tolist() == [0.0, 1.0 + (1 - 3) / 8, 2.0, 3.0, 4.0]
    assert sample((KEYS[:1], cubic[:1], "CUBICSPLINE"), TIMES)[:, 0].tolist() == [0.0] * 5


def avatar(
    names: list[str], weights: np.ndarray, *, times_s: np.ndarray | None = None, kind: str = "LINEAR"
) -> Builder:
    """A face with a head's joint and targets of these names, whose weights are (T, targets) at 50 Hz."""
    builder = Builder()
    place = builder.accessor(np.zeros((3, 3)))
    mesh = {"primitives": [{"attributes": {"POSITION": place}, "targets": [{"POSITION": place}] * len(names)}]}
    builder.row("meshes", mesh | {"extras": {"targetNames": names}})
    builder.doc["nodes"] = [{"mesh": 0}, {"name": "Head"}]
    builder.doc["scenes"] = [{"nodes": [0, 1]}]
    keys = np.arange(len(weights)) / 50 if times_s is None else times_s
    sampler = {"input": builder.accessor(keys), "output": builder.accessor(weights.reshape(-1)), "interpolation": kind}
    builder.doc["animations"] = [
        {"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}
    ]
    return builder


def turned(builder: Builder, quaternion: list[float], count: int, node: int = 1) -> None:
    (animation,) = builder.doc["animations"]
    curve = {"input": builder.accessor(np.arange(count) / 50), "output": builder.accessor([quaternion] * count)}
    animation["samplers"].append(curve)
    sampler = len(animation["samplers"]) - 1
    animation["channels"].append({"sampler": sampler, "target": {"node": node, "path": "rotation"}})


ARKIT = [name[0].lower() + name[1:] for name in shape_set("arkit").names]
OCULUS = [f"viseme_{name}" for name in shape_set("oculus").names]


def test_the_set_that_moves_is_read() -> None:
    weights = np.zeros((5, len(ARKIT) + len(OCULUS)))
    column = len(ARKIT) + OCULUS.index("viseme_aa")
    weights[2, column] = 1.0
    weights[:, len(ARKIT) + 1 : len(ARKIT) + 9] += 1e-3
    track = parse_animation(avatar(ARKIT + OCULUS, weights).glb())
    assert (len(track), track.rate_hz) == (5, 50.0)
    expected = to_codable(shape_set("oculus").to_faps(weights[:, len(ARKIT) :]))
    np.testing.assert_allclose(track.values, expected, atol=1)
    weights[:] = 0
    weights[3, ARKIT.index("jawOpen")] = 0.5
    shown = parse_animation(avatar(ARKIT + OCULUS, weights).glb())
    expected = to_codable(shape_set("arkit").to_faps(weights[:, : len(ARKIT)]))
    np.testing.assert_allclose(shown.values, expected, atol=1)


def test_a_head_that_turns_after_speech_is_read_to_its_end() -> None:
    weights = np.zeros((5, len(ARKIT)))
    weights[2, ARKIT.index("jawOpen")] = 1.0
    builder = avatar(ARKIT, weights)
    turned(builder, [0.0, 0.1, 0.0, 0.995], 9)
    assert len(parse_animation(builder.glb())) == 9


def test_few_keys_are_read_at_a_steady_rate() -> None:
    weights = np.zeros((3, len(ARKIT)))
    weights[1, ARKIT.index("jawOpen")] = 1.0
    track = parse_animation(avatar(ARKIT, weights, times_s=np.array([0.0, 0.5, 2.0])).glb())
    assert (len(track), track.rate_hz) == (49, 24.0)
    assert int(track.values[:, fap.column(3)].argmax()) == 12


@pytest.mark.parametrize("scale", [[1.0, 1.0, 1.0], [-1.0, 2.0, 1.0]])
@pytest.mark.parametrize(("is_vrm0", "sign"), [(False, 1), (True, -1)])
def test_the_head_turns_as_it_looks(*, is_vrm0: bool, sign: int, scale: list[float]) -> None:
    builder = avatar(ARKIT, np.zeros((4, len(ARKIT))))
    turned(builder, [np.sin(0.1), 0.0, 0.0, np.cos(0.1)], 4)  # 0.2 rad about x
    builder.doc["nodes"][1] |= {"rotation": [0.0, 0.0, 0.0, 1.0], "scale": scale}
    if is_vrm0:  # looks along -z, so that x is to its right
        builder.doc["extensions"] = {"VRM": {}}
    track = parse_animation(builder.glb())
    assert track.values[0, fap.column(48)] * AU_RAD == pytest.approx(0.2 * sign, abs=1e-4)


@pytest.mark.parametrize("has_look", [False, True])
def test_bones_turn_the_eyes_where_no_shape_does(*, has_look: bool) -> None:
    weights = np.zeros((4, len(ARKIT)))
    weights[:, ARKIT.index("eyeLookDownLeft")] = 0.5 * has_look
    builder = avatar(ARKIT, weights)
    builder.doc["nodes"] += [{"name": "LeftEye"}, {"name": "RightEye"}]
    builder.doc["scenes"] = [{"nodes": [0, 1, 2, 3]}]
    turned(builder, [0.0, np.sin(0.1), 0.0, np.cos(0.1)], 4, node=2)  # 0.2 rad about y
    turned(builder, [np.sin(0.05), 0.0, 0.0, np.cos(0.05)], 4, node=3)  # 0.1 rad about x
    faps = parse_animation(builder.glb()).values[2, [fap.column(n) for n in (23, 24, 25, 26)]] * AU_RAD
    if has_look:
        np.testing.assert_allclose(faps[[0, 1, 3]], 0.0, atol=1e-4)
        assert faps[2] > 0.1
    else:
        np.testing.assert_allclose(faps, [0.2, 0.0, 0.0, 0.1], atol=1e-4)


def spoil(change: str) -> bytes:
    builder = avatar(ARKIT, np.zeros((4, len(ARKIT))))
    (animation,) = builder.doc["animations"]
    if change == "none":
        animation["channels"] = []
    elif change == "kind":
        animation["samplers"][0]["interpolation"] = "SPLINE"
    elif change == "count":
        animation["samplers"][0]["output"] = builder.accessor(np.zeros(7))
    elif change == "targets":
        animation["samplers"][0]["output"] = builder.accessor(np.zeros(8))
    elif change == "times":
        animation["samplers"][0]["input"] = builder.accessor(np.array([0.0, 2.0, 1.0, 3.0]))
    elif change == "late":
        animation["samplers"][0]["input"] = builder.accessor(np.array([0.0, 2.0, 3.0, 9000.0]))
    elif change == "rotation":
        turned(builder, [0.0] * 4, 4)
    elif change == "names":
        builder.doc["meshes"][0]["extras"]["targetNames"] = [f"shape {n}" for n in range(len(ARKIT))]
    elif change == "file":
        return builder.gltf("other.bin")
    return builder.glb()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("none", "contains none that moves morph targets"),
        ("kind", "sampler: got 208 numbers for 4 keys, SPLINE"),
        ("count", "sampler: got 7 numbers for 4 keys"),
        ("targets", "weights: got 2, expected 52, one per target"),
        ("times", "times must rise"),
        ("late", "times must rise, from 0 s to at most 7200 s"),
        ("rotation", "rotation: got a quaternion of length 0"),
        ("names", "got 0 names of"),
        ("file", "'other.bin': is another file, expected a GLB that contains everything"),
    ],
)
def test_what_is_wrong_is_named(change: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_animation(spoil(change))
