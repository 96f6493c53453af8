"""Phone sets as data: what the labels of speech tools mean in IPA.

Each table says where it comes from. A label that stands for silence maps to the empty string. Tables of *visemes* map
to one phone that shows the class well: they name what is seen, so any phone of the class would do. Sets that are a
table alone are in ``phone_sets.toml``.
"""

from fapengine._arrays import read_tables
from fapengine.mpeg4.fap import VISEMES
from fapengine.speech.alphabets.japanese import KANA
from fapengine.speech.alphabets.mandarin import FINALS, PINYIN, from_zhuyin
from fapengine.speech.alphabets.phone_set import PhoneSet

MPEG4 = PhoneSet(
    "mpeg4-visemes",
    "ISO/IEC 14496-2, Annex C, Table C.4: viseme_select 0 to 14",
    "1999",
    table={str(row.number): row.phonemes[0] if row.phonemes else "" for row in VISEMES},
)
_FIRST = (
    "espeak", "misaki", "mfa", "mrpa", "pinyin", "kana", "voicevox", "openjtalk", "polly-visemes", "azure-visemes",
    "oculus-visemes", "mpeg4-visemes",
)  # fmt: skip
_ROWS = read_tables(__package__, "phone_sets.toml")
_ZHUYIN = "ㄅㄆㄇㄈㄉㄊㄋㄌㄍㄎㄏㄐㄑㄒㄚㄛㄜㄞㄟㄠㄡㄢㄣㄤㄥㄦㄧㄨㄩㄭ"
_ROWS["misaki"]["table"] |= {letter: from_zhuyin(letter) or "" for letter in _ZHUYIN}
_ROWS["misaki"]["table"] |= {letter: FINALS[final] for letter, final in _ROWS["misaki"].pop("finals").items()}
_ROWS["openjtalk"]["table"] = _ROWS["voicevox"]["table"] | _ROWS["openjtalk"]["table"]
_SETS = {name: PhoneSet(name, **row) for name, row in _ROWS.items()}
_SETS |= {each.name: each for each in (PINYIN, KANA, MPEG4)}
PHONE_SETS: dict[str, PhoneSet] = {name: _SETS[name] for name in dict.fromkeys((*_FIRST, *_SETS))}
"""All sets, in the order in which errors list them."""
ESPEAK, AZURE = PHONE_SETS["espeak"], PHONE_SETS["azure-visemes"]
