"""ARPAbet in all its spellings: CMU, TIMIT, Kaldi, Festival's radio set, Buckeye.

Sources: CMU Pronouncing Dictionary 0.7b (two letters, a stress digit); TIMIT, ``PHONCODE.DOC`` (closures, ``ax-h``,
``hv``, ``eng``); Kaldi, "Data preparation" (``_B _I _E _S`` say where in the word); Festival, ``radio_phones.scm``;
Buckeye Corpus manual, 2nd release (nasal vowels, ``tq``). Capitals and small letters mean the same.
"""

import re

# fmt: off
ARPABET: dict[str, str] = {
    "AA": "ɑ",  "AE": "æ",  "AH": "ʌ",  "AO": "ɔ",  "AW": "aʊ", "AX": "ə",  "AXR": "ɚ", "AY": "aɪ", "EH": "ɛ",
    "ER": "ɝ",  "EY": "eɪ", "IH": "ɪ",  "IX": "ɨ",  "IY": "i",  "OW": "oʊ", "OY": "ɔɪ", "UH": "ʊ",  "UW": "u",
    "UX": "ʉ",  "B": "b",   "CH": "tʃ", "D": "d",   "DH": "ð",  "DX": "ɾ",  "EL": "l",  "EM": "m",  "EN": "n",
    "F": "f",   "G": "ɡ",   "HH": "h",  "H": "h",   "JH": "dʒ", "K": "k",   "L": "l",   "M": "m",   "N": "n",
    "NG": "ŋ",  "NX": "ɾ",  "P": "p",   "Q": "ʔ",   "R": "ɹ",   "S": "s",   "SH": "ʃ",  "T": "t",   "TH": "θ",
    "V": "v",   "W": "w",   "WH": "ʍ",  "Y": "j",   "Z": "z",   "ZH": "ʒ",
    "AH0": "ə", "ER0": "ɚ", "IH0": "ɪ̈",                                               # reduced, for want of stress
    "AX-H": "ə̥", "ENG": "ŋ", "HV": "ɦ",                                               # TIMIT
    "BCL": "b", "DCL": "d", "GCL": "ɡ", "PCL": "p", "TCL": "t", "KCL": "k",           # its closures
    "TQ": "ʔ", "HHN": "h",                                                            # Buckeye
    "AAN": "ɑ̃", "AEN": "æ̃", "AHN": "ʌ̃", "AON": "ɔ̃", "AWN": "ãʊ̃", "AYN": "ãɪ̃", "EHN": "ɛ̃", "ERN": "ɝ̃", "EYN": "ẽɪ̃",
    "IHN": "ɪ̃", "IYN": "ĩ", "OWN": "õʊ̃", "OYN": "ɔ̃ɪ̃", "UHN": "ʊ̃", "UWN": "ũ",        # its nasal vowels
}
# fmt: on
_POSITION = re.compile(r"(?<=.)_[BIES]$")


def without_position(label: str) -> str:
    """Take Kaldi's place in the word off a label.

    Examples
    --------
    >>> without_position("HH_B"), without_position("sil_S"), without_position("_")
    ('HH', 'sil', '_')
    """
    return _POSITION.sub("", label)


def from_arpabet(label: str) -> str | None:
    """IPA of an ARPAbet label, stress digit and position allowed; None if it is none.

    Examples
    --------
    >>> from_arpabet("AY1"), from_arpabet("hh"), from_arpabet("AH0_B"), from_arpabet("pcl"), from_arpabet("?")
    ('aɪ', 'h', 'ə', 'p', None)
    """
    plain = without_position(label).upper()
    return ARPABET[plain] if plain in ARPABET else ARPABET.get(plain.rstrip("012"))
