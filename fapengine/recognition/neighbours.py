"""Pronunciations of words that the dictionary lacks, put together from words that are spelled like them.

Theory of operation
-------------------
A word is covered by the fewest runs of letters that words of the dictionary have, and by the longest of these; its
beginning and end count as letters, so that a beginning is taken from a beginning. Runs overlap by a letter where they
can. Letters and phones of a word of the dictionary are aligned by which letter may spell which phone
(:data:`SPELLS`), so a run of letters has phones. Pronouncing by analogy is of Dedina and Nusbaum, "PRONOUNCE: a program
for pronunciation by analogy", Computer Speech and Language 5, 1991; theirs weighs many words, this takes one for a run.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

from fapengine.recognition.sphinx import VOWELS

SPELLS: Mapping[str, frozenset[str]] = {
    letter: frozenset(names.split())
    for letter, names in {
        "b": "B", "c": "K S CH SH", "d": "D T JH", "f": "F V", "g": "G JH ZH NG F", "h": "HH", "j": "JH Y HH ZH",
        "k": "K", "l": "L", "m": "M", "n": "N NG", "p": "P F", "q": "K", "r": "R ER", "s": "S Z SH ZH", "v": "V F",
        "t": "T TH DH CH SH D", "w": "W V UW AW", "x": "K S G Z", "y": "Y", "z": "Z S T ZH", "u": "W Y", "i": "Y",
        "o": "W", "e": "Y",
    }.items()
}  # fmt: skip
"""Consonants that a letter may spell; :data:`VOWEL_LETTERS` spell all vowels."""
VOWEL_LETTERS = frozenset("aeiouy")
UNLIKELY, SILENT, DOUBLE = 3.0, 0.4, 0.5
"""Costs of a letter with a phone that it does not spell, without a phone, and with one more."""
EDGE = "#"
_MAX_LETTERS = 40


class Neighbours:
    """Speaks words by a dictionary. Stateful: it remembers the dictionary in the form that it looks for runs in.

    Parameters
    ----------
    dictionary : iterable of (word, phones)
        In lower case, with the model's phones.

    Examples
    --------
    >>> spoken = Neighbours([("lobster", "L AA B S T ER".split()), ("zone", "Z OW N".split())])
    >>> spoken.pronounce("zobster")
    ['Z', 'AA', 'B', 'S', 'T', 'ER']
    """

    def __init__(self, dictionary: Iterable[tuple[str, Sequence[str]]]) -> None:
        self._phones = {word: list(phones) for word, phones in dictionary if word.isalpha() and word.isascii()}

    @cached_property
    def _text(self) -> str:
        return "\n" + "\n".join(f"{EDGE}{word}{EDGE}" for word in self._phones) + "\n"

    def pronounce(self, word: str) -> list[str]:
        """Phones of the model for a word; none where it has characters other than letters, or too many."""
        letters = "".join(letter for letter in word.lower() if letter != "'")
        if not letters or len(letters) > _MAX_LETTERS or not (letters.isalpha() and letters.isascii()):
            return []
        edged = f"{EDGE}{letters}{EDGE}"
        runs = self._runs(edged)
        found: list[str] = []
        for index, (first, behind) in enumerate(runs):
            until = behind if index + 1 == len(runs) else max(runs[index + 1][0], first)
            found += self._spoken(edged[first:behind])[: until - first]
        return " ".join(found).split()

    def _runs(self, edged: str) -> list[tuple[int, int]]:
        """Cover a word by runs: first letter, and the one after the last."""
        longest = []
        behind = 0
        for first in range(len(edged)):
            behind = max(behind, first + 1)
            while behind < len(edged) and edged[first : behind + 1] in self._text:
                behind += 1
            longest.append(behind)
        runs = [(0, longest[0])]
        while runs[-1][1] < len(edged):
            first, behind = runs[-1]
            # the run that reaches farthest, and of those the one that begins first, with most overlap
            start = max(range(first + 1, behind + 1), key=lambda place: (longest[place], -place))
            runs.append((start, longest[start]))
        return runs

    def _place(self, run: str) -> int:
        """Places of a run in the dictionary; if possible not next to half of a double letter."""
        first = at = self._text.find(run)
        while at >= 0:
            if self._text[at - 1] != run[0] and self._text[at + len(run)] != run[-1]:
                return at
            at = self._text.find(run, at + 1)
        return first

    def _spoken(self, run: str) -> list[str]:
        """Phones of each letter of a run, with blanks between; an edge has none."""
        at = self._place(run)
        if at < 0:  # a letter that no word has
            return [""] * len(run)
        start = self._text.rfind("\n", 0, at) + 1
        word = self._text[start : self._text.find("\n", start)].strip(EDGE)
        shares = ["", *beside(word, self._phones[word]), ""]
        return shares[at - start : at - start + len(run)]


def beside(word: str, phones: Sequence[str]) -> list[str]:
    """Align the phones of a word with its letters: those of each letter, with blanks between.

    Examples
    --------
    >>> beside("lobsters", "L AA B S T ER Z".split())
    ['L', 'AA', 'B', 'S', 'T', 'ER', '', 'Z']
    """
    rows: list[list[tuple[float, int]]] = [[(0.0, 0)] + [(float("inf"), 0)] * len(phones)]
    for letter in word:
        row = []
        for count in range(len(phones) + 1):
            options = [(rows[-1][count][0] + SILENT, 0)]
            for own in (1, 2):
                if count >= own:
                    cost = sum(0.0 if _may_spell(letter, name) else UNLIKELY for name in phones[count - own : count])
                    options.append((rows[-1][count - own][0] + cost + DOUBLE * (own - 1), own))
            row.append(min(options))
        rows.append(row)
    shares: list[str] = []
    count = len(phones)
    for row in reversed(rows[1:]):
        own = row[count][1]
        shares.append(" ".join(phones[count - own : count]))
        count -= own
    return shares[::-1]


def _may_spell(letter: str, name: str) -> bool:
    return name in SPELLS.get(letter, ()) or (letter in VOWEL_LETTERS and name in VOWELS)
