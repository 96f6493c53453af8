"""Phones of a text in its sound: where they lie, strange words, other languages, texts of something else."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.recognition import small_net, sphinx
from fapengine.recognition.loudness import HOP, loudness_db, pitch_hz, soundings
from fapengine.recognition.protocol import RATE_HZ, Labelled
from fapengine.recognition.recording import MAX_PIECE_S, MIN_PIECE_S, Recording, follow, in_pieces
from fapengine.recognition.sphinx import MODEL_NAMES, MODEL_PHONES, SOUNDS_LIKE, heard_as, ipa_of, words_of
from fapengine.recognition.sphinx_aligner import Aligned, SphinxAligner, against_loudness, without_quiet
from fapengine.recognition.sphinx_recognizer import labelled
from fapengine.recognition.text_place import WORST, frame_scores, words_said
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone
from fapengine.voices.espeak import EspeakVoice
from tests.unit.recognition.speech import (
    BABY,
    POPPIES,
    VOICES,
    Spoken,
    closures,
    in_noise,
    met,
    opening_mm,
    over_telephone,
    spoken,
    spoken_by_espeak,
)

OTHER = "The weather forecast for tomorrow is probably wrong."


def pronounce(word: str, language: str = "en-us") -> Sequence[Phone]:
    return EspeakVoice(language).speak(word).phones.phones


def aligned(speech: Spoken, text: str | None = None) -> Recording:
    return follow([speech.samples], SphinxAligner(words_of(text or speech.text), pronounce))


@pytest.mark.parametrize("voice", VOICES)
def test_phones_lie_where_they_are_said(voice: str) -> None:
    speech = spoken(voice, BABY)
    found = aligned(speech)
    duration_s = len(speech.samples) / RATE_HZ
    assert found.mismatches == ()
    likeness = np.corrcoef(opening_mm(found.phones, duration_s), opening_mm(speech.phones, duration_s))[0, 1]
    assert likeness > 0.885  # .893 (awb) to .976 measured; one frame of 17 ms earlier or later .73 to .883
    truth, told = closures(speech.phones), closures(found.phones)
    assert met(truth, told) == len(truth) == len(told)
    starts = [phone.start_s for phone in found.phones.phones]
    off_s = [min(abs(start_s - phone.start_s) for start_s in starts) for phone in speech.phones.phones]
    assert np.median(off_s) < 0.02
    assert found.phones.duration_s == pytest.approx(duration_s)
    words = list(dict.fromkeys(phone.word for phone in found.phones.phones if phone.word))
    assert words == words_of(BABY)
    assert np.mean([phone.confidence for phone in found.phones.phones if not phone.is_silence]) > 0.5


def test_words_that_no_dictionary_has() -> None:
    speech = spoken("slt", "My bliffy zorbster bumped the bowl.")
    aligner = SphinxAligner(words_of(speech.text), pronounce)
    assert aligner.pronounced == ("bliffy", "zorbster")
    found = follow([speech.samples], aligner)
    truth = closures(speech.phones)
    assert met(truth, closures(found.phones)) == len(truth)
    with pytest.raises(UsageError, match="'bliffy', 'zorbster', expected words that can be pronounced"):
        SphinxAligner(words_of(speech.text))


@pytest.mark.parametrize(
    ("language", "text"),
    [("it", "Mio fratello abita a Palermo da molti anni."), ("fr", "Mon petit frère habite à Paris depuis longtemps.")],
)
def test_another_language_by_a_speaker_that_the_model_hears_badly(language: str, text: str) -> None:
    """With a narrow beam the way is lost, and the words lie anywhere."""
    speech = spoken_by_espeak(f"{language}+m1", text)
    aligner = SphinxAligner(words_of(text), lambda word: pronounce(word, language), dictionary=False)
    found = follow([speech.samples], aligner)
    assert found.unheard < 0.3
    truth = closures(speech.phones)
    assert met(truth, closures(found.phones)) >= len(truth) - 1 >= 2
    starts = [phone.start_s for phone in found.phones.phones]
    off_s = [min(abs(start_s - phone.start_s) for start_s in starts) for phone in speech.phones.phones]
    assert np.median(off_s) < 0.03


def test_no_loud_sound_of_another_language_is_a_pause() -> None:
    """The diphthong of "seit" was taken for a pause of 0.3 s, and the vowels around it lay late."""
    text = "Mein Bruder wohnt seit vielen Jahren in Hamburg."
    speech = spoken_by_espeak("de+m1", text)
    aligner = SphinxAligner(words_of(text), lambda word: pronounce(word, "de"), dictionary=False)
    found = follow([speech.samples], aligner).phones
    duration_s = len(speech.samples) / RATE_HZ
    assert np.corrcoef(opening_mm(found, duration_s), opening_mm(speech.phones, duration_s))[0, 1] > 0.88
    assert not [phone for phone in found.phones if phone.is_silence and 0.1 < phone.start_s < 2.3]


def test_quiet_is_taken_out_of_phones_and_speaks_against_them() -> None:
    rng = np.random.default_rng(1)
    sound = (5000 * rng.normal(size=RATE_HZ)).clip(-32768, 32767).astype(np.int16)
    sound[30 * 160 : 60 * 160] = 0
    told = [Aligned(0, "a", 0, 0, 40, "AA"), Aligned(0, "m", 0, 40, 50, "M"), Aligned(1, "o", 0, 50, 100, "OW")]
    assert against_loudness(told, sound) == 30
    cut = without_quiet(told, sound)
    assert [(phone.first, phone.end) for phone in cut] == [(0, 30), (40, 50), (60, 100)]
    assert against_loudness(cut, sound) == 10
    assert against_loudness(told[:1], sound) == 50  # 10 quiet ones in it, 40 loud ones behind it


def test_another_language_is_told_in_its_own_phones() -> None:
    voice = EspeakVoice("de")
    speech = voice.speak("Über die Brücke mussten fünf blaue Busse fahren.")
    sound = Spoken(
        "Über die Brücke mussten fünf blaue Busse fahren.",
        *_at_rate(speech.samples, speech.sample_rate_hz),
        speech.phones,
    )
    aligner = SphinxAligner(words_of(sound.text), lambda word: pronounce(word, "de"), dictionary=False)
    found = follow([sound.samples], aligner)
    assert {"yː", "ʏ"} <= {phone.label for phone in found.phones.phones}
    truth = closures(speech.phones)
    assert met(truth, closures(found.phones)) == len(truth)
    assert found.unheard < 0.3


def _at_rate(samples: np.ndarray, rate_hz: int) -> tuple[np.ndarray]:
    places = np.arange(0, len(samples) - 1, rate_hz / RATE_HZ)
    return (np.interp(places, np.arange(len(samples)), samples).astype(np.int16),)


def test_the_text_of_something_else_is_found_out() -> None:
    assert aligned(spoken("rms", BABY), OTHER).unheard > 0.8
    assert aligned(spoken("slt", POPPIES), OTHER).unheard > 0.5


@pytest.mark.parametrize(
    ("voice", "text", "other"),
    [("rms", "Open it.", "Stop."), ("slt", "Goodbye.", "Come in."), ("awb", "Seven.", "Open it."),
     ("kal16", "Seven.", "Good morning."), ("slt", "Twenty.", "Tomorrow."), ("kal16", "People.", "Winter."),
     ("rms", "Tea.", "Four.")],
)  # fmt: skip
def test_a_word_of_something_else_is_found_out_in_clear_sound(voice: str, text: str, other: str) -> None:
    speech = spoken(voice, text)
    assert aligned(speech, other).unheard == 1.0
    assert (aligned(speech).unheard, aligned(speech).doubted) == (0.0, ())


@pytest.mark.parametrize(
    ("voice", "text"), [("slt", "hello"), ("kal16", "thank"), ("rms", "butter"), ("slt", "chocolate")]
)
def test_one_clear_word_in_which_the_loop_is_wrong_is_believed(voice: str, text: str) -> None:
    """Other words are worse there, whatever the loop finds."""
    found = aligned(spoken(voice, text))
    assert (found.unheard, found.doubted) == (0.0, ())


def test_a_word_that_is_like_what_is_said_is_doubted() -> None:
    found = aligned(spoken("slt", "Yesterday."), "Monday.")
    assert (found.unheard, len(found.doubted)) == (0.0, 1)


def test_one_word_through_a_telephone_is_not_refused() -> None:
    clean = spoken("awb", "picture")
    assert aligned(Spoken(clean.text, over_telephone(clean.samples), clean.phones)).unheard == 0.0


def test_a_word_that_cannot_be_judged_is_believed() -> None:
    """The loop agrees in .24 of its frames; two phones are too few."""
    speech = spoken("slt", "No.")
    assert aligned(speech).unheard == 0.0
    assert aligned(spoken("awb", "Stop.")).unheard == 0.0
    for text, snr_db in (("Open it.", 6.0), ("Really?", 9.0)):
        clean = spoken("rms", text)
        assert aligned(Spoken(text, in_noise(clean.samples, snr_db), clean.phones)).unheard == 0.0


@pytest.mark.parametrize(("voice", "text", "other"), [("rms", "Water.", "People."), ("kal16", "Music.", "Seven.")])
def test_another_word_is_refused_in_noise_too(voice: str, text: str, other: str) -> None:
    clean = spoken(voice, text)
    speech = Spoken(text, in_noise(clean.samples, 8.0), clean.phones)
    assert (aligned(speech).unheard, aligned(speech, other).unheard) == (0.0, 1.0)


@pytest.mark.parametrize(("text", "other"), [("Morning.", "Table."), ("Music.", "Paper.")])
def test_a_word_that_noise_lets_through_is_doubted(text: str, other: str) -> None:
    clean = spoken("slt", text)
    speech = Spoken(text, in_noise(clean.samples, 0.0), clean.phones)
    whole = ((0.0, len(speech.samples) / RATE_HZ),)
    assert (aligned(speech, other).unheard, aligned(speech, other).doubted) == (0.0, whole)
    assert aligned(clean).doubted == ()


def test_a_text_is_right_or_wrong_in_noise_too() -> None:
    clean = spoken("rms", BABY)
    speech = Spoken(clean.text, in_noise(clean.samples, 12.0), clean.phones)
    found = aligned(speech)
    assert found.unheard == 0.0
    assert found.doubted == ((0.0, len(speech.samples) / RATE_HZ),)
    assert aligned(clean).doubted == ()
    truth = closures(speech.phones)
    assert met(truth, closures(found.phones)) >= 0.6 * len(truth)
    assert aligned(speech, OTHER).unheard > 0.5


def test_loud_noise_hides_no_text_and_lets_no_other_through() -> None:
    """The aligner alone would refuse it: .86 of the words in another order; the loop agrees in .14 of the frames."""
    clean = spoken("rms", BABY)
    speech = Spoken(clean.text, in_noise(clean.samples, 3.0), clean.phones)
    assert aligned(speech).unheard == 0.0
    assert aligned(speech, OTHER).unheard == 1.0


def test_a_text_that_is_trusted_is_not_checked() -> None:
    speech = spoken("rms", BABY)
    found = follow([speech.samples], SphinxAligner(words_of(OTHER), pronounce), is_trusted=True)
    assert (found.unheard, found.doubted) == (0.0, ())
    assert [word for word, _ in groupby(phone.word for phone in found.phones.phones if phone.word)] == words_of(OTHER)


def test_a_text_of_one_order_is_never_found_to_be_in_order() -> None:
    speech = spoken("rms", BABY)
    for words in (["baby"], ["no", "no", "no"]):
        assert SphinxAligner(words).misfit(speech.samples, 0, len(words)) == 1.0


def test_a_sentence_that_is_not_said_is_told_with_its_time() -> None:
    first, second = spoken("rms", BABY), spoken("rms", POPPIES)
    both = Spoken("", np.concatenate([first.samples, second.samples]), first.phones)
    found = aligned(both, f"{BABY} {OTHER}")
    (mismatch,) = found.mismatches
    border_s = len(first.samples) / RATE_HZ
    assert mismatch.start_s == pytest.approx(border_s, abs=0.8)
    assert "forecast" in mismatch.words
    assert "bumped" not in mismatch.words
    truth = [border_s + at_s for at_s in closures(second.phones)]
    told = [at_s for at_s in closures(found.phones) if at_s > border_s]
    assert met(truth, told) >= 0.5 * len(truth)  # there the lips follow the sound alone


def test_a_long_recording_is_followed_piece_by_piece() -> None:
    sentences = [BABY, POPPIES, OTHER]
    pause = np.zeros(RATE_HZ // 2, np.int16)
    parts = [(spoken("rms", text), pause) for text in sentences * 3]
    sound = np.concatenate([samples for speech, pause in parts for samples in (speech.samples, pause)])
    heard_s: list[float] = []
    aligner = SphinxAligner(words_of(" ".join(sentences * 3)), pronounce)
    found = follow(np.array_split(sound, 50), aligner, on_heard=heard_s.append)
    assert len(heard_s) >= 2
    assert max(heard_s) <= MAX_PIECE_S
    assert sum(heard_s) == pytest.approx(len(sound) / RATE_HZ)
    assert found.mismatches == ()
    start_s, truth = 0.0, list[float]()
    for speech, pause in parts:
        truth += [start_s + at_s for at_s in closures(speech.phones)]
        start_s += (len(speech.samples) + len(pause)) / RATE_HZ
    assert met(truth, closures(found.phones)) >= 0.97 * len(truth)


def test_words_are_shared_among_pieces_in_noise_as_well() -> None:
    """An edit distance of the loop's phones found 1 of the first piece's 15 words."""
    sounds = [spoken("rms", text).samples for text in (BABY, POPPIES, OTHER)]
    sound = in_noise(np.concatenate(sounds), 5.0)
    border = len(sounds[0]) + len(sounds[1])
    aligner = SphinxAligner(words_of(f"{BABY} {POPPIES} {OTHER}"))
    words = [aligner.model_phones(index) for index in range(len(aligner.words))]
    pieces = [frame_scores(piece, found_by_loop(piece)) for piece in (sound[:border], sound[border:])]
    count = len(words_of(f"{BABY} {POPPIES}"))
    assert words_said(*pieces, words, is_whole=True) == count
    assert words_said(*pieces, [*words, *words], is_whole=False) == count  # the text goes on


def found_by_loop(piece: np.ndarray) -> list[Labelled]:
    loop = sphinx.new_phone_loop()
    sphinx.decode(loop, piece)
    return labelled(sphinx.frames_of(loop.seg()), np.ones(-(-len(piece) // HOP), bool))


def test_pieces_are_cut_in_silence_and_lose_nothing() -> None:
    rng = np.random.default_rng(1)
    sound = (3000 * rng.normal(size=70 * RATE_HZ)).clip(-32768, 32767).astype(np.int16)
    for second in (9, 17, 30, 44, 60):
        sound[second * RATE_HZ : round((second + 0.4) * RATE_HZ)] //= 200
    pieces = list(in_pieces(np.array_split(sound, 300)))
    assert np.array_equal(np.concatenate([piece for piece, _ in pieces]), sound)
    assert [is_last for _, is_last in pieces] == [False] * (len(pieces) - 1) + [True]
    ends_s = np.cumsum([len(piece) for piece, _ in pieces])[:-1] / RATE_HZ
    assert np.abs(ends_s - np.array([17, 30, 44, 60][: len(ends_s)]) - 0.2).max() < 0.2
    assert all(MIN_PIECE_S <= len(piece) / RATE_HZ <= MAX_PIECE_S for piece, is_last in pieces if not is_last)


def test_every_ipa_letter_is_heard_as_something() -> None:
    for letter in ipa.SOUNDS:
        assert letter == "ʔ" or set(heard_as(letter)) <= set(MODEL_PHONES) != set(), letter
    assert not set(SOUNDS_LIKE) & set(MODEL_NAMES)
    assert set(SOUNDS_LIKE.values()) <= set(MODEL_PHONES)


WORDS = [["B", "EY", "B", "IY"], ["B", "L", "UW"], ["B", "OW", "L"], ["M", "AA"], ["S", "IH", "T", "S"]]


def scored(names: str, noise: float = 0.0) -> np.ndarray:
    """Scores of phones of the model that last 60 ms each; "_" is silence."""
    labels = small_net.shipped().labels
    columns = np.repeat([labels.index(ipa_of(name)) for name in names.split()], 6)
    scores = np.full((len(columns), len(labels)), WORST, np.float32)
    scores[np.arange(len(columns)), columns] = 0.0
    return scores + np.random.default_rng(3).normal(0, noise, scores.shape).astype(np.float32)


@pytest.mark.parametrize("noise", [0.0, 8.0])
def test_a_piece_contains_the_words_up_to_its_end(noise: float) -> None:
    first, second = scored("_ B EY B IY B L UW", noise), scored("B OW L _ M AA _ S IH T S _", noise)
    assert words_said(first, second, WORDS, is_whole=True) == 2
    assert words_said(first, second, WORDS[:2], is_whole=False) == 2
    assert words_said(first, None, WORDS, is_whole=False) == 2
    assert words_said(scored("_ B EY B IY B L UW B OW", noise), scored("L M AA S IH T S"), WORDS, is_whole=True) == 3
    assert words_said(scored("_ B EY B IY B L UW B"), scored("OW L M AA S IH T S"), WORDS, is_whole=True) == 2


def test_words_that_a_piece_lacks_and_sound_that_a_text_lacks_move_no_other_words() -> None:
    second = scored("B OW L M AA S IH T S")
    assert words_said(scored("B L UW"), second, WORDS, is_whole=True) == 2
    assert words_said(scored("B EY B IY F AO R K AE S T P R AA B B L UW"), second, WORDS, is_whole=True) == 2
    assert words_said(scored("B EY B IY B L UW"), scored("S IH T S"), WORDS, is_whole=True) in (2, 3, 4)
    page = [["F", "AO", "R", "K", "AE", "S", "T"]] * 40  # more than fits into both
    assert 2 <= words_said(scored("B EY B IY B L UW"), second, [*WORDS[:2], *page, *WORDS[2:]], is_whole=True) <= 42
    assert words_said(scored("_ _ _ _"), second, WORDS[2:], is_whole=True) == 0


def test_words_of_a_text() -> None:
    assert words_of("It's 9 o'clock — “really”?! (Yes...)") == ["It's", "9", "o'clock", "really", "Yes"]
    with pytest.raises(UsageError, match="contains no words"):
        SphinxAligner(words_of("?!"))


def test_loudness_and_pitch() -> None:
    at_s = np.arange(RATE_HZ) / RATE_HZ
    tone = 8000 * np.sign(np.sin(2 * np.pi * 150 * at_s))
    sound = np.concatenate([np.zeros(RATE_HZ), tone, tone / 10]).astype(np.int16)
    levels, pitches = loudness_db(sound), pitch_hz(sound)
    assert len(levels) == len(pitches) == 300
    assert levels[150] - levels[250] == pytest.approx(20, abs=0.1)
    assert np.median(pitches[110:290]) == pytest.approx(150, rel=0.01)
    assert not pitches[:95].any()
    moving = np.diff(np.rint(8000 * np.sin(600 * at_s**1.5)), prepend=0).astype(np.int16)  # its pitch rises
    for first, stop in ((0, 7), (1, 40), (30, 31), (60, 100), (97, 104), (50, 50)):
        assert pitch_hz(moving, first, stop) == pytest.approx(pitch_hz(moving)[first:stop])
    quiet, loud = soundings([Phone("_", 0, 0.9), Phone("a", 1, 2)], sound)
    assert (quiet.loudness_db, quiet.pitch_hz) == (-100, 0)
    assert loud.loudness_db == pytest.approx(-12.2, abs=0.1)
    assert loud.pitch_hz == pytest.approx(150, rel=0.01)
