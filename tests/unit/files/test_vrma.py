"""VRM animations: presets or ARKit's names, the head, and the gaze."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fapengine.files.gltf.animation import parse_animation
from fapengine.files.gltf.clip import BONES, EXTENSION, format_vrma
from fapengine.files.gltf.document import parse_gltf
from fapengine.files.provenance import SYNTHETIC
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.visemes import VRM1_NAMES, approximate_presets
from tests.unit.files.test_gltf_clip import curves, motion, nod, speech


@pytest.mark.parametrize(
    ("shapes", "kind", "names", "weights", "one"),
    [
        ("vrm1", "preset", VRM1_NAMES, partial(approximate_presets, rate_hz=30.0), "blink"),
        ("arkit", "custom", ARKIT_NAMES, approximate_arkit, "jawOpen"),
    ],
)
def test_weights_are_places_of_nodes(
    tmp_path: Any, shapes: str, kind: str, names: tuple[str, ...], weights: Any, one: str
) -> None:
    data = format_vrma(motion(), shapes=shapes)
    told = parse_gltf(data, lambda _: b"").root.item("extensions").item(EXTENSION)
    expressions = told.item("expressions").item(kind)
    wanted, found = weights(speech()), curves(data, tmp_path)
    assert one in expressions
    (animation,) = parse_gltf(data, lambda _: b"").root.items("animations")
    assert animation.extras().string("digitalSourceType") == SYNTHETIC
    assert not set(expressions) & {"lookUp", "lookDown", "lookLeft", "lookRight"}  # the gaze does that
    for name in expressions:
        times, places, _ = found[expressions.item(name).index("node", 100), "translation"]
        shown = np.interp(np.arange(len(wanted)) / 30.0, times, places[:, 0])
        np.testing.assert_allclose(shown, wanted[:, names.index(name)], atol=1e-6)
        assert not places[:, 1:].any()


def test_head_and_gaze_turn(tmp_path: Any) -> None:
    data = format_vrma(motion())
    told = parse_gltf(data, lambda _: b"").root.item("extensions").item(EXTENSION)
    found = curves(data, tmp_path)
    head = told.item("humanoid").item("humanBones").item("head").index("node", 100)
    np.testing.assert_allclose(Rotation.from_quat(found[head, "rotation"][1]).as_matrix(), nod()["head"], atol=1e-6)
    gaze = Rotation.from_quat(found[told.item("lookAt").index("node", 100), "rotation"][1])
    ahead = gaze.apply([0.0, 0.0, 1.0])
    left_rad = speech()[:, fap.column(23)] * 1e-5
    np.testing.assert_allclose(np.arctan2(ahead[:, 0], ahead[:, 2]), left_rad, atol=1e-6)
    for shapes in ("vrm1", "arkit"):
        back = parse_animation(format_vrma(motion(), shapes=shapes)).values
        np.testing.assert_allclose(back[:, fap.column(23)], speech()[:, fap.column(23)], atol=150, err_msg=shapes)
        assert np.ptp(back[:, fap.column(23)]) > 3000
    assert told.string("specVersion") == "1.0"
    assert {"hips", "spine", "head"} <= {name for name, _ in BONES}  # without which readers refuse it
