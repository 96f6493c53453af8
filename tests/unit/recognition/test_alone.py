"""Phones from sound alone: what is heard, what is no speech, and that pieces do not matter."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.recognition import recording
from fapengine.recognition.process import answers
from fapengine.recognition.protocol import RATE_HZ, due
from fapengine.recognition.recording import listen
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from tests.unit.recognition.speech import BABY, POPPIES, closures, heard, met, no_speech, opening_mm, spoken


@pytest.fixture(scope="module")
def ear() -> SphinxRecognizer:
    return SphinxRecognizer()


def test_lips_move_as_with_the_true_phones(ear: SphinxRecognizer) -> None:
    likeness, asked, hits, told, false = [], 0, 0, 0, 0
    for voice, text in (("rms", BABY), ("slt", POPPIES), ("awb", BABY), ("kal16", POPPIES)):
        speech = spoken(voice, text)
        duration_s = len(speech.samples) / RATE_HZ
        track = PhoneTrack.from_phones(heard(ear, speech.samples))
        likeness.append(
            np.corrcoef(opening_mm(track, duration_s), opening_mm(speech.phones, duration_s))[0, 1]
        )  # fmt: skip
        truth, found = closures(speech.phones), closures(track)
        asked, hits = asked + len(truth), hits + met(truth, found)
        told, false = told + len(found), false + len(found) - met(found, truth)
    assert np.median(likeness) > 0.65  # bench/recognizers.py measures ten sentences of each voice
    assert hits >= 0.75 * asked
    assert false <= 0.2 * told


@pytest.mark.parametrize("name", no_speech(0.1))
@pytest.mark.parametrize("streamed", [True, False])
def test_no_speech_moves_the_lips_less_than_a_millimetre(ear: SphinxRecognizer, name: str, streamed: bool) -> None:
    samples = no_speech(2.0)[name]
    phones = PhoneTrack.from_phones(heard(ear, samples)) if streamed else listen([samples]).phones
    assert np.abs(opening_mm(phones, 2.0)).max() < 1.0
    assert phones.duration_s == pytest.approx(2.0)


def test_without_the_gate_music_is_heard(ear: SphinxRecognizer, monkeypatch: pytest.MonkeyPatch) -> None:
    everything = "fapengine.recognition.sphinx_recognizer.spoken_frames"
    monkeypatch.setattr(everything, lambda found, pitch, levels: np.ones(len(pitch), bool))
    music = PhoneTrack.from_phones(heard(ear, no_speech(2.0)["music"]))
    assert opening_mm(music, 2.0).max() > 3.0  # so the test above can fail


def test_a_long_talk_is_cut_in_its_pauses(ear: SphinxRecognizer) -> None:
    one = np.concatenate([spoken("rms", BABY).samples, np.zeros(RATE_HZ, np.int16)])
    phones = heard(ear, np.tile(one, 3))
    truth = closures(spoken("rms", BABY).phones)
    for round_ in range(3):
        start_s = round_ * len(one) / RATE_HZ
        found = [at_s - start_s for at_s in closures(PhoneTrack.from_phones(phones))]
        assert met(truth, found) >= 0.6 * len(truth)


def test_what_is_told_stays_whatever_comes() -> None:
    first = due([("m", 0, 8), ("a", 8, 30)], 0, 15)
    assert first == [("m", 0, 8)]
    # now the m is thought to be longer, and something else
    assert due([("n", 0, 12), ("a", 12, 30)], 8, 40) == [("n", 8, 12), ("a", 12, 30)]
    assert due([("n", 0, 10), ("a", 10, 30)], 8, 40) == [("a", 8, 30)]  # 20 ms are no phone
    assert due([("n", 0, 12), ("a", 12, 14)], 8, 14) == [("n", 8, 12), ("a", 12, 14)]  # it has just begun


def test_a_recording_closes_the_lips_more_surely_than_the_loop_alone() -> None:
    speech = spoken("kal16", "The weather forecast for tomorrow is probably wrong. Many people walk home.")
    truth = closures(speech.phones)
    file = closures(listen([speech.samples]).phones)
    loop = closures(PhoneTrack.from_phones(heard(SphinxRecognizer(), speech.samples)))
    assert met(truth, file) == len(truth)
    assert len(file) - met(file, truth) <= len(loop) - met(loop, truth)


def test_pieces_of_a_recording_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """More than one piece, at once or in parts of odd length; the last is in step with the loop's pieces."""
    monkeypatch.setattr(recording, "MIN_PIECE_S", 3.0)
    monkeypatch.setattr(recording, "MAX_PIECE_S", 8.0)
    once = np.concatenate([spoken("rms", BABY).samples, np.zeros(RATE_HZ, np.int16), spoken("slt", POPPIES).samples])
    sound = np.tile(once, 2)
    assert len(list(recording.in_pieces([sound]))) > 1
    track = listen([sound]).phones
    assert track.phones == listen(np.array_split(sound, 37)).phones.phones
    assert track.duration_s == pytest.approx(len(sound) / RATE_HZ)
    start_s = len(once) / RATE_HZ
    alone = [phone for phone in listen([once]).phones.phones if not phone.is_silence]
    again = [(phone.label, phone.start_s - start_s) for phone in track.phones]
    same = [any(label == phone.label and abs(s - phone.start_s) < 0.02 for label, s in again) for phone in alone]
    assert np.mean(same) > 0.9  # .80 where the loop's phones lie elsewhere


def test_refuses_a_look_ahead_that_cannot_be() -> None:
    for look_ahead_s in (0.0, 2.0):
        with pytest.raises(UsageError, match="look_ahead_s"):
            SphinxRecognizer(look_ahead_s)


def test_nothing_and_one_sample(ear: SphinxRecognizer) -> None:
    assert heard(ear, np.zeros(0, np.int16)) == []
    (phone,) = heard(ear, np.ones(1, np.int16))
    assert phone == Phone(SILENCE, 0.0, 1 / RATE_HZ)
    assert listen([np.ones(1, np.int16)]).phones.duration_s == pytest.approx(1 / RATE_HZ)
    assert listen([]).phones.phones == ()


def parts(levels_db: Sequence[float]) -> tuple[NDArray[np.int16], float]:
    """A sentence at several levels, and the length of each part."""
    once = spoken("rms", BABY).samples.astype(float)
    once *= 8000 / np.abs(once).max()
    pause = np.zeros(RATE_HZ // 2)
    sound = np.concatenate([part for db in levels_db for part in (once * 10 ** (db / 20), pause)])
    return sound.astype(np.int16), (len(once) + len(pause)) / RATE_HZ


def test_what_is_shouted_is_loud_and_what_is_whispered_is_not() -> None:
    sound, length_s = parts((0, -20, 0, 12))
    track = listen([sound]).phones
    usual, quiet, again, loud = (
        [phone for phone in track.phones if not phone.is_silence and n * length_s <= phone.start_s < (n + 1) * length_s]
        for n in range(4)
    )
    assert max(abs(phone.loudness_db) for phone in usual + again) < 3
    assert np.mean([phone.loudness_db for phone in quiet]) < -11
    assert np.mean([phone.loudness_db for phone in loud]) > 6
    assert all(1 <= sum(phone.stress for phone in part) <= 6 for part in (usual, quiet, again, loud))  # 2 to 3 s each


def test_live_a_shout_is_told_as_one() -> None:
    sound, length_s = parts((0, 0, 12))
    head = {"stream": 1, "rate_hz": RATE_HZ, "skips": 0, "is_reduced": False}
    pieces = np.split(sound, range(320, len(sound), 320))
    messages = [(head, piece.astype("<i2").tobytes()) for piece in pieces]
    told = list(answers([*messages, ({**head, "rate_hz": 0}, b"")], SphinxRecognizer()))[1:]
    phones = [Phone(**phone) for head in told for phone in head["phones"]]
    spoken_ones = [(phone.start_s, phone.stress, phone.loudness_db) for phone in phones if not phone.is_silence]
    usual = [abs(db) for start_s, _, db in spoken_ones if start_s < 2 * length_s]
    assert len(usual) > 20
    assert max(usual) < 3
    assert np.median([db for start_s, _, db in spoken_ones if start_s > 2.2 * length_s]) > 5
    assert 3 <= sum(stress for _, stress, _ in spoken_ones) <= 20


def test_what_may_still_change_is_told_without_a_final_phone_too() -> None:
    pieces = np.split(spoken("rms", BABY).samples[:RATE_HZ], 10)
    head = {"stream": 1, "rate_hz": RATE_HZ, "skips": 0, "is_reduced": False}
    told = list(answers([(head, piece.astype("<i2").tobytes()) for piece in pieces], SphinxRecognizer()))[1:]
    recognizer = SphinxRecognizer()
    for one, piece in zip(told, pieces, strict=True):
        recognizer.push(piece)
        times = [(phone["label"], phone["start_s"], phone["end_s"]) for phone in one["partial"]]
        assert times == [(phone.label, phone.start_s, phone.end_s) for phone in recognizer.partial]


@pytest.mark.parametrize("rate_hz", [RATE_HZ, 44_100])
def test_a_message_without_samples_is_answered(ear: SphinxRecognizer, rate_hz: int) -> None:
    head = {"stream": 1, "rate_hz": rate_hz, "skips": 0, "is_reduced": False}
    sound = np.zeros(rate_hz // 10, "<i2").tobytes()
    told = list(answers([(head, b""), (head, sound), ({**head, "rate_hz": 0}, b"")], ear))[1:]
    assert [round(one["position_s"], 6) for one in told] == [0.0, 0.1, 0.1]
