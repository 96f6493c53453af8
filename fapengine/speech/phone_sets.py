"""Phone sets as data: what the labels of speech tools mean in IPA.

Each table says where it comes from. A label that stands for silence maps to the empty string. Tables of *visemes* map
to one phone that shows the class well: they name what is seen, so any phone of the class would do.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PhoneSet:
    """One phone set."""

    name: str
    source: str
    """Source of the table."""
    version: str
    """Version or date of the source."""
    table: Mapping[str, str]
    """Label to IPA; silence is the empty string."""
    joins: bool = False
    """True where a label may be several spellings of the table in a row, the longest first."""
    ignored: str = ""
    """Characters that change nothing that is seen: tones, diacritics."""


# fmt: off
ESPEAK = PhoneSet(
    "espeak", "libespeak-ng phoneme events, mnemonics against IPA over 23 languages (where they differ, the commonest)",
    "espeak-ng 1.52", joins=True, ignored="'," + "=%|!#~-.^[]0123456789;",
    table={
        "&": "æ", "*": "ɾ", "0": "ɑː", "3": "ɚ", "3:": "ɜː", "3-": "ɐ", "8": "ɵ", "?": "ʔ", "@": "ə", "@2": "ə",
        "@-": "ə", "@L": "əl", "@3": "ə", "A": "ɑ", "A:": "ɑː", "A@": "ɑːɹ", "Au": "ɑu", "B": "β", "C": "ç", "D": "ð",
        "E": "ɛ", "E-": "ə", "E:": "ɛː", "EI": "ɛɪ", "H": "ħ", "I": "ɪ", "I2": "ɪ", "J": "ɟ", "L": "ɫ", "N": "ŋ",
        "O": "ɔ", "O2": "ɔ", "O:": "ɔː", "O@": "ɔːɹ", "OI": "ɔɪ", "OY": "ɔø", "O~": "ɔ̃", "Q": "ɣ", "R": "r", "R2": "r",
        "R^": "r", "S": "ʃ", "S;": "ɕ", "T": "θ", "U": "ʊ", "U@": "ʊɹ", "V": "ʌ", "W": "œ", "Wy": "œy", "X": "χ",
        "Y": "ø", "Y:": "øː", "Z": "ʒ", "Z;": "ʑ", "_": "", "_:": "", "_!": "", "_|": "", "a": "a", "a#": "ɐ",
        "a:": "aː", "aI": "aɪ", "aI@": "aɪɚ", "aI3": "aɪɚ", "aU": "aʊ", "b": "b", "c": "c", "d": "d", "dZ": "dʒ",
        "dz": "dz", "dz;": "dʑ", "e": "e", "e:": "eː", "eI": "eɪ", "e@": "ɛɹ", "f": "f", "g": "ɡ", "h": "h", "i": "i",
        "i:": "iː", "iE": "iɛ", "iU": "iʊ", "i@": "iə", "i@3": "ɪɹ", "j": "j", "ju": "ju", "k": "k", "l": "l",
        "l^": "ʎ",
        "m": "m", "n": "n", "n^": "ɲ", "o": "o", "o:": "oː", "o@": "ɔːɹ", "oU": "oʊ", "p": "p", "pF": "pf", "r": "ɹ",
        "s": "s", "s#": "ʃ", "s.": "ʂ", "t": "t", "t#": "ɾ", "t2": "t", "tS": "tʃ", "t_s\\": "tɕ", "ts": "ts",
        "ts;": "tɕ", "u": "u", "u-": "ʉ", "u:": "uː", "u~": "ũ", "uo": "uo", "v": "v", "v#": "ʋ", "w": "w", "w2": "w",
        "x": "x", "y": "y", "y:": "yː", "yY": "yø", "z": "z", "z.": "ʐ", "z;": "ʑ",
    },
)
MISAKI = PhoneSet(
    "misaki", "hexgrad/misaki, EN_PHONES.md: one letter for each English diphthong and affricate", "misaki 0.9",
    joins=True, ignored="ˈˌː ʲ",
    table={
        "A": "eɪ", "I": "aɪ", "W": "aʊ", "Y": "ɔɪ", "O": "oʊ", "Q": "əʊ", "ʤ": "dʒ", "ʧ": "tʃ", "ʦ": "ts", "ʣ": "dz",
        "T": "ɾ", "ᵊ": "ə", "ᵻ": "ɪ", "ɚ": "ɚ", "ɝ": "ɝ", "ɜ": "ɜ", "a": "a", "b": "b", "d": "d", "e": "e", "f": "f",
        "h": "h", "i": "i", "j": "j", "k": "k", "l": "l", "m": "m", "n": "n", "o": "o", "p": "p", "r": "r", "s": "s",
        "t": "t", "u": "u", "v": "v", "w": "w", "x": "x", "z": "z", "g": "ɡ", "ɡ": "ɡ", "ɑ": "ɑ", "ɐ": "ɐ", "æ": "æ",
        "ə": "ə", "ɛ": "ɛ", "ɪ": "ɪ", "ɔ": "ɔ", "ɒ": "ɒ", "ʊ": "ʊ", "ʌ": "ʌ", "ð": "ð", "θ": "θ", "ŋ": "ŋ", "ɹ": "ɹ",
        "ɾ": "ɾ", "ʃ": "ʃ", "ʒ": "ʒ", "ʔ": "ʔ",
        ".": "", ",": "", "!": "", "?": "", ";": "", ":": "", "—": "", "…": "", '"': "", "(": "", ")": "", "“": "",
        "”": "",
    },
)
MFA = PhoneSet(
    "mfa", "Montreal Forced Aligner, MFA phone set: IPA but for these labels", "MFA 3.0",
    table={
        "sil": "", "sp": "", "spn": "", "tɹ": "tɹ", "tʃː": "tʃ", "ɟʝ": "dʒ", "cç": "tʃ", "ə˞": "ɚ", "ɝ": "ɝ",
        "m̩": "m", "n̩": "n", "ɫ̩": "ɫ", "ɾ̃": "ɾ", "kp": "kp", "ɡb": "ɡb",
    },
)
PINYIN_INITIALS = {
    "b": "p", "p": "pʰ", "m": "m", "f": "f", "d": "t", "t": "tʰ", "n": "n", "l": "l", "g": "k", "k": "kʰ", "h": "x",
    "j": "tɕ", "q": "tɕʰ", "x": "ɕ", "zh": "ʈʂ", "ch": "ʈʂʰ", "sh": "ʂ", "r": "ʐ", "z": "ts", "c": "tsʰ", "s": "s",
    "y": "j", "w": "w", "ng": "ŋ",
}
PINYIN_FINALS = {
    "a": "a", "o": "wo", "e": "ɤ", "i": "i", "u": "u", "v": "y", "ü": "y", "ai": "aɪ", "ei": "eɪ", "ao": "aʊ",
    "ou": "oʊ", "an": "an", "en": "ən", "ang": "aŋ", "eng": "əŋ", "ong": "ʊŋ", "er": "aɹ", "ia": "ja", "ie": "jɛ",
    "iao": "jaʊ", "iu": "joʊ", "iou": "joʊ", "ian": "jɛn", "in": "in", "iang": "jaŋ", "ing": "iŋ", "iong": "jʊŋ",
    "ua": "wa", "uo": "wo", "uai": "waɪ", "ui": "weɪ", "uei": "weɪ", "uan": "wan", "un": "wən", "uen": "wən",
    "uang": "waŋ", "ueng": "wəŋ", "ue": "ɥɛ", "ve": "ɥɛ", "üe": "ɥɛ", "van": "ɥɛn", "üan": "ɥɛn", "vn": "yn",
    "ün": "yn", "ê": "ɛ",
}


def _pinyin() -> dict[str, str]:
    table = {initial + final: PINYIN_INITIALS[initial] + PINYIN_FINALS[final]
             for initial in PINYIN_INITIALS for final in PINYIN_FINALS if initial not in ("y", "w", "ng")}
    for initial in ("zh", "ch", "sh", "r", "z", "c", "s"):  # here i is the consonant held on
        table[initial + "i"] = PINYIN_INITIALS[initial] + "ɨ"
    for initial in ("j", "q", "x"):  # here u is written for ü
        for final in ("u", "ue", "uan", "un"):
            table[initial + final] = PINYIN_INITIALS[initial] + PINYIN_FINALS[final.replace("u", "v", 1)]
    for spelling, final in {  # y and w only begin a syllable that has no initial
        "yi": "i", "ya": "ia", "ye": "ie", "yao": "iao", "you": "iu", "yan": "ian", "yin": "in", "yang": "iang",
        "ying": "ing", "yong": "iong", "yu": "v", "yue": "ve", "yuan": "van", "yun": "vn", "wu": "u", "wa": "ua",
        "wo": "uo", "wai": "uai", "wei": "ui", "wan": "uan", "wen": "un", "wang": "uang", "weng": "ueng",
    }.items():
        table[spelling] = PINYIN_FINALS[final]
    return table | PINYIN_INITIALS | PINYIN_FINALS


PINYIN = PhoneSet(
    "pinyin", "Hanyu Pinyin (ISO 7098), pronunciation after Lee and Zee, JIPA 33 (2003)", "ISO 7098:2015",
    ignored="12345", table=_pinyin(),
)
_KANA_ROWS = {  # consonant: the five morae with a i u e o; a space where there is none
    "": "アイウエオ", "k": "カキクケコ", "s": "サ スセソ", "t": "タ  テト", "n": "ナニヌネノ", "h": "ハ  ヘホ",
    "m": "マミムメモ", "j": "ヤ ユ ヨ", "ɾ": "ラリルレロ", "w": "ワ   ヲ", "ɡ": "ガギグゲゴ", "z": "ザ ズゼゾ",
    "d": "ダ  デド", "b": "バビブベボ", "p": "パピプペポ",
}
_KANA_VOWELS = ("a", "i", "ɯ", "e", "o")
_KANA_OTHERS = {
    "シ": "ɕi", "チ": "tɕi", "ツ": "tsɯ", "ヒ": "çi", "フ": "ɸɯ", "ジ": "dʑi", "ヂ": "dʑi", "ヅ": "dzɯ", "ン": "ɴ",
    "ッ": "ʔ", "ー": "", "ヴ": "bɯ", "ァ": "a", "ィ": "i", "ゥ": "ɯ", "ェ": "e", "ォ": "o",
    "、": "", "。": "", "？": "", "！": "", "・": "",
}
_KANA_GLIDES = {  # before a small ya, yu, yo
    "キ": "kʲ", "シ": "ɕ", "チ": "tɕ", "ニ": "ɲ", "ヒ": "ç", "ミ": "mʲ", "リ": "ɾʲ", "ギ": "ɡʲ", "ジ": "dʑ", "ヂ": "dʑ",
    "ビ": "bʲ", "ピ": "pʲ",
}
_KANA_LOANS = {
    "ファ": "ɸa", "フィ": "ɸi", "フェ": "ɸe", "フォ": "ɸo", "ティ": "ti", "ディ": "di", "トゥ": "tɯ", "ドゥ": "dɯ",
    "ウィ": "wi", "ウェ": "we", "ウォ": "wo", "シェ": "ɕe", "ジェ": "dʑe", "チェ": "tɕe", "ツァ": "tsa", "ヴァ": "ba",
}


def _kana() -> dict[str, str]:
    table = dict(_KANA_OTHERS)
    for consonant, morae in _KANA_ROWS.items():
        for vowel, mora in zip(_KANA_VOWELS, morae.ljust(5), strict=True):
            if mora != " ":
                table[mora] = consonant + vowel
    for mora, consonant in _KANA_GLIDES.items():
        for small, vowel in zip("ャュョ", "aɯo", strict=True):
            table[mora + small] = consonant + vowel
    table |= _KANA_LOANS
    hiragana = {"".join(chr(ord(c) - 0x60) if "ァ" <= c <= "ヴ" else c for c in kana): table[kana] for kana in table}
    return table | hiragana


KANA = PhoneSet(
    "kana", "Katakana and hiragana; pronunciation after Okada, Handbook of the IPA (1999)", "JIS X 0208", joins=True,
    table=_kana(),
)
VOICEVOX = PhoneSet(
    "voicevox", "VOICEVOX ENGINE, mora_mapping: consonants and vowels of a mora", "VOICEVOX 0.14 and later",
    table={
        "a": "a", "i": "i", "u": "ɯ", "e": "e", "o": "o", "A": "a", "I": "i", "U": "ɯ", "E": "e", "O": "o", "N": "ɴ",
        "cl": "ʔ", "pau": "", "k": "k", "ky": "kʲ", "kw": "kw", "g": "ɡ", "gy": "ɡʲ", "gw": "ɡw", "s": "s", "sh": "ɕ",
        "z": "z", "j": "dʑ", "t": "t", "ts": "ts", "ty": "tʲ", "ch": "tɕ", "d": "d", "dy": "dʲ", "n": "n", "ny": "ɲ",
        "h": "h", "hy": "ç", "f": "ɸ", "b": "b", "by": "bʲ", "p": "p", "py": "pʲ", "m": "m", "my": "mʲ", "y": "j",
        "r": "ɾ", "ry": "ɾʲ", "w": "w", "v": "v",
    },
)
POLLY = PhoneSet(
    "polly-visemes", "Amazon Polly developer guide, phoneme and viseme tables, English (US)", "2026",
    table={
        "sil": "", "p": "p", "t": "t", "S": "ʃ", "T": "θ", "f": "f", "k": "k", "i": "i", "l": "l", "r": "ɹ", "s": "s",
        "u": "u", "@": "ə", "a": "a", "e": "e", "E": "ɛ", "o": "o", "O": "ɔ", "J": "ɲ", "B": "β", "x": "x",
    },
)
AZURE = PhoneSet(
    "azure-visemes", "Azure Speech documentation, how-to-speech-synthesis-viseme: ids 0 to 21", "2026-02-25",
    table={
        "0": "", "1": "ə", "2": "ɑ", "3": "ɔ", "4": "ɛ", "5": "ɝ", "6": "i", "7": "u", "8": "o", "9": "aʊ", "10": "ɔɪ",
        "11": "aɪ", "12": "h", "13": "ɹ", "14": "l", "15": "s", "16": "ʃ", "17": "ð", "18": "f", "19": "d", "20": "k",
        "21": "p",
    },
)
OCULUS = PhoneSet(
    "oculus-visemes", "Meta (Oculus) Lipsync documentation, viseme reference: 15 visemes", "Lipsync 29",
    table={
        "sil": "", "PP": "p", "FF": "f", "TH": "θ", "DD": "d", "kk": "k", "CH": "tʃ", "SS": "s", "nn": "n", "RR": "ɹ",
        "aa": "ɑ", "E": "ɛ", "I": "ɪ", "O": "o", "U": "u", "ih": "ɪ", "oh": "o", "ou": "u",
    },
)
RHUBARB = PhoneSet(
    "rhubarb-shapes", "Rhubarb Lip Sync, README: mouth shapes A to H and X", "1.14",
    table={"A": "p", "B": "s", "C": "ɛ", "D": "ɑ", "E": "ɔ", "F": "u", "G": "f", "H": "l", "X": ""},
)
# fmt: on

PHONE_SETS: dict[str, PhoneSet] = {
    each.name: each for each in (ESPEAK, MISAKI, MFA, PINYIN, KANA, VOICEVOX, POLLY, AZURE, OCULUS, RHUBARB)
}
