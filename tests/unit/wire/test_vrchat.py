"""VRChat's messages: bytes by hand, read by python-osc, and where each shape goes."""

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket

from fapengine.mpeg4 import fap
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.wire import vrchat

h = bytes.fromhex


def read(datagrams: list[bytes]) -> dict[str, list[float]]:
    found = {}
    for data in datagrams:
        (timed,) = OscPacket(data).messages
        found[timed.message.address] = timed.message.params
    return found


def unified(prefix: str = "", **weights: float) -> dict[str, float]:
    row = np.zeros(52)
    for name, weight in weights.items():
        row[ARKIT_NAMES.index(name)] = weight
    start = f"/avatar/parameters/{prefix}v2/"
    values = read(vrchat.encode_unified(row, prefix=prefix))
    assert all(address.startswith(start) for address in values)
    return {address.removeprefix(start): value for address, (value,) in values.items()}


def test_a_parameter_has_its_bytes() -> None:
    start = h("2f617661 7461722f 70617261 6d657465 72732f") + b"xv2/JawOpen" + h("0000 2c660000")
    (jaw,) = [data for data in vrchat.encode_unified(np.zeros(52), prefix="x") if b"JawOpen" in data]
    assert jaw == start + h("00000000")


def test_a_face_at_rest_has_open_eyes_and_nothing_else() -> None:
    rest = unified()
    assert len(rest) == len(vrchat.UNIFIED) == 49
    assert {name: value for name, value in rest.items() if value} == {"EyeLidLeft": 0.75, "EyeLidRight": 0.75}


@pytest.mark.parametrize(
    ("shape", "wanted"),
    [
        ("jawOpen", {"JawOpen": 1}), ("mouthClose", {"MouthClosed": 1}), ("jawLeft", {"JawX": -1}),
        ("jawRight", {"JawX": 1}), ("jawForward", {"JawZ": 1}), ("eyeBlinkLeft", {"EyeLidLeft": 0}),
        ("eyeWideRight", {"EyeLidRight": 1}), ("mouthSmileLeft", {"MouthCornerPullLeft": 1}),
        ("mouthShrugLower", {"MouthRaiserLower": 1}), ("tongueOut", {"TongueOut": 1}),
        ("mouthRollUpper", {"LipSuckUpperLeft": 1, "LipSuckUpperRight": 1}),
        ("browInnerUp", {"BrowInnerUpLeft": 1, "BrowInnerUpRight": 1}),
        ("mouthPucker", {f"LipPucker{edge}{side}": 1 for edge in ("Upper", "Lower") for side in ("Left", "Right")}),
        ("mouthLeft", {}),
    ],
)  # fmt: skip
def test_each_shape_goes_where_it_belongs(shape: str, wanted: dict[str, float]) -> None:
    rest, moved = unified("FT/"), unified("FT/", **{shape: 1.0})
    assert {name: value for name, value in moved.items() if value != rest[name]} == wanted


def test_every_shape_is_sent_but_gaze_and_mouth_aside() -> None:
    used = {name for _, _, adds in vrchat.UNIFIED for name, _ in adds}
    assert {name for name in ARKIT_NAMES if name not in used and not name.startswith("eyeLook")} == {
        "mouthLeft",
        "mouthRight",
    }


def test_values_stay_in_their_ranges() -> None:
    assert unified(jawLeft=1.0, jawRight=0.25)["JawX"] == -0.75
    assert unified(eyeBlinkLeft=1.5)["EyeLidLeft"] == 0.0
    assert unified(jawOpen=1.5, jawLeft=3.0)["JawOpen"] == 1.0
    assert unified(jawLeft=3.0)["JawX"] == -1.0
    assert unified(jawOpen=-1.0)["JawOpen"] == 0.0


def test_eyes_look_where_the_faps_do() -> None:
    faps, weights = np.zeros(68), np.zeros(52)
    for number, degrees in ((23, -23.6), (25, -14.9), (24, -16.5), (26, -15.6)):  # to the subject's right, up
        faps[fap.column(number)] = np.radians(degrees) / 1e-5
    weights[ARKIT_NAMES.index("eyeBlinkLeft")] = 0.5
    eyes = read(vrchat.encode_eyes(faps, weights))
    assert eyes["/tracking/eye/EyesClosedAmount"] == [0.25]
    assert eyes["/tracking/eye/LeftRightPitchYaw"] == pytest.approx([-14.9, 23.6, -15.6, 16.5], abs=1e-4)
