"""Our tables of X-SAMPA, pinyin and kana against other people's: every difference is explained in a line here."""

import csv
import importlib.util
import re
import unicodedata
from pathlib import Path

import pytest

from fapengine.speech import ipa
from fapengine.speech.alphabets.convert import MARKS, UNSEEN, XSAMPA_LETTERS, from_xsampa
from fapengine.speech.alphabets.japanese import from_kana
from fapengine.speech.alphabets.mandarin import from_pinyin, plain_pinyin
from fapengine.speech.alphabets.phone_sets import PHONE_SETS

XSAMPA_DIFFERENCES = {
    "k_<": "ƙ has left the IPA; the mark falls away, k is seen",
    "ts`": "ʈʂ by assimilation, which X-SAMPA leaves to the reader; t and s` are read as written",
    "tz`": "panphon means ɖʐ; t and z` are read as written",
    "'=\\": "a slip of panphon's for =\\ (ǂ): the apostrophe is a mark, and has no letter before it",
    "_B": "a tone has no letter", "_L": "a tone has no letter", "_M": "a tone has no letter",
    "_H": "a tone has no letter", "_T": "a tone has no letter",
    '"': "stress is no letter", "%": "stress is no letter", ".": "a break is no letter",
}  # fmt: skip


def panphons_rows() -> list[tuple[str, str]]:
    spec = importlib.util.find_spec("panphon")
    assert spec is not None
    assert spec.submodule_search_locations
    path = Path(spec.submodule_search_locations[0]) / "data" / "ipa-xsampa.csv"
    with path.open(encoding="utf-8", newline="") as file:
        return [(row["X-SAMPA"].strip(), row["IPA"].strip()) for row in csv.DictReader(file)]


@pytest.mark.conformance
def test_xsampa_is_panphons() -> None:
    rows = panphons_rows()
    assert len(rows) >= 150
    marks = {mark: sign for mark, sign in MARKS.items() if sign}
    different = {}
    for spelling, sign in rows:
        if spelling in marks:
            same = marks[spelling] == sign
            assert from_xsampa("a" + spelling) == unicodedata.normalize("NFC", "a" + marks[spelling])
        else:
            same = ipa.normalise(from_xsampa(spelling) or "") == ipa.normalise(sign)
        if not same:
            different[spelling] = (from_xsampa(spelling), sign)
    assert set(different) == set(XSAMPA_DIFFERENCES), different


def test_every_xsampa_letter_takes_every_mark_and_keeps_its_letter() -> None:
    for spelling, sound in XSAMPA_LETTERS.items():
        for mark in (*MARKS, *UNSEEN):
            if spelling + mark in XSAMPA_LETTERS or any(
                (spelling + mark).startswith(longer)
                for longer in XSAMPA_LETTERS
                if len(longer) > len(spelling) and longer.startswith(spelling)
            ):
                continue  # together they are another letter: b_<, @`  # fmt: skip
            read = from_xsampa(spelling + mark)
            assert read is not None
            assert ipa.letters(read) == ipa.letters(sound), (spelling, mark, read)


def pypinyins_syllables() -> list[str]:
    from pypinyin.constants import PINYIN_DICT

    found = {reading for readings in PINYIN_DICT.values() for reading in readings.split(",")}
    return sorted(found)


PINYIN_DIFFERENCES = {
    "m": "pypinyin writes the interjection ㄇㄨ, another syllable", "n": "pypinyin writes ㄣ, which has a vowel",
    "hm": "h alone is x in Zhuyin, which looks the same", "hng": "h alone is x in Zhuyin, which looks the same",
}  # fmt: skip
PINYIN_STYLES = ("NORMAL", "TONE", "TONE2", "TONE3", "BOPOMOFO")
FINALS_STYLES = ("FINALS", "FINALS_TONE", "FINALS_TONE2", "FINALS_TONE3", "INITIALS")


@pytest.mark.conformance
@pytest.mark.parametrize("style", PINYIN_STYLES)
def test_pinyin_of_every_style_is_read_alike(style: str) -> None:
    from pypinyin import Style
    from pypinyin.style import convert

    syllables = pypinyins_syllables()
    assert len(syllables) >= 1500
    unread, other = [], []
    for syllable in syllables:
        spelled = convert(syllable, getattr(Style, style), strict=False)
        read, wanted = from_pinyin(spelled), from_pinyin(convert(syllable, Style.NORMAL, strict=False))
        if read is None or not ipa.letters(read):
            unread.append((syllable, spelled))
        elif read != wanted and not (style == "BOPOMOFO" and plain_pinyin(syllable) in PINYIN_DIFFERENCES):
            other.append((syllable, spelled, read, wanted))
    assert unread == []
    assert other == []


@pytest.mark.conformance
@pytest.mark.parametrize("style", FINALS_STYLES)
def test_initials_and_finals_of_every_style(style: str) -> None:
    from pypinyin import Style
    from pypinyin.style import convert

    for syllable in pypinyins_syllables():
        for strict in (True, False):
            if spelled := convert(syllable, getattr(Style, style), strict=strict):
                assert from_pinyin(spelled), (syllable, spelled)


ROWS = (
    "アイウエオカキクケコサシスセソタチツテトナニヌネノハヒフヘホマミムメモヤユヨラリルレロワヲン"
    "ガギグゲゴザジズゼゾダヂヅデドバビブベボパピプペポッヴ"
)
LOANS = re.findall(
    ".[ァィゥェォュ]",
    "シェチェツァツェツォティファフィフェフォジェディデュイェウィウェウォクァクィクェクォツィトゥグァドゥ"
    "ヴァヴィヴェヴォテュフュヴュカァキィクゥケェコォ",
)
"""The combinations of the Japanese cabinet's two tables for foreign words (1991), and lengthened morae."""
KANA_DIFFERENCES = {
    "ヅ": "dz and z are both heard, and look alike",
    "ヒ": "palatal before i; lips are free in both",
    "フュ": "the other table says hyu; lips near each other are seen",
    "イェ": "the other table makes two morae of it",
    **dict.fromkeys(
        ("クァ", "クィ", "クェ", "クォ", "グァ"), "the other table makes two morae of it; one, rounded, is said"
    ),
}


def morae() -> list[str]:
    glides = [large + small for large in "キシチニヒミリギジヂビピ" for small in "ャュョ"]
    return [*ROWS, *glides, *LOANS]


def test_kana_in_every_width_and_script_are_read_alike() -> None:
    half = {  # NFKC of the half width is the full one
        unicodedata.normalize("NFKC", chr(code)): chr(code) for code in range(0xFF66, 0xFF9E)
    }
    half |= {"\u3099": "ﾞ", "\u309a": "ﾟ"}
    for kana in morae():
        hiragana = "".join(chr(ord(letter) - 0x60) for letter in kana)
        narrow = "".join(half[letter] for letter in unicodedata.normalize("NFD", kana))
        for spelled in (hiragana, unicodedata.normalize("NFD", kana), narrow):
            assert from_kana(spelled) == from_kana(kana), (kana, spelled)


@pytest.mark.conformance
def test_kana_are_those_of_julius_as_jaconv_writes_them() -> None:
    import jaconv

    compared, different = 0, {}
    for kana in morae():
        if "ヴ" in kana:
            continue  # it leaves this one as it is
        spelled = jaconv.hiragana2julius(jaconv.kata2hira(kana)).split()
        wanted = [PHONE_SETS["openjtalk"].to_ipa(label) for label in spelled]
        assert None not in wanted, (kana, spelled)
        compared += 1
        joined = "".join(sound or "" for sound in wanted)
        if (from_kana(kana) or "").replace("ʲ", "") != joined.replace("ʲ", ""):
            different[kana] = (from_kana(kana), joined, " ".join(spelled))
    assert compared >= 130
    assert set(different) == set(KANA_DIFFERENCES), different
