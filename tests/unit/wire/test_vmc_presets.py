"""VMC in the names of an avatar's presets."""

import numpy as np
import pytest

from fapengine.host.listeners import HubFrames
from fapengine.mpeg4 import fap
from fapengine.server.sinks.encoders import vmc_face
from fapengine.server.sinks.kinds import parse_sink
from fapengine.wire import osc
from fapengine.wire.vmc import VRM0_SHOWN, VRM1_SHOWN


@pytest.mark.parametrize(("spelling", "names", "blink"), [("vrm0", VRM0_SHOWN, "Blink"), ("vrm1", VRM1_SHOWN, "blink")])
def test_an_avatars_presets_are_sent(spelling: str, names: tuple[str, ...], blink: str) -> None:
    face = vmc_face(parse_sink(f"vmc://127.0.0.1?names={spelling}"), 60.0)
    faps = np.zeros((1, 68), np.int32)
    faps[0, [fap.column(19), fap.column(20)]] = 950
    (data,) = face.encode(HubFrames(0, 1.0, ("anna",), faps))
    messages = osc.parse_packet(data)
    shown = {one.arguments[0]: one.arguments[1] for one in messages if one.address == "/VMC/Ext/Blend/Val"}
    assert tuple(shown) == names
    assert shown[blink] > 0.8
    assert sum(shown.values()) < shown[blink] + 0.1
    assert messages[-1].address == "/VMC/Ext/Blend/Apply"
    assert {one.arguments[0] for one in messages if one.address == "/VMC/Ext/Bone/Pos"} == {
        "Head",
        "LeftEye",
        "RightEye",
    }
