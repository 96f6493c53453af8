"""``PhoneSet``: what the labels of one speech tool mean in IPA, as data."""

from collections.abc import Callable, Mapping
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
    """Characters that change nothing that is seen: tones, diacritics."""
    read: Callable[[str], str | None] | None = None
    """Function from a label to IPA, for spellings that a table alone cannot hold; None for what it does not know."""

    def to_ipa(self, label: str) -> str | None:
        """IPA of a label, empty for silence; None if it is none of this set."""
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
    longest = max(map(len, table))
    out, rest = "", text
    while rest:
        width = next((n for n in range(min(longest, len(rest)), 0, -1) if rest[:n] in table), 0)
        if not width and rest[0] not in ignored:
            return None
        out += table.get(rest[:width], "")
        rest = rest[max(width, 1) :]
    return out
