r"""X-SAMPA whole: letters, modifiers, ejectives, implosives, clicks.

J. C. Wells, "Computer-coding the IPA" (1995, revised 2000). SAMPA of a language (MBROLA, MARY, BAS) is a subset but for
the archiphonemes of French, ``E/`` and its like, which leave open which of two vowels is meant. A modifier is ``_`` and
one character (two if the second is a backslash); it becomes the diacritic of the IPA, so that what is seen, rounding
and nasality, is kept, and the rest falls away where the face is moved.
"""

import unicodedata

# fmt: off
LETTERS: dict[str, str] = {  # longest spellings are tried first
    "A": "ɑ", "B": "β", "C": "ç", "D": "ð", "E": "ɛ", "F": "ɱ", "G": "ɣ", "H": "ɥ", "I": "ɪ", "J": "ɲ", "K": "ɬ",
    "L": "ʎ", "M": "ɯ", "N": "ŋ", "O": "ɔ", "P": "ʋ", "Q": "ɒ", "R": "ʁ", "S": "ʃ", "T": "θ", "U": "ʊ", "V": "ʌ",
    "W": "ʍ", "X": "χ", "Y": "ʏ", "Z": "ʒ", "{": "æ", "}": "ʉ", "@": "ə", "@`": "ɚ", "1": "ɨ", "2": "ø", "3": "ɜ",
    "3`": "ɝ", "4": "ɾ", "5": "ɫ", "6": "ɐ", "7": "ɤ", "8": "ɵ", "9": "œ", "&": "ɶ", "?": "ʔ", "?\\": "ʕ",
    "r\\": "ɹ", "R\\": "ʀ", "s\\": "ɕ", "z\\": "ʑ", "x\\": "ɧ", "h\\": "ɦ", "H\\": "ʜ", "j\\": "ʝ", "J\\": "ɟ",
    "p\\": "ɸ", "v\\": "ʋ", "B\\": "ʙ", "G\\": "ɢ", "N\\": "ɴ", "L\\": "ʟ", "M\\": "ɰ", "O\\": "ʘ", "X\\": "ħ",
    "K\\": "ɮ", "l\\": "ɺ", "r\\`": "ɻ", "l`": "ɭ", "n`": "ɳ", "r`": "ɽ", "s`": "ʂ", "t`": "ʈ", "z`": "ʐ",
    "d`": "ɖ", "u\\": "ʊ", "I\\": "ɪ", "U\\": "ʊ", "3\\": "ɞ", "@\\": "ɘ",
    "<\\": "ʢ", ">\\": "ʡ", "|\\": "ǀ", "!\\": "ǃ", "=\\": "ǂ", "|\\|\\": "ǁ",
    "b_<": "ɓ", "d_<": "ɗ", "g_<": "ɠ", "J\\_<": "ʄ", "G\\_<": "ʛ",
    "E/": "ɛ", "A/": "a", "&/": "ø", "O/": "ɔ", "U~/": "œ̃",                    # SAMPA of French: e or ɛ, a or ɑ ...
    **{letter: letter for letter in "abcdefhijklmnopqrstuvwxyz"}, "g": "ɡ",
}
MARKS: dict[str, str] = {  # what follows a letter and changes it
    "_>": "ʼ", "_0": "̥", "_v": "̬", "_h": "ʰ", "_t": "̤", "_k": "̰", "_N": "̼", "_d": "̪", "_a": "̺", "_m": "̻", "_O": "̹",
    "_c": "̜", "_+": "̟", "_-": "̠", '_"': "̈", "_x": "̽", "=": "̩", "_=": "̩", "_^": "̯", "_w": "ʷ", "'": "ʲ", "_j": "ʲ",
    "_G": "ˠ", "_?\\": "ˤ", "_e": "̴", "_r": "̝", "_o": "̞", "~": "̃", "_~": "̃", "_n": "ⁿ", "_l": "ˡ", "_}": "̚", "_A": "̘",
    "_q": "̙", "_X": "̆", "`": "˞", ":": "ː", ":\\": "ˑ", "_<": "",
}
# fmt: on
UNSEEN = (
    "_T",
    "_H",
    "_M",
    "_L",
    "_B",
    "_F",
    "_R",
    "_/",
    "_\\",
    "<F>",
    "<R>",
    "-\\",
    "_",
    "-",
    ".",
    "||",
    "|",
    "^",
    "!",
)
"""Tones, breaks and joins: nothing of them is seen."""
_PIECES = {**LETTERS, **MARKS, **dict.fromkeys(UNSEEN, ""), '"': "", "%": ""}
_MAX_LETTERS = max(map(len, _PIECES))


def from_xsampa(label: str) -> str | None:
    r"""IPA of an X-SAMPA label; None if it is none.

    Letters of the IPA that ASCII lacks are no X-SAMPA.

    Examples
    --------
    >>> from_xsampa("tS"), from_xsampa("A:"), from_xsampa("r\\"), from_xsampa("§")
    ('tʃ', 'ɑː', 'ɹ', None)
    >>> from_xsampa("p_h"), from_xsampa("b_<"), from_xsampa("|\\|\\"), from_xsampa("_h")
    ('pʰ', 'ɓ', 'ǁ', None)
    >>> from_xsampa("s_m") == "s\u033b"
    True
    """
    out, letters, rest = "", 0, label
    while rest:
        width = next((n for n in range(min(_MAX_LETTERS, len(rest)), 0, -1) if rest[:n] in _PIECES), 0)
        if not width:
            return None
        out += _PIECES[rest[:width]]
        letters += rest[:width] in LETTERS
        rest = rest[width:]
    return unicodedata.normalize("NFC", out) if letters else None
