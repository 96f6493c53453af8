"""Answers of a listening test: whom people prefer, with intervals, and who failed the attention checks.

The page (:mod:`fapengine.app.listening`) shows the same utterance by two systems and asks which fits its speech better.
Attention checks show one film twice, once with a picture that stands still. Who chooses the standing one in more than
a quarter of the checks is left out, and counted.
"""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from fapengine.errors import DataError
from fapengine.scoring.statistics import Estimate, estimate, share_test

COLUMNS = ("listener", "seed", "trial", "item", "left", "right", "choice", "seconds", "plays")
"""Columns of the page's CSV; ``left`` and ``right`` are systems, ``choice`` is the side that was chosen."""
MOVING, STILL = "moving", "still"
"""What attention checks have in place of systems."""
MIN_PASSED = 0.75
"""Least share of attention checks that a listener passes; our choice."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One choice of one listener."""

    listener: str
    item: str
    chosen: str
    """System, or :data:`MOVING` or :data:`STILL` in an attention check."""
    other: str
    line: tuple[str, ...] = ()
    """Its row of the table, by which an answer that was saved twice is known."""

    @property
    def is_check(self) -> bool:
        """Whether this is an attention check."""
        return {self.chosen, self.other} == {MOVING, STILL}


@dataclass(frozen=True, slots=True, kw_only=True)
class Preference:
    """Whom the listeners prefer."""

    system: str
    other: str
    chosen: int
    """How often ``system`` was chosen over ``other``."""
    answers: int
    share: float
    """``chosen / answers``."""
    low: float
    """Lower end of its exact 95 % binomial interval."""
    high: float
    p: float
    """Two-sided p of the exact binomial test against equal chances."""
    over_listeners: Estimate
    """The same share, with a bootstrap interval over listeners: answers of one person depend on each other."""
    by_item: Mapping[str, float]
    """Share by utterance."""
    listeners: int
    """Number of listeners that count."""
    excluded: Mapping[str, float]
    """Listeners that were left out, and the share of attention checks that each passed."""


def parse_answers(data: bytes) -> list[Answer]:
    """Read the CSV of a listener, or of several one below the other.

    Raises
    ------
    DataError
        If it is not such a table; ``where`` is the line.
    """
    try:
        rows = list(csv.reader(io.StringIO(data.decode("utf-8-sig")), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"answers: is not a table of UTF-8 text: {error}") from error
    if not rows or tuple(rows[0]) != COLUMNS:
        raise DataError(f"answers: expected the columns {', '.join(COLUMNS)}", where="line 1")
    answers = []
    for line, row in enumerate(rows[1:], 2):
        if not row or tuple(row) == COLUMNS:
            continue
        cells = dict(zip(COLUMNS, row, strict=False))
        if len(row) != len(COLUMNS) or cells["choice"] not in ("left", "right"):
            raise DataError(
                f"answers: got {','.join(row)!r:.80}, expected a choice of left or right", where=f"line {line}"
            )
        other = "right" if cells["choice"] == "left" else "left"
        answers.append(Answer(cells["listener"], cells["item"], cells[cells["choice"]], cells[other], tuple(row)))
    return answers


def preference_of(answers: Iterable[Answer], *, seed: int = 1) -> Preference:
    """Analyse a listening test of two systems. The same row twice is one answer: people save and send files again.

    Raises
    ------
    DataError
        If there is no answer of a listener that counts, or the answers are not about two systems.
    """
    answers = list(dict.fromkeys(answers))
    checks = [answer for answer in answers if answer.is_check]
    shares = _shares((answer.listener, answer.chosen == MOVING) for answer in checks)
    excluded = {listener: share for listener, (share, _) in shares.items() if share < MIN_PASSED}
    pairs = [answer for answer in answers if not answer.is_check and answer.listener not in excluded]
    systems = sorted({name for answer in pairs for name in (answer.chosen, answer.other)})
    if len(systems) != 2:
        raise DataError(
            f"answers: got {len(pairs)} about {', '.join(systems) or 'no system'} of listeners that count"
            f" ({len(excluded)} left out), expected answers about two systems"
        )
    wins = [answer.chosen == systems[0] for answer in pairs]
    if sum(wins) * 2 < len(wins):
        systems, wins = systems[::-1], [not won for won in wins]
    chosen = sum(wins)
    by_listener = _shares(zip((answer.listener for answer in pairs), wins, strict=True))
    by_item = _shares(zip((answer.item for answer in pairs), wins, strict=True))
    low, high, p = share_test(chosen, len(wins))
    return Preference(
        system=systems[0],
        other=systems[1],
        chosen=chosen,
        answers=len(wins),
        share=chosen / len(wins),
        low=low,
        high=high,
        p=p,
        over_listeners=estimate(*zip(*by_listener.values(), strict=True), seed=seed),
        by_item={item: share for item, (share, _) in by_item.items()},
        listeners=len(by_listener),
        excluded=excluded,
    )


def _shares(pairs: Iterable[tuple[str, bool]]) -> dict[str, tuple[float, int]]:
    """Share of true values, and number of values, by name."""
    values: dict[str, list[bool]] = {}
    for name, value in pairs:
        values.setdefault(name, []).append(value)
    return {name: (sum(each) / len(each), len(each)) for name, each in values.items()}
