"""The small ear, and the two together: phones of speech, no speech, pieces of any length, damaged weights."""

import contextlib
import io
import json
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.recognition import choice
from fapengine.recognition.choice import BOTH, SMALL, check_recognizer, chosen, new_recognizer
from fapengine.recognition.loudness import (
    RunningSoundings,
    gliding,
    loudness_db,
    pitch_hz,
    soundings,
    voice_frames,
    whispered_frames,
)
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.small_net import WEIGHTS, read_weights
from fapengine.recognition.small_recognizer import SURE_AFTER, JointRecognizer, KnownFrames, SmallRecognizer
from fapengine.speech.phone_track import Phone, PhoneTrack
from tests.unit.recognition.speech import (
    BABY,
    POPPIES,
    closures,
    heard,
    in_noise,
    in_room,
    met,
    no_speech,
    opening_mm,
    over_telephone,
    spoken,
    spoken_by_espeak,
    whispered,
)


@pytest.fixture(scope="module", params=[SmallRecognizer, JointRecognizer])
def ear(request: pytest.FixtureRequest) -> SmallRecognizer:
    made: SmallRecognizer = request.param()
    return made


def test_lips_move_as_with_the_true_phones(ear: SmallRecognizer) -> None:
    likeness, asked, hits, told, false = [], 0, 0, 0, 0
    for voice, text in (("rms", BABY), ("slt", POPPIES), ("awb", BABY), ("kal16", POPPIES)):
        speech = spoken(voice, text)
        duration_s = len(speech.samples) / RATE_HZ
        track = PhoneTrack.from_phones(heard(ear, speech.samples))
        likeness.append(np.corrcoef(opening_mm(track, duration_s), opening_mm(speech.phones, duration_s))[0, 1])
        truth, found = closures(speech.phones), closures(track)
        asked, hits = asked + len(truth), hits + met(truth, found)
        told, false = told + len(found), false + len(found) - met(found, truth)
    assert np.median(likeness) > 0.7  # bench/recognizers.py measures ten sentences of each voice
    assert hits >= 0.75 * asked
    assert false <= 0.2 * told


def test_phones_of_a_sentence() -> None:
    labels = [phone.label for phone in heard(SmallRecognizer(), spoken("rms", BABY).samples) if not phone.is_silence]
    assert "".join(labels).startswith("maɪbeɪbi")  # my baby


@pytest.mark.parametrize("name", no_speech(0.1))
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.nightly)])
def test_no_speech_moves_the_lips_less_than_a_millimetre(ear: SmallRecognizer, name: str, seed: int) -> None:
    phones = PhoneTrack.from_phones(heard(ear, no_speech(seed=seed)[name]))
    assert np.abs(opening_mm(phones, 4.0)).max() < 1.0
    assert phones.duration_s == pytest.approx(4.0)


@pytest.mark.parametrize("voice", ["slt", "kal16"])
def test_a_whisper_moves_the_lips(ear: SmallRecognizer, voice: str) -> None:
    speech = spoken(voice, POPPIES)
    duration_s = len(speech.samples) / RATE_HZ
    lips = opening_mm(PhoneTrack.from_phones(heard(ear, whispered(speech.samples))), duration_s)
    true = opening_mm(speech.phones, duration_s)
    count = min(len(lips), len(true))
    assert np.corrcoef(lips[:count], true[:count])[0, 1] > 0.3  # measured .49 to .55; it stays shut without


def test_a_whisper_has_many_sure_phones_and_no_pitch() -> None:
    phones, silent = np.repeat(np.arange(24) % 6, 10), np.zeros(240)
    assert whispered_frames(phones, silent).all()
    assert not whispered_frames(phones % 5, silent).any()  # four labels
    assert not whispered_frames(np.where(np.arange(240) % 10 < 1, phones, 0), silent).any()  # a frame of each
    assert not whispered_frames(phones, np.full(240, 200.0)).any()
    assert not whispered_frames(phones[:0], silent[:0]).any()


def test_a_voice_has_a_pitch_that_glides_and_phones() -> None:
    glide_hz, sure = 200.0 * 1.01 ** np.arange(60), np.arange(60) % 15 == 0  # in four frames
    assert voice_frames(glide_hz, sure).all()
    assert not voice_frames(glide_hz, sure & (np.arange(60) > 0)).any()
    assert not voice_frames(200.0 * 1.07 ** (np.arange(60) % 9), sure).any()  # faster than any voice
    broken_hz = np.where(np.arange(60) % 3 == 2, 0.0, glide_hz)
    assert not voice_frames(broken_hz, sure).any()  # two frames in a row
    assert gliding(np.where(np.arange(60) % 4 == 3, 0.0, glide_hz)).sum() == 45
    assert not gliding(glide_hz[:0]).any()


@pytest.mark.parametrize("change", [lambda sound: in_noise(sound, 5.0), over_telephone, in_room])
def test_a_voice_is_found_in_noise_rooms_and_telephones(change: Callable[..., NDArray[np.int16]]) -> None:
    speech = spoken("kal16", POPPIES)
    heard_s = sum(
        phone.duration_s for phone in heard(SmallRecognizer(), change(speech.samples)) if not phone.is_silence
    )
    said_s = sum(phone.duration_s for phone in speech.phones.phones if not phone.is_silence)
    assert heard_s > 0.8 * said_s


def test_loudness_hardly_matters() -> None:
    speech = spoken("rms", BABY)
    truth = closures(speech.phones)
    for gain in (0.03, 0.3, 1.0):
        found = closures(PhoneTrack.from_phones(heard(SmallRecognizer(), (gain * speech.samples).astype(np.int16))))
        assert met(truth, found) >= 0.7 * len(truth)


@pytest.mark.parametrize("count", [0, 1, 159, 160, 161, 640, 1279, 1281])
def test_sounds_of_a_few_samples(ear: SmallRecognizer, count: int) -> None:
    phones = heard(ear, np.full(count, 500, np.int16))
    assert (phones[-1].end_s if phones else 0.0) == pytest.approx(count / RATE_HZ)


def test_loudness_and_pitch_of_a_stream_are_those_of_the_whole() -> None:
    samples = spoken_by_espeak("en-us", BABY).samples[: 2 * RATE_HZ + 77]
    for length in (50, 320, 999, 4000):
        running = RunningSoundings()
        for at in range(0, len(samples), length):
            running.push(samples[at : at + length])
        running.push(samples[:0], is_last=True)
        assert np.array_equal(running.levels_db, loudness_db(samples))
        assert np.allclose(running.pitches_hz, pitch_hz(samples), rtol=0, atol=1e-9)
        phones = [Phone("a", at / 100, (at + 9) / 100) for at in range(0, 198, 9)]
        whole = soundings(phones, samples)
        assert running.look(phones) == whole
        assert running.of(phones[:11]) + running.of(phones[11:]) == whole
        assert len(running.levels_db) <= 6


def test_memory_does_not_grow() -> None:
    ear = SmallRecognizer()
    rng = np.random.default_rng(1)
    for _ in range(20):
        ear.push(rng.normal(0, 3000, RATE_HZ).astype(np.int16))
    assert len(ear._search._before) < 100
    assert len(ear._voicing._frames.pitches_hz) <= 300


def test_refuses_a_look_ahead_that_cannot_be() -> None:
    for look_ahead_s in (0.05, 2.0):
        with pytest.raises(UsageError, match="look_ahead_s"):
            SmallRecognizer(look_ahead_s)


def test_the_weights_tell_where_they_come_from() -> None:
    weights = read_weights(WEIGHTS.read_bytes())
    assert weights.labels[0] == "_"
    assert {"steps", "seed", "speakers"} <= set(weights.about)
    assert WEIGHTS.stat().st_size < 3e6


@settings(max_examples=25, deadline=None)
@given(at=st.floats(0, 1), byte=st.integers(1, 255))
def test_damaged_weights_are_refused_or_read(at: float, byte: int) -> None:
    data = bytearray(WEIGHTS.read_bytes())
    data[int(at * (len(data) - 1))] ^= byte
    with contextlib.suppress(DataError):
        read_weights(bytes(data))


def test_weights_state_the_licence_of_the_file_beside_them() -> None:
    with np.load(WEIGHTS) as arrays:
        stated = json.loads(str(arrays["about"]))["licence"].partition(":")[0]
    assert WEIGHTS.with_suffix(".npz.license").read_text().splitlines()[-1].endswith(f": {stated}")


@pytest.mark.parametrize("part", [0, 10, 1000, -1])
def test_cut_weights_are_refused(part: int) -> None:
    with pytest.raises(DataError, match="weights"):
        read_weights(WEIGHTS.read_bytes()[:part])


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("head.weight", np.zeros((3, 3), np.float16)), ("front.bias", np.zeros((), np.float16)), ("shares", None),
        ("first_mean", np.full(40, np.nan, np.float16)), ("pairs", np.array([["a"]])),
        ("about", np.array("[1]")), ("about", np.array("no JSON")), ("about", np.array(json.dumps({"labels": 3}))),
    ],
)  # fmt: skip
def test_weights_of_another_shape_are_refused(name: str, wrong: np.ndarray | None) -> None:
    with np.load(WEIGHTS) as found:
        arrays = {key: found[key] for key in found.files}
    arrays.pop(name)
    if wrong is not None:
        arrays[name] = wrong
    out = io.BytesIO()
    np.savez(out, **arrays)
    with pytest.raises(DataError, match="weights"):
        read_weights(out.getvalue())


class HearsOnlySilence(KnownFrames):
    weight = 20.0

    def __init__(self, sure_after: int) -> None:
        super().__init__()
        self.sure_after = sure_after

    def labels(self, first: int, end: int, numbers: Mapping[str, int]) -> NDArray[np.int64]:
        return np.full(end - first, numbers["_"])


@pytest.mark.parametrize("sure_after", [0, SURE_AFTER])
def test_the_latest_phones_are_the_small_networks(sure_after: int) -> None:
    """PocketSphinx's labels count from an age on, for younger ones are often wrong."""
    joint, final, latest = JointRecognizer(other=HearsOnlySilence(sure_after)), [], []
    for block in np.split(spoken("rms", BABY).samples[: 64 * 320], 64):
        final += joint.push(block)
        latest += [phone for phone in joint.partial if not phone.is_silence]
    assert {phone.label for phone in final} == {"_"}
    assert bool(latest) is bool(sure_after)
    assert max((phone.duration_s for phone in latest), default=0.0) <= sure_after / 100


def test_which_ear_hears(monkeypatch: pytest.MonkeyPatch) -> None:
    from pathlib import Path

    assert str(chosen(None)) == BOTH
    assert isinstance(new_recognizer(None), JointRecognizer)
    monkeypatch.setattr(choice, "find_spec", lambda name: None)
    assert str(chosen(None)) == SMALL
    check_recognizer(None)
    assert type(new_recognizer(None)) is SmallRecognizer
    for name in ("sphinx", "both"):
        with pytest.raises(ResourceError, match="PocketSphinx is not installed"):
            check_recognizer(Path(name))
