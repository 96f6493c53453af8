"""A long text in pieces that a voice speaks one after the other, so that others have their turn between them."""

import re

PIECE_LETTERS = 300
"""Letters of a piece; 300 of 字, read out in English, are 100 s of sound and 0.4 s of work of espeak-ng."""
_CUTS = (
    re.compile(r"\n+|\w{4,}[.!?…][\"'»”)]*\s+|[。！？]"),  # not behind "Dr."
    re.compile(r"[.!?…]\s+|[,;:]\s+|[、，；：]"),
    re.compile(r"\s+"),
)
"""Places where a text may be cut, the best first."""


def pieces_of(text: str, letters: int = PIECE_LETTERS) -> list[str]:
    """Cut a text into pieces, behind a sentence where one ends, else behind a comma, a word, or where it must be.

    Examples
    --------
    >>> pieces_of("I saw Dr. Lee. He slept, and then he woke.", 30)
    ['I saw Dr. Lee. He slept, ', 'and then he woke.']
    >>> pieces_of("The sentence ends. The next begins.", 30)
    ['The sentence ends. ', 'The next begins.']
    >>> "".join(pieces_of("x" * 1000)) == "x" * 1000, len(pieces_of("x" * 1000))
    (True, 4)
    """
    pieces = []
    while len(text) > letters:
        window = text[:letters]
        ends = ([found.end() for found in cut.finditer(window)] for cut in _CUTS)
        end = next((places[-1] for places in ends if places and places[-1] >= letters // 4), letters)
        pieces.append(text[:end])
        text = text[end:]
    return [*pieces, text] if text else pieces


def ends_sentence(piece: str) -> bool:
    """Whether a sentence ends with a piece, so that a longer pause follows.

    Examples
    --------
    >>> [ends_sentence(piece) for piece in ("He slept. ", "He slept, ", "睡了。")]
    [True, False, True]
    """
    return bool(re.search(r"[.!?…。！？\n][\"'»”)]*\s*$", piece))
