"""``PhoneSet``: what the labels of one speech tool mean in IPA, as data."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PhoneSet:
    """One phone set."""

    name: str
    source: str
    """Source of the table."""
    version: str
    """Version or date of the source."""
    table: Mapping[str, str]
    """Label to IPA; silence is the empty string."""
    joins: bool = False
    """True where a label may be several spellings of the table in a row, the longest first."""
    ignored: str = ""
    """Characters without a visible effect: tones, diacritics."""
    read: Callable[[str], str | None] | None = None
    """Function from a label to IPA, for spellings beyond a table; it returns None for an unknown label."""

    def to_ipa(self, label: str) -> str | None:
        """IPA of a label, empty for silence; None for a label outside this set."""
        if label in self.table:
            return self.table[label]
        if self.read is not None:
            return self.read(label)
        rest = label.strip(self.ignored)
        if not self.joins or not rest:
            return self.table.get(rest)
        return joined(rest, self.table, self.ignored)


def joined(text: str, table: Mapping[str, str], ignored: str = "") -> str | None:
    """IPA of several spellings in a row, the longest first; None where one is not in the table.

    Examples
    --------
    >>> joined("tS_a", {"tS": "tʃ", "t": "t", "a": "a"}, "_"), joined("tx", {"t": "t"})
    ('tʃa', None)
    """
    pieces = split_longest(text, table, ignored)
    return None if pieces is None else "".join(table.get(piece, "") for piece in pieces)


def split_longest(text: str, known: Collection[str], ignored: str = "") -> list[str] | None:
    """Split a text into known pieces, the longest first, and ignored characters; None if that is impossible."""
    longest = max(map(len, known))
    pieces: list[str] = []
    while text:
        width = next((n for n in range(longest, 0, -1) if text[:n] in known), 0)
        if not width and text[0] not in ignored:
            return None
        pieces.append(text[: max(width, 1)])
        text = text[len(pieces[-1]) :]
    return pieces
