"""The names that espeak-ng gives to phones, as IPA.

They are meant to be IPA with stress marks, cut at 8 bytes. Where a voice's data name no IPA, the library turns its own
mnemonic letter by letter: ``s.`` for ʂ, ``ə-`` for a weak e. An empty name is a pause or less.
"""

import re
import unicodedata

from fapengine.speech import ipa
from fapengine.speech.alphabets.convert import from_set
from fapengine.speech.alphabets.phone_sets import ESPEAK

NAME_BYTES = 8
"""Length of a name in an event (speak_lib.h); a longer one is cut."""
_LANGUAGE = re.compile(r"\(.*\)")
"""A change of language, such as (en): no phone."""
_ASPIRATED = re.compile(r"(?<=[ptkqcʈɕʂs])h$")
_NASAL = "\u0303"

# Places by voice; espeak-ng 1.52, number texts of all its voices (tests/unit/voices/test_all_voices.py).
_OWN = {
    "s.": "ʂ", "ts.": "ʈʂ", "ts.h": "ʈʂʰ", "i.": "ɨ", "o-": "ɤ",  # cmn, hak
    "r.": "ɽ", "n^": "ɲ", "t[": "t̪", "d[": "d̪", "l-": "ɫ",  # gu ml or sd; fr; ky
    "r#": "r̥", "l#": "l̥", "tl#": "tl̥",  # is
    "ε": "ɛ", "Φ": "ɸ", "A": "ɑ", "t`": "ʈ", "d`": "ɖ",  # da; smj; ga; Scandinavian
}  # fmt: skip


def read_label(name: bytes) -> tuple[str, int] | None:
    """Label in IPA and stress of a phone event; an empty label for a nameless event, None for what is no phone.

    A name that is no IPA even so is returned as it is, to be reported as unknown.

    Parameters
    ----------
    name : bytes
        UTF-8, filled up with zeros.

    Examples
    --------
    >>> read_label("ˈaɪ".encode()), read_label(b"s."), read_label(b""), read_label(b"(en)")
    (('aɪ', 1), ('ʂ', 0), ('', 0), None)
    """
    spelling = name.split(b"\0")[0].decode("utf-8", errors="ignore").strip("_:| ")
    if _LANGUAGE.fullmatch(spelling):
        return None
    label, stress = ipa.split_stress(spelling)
    label = _ASPIRATED.sub("ʰ", _OWN.get(label, label))
    if len(name.rstrip(b"\0")) == NAME_BYTES and _NASAL in label and label[-1] != _NASAL:
        label += _NASAL  # Portuguese ɐ̃ʊ̃ under stress has 10 bytes
    if label and not ipa.letters(label) and not all(unicodedata.category(sign) in ("Mn", "Lm") for sign in label):
        label = from_set(label, ESPEAK) or label.rstrip("-#.") or label
    return label, stress
