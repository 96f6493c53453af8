"""Visemes and expressions, the values of FAP 1 and 2: ISO/IEC 14496-2, Annex C, Tables C.4 and C.5."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Viseme:
    """One row of the viseme table."""

    number: int
    label: str
    """Short label in common use; ``sil`` for 0."""
    phonemes: tuple[str, ...]
    """IPA. The table lists SAMPA; rewritten once here."""
    example: str


# fmt: off
VISEMES: tuple[Viseme, ...] = (
    Viseme(number=0,  label="sil", phonemes=(),                example=""),
    Viseme(number=1,  label="PP",  phonemes=("p", "b", "m"),   example="put, bed, mill"),
    Viseme(number=2,  label="FF",  phonemes=("f", "v"),        example="far, voice"),
    Viseme(number=3,  label="TH",  phonemes=("θ", "ð"),        example="think, that"),
    Viseme(number=4,  label="DD",  phonemes=("t", "d"),        example="tip, doll"),
    Viseme(number=5,  label="kk",  phonemes=("k", "ɡ"),        example="call, gas"),
    Viseme(number=6,  label="CH",  phonemes=("tʃ", "dʒ", "ʃ"), example="chair, join, she"),
    Viseme(number=7,  label="SS",  phonemes=("s", "z"),        example="sir, zeal"),
    Viseme(number=8,  label="nn",  phonemes=("n", "l"),        example="lot, not"),
    Viseme(number=9,  label="RR",  phonemes=("r",),            example="red"),
    Viseme(number=10, label="aa",  phonemes=("ɑː",),           example="car"),
    Viseme(number=11, label="E",   phonemes=("e",),            example="bed"),
    Viseme(number=12, label="ih",  phonemes=("ɪ",),            example="tip"),
    Viseme(number=13, label="oh",  phonemes=("ɒ",),            example="top"),
    Viseme(number=14, label="ou",  phonemes=("ʊ",),            example="book"),
)
# fmt: on

FULL_WEIGHT = 63
"""Blend of a viseme, or intensity of an expression, that is shown alone."""
FAP_2_EXPRESSIONS = ("neutral", "joy", "sadness", "anger", "fear", "disgust", "surprise")
"""Expressions of FAP 2 by their numbers; 0 is no expression."""
