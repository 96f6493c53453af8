"""Visemes and expressions, the values of FAP 1 and 2: ISO/IEC 14496-2, Annex C, Tables C.4 and C.5."""

from dataclasses import dataclass

from fapengine.mpeg4.fap import read_rows


@dataclass(frozen=True, slots=True)
class Viseme:
    """One row of the viseme table."""

    number: int
    label: str
    """Short label in common use; ``sil`` for 0."""
    phonemes: tuple[str, ...]
    """IPA. The table lists SAMPA; rewritten once here."""
    example: str


VISEMES = tuple(
    Viseme(int(row["number"]), row["label"], tuple(row["phonemes"].split()), row["example"])
    for row in read_rows("visemes.csv")
)
FULL_WEIGHT = 63
"""Blend of a viseme, or intensity of an expression, that is shown alone."""
FAP_2_EXPRESSIONS = ("neutral", "joy", "sadness", "anger", "fear", "disgust", "surprise")
"""Expressions of FAP 2 by their numbers; 0 is no expression."""
