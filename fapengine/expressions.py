"""The expressions of a face: one row each. All other places that need their names take them from here.

The standard's FAP 2 has the first six (:data:`fapengine.mpeg4.fap.FAP_2_EXPRESSIONS`); the others are our own. A
profile holds poses for the standard's; ours are mixed from its joy (:mod:`fapengine.trajectory.expression`). To add an
expression, add a row.
"""

from dataclasses import dataclass
from enum import IntEnum

from fapengine.mpeg4.fap import FAP_2_EXPRESSIONS


@dataclass(frozen=True, slots=True)
class Mix:
    """A part of joy on one half of the face, with closed lips."""

    is_left: bool
    corner: float
    """Fraction of joy by which the corner of the lips is raised."""
    stretch: float
    """Fraction of joy by which the corner is drawn aside."""
    cheek: float
    """Fraction of joy by which cheek and lids of that half are raised."""
    lids: float = 0.0
    """How far both upper lids sink, FAPU."""


class Expression(IntEnum):
    """An expression by its number: the six of FAP 2, 0 for none, and from 7 on our own, which FAP 2 cannot express."""

    _value_: int
    synonyms: tuple[str, ...]
    """Other names that senders use."""
    mix: Mix | None
    """How an expression of our own is made of joy; None for the standard's."""

    def __new__(cls, number: int, synonyms: tuple[str, ...] = (), mix: Mix | None = None) -> "Expression":
        """Make a member of a row."""
        member = int.__new__(cls, number)
        member._value_, member.synonyms, member.mix = number, synonyms, mix
        return member

    # fmt: off
    NEUTRAL     = 0, ("neutral", "none")
    JOY         = 1, ("happy", "happiness", "smile")
    SADNESS     = 2, ("sad",)
    ANGER       = 3, ("angry",)
    FEAR        = 4, ("afraid", "scared", "fearful")
    DISGUST     = 5, ("disgusted",)
    SURPRISE    = 6, ("surprised",)
    SMILE_LEFT  = 7, ("smirk",), Mix(is_left=True,  corner=1.0, stretch=0.9,  cheek=0.8)
    SMILE_RIGHT = 8, (),         Mix(is_left=False, corner=1.0, stretch=0.9,  cheek=0.8)
    CONTEMPT    = 9, (),         Mix(is_left=True,  corner=0.6, stretch=0.25, cheek=0.35, lids=170.0)
    # fmt: on
    """Contempt is Ekman's unilateral one: a tightened and raised corner below heavy lids."""

    @property
    def label(self) -> str:
        """Its name in texts, files and messages, such as ``smile_left``."""
        return self.name.lower()

    @property
    def is_standard(self) -> bool:
        """Whether FAP 2 has it."""
        return self < len(FAP_2_EXPRESSIONS)


EXPRESSIONS = tuple(expression for expression in Expression if expression)
"""All but the neutral one; the index is the column of levels and the channel of ramps."""
STANDARD_EXPRESSIONS = tuple(expression for expression in EXPRESSIONS if expression.is_standard)
EXPRESSION_NAMES = tuple(expression.label for expression in EXPRESSIONS)
