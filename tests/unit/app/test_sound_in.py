"""Sound that enters through Python, in the forms in which other libraries give it."""

from pathlib import Path

import numpy as np
import pytest

import fapengine
from fapengine import DataError, Phone, PhoneTrack, UsageError
from fapengine.files.sound import load_sound, save_wav
from fapengine.voices.protocol import Speech

RATE_HZ = 16_000
TONE = np.rint(9000 * np.sin(2 * np.pi * 220 * np.arange(RATE_HZ) / RATE_HZ)).astype(np.int16)
PHONES = PhoneTrack.from_phones([Phone("m", 0.0, 0.4), Phone("a", 0.4, 1.0)])
FORMS = {
    "int16": TONE,
    "float32": (TONE / 2**15).astype(np.float32),
    "float64": TONE / 2**15,
    "int32": TONE.astype(np.int32) << 16,
    "(N, 2) int16": np.stack([TONE, TONE], axis=1),
    "(N, 1) float32": (TONE / 2**15).astype(np.float32)[:, None],
    "(N, 2) float64, one channel silent": np.stack([TONE / 2**14, np.zeros(RATE_HZ)], axis=1),
    "(1, N) float32, of PyTorch": (TONE / 2**15).astype(np.float32)[None],
    "(1, 1, N) float32": (TONE / 2**15).astype(np.float32)[None, None],
    "big-endian int16": TONE.astype(">i2"),
    "not contiguous": np.repeat(TONE, 2)[::2],
    "list": (TONE / 2**15).tolist(),
}


def wrong(samples: object, rate_hz: object = RATE_HZ) -> tuple[object, object]:
    return samples, rate_hz


WRONG = [
    (wrong(TONE.astype(np.int64)), "sound: got dtype int64, expected int16"),
    (wrong(TONE.astype(np.complex64)), "sound: got dtype complex64"),
    (wrong(TONE > 0), "sound: got dtype bool"),
    (wrong(["a", "b"]), "sound: got dtype <U1"),
    (wrong(None), "sound: got"),
    (wrong([[1.0], [0.0, 1.0]]), "sound: got a ragged sequence"),
    (wrong(np.where(TONE > 8999, np.nan, 0.1)), r"sound: got nan at \d+, expected finite numbers"),
    (wrong(TONE.astype(np.float32)), r"sound: got float32 samples up to 9000, expected -1 to 1"),
    (wrong(np.stack([TONE, TONE])), r"sound: got shape \(2, 16000\), expected \(N,\) or \(N, channels\)"),
    (wrong(np.zeros((4, 4, 4), np.float32)), r"sound: got shape \(4, 4, 4\)"),
    (wrong(np.float32(0.5)), r"sound: got shape \(\)"),
    (wrong(TONE, 44.1), r"sound: got a rate of 44\.1 Hz, expected 1000 to 768000, a whole number"),
    (wrong(TONE, 22050.5), r"sound: got a rate of 22050\.5 Hz"),
    (wrong(TONE, 0), "sound: got a rate of 0 Hz"),
    (wrong(TONE, "16000"), "sound: "),
    (TONE, "sound: "),
    ((TONE,), "sound: "),
    (b"RIFF", "sound: "),
]


@pytest.fixture(scope="module")
def track() -> fapengine.FapTrack:
    return fapengine.animate(PHONES).track


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_samples_is_the_same_sound(track: fapengine.FapTrack, form: str, tmp_path: Path) -> None:
    fapengine.save(track, tmp_path / "a.wav", sound=(FORMS[form], RATE_HZ))
    performance = fapengine.animate(PHONES, sound=(FORMS[form], RATE_HZ))
    performance.save(tmp_path / "b.wav")
    spoken = Speech(samples=FORMS[form], sample_rate_hz=float(RATE_HZ), phones=PHONES)
    for samples in (load_sound(tmp_path / "a.wav")[0], load_sound(tmp_path / "b.wav")[0], spoken.samples):
        assert np.array_equal(samples, TONE)
    assert performance.duration_s == spoken.duration_s == 1.0
    assert performance.remarks == ()


def test_8_bits_are_centred_on_128(track: fapengine.FapTrack, tmp_path: Path) -> None:
    coarse = ((TONE.astype(int) >> 8) + 128).astype(np.uint8)
    fapengine.save(track, tmp_path / "a.wav", sound=(coarse, RATE_HZ))
    assert np.array_equal(load_sound(tmp_path / "a.wav")[0], (TONE >> 8) << 8)


@pytest.mark.parametrize(("sound", "message"), WRONG, ids=[message for _, message in WRONG])
def test_no_sound_is_refused_with_its_form(
    track: fapengine.FapTrack, sound: object, message: str, tmp_path: Path
) -> None:
    for call in (
        lambda: fapengine.save(track, tmp_path / "a.wav", sound=sound),
        lambda: fapengine.animate(PHONES, sound=sound),
        lambda: fapengine.Performance(track=track, phones=PHONES, sound=sound),
    ):
        with pytest.raises((UsageError, DataError), match=message):
            call()
    assert not list(tmp_path.iterdir())


def test_a_voice_that_gives_floats_is_heard(tmp_path: Path) -> None:
    class Floats:
        def speak(self, text: str) -> Speech:
            return Speech(samples=TONE / 2**15, sample_rate_hz=RATE_HZ, phones=PHONES)

    spoken = fapengine.speak("Ma.", voice=Floats())
    assert np.abs(spoken.sound[0]).max() == 9000


def test_silent_and_clipped_sound_is_remarked() -> None:
    assert fapengine.animate(PHONES, sound=(TONE * 0, RATE_HZ)).remarks == (
        "sound: it is silent, though phones are spoken in it; is it the right file or channel?",
    )
    loud = np.clip(TONE / 2**15 * 6, -1, 1)
    (remark,) = fapengine.animate(PHONES, sound=(loud, RATE_HZ)).remarks
    assert remark.startswith("sound: 58 % of its samples are at full scale (clipped)")


def test_a_cut_file_is_remarked_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "cut.wav"
    save_wav(path, np.tile(TONE, 3), RATE_HZ)
    path.write_bytes(path.read_bytes()[: 44 + 2 * RATE_HZ])
    said = f"{path}: has 1.00 s of the 3.00 s that it states: damaged or cut off"
    timed = fapengine.animate(PHONES, sound=path)
    recognized = fapengine.animate(path, recognizer="small")
    for performance in (timed, recognized):
        assert [remark for remark in performance.remarks if "cut off" in remark] == [said]
        assert said in performance.doubts
    assert not caplog.messages
    with pytest.raises(DataError, match="damaged or cut off"):
        fapengine.animate(path, recognizer="small", strict=True)
