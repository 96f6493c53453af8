"""Live Link Face and VMC against receivers of others: PyLiveLinkFace; osc4py3 with vmcp's events."""

import numpy as np
import pytest
from osc4py3.oscbuildparse import OSCBundle, OSCMessage, decode_packet
from pylivelinkface import FaceBlendShape, PyLiveLinkFace
from vmcp.events import BlendShapeEvent, BoneTransformEvent

from fapengine.host.listeners import HubFrames
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.server.sinks.encoders import SingleFaceEncoder, livelink_face, vmc_face
from fapengine.server.sinks.kinds import parse_sink
from tests.unit.retarget.living_speech import RATE_HZ, held, living

DEVICE = "01234567-89AB-CDEF-0123-456789ABCDEF"
GRIMACES = ("JawForward", "JawLeft", "JawRight", "MouthLeft", "MouthRight", "MouthFrownLeft", "MouthFrownRight")


def datagrams(encoder: SingleFaceEncoder, faps: np.ndarray) -> list[list[bytes]]:
    rows = np.rint(faps).astype(np.int32)[:, None]
    return [
        encoder.encode(HubFrames(number=number, time_s=number / RATE_HZ, sessions=("a",), faps=row))
        for number, row in enumerate(rows)
    ]


def test_live_link_is_read_as_it_was_meant() -> None:
    faps = living().copy()
    faps[:, fap.column(49)] = 20_000  # yaw, 1e-5 rad
    told = []
    for (data,) in datagrams(
        livelink_face(parse_sink(f"livelink://127.0.0.1?name=änna&device={DEVICE}"), RATE_HZ), faps
    ):
        is_seen, face = PyLiveLinkFace.decode(data)
        assert is_seen
        assert face.name == "änna"
        assert face.uuid == f"${DEVICE}"
        told.append([face.get_blendshape(shape) for shape in FaceBlendShape])
    values = np.array(told)
    assert [shape.name[0].lower() + shape.name[1:] for shape in FaceBlendShape][:52] == list(ARKIT_NAMES)
    seen = {shape.name: values[:, shape.value] for shape in FaceBlendShape}
    assert seen["JawOpen"].max() > 0.25
    assert max(seen[name].max() for name in GRIMACES) < 0.1
    assert (seen["JawOpen"] - seen["MouthClose"])[held("p b m")].max() < 0.02
    np.testing.assert_allclose(np.abs(seen["HeadYaw"]), 0.2, atol=1e-3)


@pytest.mark.parametrize("spelling", ["arkit", "vrm1"])
def test_vmc_is_read_as_it_was_meant(spelling: str) -> None:
    now: dict[str, float] = {}
    rows, bones = [], set()
    for tick in datagrams(vmc_face(parse_sink(f"vmc://127.0.0.1?names={spelling}"), RATE_HZ), living()):
        for message in (each for data in tick for each in messages(data)):
            arguments = tuple(message.arguments)
            if message.addrpattern == BlendShapeEvent.ADDRESS_PATTERN:
                event = BlendShapeEvent.from_message_data("a", message.addrpattern, arguments)
                now[event.key] = event.value
            elif message.addrpattern == BoneTransformEvent.ADDRESS_PATTERN:
                bone = BoneTransformEvent.from_message_data("a", message.addrpattern, arguments)
                bones.add(bone.joint.value)
                turn = bone.rotation
                assert turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 == pytest.approx(1.0, abs=1e-5)
        rows.append(dict(now))
    assert bones == {"Head", "LeftEye", "RightEye"}
    seen = {name: np.array([row.get(name, 0.0) for row in rows]) for name in now}
    if spelling == "arkit":
        assert seen["jawOpen"].max() > 0.25
        assert max(seen[name[0].lower() + name[1:]].max() for name in GRIMACES) < 0.1
    else:
        assert sum(seen[name] for name in ("aa", "ih", "ou", "ee", "oh")).max() > 0.5
        assert max(seen[name].max() for name in ("happy", "angry", "sad", "relaxed", "surprised")) == 0.0


def messages(data: bytes) -> list[OSCMessage]:
    packet = decode_packet(data)
    if isinstance(packet, OSCBundle):
        return list(packet.elements)
    return [packet]
