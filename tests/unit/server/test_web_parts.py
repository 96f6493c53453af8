"""Parts of the web server that know neither sockets nor clocks: outbox, allowance, sounds, the head's file, setup."""

import io
import json
import re
import struct
import wave
from pathlib import Path

import numpy as np
import pytest

from fapengine.expressions import EXPRESSION_NAMES
from fapengine.mesh.default_head.head import build_head
from fapengine.mpeg4 import fap
from fapengine.render.camera import FAR_MM, NEAR_MM
from fapengine.render.packing import pack
from fapengine.render.programs import ES_HEADER, MAX_CHANNELS, STAGES
from fapengine.server.web import connection
from fapengine.server.web.app import SoundCache
from fapengine.server.web.connection import SendQueue
from fapengine.server.web.page_files import MAGIC, head_binary, setup
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.voices.protocol import Speech


def spoken(length: int, rate_hz: int = 16_000) -> Speech:
    phones = PhoneTrack.from_phones([Phone(SILENCE, 0.0, length / rate_hz)])
    samples = np.arange(length, dtype=np.int16)
    return Speech(samples=samples, sample_rate_hz=rate_hz, phones=phones)


def test_texts_go_before_frames_and_all_go() -> None:
    box = SendQueue()
    box.put_frame(b"1")
    box.put_text("a")
    box.put_text("b")
    assert [box.take() for _ in range(4)] == ["a", "b", b"1", None]


def test_a_slow_page_gets_the_newest_frames() -> None:
    box = SendQueue()
    for number in range(10):
        box.put_frame(bytes([number]))
    assert [box.take() for _ in range(4)] == [b"\7", b"\10", b"\11", None]
    assert box.dropped == 7


def test_too_many_texts_are_told_not_kept() -> None:
    box = SendQueue()
    for _ in range(connection.MAX_TEXTS):
        box.put_text("a")
    assert not box.overflowed
    box.put_text("one more")
    assert box.overflowed


def test_a_sound_is_a_wav_file() -> None:
    shelf = SoundCache()
    shelf.put("anna", 5, spoken(300))
    data = shelf.wav("anna", 5)
    assert data is not None
    with wave.open(io.BytesIO(data)) as file:
        assert file.getparams()[:4] == (1, 2, 16_000, 300)
        assert np.frombuffer(file.readframes(300), "<i2").tolist() == list(range(300))
    assert shelf.wav("anna", 6) is None
    assert shelf.wav("bert", 5) is None


def test_old_sounds_make_room_for_new_ones() -> None:
    shelf = SoundCache(most_bytes=1000)
    for number in range(5):
        shelf.put("anna", number, spoken(200))
    assert [shelf.wav("anna", number) is not None for number in range(5)] == [False, False, False, True, True]
    shelf.put("anna", 4, spoken(250))  # in place of the one before
    assert shelf.wav("anna", 3) is not None
    shelf.put("anna", 9, spoken(5000))  # the newest stays, however long
    assert [shelf.wav("anna", number) is not None for number in (3, 4, 9)] == [False, False, True]


def test_the_head_file_holds_what_the_desktop_uploads() -> None:
    head = build_head()
    data, packed = head_binary(head), pack(head)
    assert data == head_binary(head)
    assert data[:8] == b"FAPHEAD1"
    (length,) = struct.unpack_from("<I", data, 8)
    about = json.loads(data[12 : 12 + length])
    expected = {
        "vertices": packed.vertices, "displacements": packed.displacements, "normal_deltas": packed.normal_deltas,
    }  # fmt: skip
    assert packed.skin is not None
    expected["skin"] = packed.skin
    expected |= {f"part.{name}": triangles for name, triangles in packed.parts.items()}
    for name, array in expected.items():
        place = about["arrays"][name]
        assert place["offset"] % 16 == 0
        found = np.frombuffer(data, place["kind"], array.size, place["offset"]).reshape(place["shape"])
        assert (found == array).all(), name
    channels = np.frombuffer(data, "<f8", 3 * len(head.basis.channels), about["arrays"]["channels"]["offset"])
    assert channels.tolist() == [
        value for channel in head.basis.channels for value in (channel.fap, channel.start, channel.stop)
    ]
    assert sum(size for _, size in about["attributes"]) == packed.vertices.shape[1]


def test_the_page_is_told_every_fap_once_and_every_program() -> None:
    told = json.loads(json.dumps(setup(voices={"en-us": "English (America)"})))
    sliders = [slider for group in told["groups"] for slider in group["faps"]]
    assert sorted(slider["number"] for slider in sliders) == list(range(3, 69))
    for slider in sliders:
        row = fap.spec(slider["number"])
        assert slider["name"] == row.name
        assert (slider["low"] < 0) == row.bidirectional
        assert slider["low"] in (0, -slider["high"])
        assert 0 < slider["high"] <= row.intra_limit * row.quantiser_step  # the standard can say it
    faces = {"face", "face PAINTED", "face PAINTED CUT_OUT", "face STRAND"}
    used = faces | {f"{name} LIT_AT_VERTICES" for name in faces} | {"eye", "backdrop", "edges", "smooth"}
    assert set(told["programs"]) == used
    assert {name.split()[0] for name in used} < set(STAGES)
    for stages in told["programs"].values():
        assert all(stages[kind].startswith(ES_HEADER) for kind in ("vertex", "fragment"))
    assert [(angle["name"], angle["reach"]) for angle in told["head"]] == [("yaw", 45), ("pitch", 30), ("roll", 30)]
    assert told["head"][0]["positive"] == "to the subject's left"
    assert told["ranges"]["look"]["yaw"] == {"low": -1.5, "high": 1.5}
    assert told["ranges"]["blink"] == {}
    assert {name: part["program"] for name, part in told["parts"].items()} == {
        "face": "face", "cutout": "face", "eyeball": "face", "eye": "eye", "strand": "face",
    }  # fmt: skip
    assert told["parts"]["cutout"] == {
        "program": "face", "definitions": ["CUT_OUT"], "may_be_lit_at_vertices": True, "may_be_painted": True,
        "covers_in_part": False,
    }  # fmt: skip
    assert (told["max_fine_edge_px"], told["skin_level_bias"], told["fine_samples"]) == (12.0, 0.3, 4)
    assert told["expressions"] == list(EXPRESSION_NAMES)
    assert told["cameras"]["front"]["distance"] == pytest.approx(900.0)


def test_numbers_that_the_page_repeats_are_pythons() -> None:
    page = Path(__file__).resolve().parents[3] / "fapengine-face"
    repeated = {
        ("camera.js", "NEAR"): NEAR_MM, ("camera.js", "FAR"): FAR_MM, ("deform.js", "MAX_CHANNELS"): MAX_CHANNELS,
        ("head.js", "MAGIC"): MAGIC.decode(),
    }  # fmt: skip
    for (file, name), value in repeated.items():
        stated = re.search(rf"^const {name} = (.+);$", (page / file).read_text(encoding="utf-8"), re.MULTILINE)
        assert stated is not None, name
        assert json.loads(stated[1]) == value, name
