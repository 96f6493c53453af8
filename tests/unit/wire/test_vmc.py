"""VMC datagrams: bytes by hand, read by python-osc, split, and poses in Unity's space."""

import struct

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket
from scipy.spatial.transform import Rotation

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.wire import osc, vmc

h = bytes.fromhex


def read(datagrams: list[bytes]) -> list[tuple[object, ...]]:
    return [(t.message.address, *t.message.params) for data in datagrams for t in OscPacket(data).messages]


def test_a_frame_has_its_bytes() -> None:
    still = ("Head", np.array([0, 0, 0, 1.0]))
    (data,) = vmc.encode_frame([("jawOpen", 0.5)], time_s=2.0, bones=[still])
    parts = [
        "2f564d43 2f457874 2f4f4b00 2c690000 00000001",  # /VMC/Ext/OK
        "2f564d43 2f457874 2f540000 2c660000 40000000",  # /VMC/Ext/T
        "2f564d43 2f457874 2f426f6e 652f506f 73000000 2c736666 66666666 66000000 48656164 00000000"  # Bone/Pos, Head
        + "00000000" * 6 + "3f800000",
        "2f564d43 2f457874 2f426c65 6e642f56 616c0000 2c736600 6a61774f 70656e00 3f000000",  # Blend/Val, jawOpen
        "2f564d43 2f457874 2f426c65 6e642f41 70706c79 00000000 2c000000",  # Blend/Apply
    ]  # fmt: skip
    assert data == osc.BUNDLE_HEAD + b"".join(struct.pack(">i", len(h(part))) + h(part) for part in parts)


def test_all_shapes_are_split_and_applied_last() -> None:
    weights = np.linspace(0, 1, 52)
    datagrams = vmc.encode_shapes(list(zip(ARKIT_NAMES, weights, strict=True)))
    assert [len(data) for data in datagrams] == [1472, 1068]  # what others measured, too
    *values, last = read(datagrams)
    assert last == ("/VMC/Ext/Blend/Apply",)
    assert [value[:2] for value in values] == [("/VMC/Ext/Blend/Val", name) for name in ARKIT_NAMES]
    assert [value[2] for value in values] == pytest.approx(weights)


@pytest.mark.parametrize("limit", [80, 100, 508, 1472, 60_000])
def test_no_datagram_passes_its_limit_and_nothing_is_lost(limit: int) -> None:
    weights = [(name, 0.25) for name in vmc.PASCAL_NAMES]
    datagrams = vmc.encode_frame(weights, time_s=1.0, limit=limit)
    assert max(map(len, datagrams)) <= limit
    messages = read(datagrams)
    assert messages[:2] == [("/VMC/Ext/OK", 1), ("/VMC/Ext/T", 1.0)]
    assert messages[2:-1] == [("/VMC/Ext/Blend/Val", name, 0.25) for name in vmc.PASCAL_NAMES]
    assert messages[-1] == ("/VMC/Ext/Blend/Apply",)


def test_weights_are_clipped_and_must_be_numbers() -> None:
    values = read(vmc.encode_shapes([("A", -1.0), ("I", 2.0)]))
    assert values[:2] == [("/VMC/Ext/Blend/Val", "A", 0.0), ("/VMC/Ext/Blend/Val", "I", 1.0)]
    with pytest.raises(UsageError, match="A: got nan"):
        vmc.encode_shapes([("A", float("nan"))])
    with pytest.raises(UsageError, match="time_s: got inf"):
        vmc.encode_frame([], time_s=float("inf"))
    with pytest.raises(UsageError, match="room for it"):
        vmc.encode_shapes([("A", 1.0)], limit=40)


def turned(**faps: float) -> dict[str, Rotation]:
    values = np.zeros(68)
    for number, value in faps.items():
        values[fap.column(int(number[1:]))] = value
    # the algebra of quaternions is the same in left-handed space
    return {name: Rotation.from_quat(rotation) for name, rotation in vmc.head_and_eyes(values)}


NOSE, CROWN, RIGHT_EAR = np.eye(3)[[2, 1, 0]]  # Unity: x the subject's right, y up, z out of the face


def test_turns_go_where_the_faps_say() -> None:
    assert turned(f49=20_000)["Head"].apply(NOSE)[0] == pytest.approx(-np.sin(0.2))  # yaw: to the subject's left
    assert turned(f48=20_000)["Head"].apply(NOSE)[1] == pytest.approx(-np.sin(0.2))  # pitch: down
    assert turned(f50=20_000)["Head"].apply(RIGHT_EAR)[1] == pytest.approx(-np.sin(0.2))  # roll: right ear down
    left = turned(f23=20_000, f25=-10_000)
    assert left["LeftEye"].apply(NOSE)[0] < -0.19
    assert left["LeftEye"].apply(NOSE)[1] == pytest.approx(np.sin(0.1))  # up
    assert left["RightEye"].magnitude() == left["Head"].magnitude() == 0
    assert turned(f24=20_000)["RightEye"].apply(NOSE)[0] < -0.19


def test_turns_together_are_roll_then_pitch_then_yaw() -> None:
    both = turned(f48=30_000, f49=40_000, f50=50_000)["Head"]
    wanted = Rotation.from_euler("YXZ", [-0.4, 0.3, -0.5])
    assert (both * wanted.inv()).magnitude() == pytest.approx(0, abs=1e-9)


def test_only_what_moved_is_sent_and_sometimes_all() -> None:
    changes = vmc.ChangedShapes(["A", "I"], every=4, least=0.1)
    steps = [[0.5, 0.5], [0.55, 0.7], [0.62, 0.7], [0.0, 0.75], [0.0, 0.75], [0.05, 0.75], [0.0, 1.0]]
    sent = [dict(changes.of(step)) for step in steps]
    assert sent == [
        {"A": 0.5, "I": 0.5}, {"I": 0.7}, {"A": 0.62}, {"A": 0.0}, {"A": 0.0, "I": 0.75}, {}, {"I": 1.0},
    ]  # fmt: skip


def test_a_mouth_that_shuts_shuts_wholly() -> None:
    changes = vmc.ChangedShapes(["jawOpen"], every=100, least=0.1)
    sent = [changes.of([value]) for value in (0.08, 0.04, 0.0, 0.0)]
    assert sent == [
        [("jawOpen", 0.08)],
        [],
        [("jawOpen", 0.0)],
        [],
    ]


def test_every_frame_whole_or_every_change() -> None:
    whole, changes = vmc.ChangedShapes(["A"], every=1), vmc.ChangedShapes(["A"], every=100, least=0.0)
    assert [len(whole.of([0.5])) for _ in range(3)] == [1, 1, 1]
    assert [len(changes.of([value])) for value in (0.5, 0.5, 0.5001)] == [1, 0, 1]


@pytest.mark.parametrize("wrong", [{"every": 0}, {"least": -0.1}, {"least": 1.0}])
def test_wrong_wishes_for_changes(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="expected 1 or more and"):
        vmc.ChangedShapes(["A"], **wrong)


def test_mouth_close_never_passes_jaw_open() -> None:
    faps = np.random.default_rng(0).normal(0, 200, (50, 68))
    weights = approximate_arkit(faps)
    close, jaw = (weights[:, ARKIT_NAMES.index(name)] for name in ("mouthClose", "jawOpen"))
    assert (close <= jaw).all()
    assert close.max() > 0
