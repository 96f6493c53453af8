"""Every timing format: what is read, how it is found, what is refused."""

import json
import re
from pathlib import Path

import pytest

from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.files.sessions import _phones
from fapengine.files.timings import load_timings
from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.formats.documents import MAX_BYTES, parse_document
from fapengine.speech.formats.registry import FORMATS, ParseOptions, guess_format, parse_timings
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

from .samples import SAMPLES, lines

MY = [("m", 0.0, 0.4), ("aɪ", 0.4, 1.0)]
WORDS = (
    "whisper", "whisper timestamped", "openai-words", "whisper-cpp", "whisper-cpp words", "transformers", "vosk",
    "vosk stream", "deepgram", "assemblyai", "aws-transcribe", "google-speech", "google-speech v2", "soniox",
    "kokoro-fastapi", "edge-tts", "edge-tts metadata", "aeneas", "fish", "subtitles", "subtitles inside",
    "subtitles underlined", "azure-batch", "azure-speech", "azure-speech-ticks", "rev", "speechmatics",
    "gladia", "watson",
)  # fmt: skip
"""Samples that time words."""
NEEDS = {"moho": ParseOptions(columns="fps=10")}
"""Options without which a sample cannot be read."""
OTHERS: dict[str, list[tuple[str, float, float]]] = {
    "espeak-json": [("m", 0.0, 0.4), ("aɪ", 0.4, 0.9), ("_", 0.9, 1.0)],
    "polly": [("p", 0.0, 0.4), ("a", 0.4, 1.0), ("_", 1.0, 1.1)],
    "polly words": [("my", 0.0, 0.9), ("oh", 0.9, 1.0)],
    "azure": [("p", 0.0, 0.4), ("aɪ", 0.4, 1.0), ("_", 1.0, 1.1)],
    "azure lines": [("p", 0.0, 0.4), ("aɪ", 0.4, 1.0), ("_", 1.0, 1.1)],
    **{
        name: [("my", 0.0, 0.4), ("_", 0.4, 0.5), ("oh", 0.5, 1.0)]
        for name in ("elevenlabs", "elevenlabs stream", "elevenlabs aligned", "cartesia words")
    },
    "voicevox": [("_", 0.0, 0.1), ("m", 0.1, 0.2), ("a", 0.2, 0.5), ("ɴ", 0.5, 0.7), ("_", 0.7, 1.0)],
    "kokoro": [("m", 0.0, 0.5), ("aɪ", 0.5, 1.0)],
    "kokoro durations": [("_", 0.0, 0.1), ("m", 0.1, 0.45), ("aɪ", 0.45, 0.75), ("_", 0.75, 1.0)],
    "headtts": [("p", 0.0, 0.39), ("ɑ", 0.39, 0.69), ("ɪ", 0.69, 1.0)],
    "piper": [("_", 0.0, 0.1), ("m", 0.1, 0.4), ("a", 0.4, 0.6), ("ɪː", 0.6, 0.8), ("_", 0.8, 1.0)],
    "piper samples": [("_", 0.0, 0.1), ("m", 0.1, 0.4), ("a", 0.4, 1.0)],
    "rhubarb-json": [("p", 0.0, 0.4), ("ɑ", 0.4, 0.9), ("_", 0.9, 1.0)],
    "rhubarb-tsv": [("p", 0.0, 0.4), ("ɑ", 0.4, 0.9), ("_", 0.9, 1.0)],
    "rhubarb-xml": [("p", 0.0, 0.4), ("ɑ", 0.4, 1.0)],
    "phone-list lengths": [("_", 0.0, 0.1), ("m", 0.1, 0.4), ("aɪ", 0.4, 1.0), ("_", 1.0, 1.01)],
    "align": [("_", 0.0, 0.4), ("bin", 0.4, 0.8), ("blue", 0.8, 1.0)],
    **{
        name: [("my", 0.0, 0.4), ("_", 0.4, 0.5), ("oh", 0.5, 1.0)]
        for name in (
            *WORDS,
            "pocketsphinx words",
            "cartesia stream",
            "gentle words",
            "inworld words",
            "table words",
            "hume words",
            "resemble words",
        )
    },
    "openai-words": [("My", 0.0, 0.4), ("_", 0.4, 0.5), ("Oh", 0.5, 1.0)],
    "ctm words": [("montreal", 0.0, 0.4), ("_", 0.4, 0.5), ("aligner", 0.5, 1.0)],
    "allosaurus": [("m", 0.0, 0.25), ("_", 0.25, 0.4), ("aɪ", 0.4, 0.5)],
    "resemble": [("m", 0.0, 0.4), ("aɪ", 0.4, 0.9), ("_", 0.9, 1.0)],
    "inworld visemes": [("p", 0.0, 0.4), ("a", 0.4, 1.0)],
    "papagayo": [("m", 0.0, 0.4), ("a", 0.4, 1.0)],
    "papagayo json": [("m", 0.0, 0.4), ("a", 0.4, 1.0)],
    "moho": [("m", 0.0, 0.4), ("a", 0.4, 1.0), ("_", 1.0, 1.1)],
    "diffsinger": [("_", 0.0, 0.1), ("m", 0.1, 0.4), ("a", 0.4, 0.9), ("_", 0.9, 1.0)],
    "utau": [("_", 0.0, 0.1), ("ma", 0.1, 0.4), ("i", 0.4, 1.0)],
    "timit": [("_", 0.0, 0.1), ("b", 0.1, 0.4), ("aɪ", 0.4, 1.0)],
    "xlabel words": [("The", 0.0, 0.4), ("birch", 0.4, 1.0)],
    **{name: [("_", 0.0, 0.1), ("m", 0.1, 0.4), ("aɪ", 0.4, 1.0)] for name in ("xlabel", "flite", "pho")},
}
LEVELS = {
    "polly": "viseme", "polly words": "word", "azure": "viseme", "azure lines": "viseme", "elevenlabs": "character",
    "elevenlabs stream": "character", "elevenlabs aligned": "word", "cartesia words": "word", "kokoro": "word",
    "headtts": "viseme", "papagayo json": "viseme", "rhubarb-json": "viseme",
    "rhubarb-xml": "viseme", "rhubarb-tsv": "viseme", "align": "word",
    "xlabel words": "word", **dict.fromkeys(WORDS, "word"), "gentle words": "word", "pocketsphinx words": "word",
    "cartesia stream": "word", "inworld words": "word", "hume words": "word",
    "resemble words": "character",
    "table words": "word", "ctm words": "word", "inworld visemes": "viseme", "papagayo": "viseme", "moho": "viseme",
    "utau": "character",
}  # fmt: skip


def told(track: PhoneTrack) -> list[tuple[str, float, float]]:
    return [(phone.label, round(phone.start_s, 6), round(phone.end_s, 6)) for phone in track.phones]


@pytest.mark.parametrize(("fixed_s", "pause_s"), [({}, 0.3), ({"pauseLength": 0.2}, 0.2)])
def test_pauses_of_voicevox_are_scaled(fixed_s: dict[str, float], pause_s: float) -> None:
    mora = {"vowel": "a", "vowel_length": 0.4}
    query = {
        "accent_phrases": [{"moras": [mora], "pause_mora": {"vowel": "pau", "vowel_length": 0.3}}, {"moras": [mora]}]
    }
    for scale in (1.0, 0.5, 3.0):
        scaled = json.dumps({**query, **fixed_s, "speedScale": 2, "pauseLengthScale": scale}).encode()
        middle = 0.2 + pause_s * scale / 2
        assert told(parse_timings(scaled)) == [
            ("a", 0.0, 0.2),
            ("_", 0.2, pytest.approx(middle)),
            ("a", pytest.approx(middle), pytest.approx(middle + 0.2)),
        ]


@pytest.mark.conformance
def test_every_format_has_a_sample() -> None:
    assert {name.split()[0] for name in SAMPLES} == set(FORMATS)
    assert len(FORMATS) >= 53


@pytest.mark.conformance
@pytest.mark.parametrize("name", SAMPLES)
def test_format_is_found_and_read(name: str) -> None:
    data = SAMPLES[name].encode()
    found = guess_format(data)
    assert found is not None
    assert found.name == name.split()[0]
    track = parse_timings(data, options=NEEDS.get(name))
    assert told(track) == OTHERS.get(name, MY)
    assert track.level == LEVELS.get(name, "phone")
    assert track.spelled == (track.level in ("word", "character") and name not in ("kokoro", "utau"))


@pytest.mark.parametrize(
    "name",
    [
        "textgrid chronological",
        "mfa-json",
        "mfa-csv",
        "espeak-json",
        "cartesia",
        "phone-list",
        "gentle",
        "pocketsphinx",
        "mlf",
        "hume",
        "resemble",
    ],
)
def test_phones_know_their_word(name: str) -> None:
    assert [phone.word for phone in parse_timings(SAMPLES[name].encode()).phones if phone.label != SILENCE] == [
        "my"
    ] * 2


def test_stress_arrives() -> None:
    for name in ("textgrid", "mfa-json", "mfa-csv", "kokoro durations"):
        assert max(phone.stress for phone in parse_timings(SAMPLES[name].encode()).phones) == 1
    assert [phone.stress for phone in parse_timings(SAMPLES["piper"].encode()).phones] == [0, 0, 1, 0, 0]
    assert parse_timings(SAMPLES["kokoro"].encode()).phones[1].stress == 2


TELLING = [  # sample, what is replaced, by what, error, message
    ("textgrid chronological", '2 0 0.4\n"M"', '9 0 0.4\n"M"', DataError, "tier number: must be 1 to 3, got 9"),
    ("textgrid chronological", '"TextTier"', '"Pitch"', DataError, "tier class: got 'Pitch'"),
    ("mfa-json", '"entries": [[0, 0.4, "M"]', '"entries": [[0, 0.4]', DataError, r"expected begin, end, label.*phones"),
    ("mfa-json", '"phones"', '"tones"', DataError, "0 tiers"),
    ("mfa-json", "0.4", "NaN", DataError, r"got nan, expected a number \(at tiers.phones.entries\[0\]\[1\]"),
    ("mfa-json", "0.4", "1" + 400 * "0", DataError, "expected a number"),
    ("mfa-json", "0.4", 5000 * "1", DataError, "too long"),
    ("mfa-json", '"start": 0', '"start"', DataError, "line 1, column"),
    ("mfa-csv", "0,0.4,M,phones,A", "0,x,M,phones,A", DataError, "got 'x', expected a number.*line 3"),
    ("mfa-csv", "0,0.4,M,phones,A", "0,0.4,M,phones,B", DataError, r"speakers \['A', 'B'\].*tier=NAME"),
    ("mfa-csv", "phones,A", "words,A", DataError, "no timed label"),
    ("espeak-json", '"samplerate": 1000', '"samplerate": 0', DataError, "samplerate: must be above 0, got 0"),
    ("espeak-json", '"phoneme": "m"', '"name": "m"', DataError, r"expected an object with 'phoneme' \(at events\[1\]"),
    ("polly", '"type": "sentence"', '"type": "tune"', DataError, r"'tune', expected viseme.*line 1\)"),
    ("polly", '"value": "sil"}', "", DataError, "line 5"),
    ("azure", '"audio_offset": 4000000', '"audio_offset": "x"', DataError, r"got 'x', expected a number \(at \[1\]"),
    ("azure", '"audio_offset": 4000000', '"time": 4', DataError, r"'audio_offset' is missing \(at \[1\]\)"),
    ("azure", "4000000", "40000000", DataError, "expected 0 <= start <= end"),
    ("elevenlabs", "[0.0, 0.2,", "[0.2,", DataError, r"lengths \[4, 5, 5\]"),
    ("elevenlabs stream",
     '"charDurationsMs": [200, 200]', '"charDurationsMs": [200]', DataError, r"lengths \[2, 1, 2\]"),
    ("elevenlabs stream", '["m", "y"]', '["m", 5]', DataError, "got 5, expected a text"),
    ("cartesia words", '["my", "oh"]', '["my"]', DataError, r"lengths \[2, 2, 1\]"),
    ("voicevox", '"speedScale": 2', '"speedScale": 0', DataError, "speedScale: must be .*, got 0"),
    ("voicevox", '"vowel_length": 0.6', '"vowel_length": -0.6', DataError, r"0 or more, got -0\.3 s.*moras\[0\]"),
    ("kokoro durations", "[4, ", "[", DataError, "got 6 counts, expected 7"),
    ("headtts", "[-10, 390, 690]", "[-10, 390]", DataError, r"lengths \[2, 3, 3\]"),
    ("piper", '"seconds": 0.2', '"seconds": -1', DataError, r"must be 0 or more, got -1 s.*alignments\[1\]"),
    ("piper samples", '"sample_rate": 1000, ', "", DataError, "seconds and sample_rate are missing"),
    ("rhubarb-xml", 'end="0.40"', 'end="soon"', DataError, "end: got 'soon'.*mouthCue 1"),
    ("rhubarb-xml", "</rhubarbResult>", "", DataError, "no XML"),
    ("rhubarb-xml", "<rhubarbResult>", "<!DOCTYPE x><rhubarbResult>", UnsupportedError, "document type"),
    ("phone-list", '"end": 0.4', '"end": 1e6', DataError, "at most a day"),
    ("phone-list", '"end": 0.4', '"end": 0.6', DataError, r"'AY' starts at 0\.4 s, expected 0\.6 s or later"),
    ("align", "10000 20000 bin", "10000 200_ bin", DataError, "line 2"),
    ("htk", "4000000 10000000 ay", "4000000", DataError, "expected 3 fields.*line 2"),
    ("mlf", '"./plp/talk.rec"', "", DataError, "no recording.*goes above its labels"),
    ("mlf", "4000000 10000000 AY1", "4000000 AY1", DataError, "time: got 'AY1', expected a number.*line 5"),
    ("mlf", "\n.\n", '\n.\n"b.rec"\n0 1 a\n.\n', DataError, r"recordings \['b', 'talk'\].*tier=NAME"),
    ("allosaurus", "0.400 0.045", "0.400s 0.045", DataError, "got '0.400s', expected a number.*line 2"),
    ("hume", '"timestamp": {', '"audio": {', DataError, "no timestamp; ask for include_timestamp_types"),
    ("hume", '"begin": 400', '"begin": null', DataError, r"got None, expected a number \(at line 3\.timestamp"),
    ("resemble", "[[0, 0.45], [0.4, 0.8]", "[[0.4, 0.8]", DataError, r"phon_times: got 3 pairs of times, expected 4"),
    ("resemble words", "[0.4, 0.5]", "[0.4]", DataError, "graph_times: got 4 pairs of times, expected 5.*item"),
    ("htk", "4000000 10000000 ay", "#", DataError, "expected 3 fields.*line 2"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "error", "message"), TELLING)
def test_refusals_say_what_and_where(name: str, old: str, new: str, error: type[DataError], message: str) -> None:
    assert old in SAMPLES[name]
    with pytest.raises(error, match=message):
        parse_timings(SAMPLES[name].replace(old, new).encode(), file_format=name.split()[0])


@pytest.mark.parametrize(
    ("file_format", "data", "error", "message"),
    [
        ("mfa-json", '{"tiers": 5}', DataError, "got 5, expected an object of tiers"),
        ("mfa-json", '{"tiers": ', TruncatedError, "invalid JSON"),
        ("mfa-json", "[" * 100_000, DataError, "nested too deeply"),
        ("mfa-csv", "a,b\n1,2\n", DataError, "expected the header Begin"),
        ("mfa-csv", "a\n" + "b" * 200_000, DataError, "MFA CSV"),
        ("xlabel", "0.1 100 m", DataError, "the line with # alone"),
        ("rhubarb-tsv", "0.00\tA", DataError, "fewer than two lines"),
        ("flite", "m:x", DataError, "piece 1"),
        ("voicevox", '{"accent_phrases": 1}', DataError, "got 1, expected a list"),
        ("azure", json.dumps({"FrameIndex": 0, "BlendShapes": [[0.0] * 55]}), UnsupportedError, "blend-shape frames"),
        ("cartesia", "[]", DataError, "no message with phoneme_timestamps"),
        ("cartesia", lines({"a": 1}, {"b": 2}), DataError, "no message with"),
        ("polly", '{"a": 1}\n{"b"}', DataError, "line 2"),
        ("htk", "0 1 a", UsageError, "tier: got"),
        (None, "once upon a time", DataError, "expected a known format; choose one with format=NAME"),
        (None, " \n", DataError, "timings: the file is empty"),
        ("docx", "", UsageError, "use one of textgrid"),
    ],
)  # fmt: skip
def test_refusals_of_the_whole(file_format: str | None, data: str, error: type[Exception], message: str) -> None:
    wishes = ParseOptions(tier="phones") if message == "tier: got" else None
    with pytest.raises(error, match=message):
        parse_timings(data.encode(), file_format=file_format, options=wishes)


def test_a_speaker_is_chosen() -> None:
    two = SAMPLES["mfa-csv"] + "0,0.5,OW1,phones,B\n"
    assert told(parse_timings(two.encode(), options=ParseOptions(tier="B"))) == [("oʊ", 0.0, 0.5)]


def test_a_recording_or_a_generation_is_chosen() -> None:
    two = SAMPLES["mlf"] + '"C:\\\\talk\\\\b.lab"\n0 5000000 OW1\n.\n'
    assert told(parse_timings(two.encode(), options=ParseOptions(tier="b"))) == [("oʊ", 0.0, 0.5)]
    two = SAMPLES["hume"] + "\n" + SAMPLES["hume"].replace('"g"', '"h"').replace("1000", "900")
    assert parse_timings(two.encode(), options=ParseOptions(tier="h")).duration_s == 0.9
    with pytest.raises(DataError, match=r"generations \['g', 'h'\]"):
        parse_timings(two.encode())


def test_far_too_long_a_document() -> None:
    with pytest.raises(DataError, match="at most"):
        parse_document(b" " * (MAX_BYTES + 1), "file")


def test_the_alphabet_can_be_said() -> None:
    track = parse_timings(b"0 4000000 zh\n4000000 9000000 ong1\n", options=ParseOptions(alphabet="pinyin"))
    assert [phone.label for phone in track.phones] == ["ʈʂ", "ʊŋ"]
    with pytest.raises(UsageError, match="alphabet: unknown value 'runes'"):
        parse_timings(b"0 4000000 zh\n", options=ParseOptions(alphabet="runes"))


def test_a_word_of_hvite_may_have_a_score_of_its_own() -> None:
    rows = "0 2000000 M -52.3 MY -90.1\n2000000 4000000 AY1 9.0\n4000000 9000000 OW1 7.5 OH 8.1\n"
    assert [phone.word for phone in parse_timings(rows.encode()).phones] == ["MY", "MY", "OH"]


def test_a_table_of_numbers_is_not_allosaurus() -> None:
    assert guess_format(b"0.1 0.045 0.00\n0.2 0.045 1.00\n") is FORMATS["htk"]


def test_the_name_decides_where_the_content_does_not(tmp_path: Path) -> None:
    assert guess_format(b"odd", ending=".LAB") is FORMATS["htk"]
    odd = tmp_path / "odd.lab"
    odd.write_bytes(b"odd")
    with pytest.raises(DataError, match=r"odd\.lab.*line 1"):
        load_timings(odd)


@pytest.mark.parametrize("name", PHONE_SETS)
def test_every_label_of_every_phone_set_is_known_ipa(name: str) -> None:
    phones = PHONE_SETS[name]
    assert len(phones.table) >= 9
    assert phones.source
    assert phones.version
    assert [label for label, sound in phones.table.items() if sound not in ("", "ː") and not ipa.letters(sound)] == []
    for label, sound in phones.table.items():
        assert alphabets.to_ipa(label, name)[0] == (ipa.normalise(sound) if name == "mfa" and sound else sound)


@pytest.mark.parametrize(
    ("alphabet", "label", "expected"),
    [
        ("pinyin", "shi4", ("ʂɨ", 0)), ("pinyin", "xue2", ("ɕɥɛ", 0)), ("pinyin", "nü3", ("ny", 0)),
        ("pinyin", "zhuang", ("ʈʂwaŋ", 0)), ("kana", "しゃ", ("ɕa", 0)), ("kana", "ヴァ", ("ba", 0)),
        ("kana", "ラーメン", ("ɾaːmeɴ", 0)), ("espeak", "'oU", ("oʊ", 1)), ("espeak", ",aI", ("aɪ", 2)),
        ("espeak", "t;", ("t", 0)), ("misaki", "ˈʤʌʤ", ("dʒʌdʒ", 1)), ("mfa", "d͡ʒʲ", ("dʒʲ", 0)),
        ("mfa", "ə˞", ("ɚ", 0)),
        ("oculus-visemes", "FF", ("f", 0)), ("polly-visemes", "Q", ("Q", 0)), ("espeak", "§", ("§", 0)),
        ("misaki", "m§", ("m§", 0)),
    ],
)  # fmt: skip
def test_labels_of_phone_sets(alphabet: str, label: str, expected: tuple[str, int]) -> None:
    assert alphabets.to_ipa(label, alphabet) == expected


def test_words_are_not_taken_for_the_phones_of_a_recording(tmp_path: Path) -> None:
    (tmp_path / "take.align").write_text(SAMPLES["align"])
    warnings: list[str] = []
    assert _phones(tmp_path / "take.c3d", 1.0, None, warnings) == ()
    assert warnings == ["take take: take.align times words, not phones: left out"]
    said = _phones(tmp_path / "take.c3d", 9.0, lambda track: PhoneTrack.from_phones([Phone("m", 0.0, 0.2)]), warnings)
    assert [interval.label for interval in said] == ["m"]
    assert warnings.pop().endswith("pronounced, so phones within a word are not where they were said")
    (tmp_path / "take.lab").write_text(SAMPLES["htk"])
    assert [interval.label for interval in _phones(tmp_path / "take.c3d", 1.0, None, warnings)] == ["m", "aɪ"]


@pytest.mark.shared
def test_real_files_of_many_tools(shared: Path) -> None:
    expected = {
        "aflorithmic_24_phoneme_durations.json": ("phone", 29), "espeak-ng_events.json": ("phone", 29),
        "espeak-ng_events_ipa.json": ("phone", 29), "festival_segs.lab": ("phone", 29),
        "festival_words.lab": ("word", 8), "flite_psdur.txt": ("phone", 29), "grid_bbaf2n.align": ("word", 8),
        "htk_mono_merlin.lab": ("phone", 20), "pocketsphinx_align.json": ("phone", 16),
        "polly_speechmarks_marylamb.jsonl": ("viseme", 16), "praat_chronological.TextGrid": ("phone", 16),
        "rhubarb_readme_hi.json": ("viseme", 5), "rhubarb_readme_hi.tsv": ("viseme", 5),
        "rhubarb_readme_hi.xml": ("viseme", 5), "rhubarb_wasm_bbaf2n.json": ("viseme", 19),
    }  # fmt: skip
    folder = shared / "data" / "timings"
    tracks = {name: load_timings(folder / name) for name in expected}
    assert {name: (track.level, len(track.phones)) for name, track in tracks.items()} == expected
    phones = [phone for track in tracks.values() if not track.spelled for phone in track.phones]
    strange = {phone.label for phone in phones if phone.label != SILENCE and not ipa.letters(phone.label)}
    assert strange == set()
    mnemonics, in_ipa = (tracks[f"espeak-ng_events{kind}.json"] for kind in ("", "_ipa"))
    assert [p.start_s for p in mnemonics.phones] == [p.start_s for p in in_ipa.phones]
    assert sum(a.label != b.label for a, b in zip(mnemonics.phones, in_ipa.phones, strict=True)) <= 1
    chronological, long = (load_timings(folder / f"praat_{form}.TextGrid") for form in ("chronological", "long"))
    assert told(chronological) == told(long)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_wrong_word_of_any_length_is_quoted_by_40_letters_at_most(name: str) -> None:
    """Wherever it stands; so an error fits a line, whatever a file contains."""
    text = SAMPLES[name]
    for word in re.finditer(r"[^\s,:\"'<>{}\[\]()=/;|]+", text):
        wrong = text[: word.start()] + "w" * 90 + text[word.end() :]
        told = ""
        try:
            parse_timings(wrong.encode(), file_format=name.split()[0], options=NEEDS.get(name))
        except DataError as error:
            told = str(error)
        assert "w" * 41 not in told


@pytest.mark.parametrize("name", [name for name, text in SAMPLES.items() if text.startswith(("{", "[{"))])
def test_json_may_be_laid_out_in_any_way_and_be_an_event(name: str) -> None:
    options, texts = NEEDS.get(name), [SAMPLES[name]]
    expected = parse_timings(SAMPLES[name].encode(), options=options)
    try:
        value = json.loads(SAMPLES[name])
    except json.JSONDecodeError:  # one value a line
        texts += ["\n\n".join(SAMPLES[name].splitlines())]
    else:
        texts += [json.dumps(value, indent=2), json.dumps(value, separators=(",", ":")), json.dumps(value) + "\n\n"]
    is_file = name in ("papagayo json", "table json")  # no service sends them
    for start in () if is_file else ("data:", "data: ", "event: message\ndata: "):
        texts += ["\n\n".join(start + line for line in SAMPLES[name].splitlines())]
    for text in texts:
        assert parse_timings(text.encode(), file_format=name.split()[0], options=options) == expected


def test_what_is_no_number_or_text_is_no_cell_of_a_table() -> None:
    rows = [{"start": 0.0, "end": 0.5, "phone": "m"}, {"start": 0.5, "end": 1.0, "phone": "aɪ"}]
    expected = parse_timings(json.dumps(rows).encode(), file_format="table")
    for other in (True, None, [1], {"a": 1}):
        beside = [row | {"stress": other, "confidence": other} for row in rows]
        assert parse_timings(json.dumps(beside).encode(), file_format="table") == expected


def test_words_of_a_chunk_are_later_by_its_offset_and_by_their_place_in_it() -> None:
    events = [json.loads(line.removeprefix("data: ")) for line in SAMPLES["fish"].split("\n\n")]
    later = json.loads(json.dumps(events))
    for event in later:
        event["chunk_audio_offset_sec"] += 1.5
        for row in (event["alignment"] or {"segments": ()})["segments"]:
            row["start"], row["end"] = row["start"] + 0.2, row["end"] + 0.2
    before, after = (parse_timings(lines(*each).encode(), file_format="fish") for each in (events, later))
    heard = [[phone for phone in track.phones if phone.label != SILENCE] for track in (before, after)]
    assert [(one.label, one.start_s + 1.7, one.end_s + 1.7) for one in heard[0]] == [
        (one.label, pytest.approx(one.start_s), pytest.approx(one.end_s)) for one in heard[1]
    ]


def test_lists_of_other_things_beside_the_rows_do_not_hide_a_table() -> None:
    rows = [{"start": 0.0, "end": 0.5, "phone": "m"}, {"start": 0.5, "end": 1.0, "phone": "aɪ"}]
    found = guess_format(json.dumps({"sizes": [1, 2], "rows": rows}).encode())
    assert found is not None
    assert found.name == "table"
