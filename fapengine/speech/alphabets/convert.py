"""Labels to IPA: ARPAbet, X-SAMPA and the phone sets; :mod:`fapengine.speech.alphabets.guess` finds which one it is.

ARPAbet is read in all its spellings: CMU Pronouncing Dictionary 0.7b (two letters, a stress digit); TIMIT,
``PHONCODE.DOC`` (closures, ``ax-h``, ``hv``, ``eng``); Kaldi, "Data preparation" (``_B _I _E _S``: position in the
word); Festival, ``radio_phones.scm``; Buckeye Corpus manual, 2nd release (nasal vowels, ``tq``). Case does not matter.

X-SAMPA (J. C. Wells, "Computer-coding the IPA", 1995, revised 2000) is read whole: letters, modifiers, ejectives,
implosives, clicks. SAMPA of a language (MBROLA, MARY, BAS) is a subset, except for the archiphonemes of French, ``E/``
and its like, which leave open which of two vowels is meant. A modifier is ``_`` and one character (two if the second
is a backslash). It becomes the IPA's diacritic, so rounding and nasality, which are seen, are kept.
"""

import re
import unicodedata
from string import ascii_lowercase

from fapengine._arrays import read_tables
from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.alphabets.phone_set import split_longest
from fapengine.speech.alphabets.phone_sets import PHONE_SETS

_TABLES = read_tables(__package__, "labels.toml")
ARPABET: dict[str, str] = _TABLES["arpabet"]
_POSITION = re.compile(r"(?<=.)_[BIES]$")


def without_position(label: str) -> str:
    """Remove Kaldi's position in the word from a label.

    Examples
    --------
    >>> without_position("HH_B"), without_position("sil_S"), without_position("_")
    ('HH', 'sil', '_')
    """
    return _POSITION.sub("", label)


def from_arpabet(label: str) -> str | None:
    """IPA of an ARPAbet label, with or without stress digit and position; None for any other label.

    Examples
    --------
    >>> from_arpabet("AY1"), from_arpabet("hh"), from_arpabet("AH0_B"), from_arpabet("pcl"), from_arpabet("?")
    ('aɪ', 'h', 'ə', 'p', None)
    """
    plain = without_position(label).upper()
    return ARPABET[plain] if plain in ARPABET else ARPABET.get(plain.rstrip("012"))


XSAMPA_LETTERS: dict[str, str] = {letter: letter for letter in ascii_lowercase} | _TABLES["x-sampa-letters"]
MARKS: dict[str, str] = _TABLES["x-sampa-marks"]
UNSEEN = ("_T", "_H", "_M", "_L", "_B", "_F", "_R", "_/", "_\\", "<F>", "<R>", "-\\", "_", "-", ".", "||", "|", "^",
          "!")  # fmt: skip
"""Tones, breaks and joins, which are invisible."""
_PIECES = {**XSAMPA_LETTERS, **MARKS, **dict.fromkeys(UNSEEN, ""), '"': "", "%": ""}


def from_xsampa(label: str) -> str | None:
    r"""IPA of an X-SAMPA label; None for any other label, also for IPA outside ASCII.

    Examples
    --------
    >>> from_xsampa("tS"), from_xsampa("A:"), from_xsampa("r\\"), from_xsampa("§")
    ('tʃ', 'ɑː', 'ɹ', None)
    >>> from_xsampa("p_h"), from_xsampa("b_<"), from_xsampa("|\\|\\"), from_xsampa("_h")
    ('pʰ', 'ɓ', 'ǁ', None)
    >>> from_xsampa("s_m") == "s\u033b"
    True
    """
    pieces = split_longest(label, _PIECES)
    if pieces is None or XSAMPA_LETTERS.keys().isdisjoint(pieces):
        return None
    return unicodedata.normalize("NFC", "".join(_PIECES[piece] for piece in pieces))


SILENCES = frozenset(
    {"", "_", "sil", "silb", "sile", "silence", "sp", "ssp", "spn", "spnoise", "pau", "pause", "h#", "epi",
     "<eps>", "<sil>", "<s>", "</s>", "#", "##", "{sl}", "<p:>", "<usb>", "<nib>", "<p>", "(.)", "...", "ns", "nsn",
     "noise", "<noise>", "vocnoise", "<vocnoise>", "iver", "<iver>", "laugh", "<laugh>", "cutoff", "unknown",
     "{b_trans}", "{e_trans}", "br", "ap", "+breath+", "+noise+", "+cough+", "+um+", "+uh+", "++breath++", "[noise]",
     "[silence]", "[sil]", "[laughter]"}
)  # fmt: skip
"""Labels that tools write for silence and for sounds that are not speech, in small letters.

Praat: empty; MFA: sil, sp, spn; Festival: pau; TIMIT: h#, epi; MAUS: <p:> <usb> <nib>; Julius: silB, silE; Kaldi: SIL,
SPN, NSN; Buckeye: VOCNOISE, IVER (the other speaker), {B_TRANS}; singing: AP, SP, br; PocketSphinx: +BREATH+.
"""
_SILENT_WORDS = frozenset({"", "_", "sil", "sp", "h#", "#", "..."})
_BRACKETED = re.compile(r"[<\[({].*[>\])}]")

ALPHABETS = ("ipa", "arpabet", "x-sampa", *PHONE_SETS)
"""Names that :func:`to_ipa` accepts."""


def is_silence(label: str, *, spelled: bool = False) -> bool:
    """Whether a label means silence; among written words only what is not a word, for "silence" is one.

    Examples
    --------
    >>> is_silence("SIL_S"), is_silence("silB"), is_silence("silence", spelled=True), is_silence("<eps>", spelled=True)
    (True, True, False, True)
    """
    plain = label.strip().lower()
    if spelled:
        return plain in _SILENT_WORDS or bool(_BRACKETED.fullmatch(plain))
    return plain in SILENCES or without_position(label.strip()).lower() in SILENCES


def to_ipa(label: str, alphabet: str) -> tuple[str, int]:
    """IPA and stress of a label; a label outside the alphabet stays as it is, to be reported later.

    Examples
    --------
    >>> to_ipa("AY1", "arpabet"), to_ipa("ˌaɪ", "ipa"), to_ipa("QQ", "arpabet"), to_ipa("21", "azure-visemes")
    (('aɪ', 1), ('aɪ', 2), ('QQ', 0), ('p', 0))
    """
    as_ipa, stress = spelled_out(label, alphabet)
    return (label, stress if alphabet == "x-sampa" else 0) if as_ipa is None else (as_ipa, stress)


def spelled_out(label: str, alphabet: str) -> tuple[str | None, int]:
    """IPA and stress of a label, empty for silence; None for a label outside the alphabet."""
    if alphabet == "arpabet":
        return from_arpabet(label), {"1": 1, "2": 2}.get(without_position(label)[-1:], 0)
    if alphabet == "x-sampa":
        return from_xsampa(label), 1 if label.startswith('"') else 2 if label.startswith("%") else 0
    if alphabet in ("ipa", "mfa"):
        spelling, stress = ipa.split_stress(without_position(label))
        return ipa.normalise(PHONE_SETS["mfa"].table.get(spelling, spelling)), stress
    if alphabet not in PHONE_SETS:
        raise UsageError(f"alphabet: unknown value {alphabet!r}; use one of {', '.join(ALPHABETS)}")
    stress = {"'": 1, ",": 2, "ˈ": 1, "ˌ": 2}.get(label[:1], 0) if alphabet in ("espeak", "misaki") else 0
    return PHONE_SETS[alphabet].to_ipa(label), stress
