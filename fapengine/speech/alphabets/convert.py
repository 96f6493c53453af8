"""Labels to IPA, in any alphabet; which alphabet it is, is found by :mod:`fapengine.speech.alphabets.guess`."""

import re

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.alphabets.arpabet import ARPABET, from_arpabet, without_position
from fapengine.speech.alphabets.phone_set import PhoneSet
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.alphabets.xsampa import LETTERS as XSAMPA_LETTERS
from fapengine.speech.alphabets.xsampa import from_xsampa

__all__ = [
    "ALPHABETS", "ARPABET", "SILENCES", "XSAMPA_LETTERS", "from_arpabet", "from_set", "from_xsampa", "is_silence",
    "to_ipa", "without_position",
]  # fmt: skip

SILENCES = frozenset(
    {"", "_", "sil", "silb", "sile", "silence", "sp", "ssp", "spn", "spnoise", "pau", "pause", "h#", "epi",
     "<eps>", "<sil>", "<s>", "</s>", "#", "##", "{sl}", "<p:>", "<usb>", "<nib>", "<p>", "(.)", "...", "ns", "nsn",
     "noise", "<noise>", "vocnoise", "<vocnoise>", "iver", "<iver>", "laugh", "<laugh>", "cutoff", "unknown",
     "{b_trans}", "{e_trans}", "br", "ap", "+breath+", "+noise+", "+cough+", "+um+", "+uh+", "++breath++", "[noise]",
     "[silence]", "[laughter]"}
)  # fmt: skip
"""Labels that tools write for silence and for sounds that are no speech, in small letters.

Praat: empty; MFA: sil, sp, spn; Festival: pau; TIMIT: h#, epi; MAUS: <p:> <usb> <nib>; Julius: silB, silE; Kaldi: SIL,
SPN, NSN; Buckeye: VOCNOISE, IVER (the other speaker), {B_TRANS}; singing: AP, SP, br; PocketSphinx: +BREATH+.
"""
_SILENT_WORDS = frozenset({"", "_", "sil", "sp", "h#", "#", "..."})
_BRACKETED = re.compile(r"[<\[({].*[>\])}]")

ALPHABETS = ("ipa", "arpabet", "x-sampa", *PHONE_SETS)
"""Names that :func:`to_ipa` takes."""


def is_silence(label: str, *, spelled: bool = False) -> bool:
    """Whether a label stands for silence; of spelled words only what is no word does, for "silence" is one.

    Examples
    --------
    >>> is_silence("SIL_S"), is_silence("silB"), is_silence("silence", spelled=True), is_silence("<eps>", spelled=True)
    (True, True, False, True)
    """
    plain = label.strip().lower()
    if spelled:
        return plain in _SILENT_WORDS or bool(_BRACKETED.fullmatch(plain))
    return plain in SILENCES or without_position(label.strip()).lower() in SILENCES


def from_set(label: str, phones: PhoneSet) -> str | None:
    """IPA of a label of a phone set, empty for silence; None if it is none.

    Examples
    --------
    >>> from_set("chuang1", PHONE_SETS["pinyin"]), from_set("きょ", PHONE_SETS["kana"])
    ('ʈʂʰwaŋ', 'kʲo')
    >>> from_set("hWs", PHONE_SETS["misaki"])
    'haʊs'
    """
    return phones.to_ipa(label)


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
    as_ipa, stress = spelled_out(label, alphabet)
    return (label, stress if alphabet == "x-sampa" else 0) if as_ipa is None else (as_ipa, stress)


def spelled_out(label: str, alphabet: str) -> tuple[str | None, int]:
    """IPA and stress of a label, empty for silence; None for a label outside the alphabet.

    Raises
    ------
    UsageError
        If there is no such alphabet.
    """
    if alphabet == "arpabet":
        return from_arpabet(label), {"1": 1, "2": 2}.get(without_position(label)[-1:], 0)
    if alphabet == "x-sampa":
        return from_xsampa(label), 1 if label.startswith('"') else 2 if label.startswith("%") else 0
    if alphabet in ("ipa", "mfa"):
        spelling, stress = ipa.split_stress(without_position(label))
        return ipa.normalise(PHONE_SETS["mfa"].table.get(spelling, spelling)), stress
    if alphabet not in PHONE_SETS:
        raise UsageError(f"alphabet: got {alphabet!r}, expected one of {', '.join(ALPHABETS)}")
    stress = {"'": 1, ",": 2, "ˈ": 1, "ˌ": 2}.get(label[:1], 0) if alphabet in ("espeak", "misaki") else 0
    return PHONE_SETS[alphabet].to_ipa(label), stress
