"""Phone sets as data: what the labels of speech tools mean in IPA.

Each table says where it comes from. A label that stands for silence maps to the empty string. Tables of *visemes* map
to one phone that shows the class well: they name what is seen, so any phone of the class would do.
"""

from fapengine.mpeg4.fap import VISEMES
from fapengine.speech.alphabets.japanese import KANA, OPENJTALK, VOICEVOX
from fapengine.speech.alphabets.mandarin import FINALS, PINYIN, from_zhuyin
from fapengine.speech.alphabets.phone_set import PhoneSet

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
_MISAKI_ENGLISH = {
    "A": "eɪ", "I": "aɪ", "W": "aʊ", "Y": "ɔɪ", "O": "oʊ", "Q": "əʊ", "ʤ": "dʒ", "ʧ": "tʃ", "ʦ": "ts", "ʣ": "dz",
    "T": "ɾ", "ᵊ": "ə", "ᵻ": "ɪ", "g": "ɡ",
    **{letter: letter for letter in "abdefhijklmnoprstuvwxzɚɝɜɡɑɐæəɛɪɔɒʊʌðθŋɹɾʃʒʔ"},
}
_MISAKI_JAPANESE = {
    "ᶀ": "bʲ", "ᶁ": "dʲ", "ᶂ": "ɸʲ", "ᶃ": "ɡʲ", "ᶄ": "kʲ", "ᶆ": "mʲ", "ᶈ": "pʲ", "ᶉ": "ɾʲ", "ƫ": "tʲ", "ʨ": "tɕ",
    "ʥ": "dʑ", **{letter: letter for letter in "ɲɕʑçɸβɯɴɨ"},
}
_MISAKI_MANDARIN = {
    "ꭧ": "ʈʂ", **{letter: letter for letter in "ʂʐɤyɥøœcqʈɻ"}, "ㄝ": "jɛ",
    **{letter: from_zhuyin(letter) or "" for letter in "ㄅㄆㄇㄈㄉㄊㄋㄌㄍㄎㄏㄐㄑㄒㄚㄛㄜㄞㄟㄠㄡㄢㄣㄤㄥㄦㄧㄨㄩㄭ"},
    "ㄓ": "ʈʂ", "ㄔ": "ʈʂʰ", "ㄕ": "ʂ", "ㄖ": "ʐ", "ㄗ": "ts", "ㄘ": "tsʰ", "ㄙ": "s", "十": "ɨ",
    **{letter: FINALS[final] for letter, final in {  # v1.1: one letter each, the sign of a word that sounds so
        "月": "ve", "压": "ia", "言": "ian", "阳": "iang", "要": "iao", "阴": "in", "应": "ing", "用": "iong",
        "又": "iou", "中": "ong", "穵": "ua", "外": "uai", "万": "uan", "王": "uang", "为": "uei", "文": "uen",
        "瓮": "ueng", "我": "uo", "元": "van", "云": "vn",
    }.items()},
}
MISAKI = PhoneSet(
    "misaki", "hexgrad/misaki: EN_PHONES.md, one letter for each English diphthong and affricate; Japanese letters with"
    " hooks; Mandarin as IPA with arrows (1.0) and as Zhuyin with signs for whole finals (1.1)", "misaki 0.9",
    joins=True, ignored="ˈˌː ʲʰᵝ̩̃̍→↗↘↓↑ꜜꜛ012345R",
    table=_MISAKI_ENGLISH | _MISAKI_JAPANESE | _MISAKI_MANDARIN | dict.fromkeys('.,!?;:—…"()“”/→↗↘↓↑ꜜꜛ', ""),
)
MRPA = PhoneSet(
    "mrpa", "Festival, mrpa_phones.scm: British English, after the Machine Readable Phonetic Alphabet", "Festival 2.5",
    table={
        "uh": "ʌ", "e": "ɛ", "a": "æ", "o": "ɒ", "i": "ɪ", "u": "ʊ", "ii": "iː", "uu": "uː", "oo": "ɔː", "aa": "ɑː",
        "@@": "ɜː", "ai": "aɪ", "ei": "eɪ", "oi": "ɔɪ", "au": "aʊ", "ou": "əʊ", "e@": "ɛə", "i@": "ɪə", "u@": "ʊə",
        "@": "ə", "p": "p", "t": "t", "k": "k", "b": "b", "d": "d", "g": "ɡ", "s": "s", "z": "z", "sh": "ʃ", "zh": "ʒ",
        "f": "f", "v": "v", "th": "θ", "dh": "ð", "ch": "tʃ", "jh": "dʒ", "h": "h", "m": "m", "n": "n", "ng": "ŋ",
        "l": "l", "y": "j", "r": "ɹ", "w": "w", "#": "",
    },
)
MFA = PhoneSet(
    "mfa", "Montreal Forced Aligner, MFA phone set: IPA but for these labels", "MFA 3.0",
    table={
        "sil": "", "sp": "", "spn": "", "tɹ": "tɹ", "tʃː": "tʃ", "ɟʝ": "dʒ", "cç": "tʃ", "ə˞": "ɚ", "ɝ": "ɝ",
        "m̩": "m", "n̩": "n", "ɫ̩": "ɫ", "ɾ̃": "ɾ", "kp": "kp", "ɡb": "ɡb",
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
MPEG4 = PhoneSet(
    "mpeg4-visemes", "ISO/IEC 14496-2, Annex C, Table C.4: viseme_select 0 to 14", "1999",
    table={str(row.number): row.phonemes[0] if row.phonemes else "" for row in VISEMES},
)
INWORLD = PhoneSet(
    "inworld-visemes", "Inworld TTS documentation, timestamps: viseme symbols", "TTS 1.5, 2026",
    table={
        "sil": "", "aei": "a", "o": "o", "ee": "i", "bmp": "p", "fv": "f", "l": "l", "r": "ɹ", "th": "θ", "qw": "w",
        "cdgknstxyz": "t", "chjsh": "ʃ", "u": "u", "rest": "",
    },
)
PRESTON_BLAIR = PhoneSet(
    "preston-blair", "Papagayo and Papagayo-NG, phonemes_preston_blair.py: ten mouths", "Papagayo-NG 1.6",
    table={
        "AI": "a", "E": "ɛ", "etc": "t", "FV": "f", "L": "l", "MBP": "m", "O": "o", "rest": "", "U": "u", "WQ": "w",
    },
)
RHUBARB = PhoneSet(
    "rhubarb-shapes", "Rhubarb Lip Sync, README: mouth shapes A to H and X", "1.14",
    table={"A": "p", "B": "s", "C": "ɛ", "D": "ɑ", "E": "ɔ", "F": "u", "G": "f", "H": "l", "X": ""},
)

PHONE_SETS: dict[str, PhoneSet] = {each.name: each for each in (
    ESPEAK, MISAKI, MFA, MRPA, PINYIN, KANA, VOICEVOX, OPENJTALK, POLLY, AZURE, OCULUS, MPEG4, INWORLD,
    PRESTON_BLAIR, RHUBARB,
)}
# fmt: on
