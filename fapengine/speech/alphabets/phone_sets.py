"""Phone sets as data: what the labels of speech tools mean in IPA.

Each table says where it comes from. A label that stands for silence maps to the empty string. Tables of *visemes* map
to one phone that shows the class well: they name what is seen, so any phone of the class would do. Sets that are a
table alone are in ``phone_sets.toml``.
"""

from fapengine._arrays import read_tables
from fapengine.mpeg4.fap import VISEMES
from fapengine.speech.alphabets.japanese import KANA, OPENJTALK, VOICEVOX
from fapengine.speech.alphabets.mandarin import FINALS, PINYIN, from_zhuyin
from fapengine.speech.alphabets.phone_set import PhoneSet

# fmt: off
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
MPEG4 = PhoneSet(
    "mpeg4-visemes", "ISO/IEC 14496-2, Annex C, Table C.4: viseme_select 0 to 14", "1999",
    table={str(row.number): row.phonemes[0] if row.phonemes else "" for row in VISEMES},
)
_FIRST = ("espeak", "misaki", "mfa", "mrpa", "pinyin", "kana", "voicevox", "openjtalk", "polly-visemes",
          "azure-visemes", "oculus-visemes", "mpeg4-visemes")
# fmt: on
_SETS = {name: PhoneSet(name, **row) for name, row in read_tables(__package__, "phone_sets.toml").items()}
_SETS |= {each.name: each for each in (MISAKI, PINYIN, KANA, VOICEVOX, OPENJTALK, MPEG4)}
PHONE_SETS: dict[str, PhoneSet] = {name: _SETS[name] for name in dict.fromkeys((*_FIRST, *_SETS))}
"""All sets, in the order in which errors list them."""
ESPEAK, AZURE = PHONE_SETS["espeak"], PHONE_SETS["azure-visemes"]
