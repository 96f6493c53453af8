"""Phone alphabets other than IPA, as tables to IPA.

ARPAbet: the symbol set of the CMU Pronouncing Dictionary and of TIMIT-style aligners. X-SAMPA: J. C. Wells,
"Computer-coding the IPA" (1995); MBROLA's language sets are subsets of SAMPA, which X-SAMPA contains. All others are
data of one form: :mod:`fapengine.speech.phone_sets`.
"""

from collections.abc import Iterable

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.phone_sets import PHONE_SETS, PhoneSet

# fmt: off
ARPABET: dict[str, str] = {
    "AA": "ɑ",  "AE": "æ",  "AH": "ʌ",  "AO": "ɔ",  "AW": "aʊ", "AX": "ə",  "AXR": "ɚ", "AY": "aɪ", "EH": "ɛ",
    "ER": "ɝ",  "EY": "eɪ", "IH": "ɪ",  "IX": "ɨ",  "IY": "i",  "OW": "oʊ", "OY": "ɔɪ", "UH": "ʊ",  "UW": "u",
    "UX": "ʉ",  "B": "b",   "CH": "tʃ", "D": "d",   "DH": "ð",  "DX": "ɾ",  "EL": "l",  "EM": "m",  "EN": "n",
    "F": "f",   "G": "ɡ",   "HH": "h",  "H": "h",   "JH": "dʒ", "K": "k",   "L": "l",   "M": "m",   "N": "n",
    "NG": "ŋ",  "NX": "ɾ",  "P": "p",   "Q": "ʔ",   "R": "ɹ",   "S": "s",   "SH": "ʃ",  "T": "t",   "TH": "θ",
    "V": "v",   "W": "w",   "WH": "ʍ",  "Y": "j",   "Z": "z",   "ZH": "ʒ",
}
XSAMPA_LETTERS: dict[str, str] = {  # longest spellings are tried first
    "A": "ɑ", "B": "β", "C": "ç", "D": "ð", "E": "ɛ", "F": "ɱ", "G": "ɣ", "H": "ɥ", "I": "ɪ", "J": "ɲ", "K": "ɬ",
    "L": "ʎ", "M": "ɯ", "N": "ŋ", "O": "ɔ", "P": "ʋ", "Q": "ɒ", "R": "ʁ", "S": "ʃ", "T": "θ", "U": "ʊ", "V": "ʌ",
    "W": "ʍ", "X": "χ", "Y": "ʏ", "Z": "ʒ", "{": "æ", "}": "ʉ", "@": "ə", "@`": "ɚ", "1": "ɨ", "2": "ø", "3": "ɜ",
    "3`": "ɝ", "4": "ɾ", "5": "ɫ", "6": "ɐ", "7": "ɤ", "8": "ɵ", "9": "œ", "&": "ɶ", "?": "ʔ", "?\\": "ʕ",
    "r\\": "ɹ", "R\\": "ʀ", "s\\": "ɕ", "z\\": "ʑ", "x\\": "ɧ", "h\\": "ɦ", "H\\": "ʜ", "j\\": "ʝ", "J\\": "ɟ",
    "p\\": "ɸ", "v\\": "ʋ", "B\\": "ʙ", "G\\": "ɢ", "N\\": "ɴ", "L\\": "ʟ", "M\\": "ɰ", "O\\": "ʘ", "X\\": "ħ",
    "K\\": "ɮ", "l\\": "ɺ", "r\\`": "ɻ", "l`": "ɭ", "n`": "ɳ", "r`": "ɽ", "s`": "ʂ", "t`": "ʈ", "z`": "ʐ",
    "d`": "ɖ", "u\\": "ʊ", "I\\": "ɪ", "U\\": "ʊ", "3\\": "ɞ", "@\\": "ɘ",
}
# fmt: on
SILENCES = frozenset(
    {"", "_", "sil", "sp", "spn", "pau", "h#", "epi", "silence", "<eps>", "<sil>", "#", "{sl}", "<p:>"}
)
"""Labels that tools write for silence (Praat: empty; MFA: sil, sp, spn; Festival: pau; TIMIT: h#; MAUS: <p:>)."""

ALPHABETS = ("ipa", "arpabet", "x-sampa", *PHONE_SETS)
"""Names that :func:`to_ipa` takes."""


def from_arpabet(label: str) -> str | None:
    """IPA of an ARPAbet label, stress digit allowed; None if it is none.

    Examples
    --------
    >>> from_arpabet("AY1"), from_arpabet("hh"), from_arpabet("?")
    ('aɪ', 'h', None)
    """
    return ARPABET.get(label.upper().rstrip("012"))


def from_xsampa(label: str) -> str | None:
    r"""IPA of an X-SAMPA label; None if it is none.

    Examples
    --------
    >>> from_xsampa("tS"), from_xsampa("A:"), from_xsampa("r\\"), from_xsampa("§")
    ('tʃ', 'ɑː', 'ɹ', None)
    """
    out = ""
    rest = label.strip('"%')
    while rest:
        for width in (3, 2, 1):
            piece = rest[:width]
            if piece in XSAMPA_LETTERS:
                out += XSAMPA_LETTERS[piece]
                break
        else:
            width, letter = 1, rest[0]
            if letter == ":":
                out += "ː"
            elif letter in "_~=`'":
                pass  # diacritics change nothing that is seen
            elif ipa.letters(letter):
                out += ipa.letters(letter)[0]
            else:
                return None
        rest = rest[width:]
    return out or None


def guess_alphabet(labels: Iterable[str]) -> str:
    """Name the alphabet that explains most of the labels, silences aside; ties go to ARPAbet, then IPA.

    ARPAbet must be in capitals to be guessed. What the alphabet does not explain is reported later as unknown.

    Examples
    --------
    >>> guess_alphabet(["B", "R", "AY1", "T"]), guess_alphabet(["b", "ɹ", "aɪ"]), guess_alphabet(["b", "{", "t"])
    ('arpabet', 'ipa', 'x-sampa')
    """
    spoken = [label for label in labels if label.lower() not in SILENCES]
    explained = {
        "arpabet": sum(label.isupper() and from_arpabet(label) is not None for label in spoken),
        "ipa": sum(bool(ipa.letters(ipa.split_stress(label)[0])) for label in spoken),
        "x-sampa": sum(from_xsampa(label) is not None for label in spoken),
    }
    return max(explained, key=lambda name: explained[name])


def from_set(label: str, phones: PhoneSet) -> str | None:
    """IPA of a label of a phone set, empty for silence; None if it is none.

    Examples
    --------
    >>> from_set("chuang1", PHONE_SETS["pinyin"]), from_set("きょ", PHONE_SETS["kana"])
    ('ʈʂʰwaŋ', 'kʲo')
    >>> from_set("hWs", PHONE_SETS["misaki"])
    'haʊs'
    """
    if label in phones.table:
        return phones.table[label]
    rest = label.strip(phones.ignored)
    if not phones.joins or not rest:
        return phones.table.get(rest)
    longest = max(map(len, phones.table))
    out = ""
    while rest:
        width = next((n for n in range(min(longest, len(rest)), 0, -1) if rest[:n] in phones.table), 0)
        if not width and rest[0] not in phones.ignored:
            return None
        out += phones.table.get(rest[:width], "")
        rest = rest[max(width, 1) :]
    return out


def to_ipa(label: str, alphabet: str) -> tuple[str, int]:
    """IPA and stress of a label; a label outside the alphabet stays as it is, to be reported later.

    Raises
    ------
    UsageError
        If there is no such alphabet.

    Examples
    --------
    >>> to_ipa("AY1", "arpabet"), to_ipa("ˌaɪ", "ipa"), to_ipa("QQ", "arpabet"), to_ipa("21", "azure-visemes")
    (('aɪ', 1), ('aɪ', 2), ('QQ', 0), ('p', 0))
    """
    if alphabet == "arpabet":
        stress = {"1": 1, "2": 2}.get(label[-1:], 0)
        as_ipa = from_arpabet(label)
        return (as_ipa, stress) if as_ipa else (label, 0)
    if alphabet == "x-sampa":
        stress = 1 if label.startswith('"') else 2 if label.startswith("%") else 0
        return from_xsampa(label) or label, stress
    if alphabet in ("ipa", "mfa"):
        spelling, stress = ipa.split_stress(label)
        return ipa.normalise(PHONE_SETS["mfa"].table.get(spelling, spelling)), stress
    if alphabet not in PHONE_SETS:
        raise UsageError(f"alphabet: got {alphabet!r}, expected one of {', '.join(ALPHABETS)}")
    stress = {"'": 1, ",": 2, "ˈ": 1, "ˌ": 2}.get(label[:1], 0) if alphabet in ("espeak", "misaki") else 0
    letters_of = from_set(label, PHONE_SETS[alphabet])
    return (label, 0) if letters_of is None else (letters_of, stress)
