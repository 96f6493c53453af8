"""Cases and verdicts: running a suite, and formatting its results."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Generic, Literal, TypeVar

Subject = TypeVar("Subject")
Outcome = Literal["pass", "fail", "skip"]


class BreachError(Exception):
    """The program under test does not do what the document says."""


class NotTriedError(Exception):
    """The program under test did not do what the case is about."""


@dataclass(frozen=True, slots=True)
class Case(Generic[Subject]):
    """One requirement."""

    number: str
    section: str
    """Document and section."""
    says: str
    check: Callable[[Subject], None]
    """Raises :class:`BreachError` or :class:`NotTriedError`."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of a case."""

    number: str
    section: str
    says: str
    outcome: Outcome
    found: str = ""


def demand(is_so: object, found: str) -> None:
    """Raise :class:`BreachError` unless a condition is true."""
    if not is_so:
        raise BreachError(found)


def run(cases: Sequence[Case[Subject]], subject: Subject) -> list[Verdict]:
    """Run every case, also after failures.

    Examples
    --------
    >>> def is_even(number):
    ...     demand(number % 2 == 0, f"got {number}")
    >>> run([Case("1", "docs/x.md", "It is even.", is_even)], 3)[0].outcome
    'fail'
    """
    verdicts = []
    for case in cases:
        outcome: Outcome = "pass"
        found = ""
        try:
            case.check(subject)
        except BreachError as breach:
            outcome, found = "fail", str(breach)
        except NotTriedError as reason:
            outcome, found = "skip", str(reason)
        except Exception as error:  # noqa: BLE001  mostly caused by the program under test
            outcome, found = "fail", f"{type(error).__name__}: {error}"
        verdicts.append(Verdict(case.number, case.section, case.says, outcome, " ".join(found.split())[:300]))
    return verdicts


def table(verdicts: Sequence[Verdict]) -> str:
    """Format verdicts as text."""
    lines = []
    for verdict in verdicts:
        lines.append(f"{verdict.outcome:<5} {verdict.number:<6} {verdict.says}  [{verdict.section}]")
        if verdict.found:
            lines.append(f"{'':12} {verdict.found}")
    counts = {outcome: sum(one.outcome == outcome for one in verdicts) for outcome in ("pass", "fail", "skip")}
    lines.append(f"{counts['pass']} passed, {counts['fail']} failed, {counts['skip']} not tried")
    return "\n".join(lines)


def as_json(suite: str, verdicts: Sequence[Verdict]) -> str:
    """Format verdicts as JSON."""
    return json.dumps({"suite": suite, "cases": [asdict(verdict) for verdict in verdicts]}, indent=2)
