"""Labels of every alphabet, the guess of an alphabet, and what it leaves in doubt."""

import pytest

from fapengine.speech import ipa
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.convert import ARPABET
from fapengine.speech.alphabets.guess import explains, guess, is_one_phone
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.phone_track import SILENCE, PhoneTrack, Reading, find_unknown


def read(labels: str, alphabet: str | None = None) -> PhoneTrack:
    return track_of(
        [Entry(i, i + 1, label, f"label {i}") for i, label in enumerate(labels.split())], "test", alphabet=alphabet
    )


def shown(track: PhoneTrack) -> list[str]:
    return [phone.label for phone in track.phones]


def lips_close(label: str) -> bool:
    return any(ipa.SOUNDS[letter].lips == 1.0 for letter in ipa.letters(label))


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("p_h", "pʰ"), ("t_d", "t̪"), ("s_m", "s̻"), ("k_}", "k̚"), ("a_o", "a̞"), ("l_e", "l̴"), ("g_R", "ɡ"),
        ("p_w", "pʷ"), ("a_T", "a"), ("a_X", "ă"), ("ts_h", "tsʰ"), ("m_0", "m̥"), ("p_>", "pʼ"), ("b_<", "ɓ"),
        ("d_<", "ɗ"), ("g_<", "ɠ"), ("J\\_<", "ʄ"), ("G\\_<", "ʛ"), ("i_^", "i̯"), ("<\\", "ʢ"), (">\\", "ʡ"),
        ("|\\", "ǀ"), ("!\\", "ǃ"), ("=\\", "ǂ"), ("|\\|\\", "ǁ"), ("a:\\", "aˑ"), ("o_O", "o̹"), ("o_c", "o̜"),
        ("e_~", "ẽ"), ("9~", "œ̃"), ("E/", "ɛ"), ("U~/", "œ̃"), ("n=", "n̩"), ("_h", None), ("ʃ", None), ("", None),
    ],
)  # fmt: skip
def test_xsampa(label: str, expected: str | None) -> None:
    assert alphabets.from_xsampa(label) == expected


def test_no_mark_of_xsampa_moves_the_lips() -> None:
    for mark in ("_m", "_w", "_o", "_R", "_X", "_B", "_h", "_N"):
        assert not lips_close(alphabets.from_xsampa("s" + mark) or "")


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("AH0", "ə"), ("AH1", "ʌ"), ("AH", "ʌ"), ("ER0", "ɚ"), ("ER1", "ɝ"), ("IH0", "ɪ̈"), ("ah0_E", "ə"),
        ("HH_B", "h"), ("ax-h", "ə̥"), ("pcl", "p"), ("bcl", "b"), ("eng", "ŋ"), ("hv", "ɦ"), ("aen", "æ̃"), ("tq", "ʔ"),
        ("OW1_S", "oʊ"),
    ],
)  # fmt: skip
def test_arpabet_of_timit_kaldi_and_buckeye(label: str, expected: str) -> None:
    assert alphabets.to_ipa(label, "arpabet")[0] == expected


def test_stress_is_before_the_position() -> None:
    assert alphabets.to_ipa("OW1_E", "arpabet") == ("oʊ", 1)
    assert len(ARPABET) >= 80


def test_a_closure_and_its_burst_are_one_stop_that_closes_the_lips() -> None:
    track = read("h# sh iy pcl p tcl ch bcl axr h#")
    assert track.reading is not None
    assert track.reading.alphabet == "arpabet"
    assert shown(track) == [SILENCE, "ʃ", "i", "p", "tʃ", "b", "ɚ", SILENCE]
    assert (track.phones[3].start_s, track.phones[3].end_s) == (3.0, 5.0)
    assert lips_close(track.phones[5].label)


@pytest.mark.parametrize(
    ("labels", "alphabet"),
    [
        ("SH IY HH AE DCL D Y AXR DCL D AA R KCL K", "arpabet"), ("sh iy hv ae dcl d y axr eng pcl", "arpabet"),
        ("HH_B AH0_I L_I OW1_E SIL", "arpabet"), ("hh_B ah_I l_I ow_E", "arpabet"), ("pau dh ax", "arpabet"),
        ("sil k o N n i ch i w a sh i r y u", "openjtalk"), ("silB k a cl t e q silE", "openjtalk"),
        ("h @ l ou w @@ l d", "mrpa"), ("p ii t @ e@", "mrpa"), ("D @ tS I n", "x-sampa"), ("a~ v E~ R", "x-sampa"),
        ("b ɹ aɪ t", "ipa"), ("zh ong1 g uo2", "pinyin"), ("zhōng guó rén", "pinyin"), ("ㄓㄨㄥ ㄍㄨㄛ", "pinyin"),
        ("こ ん に ち は", "kana"), ("ｶ ﾀ ｶ ﾅ", "kana"), ("m a p a", "ipa"), ("b y d", "ipa"),
    ],
)  # fmt: skip
def test_whole_labels_decide_the_alphabet(labels: str, alphabet: str) -> None:
    found = guess(labels.split())
    assert found.alphabet == alphabet
    assert not found.words
    assert found.explained >= 0.8


def test_two_readings_are_told() -> None:
    assert guess(["m", "ao", "t"]).others == ("ipa", "pinyin")
    assert guess(["m", "a", "t"]).others == ()  # single letters are no evidence for another alphabet
    assert guess(["B", "P", "T"]).others == ("x-sampa",)
    assert guess(["SH", "IY", "T"]).others == ()


@pytest.mark.parametrize(
    "words", ["The birch canoe slid", "montreal aligner", "blah bluh", "good day", "mama papa", "china panda"]
)
def test_words_are_no_phones(words: str) -> None:
    assert guess(words.split()).words


def test_doubtful_labels_are_said_with_what_stands_in() -> None:
    track = read("b ɹ aɪ t pho pho ŋ æ ɛ")
    assert track.reading is not None
    assert track.reading.guessed
    assert str(track.reading) == "labels read as ipa (guessed)"
    (unknown,) = find_unknown(track)
    assert (unknown.label, unknown.count, unknown.first_s, unknown.stand_in) == ("pho", 2, 4.0, "p h o")
    assert find_unknown(read("b ɹ aɪ t pho", "ipa")) == ()
    assert [each.label for each in find_unknown(read("b r pho", "mrpa"))] == ["pho"]


@pytest.mark.parametrize(
    ("label", "silent"),
    [
        ("silB", True), ("silE", True), ("SIL_S", True), ("<usb>", True), ("<nib>", True), ("{B_TRANS}", True),
        ("[SIL]", True), ("IVER", True), ("SPN_S", True), ("s", False), ("silk", False),
    ],
)  # fmt: skip
def test_silences(label: str, silent: bool) -> None:
    assert alphabets.is_silence(label) == silent


def test_capitals_without_small_consonants_are_no_xsampa() -> None:
    labels = [
        "AE",
        "AX",
        "A~",
        "D",
        "E",
        "EU",
        "E~",
        "F",
        "H",
        "J",
        "K",
        "L",
        "M",
        "N",
        "NJ",
        "O",
        "P",
        "R",
        "S",
        "T",
        "V",
        "Z",
        "ZH",
        "a",
        "e",
        "i",
        "o",
        "o~",
        "u",
        "y",
    ]  # GlobalPhone, French
    assert guess(labels).alphabet == "arpabet"
    track = read(" ".join(labels))
    assert track.phones[labels.index("P")].label == "p"
    assert {unknown.label for unknown in find_unknown(track)} >= {"A~", "EU", "NJ"}


def test_words_that_mean_noises_are_words() -> None:
    entries = [Entry(i, i + 1, word, "") for i, word in enumerate(["silence", "noise", "<eps>", "laugh"])]
    assert shown(track_of(entries, "test", level="word", spelled=True)) == ["silence", "noise", SILENCE, "laugh"]


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("mā", "ma"), ("ma1n", "man"), ("hǎo", "xaʊ"), ("lǜ", "ly"), ("lu:4", "ly"), ("Zhong1", "ʈʂʊŋ"), ("ma0", "ma"),
        ("huar1", "xwaɻ"), ("wanr2", "waɻ"), ("dianr3", "tjɛɻ"), ("hua1r", "xwaɻ"), ("zhong1guo2", "ʈʂʊŋkwo"),
        ("xi'an", "ɕian"), ("nanguo", "nankwo"), ("fangan", "fankan"), ("ii4", "ɨ"), ("iii1", "ɨ"), ("ix4", "ɨ"),
        ("ㄓㄨㄥ", "ʈʂʊŋ"), ("ㄕˋ", "ʂɨ"), ("ㄩㄢˊ", "ɥɛn"), ("˙ㄇㄚ", "ma"), ("yo", "jo"), ("r5", "ʐ"), ("er2", "aɹ"),
        ("hm", "hm"), ("xyz", None), ("ㄅㄅㄅx", None), ("", None), ("zhong1x", None),
    ],
)  # fmt: skip
def test_pinyin_in_every_spelling(label: str, expected: str | None) -> None:
    assert alphabets.PHONE_SETS["pinyin"].to_ipa(label) == expected


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("クァ", "kwa"), ("グァ", "ɡwa"), ("ツィ", "tsi"), ("ツェ", "tse"), ("ウァ", "wa"), ("スィ", "si"),
        ("イェ", "je"), ("キェ", "kʲe"), ("ヴィ", "bi"),
        ("ヴォ", "bo"), ("テュ", "tʲɯ"), ("フュ", "ɸʲɯ"), ("クヮ", "kwa"),
        ("ヰ", "i"), ("ヶ", "ke"), ("ゐ", "i"), ("ｶﾞ", "ɡa"), ("「", ""), ("あ〜", "aː"), ("こゝろ", "kokoɾo"),
        ("しんぶん", "ɕimbɯɴ"), ("きっぷ", "kippɯ"), ("漢", None),
    ],
)  # fmt: skip
def test_kana(label: str, expected: str | None) -> None:
    assert alphabets.PHONE_SETS["kana"].to_ipa(label) == expected


@pytest.mark.parametrize("labels", ["シ ン ブ ン", "sh i N b u N", "ɕ i ɴ b ɯ ɴ"])
def test_the_moraic_nasal_closes_the_lips_before_them(labels: str) -> None:
    nasals = [label for label in shown(read(labels, "misaki" if "ɕ" in labels else None)) if label in ("m", "ɴ")]
    assert nasals == ["m", "ɴ"]


def test_a_doubled_p_closes_the_lips_and_a_long_mark_lengthens() -> None:
    assert shown(read("キ ッ プ")) == ["ki", "p", "pɯ"]
    assert shown(read("k i cl p u a", "voicevox")) == ["k", "i", "p", "p", "ɯ", "a"]
    assert shown(read("ラ ー メ ン")) == ["ɾaː", "me", "ɴ"]
    assert read("ラ ー メ ン").phones[0].end_s == 2.0


@pytest.mark.parametrize(
    ("label", "expected"),
    [("ᶄ", "kʲ"), ("ᶀ", "bʲ"), ("ᶆ", "mʲ"), ("ᶈ", "pʲ"), ("↓", ""), ("ꜜ", ""), ("→", ""), ("ꭧ", "ʈʂ"), ("十", "ɨ"),
     ("中", "ʊŋ"), ("ㄅ", "p"), ("ㄓ", "ʈʂ"), ("万", "wan")],
)  # fmt: skip
def test_misaki_speaks_japanese_and_mandarin(label: str, expected: str) -> None:
    assert PHONE_SETS["misaki"].to_ipa(label) == expected


def test_festivals_and_julius_sets() -> None:
    assert [PHONE_SETS["mrpa"].to_ipa(label) for label in ("@@", "e@", "i@", "uu", "#")] == ["ɜː", "ɛə", "ɪə", "uː", ""]
    openjtalk = PHONE_SETS["openjtalk"]
    assert [openjtalk.to_ipa(label) for label in ("silB", "a:", "q", "ch", "N")] == ["", "aː", "ʔ", "tɕ", "ɴ"]


def test_what_is_one_phone() -> None:
    one = ("tʃ", "ts", "kp", "aɪ", "aɪə", "ju", "oʊ̃", "mb", "pf", "ən", "t͡ɬ", "juə", "ɑːɹ", "aɪɹ")
    several = ("sh", "ch", "th", "ng", "blah", "uttɨ", "%", "", "ɥɥ", "jam", "wel", "jaɪəʊ", "aɪəʊ", "mɑːɹ", "aɪəɹ")
    assert [label for label in (*one, *several) if is_one_phone(label)] == [*one]
    assert not explains("ipa", "%")


def test_an_alphabet_without_any_label() -> None:
    assert guess(["sil", "", "_"]).alphabet == "ipa"


def test_a_reading_that_was_named_is_no_guess() -> None:
    assert str(Reading("ipa")) == "labels read as ipa"
    assert str(Reading("ipa", guessed=True)) == "labels read as ipa (guessed)"


def test_hiragana_stands_in_the_table_with_the_sounds_of_katakana() -> None:
    table = PHONE_SETS["kana"].table
    katakana = {kana: sound for kana, sound in table.items() if "ァ" <= kana[0] <= "ヶ"}
    assert len(katakana) > 150
    for kana, sound in katakana.items():
        assert table["".join(chr(ord(c) - 0x60) if "ァ" <= c <= "ヶ" else c for c in kana)] == sound


@pytest.mark.parametrize(
    ("label", "is_one"),
    [("ja", True), ("jaɪ", True), ("jaʊə", False), ("jat", False), ("wət", False), ("aɪəʊ", False), ("kp", True)],
)
def test_a_glide_is_one_phone_with_its_vowels_alone(label: str, is_one: bool) -> None:
    assert is_one_phone(label) is is_one
