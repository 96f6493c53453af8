"""Learned ears: a model that a second makes, its card, its times, and models that are none."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper

import fapengine
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.sound import save_wav
from fapengine.recognition.onnx_recognizer import OnnxRecognizer, load_model, segments_of, softmax
from fapengine.recognition.process import RecognizerProcess
from fapengine.speech.phone_track import Phone
from tests.unit.recognition.speech import FAPU_MM
from tests.unit.recognition.tone_model import CARD, LABELS, RATE_HZ, melody, save_model

NOTES = (("_", 0.5), ("m", 0.12), ("a", 0.3), ("m", 0.1), ("a", 0.2), ("_", 0.6), ("s", 0.16), ("a", 0.24), ("_", 6.0),
         ("m", 0.2), ("a", 0.2), ("_", 0.3))  # fmt: skip
TUNE = melody(*NOTES)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_model(tmp_path_factory.mktemp("model") / "tones.onnx")


@pytest.fixture(scope="module")
def ear(path: Path) -> OnnxRecognizer:
    return OnnxRecognizer(path)


def heard(ear: OnnxRecognizer, samples: np.ndarray, cuts: list[int] | None = None) -> list[Phone]:
    ear.reset()
    return [phone for piece in np.split(samples, cuts or []) for phone in ear.push(piece)] + ear.end()


def merged(phones: list[Phone]) -> list[tuple[str, float, float]]:
    """Label, start and end; silences that follow each other as one."""
    rows: list[tuple[str, float, float]] = []
    for phone in phones:
        if rows and rows[-1][0] == phone.label == "_":
            rows[-1] = "_", rows[-1][1], phone.end_s
        else:
            rows.append((phone.label, phone.start_s, phone.end_s))
    return rows


def test_phones_are_heard_where_they_sound(ear: OnnxRecognizer) -> None:
    rows = merged(heard(ear, TUNE))
    assert [label for label, _, _ in rows] == [label for label, _ in NOTES]
    starts = np.cumsum([0.0, *(lasts_s for _, lasts_s in NOTES)])
    assert np.abs(np.array([start_s for _, start_s, _ in rows]) - starts[:-1]).max() <= 0.021  # a frame
    assert rows[-1][2] == pytest.approx(len(TUNE) / RATE_HZ)


def test_spikes_become_phones_that_meet() -> None:
    """A frame of 20 ms is all that a CTC model tells of most phones."""
    frames = [""] * 40
    for at, label in ((5, "m"), (9, "a"), (15, "m"), (30, "a")):
        frames[at] = label
    assert segments_of(frames, 50.0) == [
        ("_", 0, 1), ("m", 1, 7), ("a", 7, 12), ("m", 12, 20), ("_", 20, 26), ("a", 26, 35), ("_", 35, 40)
    ]  # fmt: skip


def test_what_is_told_is_certain_old_enough_and_without_holes(ear: OnnxRecognizer) -> None:
    ear.reset()
    told: list[Phone] = []
    for start in range(0, len(TUNE), 320):
        told += ear.push(TUNE[start : start + 320])
        assert not told or told[-1].end_s <= (start + 320) / RATE_HZ - ear.look_ahead_s + 0.01
    told += ear.end()
    assert told[0].start_s == 0.0
    assert all(one.end_s == other.start_s for one, other in pairwise(told))
    assert all(0.9 < phone.confidence <= 1 for phone in told)


@given(st.lists(st.integers(0, len(TUNE)), max_size=12).map(sorted))
@settings(max_examples=5, deadline=None)
def test_pieces_of_any_length_give_the_same_phones(ear: OnnxRecognizer, cuts: list[int]) -> None:
    assert heard(ear, TUNE, cuts) == heard(ear, TUNE)


def test_nothing_and_one_sample(ear: OnnxRecognizer) -> None:
    assert heard(ear, np.zeros(0, np.int16)) == []
    assert heard(ear, np.zeros(1, np.int16)) == [Phone("_", 0.0, 1 / RATE_HZ)]


def test_less_than_a_block_is_heard_up_to_its_end(ear: OnnxRecognizer) -> None:
    found = [(phone.label, phone.start_s, phone.end_s) for phone in heard(ear, melody(("a", 0.07)))]
    assert found == [("a", 0.0, 0.07)]


def test_another_rate_another_alphabet_and_a_card_inside(tmp_path: Path) -> None:
    card = {"labels": ["-", "M", "AA1", "S"], "blank": "-", "alphabet": "arpabet", "rate_hz": 8000, "normalized": False}
    save_model(tmp_path / "inside.onnx", None, rate_hz=8000)
    model = onnx.load(tmp_path / "inside.onnx")
    helper.set_model_props(model, {"fapengine": json.dumps(card)})
    onnx.save(model, tmp_path / "inside.onnx")
    found = {label for label, _, _ in merged(heard(OnnxRecognizer(tmp_path / "inside.onnx"), TUNE))}
    assert found == {"_", "m", "ɑ", "s"}


def test_it_moves_a_face_and_runs_in_a_process_of_its_own(path: Path, tmp_path: Path) -> None:
    save_wav(tmp_path / "tune.wav", TUNE, RATE_HZ)
    made = fapengine.animate(tmp_path / "tune.wav", recognizer=path, rate_hz=100.0, style=fapengine.Style.speech_only())
    opening_mm = -(made.track.values[:, 3] + made.track.values[:, 4]) * FAPU_MM
    assert opening_mm[92:108].min() < 0.5 < 4 < opening_mm[62:92].max()  # shut on the second m
    process = RecognizerProcess.open(path)
    try:
        process.begin()
        process.push(TUNE[: round(1.96 * RATE_HZ)], RATE_HZ)
        process.end()
        told: list[Phone] = []
        is_over = False
        while not is_over:
            for news in process.poll():
                told += news.phones
                is_over = is_over or news.is_over
        assert process.look_ahead_s == 0.3
    finally:
        process.close()
    assert [label for label, _, _ in merged(told)] == ["_", "m", "a", "m", "a", "_", "s"]


def _card(**changes: object) -> dict[str, object]:
    return {**CARD, **changes}


@pytest.mark.parametrize(
    ("card", "told"),
    [
        (None, "its labels are unknown; expected bad.json next to it"),
        ({}, "its card is wrong: Object missing required field `labels`"),
        (_card(lables=3), "unknown field `lables`"),
        (_card(rate_hz=5), "its card is wrong: Expected `int` >= 8000"),
        (_card(alphabet="latin"), "got alphabet 'latin', expected one of ipa"),
        (
            _card(labels=["<blank>", "m", "a"]),
            r"got an answer float32 of shape \(1, 50, 4\), expected \(1, frames, 3\)",
        ),
        (_card(labels=["x", "m", "a", "s"]), "its labels have no blank"),
        (_card(labels=["<blank>", "m", "QQ5", "s"]), "got labels 'QQ5', expected ipa"),
        (_card(labels=["<blank>", "sil", "sp", "|"]), "contains no label of a phone"),
    ],
)
def test_a_card_that_does_not_fit_is_told(tmp_path: Path, card: dict[str, object] | None, told: str) -> None:
    with pytest.raises(DataError, match=told):
        load_model(save_model(tmp_path / "bad.onnx", card))


def _no_model(path: Path) -> None:
    path.write_bytes(b"not a model")


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _cut(path: Path) -> None:
    path.write_bytes(save_model(path).read_bytes()[:-200])


def _two_inputs(path: Path) -> None:
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "n"]) for name in ("a", "b", "c")]
    graph = helper.make_graph([helper.make_node("Add", ["a", "b"], ["c"])], "two", values[:2], values[2:])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)


def _an_echo(path: Path) -> None:
    """Gives its input back: no (1, T, V)."""
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "n"]) for name in ("a", "c")]
    graph = helper.make_graph([helper.make_node("Identity", ["a"], ["c"])], "echo", values[:1], values[1:])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    path.with_suffix(".json").write_text(json.dumps({"labels": LABELS}))


@pytest.mark.parametrize(
    ("write", "told"),
    [
        (_no_model, "cannot be read as an ONNX model"),
        (_empty, "cannot be read as an ONNX model"),
        (_cut, "cannot be read as an ONNX model"),
        (_two_inputs, "got input a .*, b .*, expected one of float"),
        (_an_echo, "got an answer float32 of shape"),
    ],
)
def test_a_file_that_is_no_such_model_is_one_clear_error(
    tmp_path: Path, write: Callable[[Path], None], told: str
) -> None:
    write(tmp_path / "bad.onnx")
    with pytest.raises(DataError, match=rf"bad\.onnx: {told}") as raised:
        load_model(tmp_path / "bad.onnx")
    assert "\n" not in str(raised.value)


def test_other_refusals(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_wav(tmp_path / "tune.wav", TUNE, RATE_HZ)
    (tmp_path / "talk.pho").write_text("m 80\na 120\n")
    with pytest.raises(UsageError, match="expected an ONNX model"):
        load_model(tmp_path / "absent.onnx")
    with pytest.raises(UsageError, match="recognizer: cannot be combined with a transcript"):
        fapengine.animate(tmp_path / "tune.wav", recognizer=path, transcript="mama")
    with pytest.raises(UsageError, match="recognizer: cannot be used with phone timings"):
        fapengine.animate(tmp_path / "talk.pho", recognizer=path)
    monkeypatch.setitem(__import__("sys").modules, "onnxruntime", None)
    with pytest.raises(ResourceError, match=r"onnxruntime is not installed\. Install it with: pip install"):
        load_model(path)


def test_softmax_of_scores_and_of_logarithms() -> None:
    shares = softmax(np.log(np.array([[0.25, 0.75], [0.5, 0.5]])))
    np.testing.assert_allclose(shares, [[0.25, 0.75], [0.5, 0.5]])


def test_silence_that_a_model_tells_ends_a_phone() -> None:
    assert segments_of(["_", "a", "", "_", "_", "", "s"], 50.0) == [
        ("_", 0, 1), ("a", 1, 3), ("_", 3, 5), ("s", 5, 7)
    ]  # fmt: skip
    assert segments_of([], 50.0) == []
    assert segments_of(["", ""], 50.0) == [("_", 0, 2)]
