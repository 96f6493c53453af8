"""FAP interpolation tables (FIT): FAPs that were not sent, computed from those that were.

A table is a graph. A node is a list of FAPs; a link says how each FAP of its child follows from the FAPs of its parent,
as a quotient of polynomials with rational exponents. A node is computed from its parent of the lowest priority number
whose FAPs are all known. A FAP that was sent is never replaced.

The text format (``.fit``) is that of the reference software of ISO/IEC 14496-5, ``video/snhc/FIT``: integers, separated
by white space::

    nodes      then per node:  count  fap ...
    links      then per link:  from  to  priority, and per FAP of node "to" a numerator and a denominator
    polynomial:  terms, and if there are any: divisor, then per term
                 sign (0 plus, 1 minus)  coefficient  factors, then per factor
                 index in node "from"  exponent's numerator  exponent's denominator

Deviation: the format's text says that priorities are greater than 1, its example has 1; 1 is accepted. A polynomial
without terms is read as 0 in a numerator and as 1 in a denominator, as the example seems to mean. Where a value is not
real or not finite, the FAP stays unknown. FAP 1 and 2 are not single numbers: a node that has one of them is never
known and never computed.

Deviation: the standard's formula for mask type 2 is not known here. The table :data:`PARTNERS` has the rules of FBA
section 9; a FIT table of your own replaces it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.codec.decoder import Decoded
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

MAX_NUMBER = 2**31 - 1
FIRST_LOW_LEVEL = 3


@dataclass(frozen=True, slots=True)
class Term:
    """A coefficient times powers of the parent's FAPs."""

    coefficient: int
    powers: tuple[tuple[int, int, int], ...] = ()
    """Index in the parent node, and numerator and denominator of the exponent."""


@dataclass(frozen=True, slots=True)
class Polynomial:
    """A sum of terms over a divisor."""

    terms: tuple[Term, ...] = ()
    divisor: int = 1

    def __call__(self, values: Array, empty: float) -> Array:
        """Evaluate for (N, P) values of the parent's FAPs; ``empty`` is the value of a polynomial without terms."""
        if not self.terms:
            return np.full(len(values), empty)
        total = np.zeros(len(values))
        for term in self.terms:
            product = np.full(len(values), float(term.coefficient))
            for index, numerator, denominator in term.powers:
                product *= values[:, index] ** (numerator / denominator)
            total += product
        return total / self.divisor


@dataclass(frozen=True, slots=True)
class Link:
    """How the FAPs of a child node follow from those of its parent."""

    parent: int
    child: int
    priority: int
    """1 is tried first."""
    quotients: tuple[tuple[Polynomial, Polynomial], ...]
    """Numerator and denominator of each FAP of the child."""

    def evaluate(self, values: Array) -> Array:
        """Compute the child's FAPs, (N, C) float64, from the parent's, (N, P) float64; NaN where there is no value."""
        with np.errstate(all="ignore"):
            columns = [above(values, 0.0) / below(values, 1.0) for above, below in self.quotients]
        computed = np.stack(columns, axis=1)
        return np.where(np.isfinite(computed), computed, np.nan)


@dataclass(frozen=True, slots=True)
class Fit:
    """A FAP interpolation table."""

    nodes: tuple[tuple[int, ...], ...]
    """FAP numbers of each node, 1..68."""
    links: tuple[Link, ...]

    def __post_init__(self) -> None:
        if not all(self.nodes):
            raise UsageError("FIT: got a node without FAPs, expected at least one")
        for number in (number for node in self.nodes for number in node):
            if not 1 <= number <= fap.FAP_COUNT:
                raise UsageError(f"FIT: got FAP {number}, expected 1 to {fap.FAP_COUNT}")
        for link in self.links:
            for end in (link.parent, link.child):
                if not 0 <= end < len(self.nodes):
                    raise UsageError(f"FIT: got a link to node {end}, expected 0 to {len(self.nodes) - 1}")
            if len(link.quotients) != len(self.nodes[link.child]):
                counts = f"{len(link.quotients)} quotients for {len(self.nodes[link.child])} FAPs"
                raise UsageError(f"FIT: got {counts} of node {link.child}, expected one each")
            parents = len(self.nodes[link.parent])
            factors = [
                power for pair in link.quotients for side in pair for term in side.terms for power in term.powers
            ]
            if any(not 0 <= index < parents for index, _, _ in factors):
                raise UsageError(f"FIT: got an index outside node {link.parent}, which has {parents} FAPs")

    def fill(self, values: Array, known: NDArray[np.bool_], wanted: NDArray[np.bool_]) -> int:
        """Compute what is wanted and not known, in place, until nothing more follows.

        Parameters
        ----------
        values : (T, 68) float64, FAPU
            Used where known; computed values are written here.
        known : (T, 68) bool
            Values that were sent, or are known otherwise; set for what is computed.
        wanted : (T, 68) bool
            What may be computed.

        Returns
        -------
        int
            Values that could not be computed because they are not real numbers.
        """
        links = [
            (link, fap.columns(*self.nodes[link.parent]), fap.columns(*self.nodes[link.child]))
            for link in sorted(self.links, key=lambda link: link.priority)
            if min(self.nodes[link.parent] + self.nodes[link.child]) >= FIRST_LOW_LEVEL
        ]
        unreal = np.zeros_like(known)
        while True:
            before = known.sum()
            for link, parent, child in links:
                open_ = wanted[:, child] & ~known[:, child]
                rows = np.flatnonzero(known[:, parent].all(axis=1) & open_.any(axis=1))
                if not len(rows):
                    continue
                computed = link.evaluate(values[rows[:, None], parent])
                real = open_[rows] & np.isfinite(computed)
                at = rows[:, None], child
                values[at] = np.where(real, computed, values[at])
                known[at] |= real
                unreal[at] |= open_[rows] & ~real
            if known.sum() == before:
                return int((unreal & ~known).sum())


def parse_fit(data: bytes) -> Fit:
    """Parse the text of a ``.fit`` file.

    Raises
    ------
    DataError
        If it is not such a table; the message says at which number.
    """
    numbers = _Numbers(data)
    nodes = tuple(
        tuple(numbers.take("a FAP", 1, fap.FAP_COUNT) for _ in range(numbers.count("FAPs")))
        for _ in numbers.each("nodes")
    )
    links = tuple(_link(numbers, nodes) for _ in numbers.each("links"))
    if numbers.left():
        raise DataError(f"{numbers.left()} numbers follow the last link", where=numbers.where)
    return Fit(nodes, links)


class _Numbers:
    """The integers of a file, one after the other. Stateful."""

    def __init__(self, data: bytes) -> None:
        self._words = data.split()
        self._at = 0

    @property
    def where(self) -> str:
        return f"number {self._at + 1}"

    def left(self) -> int:
        return len(self._words) - self._at

    def take(self, what: str, low: int, high: int = MAX_NUMBER) -> int:
        if not self.left():
            raise TruncatedError(f"the table ends where {what} is expected", where=self.where)
        word = self._words[self._at]
        if not (word.isdigit() and len(word) <= len(str(MAX_NUMBER)) and low <= int(word) <= high):
            shown = word[:20].decode("ascii", "replace")
            raise DataError(f"{what}: got {shown!r}, expected an integer {low} to {high}", where=self.where)
        self._at += 1
        return int(word)

    def count(self, what: str, low: int = 1) -> int:
        return self.take(f"the number of {what}", low)

    def each(self, what: str) -> Iterator[int]:
        """Go through as many things as the next number says."""
        return iter(range(self.count(what, 0)))


def _link(numbers: _Numbers, nodes: tuple[tuple[int, ...], ...]) -> Link:
    parent, child = (
        numbers.take(f"the node that a link {what}", 0, len(nodes) - 1) for what in ("comes from", "leads to")
    )
    priority = numbers.take("a priority", 1)
    quotients = tuple(
        (_polynomial(numbers, len(nodes[parent])), _polynomial(numbers, len(nodes[parent]))) for _ in nodes[child]
    )
    return Link(parent, child, priority, quotients)


def _polynomial(numbers: _Numbers, parents: int) -> Polynomial:
    terms: list[Term] = []
    count = numbers.count("terms", 0)
    if not count:
        return Polynomial()
    divisor = numbers.take("a divisor", 1)
    for _ in range(count):
        sign = 1 - 2 * numbers.take("a sign", 0, 1)
        coefficient = sign * numbers.take("a coefficient", 0)
        powers = tuple(
            (
                numbers.take("an index of a FAP", 0, parents - 1),
                numbers.take("an exponent", 0),
                numbers.take("an exponent's denominator", 1),
            )
            for _ in numbers.each("factors")
        )
        terms.append(Term(coefficient, powers))
    return Polynomial(tuple(terms), divisor)


LIP_PARTNERS = tuple(zip(range(4, 14), range(51, 61), strict=True))
"""Inner and outer lip FAPs; each fills the other."""
SIDE_PARTNERS = (
    (6, 7), (8, 9), (10, 11), (12, 13), (19, 20), (21, 22), (23, 24), (25, 26), (27, 28), (29, 30), (31, 32), (33, 34),
    (35, 36), (37, 38), (39, 40), (41, 42), (53, 54), (55, 56), (57, 58), (59, 60), (61, 62), (65, 66), (67, 68),
)  # fmt: skip
"""The value is copied unchanged: units and positive directions of each pair are mirror images."""
INTERPOLATED = 2
"""Mask type of groups whose FAPs that are not sent are interpolated."""
LOW_LEVEL = slice(fap.column(3), None)
_COPY = ((Polynomial((Term(1, ((0, 1, 1),)),)), Polynomial()),)
PARTNERS = Fit(
    tuple((number,) for number in range(1, fap.FAP_COUNT + 1)),
    tuple(
        Link(fap.column(parent), fap.column(child), priority, _COPY)
        for priority, pairs in ((1, LIP_PARTNERS), (2, SIDE_PARTNERS))
        for pair in pairs
        for parent, child in (pair, pair[::-1])
    ),
)
"""The rules of mask type 2."""


def fill(
    values: NDArray[np.int32], known: NDArray[np.bool_], wanted: NDArray[np.bool_], table: Fit = PARTNERS
) -> tuple[NDArray[np.int32], int]:
    """Low-level FAPs that a face shows: computed by a table, else held.

    Parameters
    ----------
    values : (T, 68) int32, FAPU
        Used where known.
    known : (T, 68) bool
        FAPs that were sent.
    wanted : (T, 68) bool
        FAPs that the table may compute.
    table : Fit

    Returns
    -------
    values : (T, 68) int32, FAPU
        What neither was sent nor follows from the table keeps its last value; 0 at first.
    unreal : int
        Values that the table gives no real number for.
    """
    filled, known = values.astype(np.float64), known.copy()
    unreal = table.fill(filled, known, wanted)
    last = np.maximum.accumulate(np.where(known, np.arange(1, len(values) + 1)[:, None], 0), axis=0)
    held = np.take_along_axis(filled, np.maximum(last - 1, 0), axis=0)
    limits = np.iinfo(np.int32)
    return np.where(last > 0, np.rint(held.clip(limits.min, limits.max)), 0).astype(np.int32), unreal


def fill_track(decoded: Decoded, track: FapTrack | None = None, table: Fit | None = None) -> tuple[FapTrack, int]:
    """Return the track that a face shows: every low-level FAP of every frame.

    Parameters
    ----------
    decoded : Decoded
        Its mask types say which FAPs are interpolated.
    track : FapTrack, optional
        Its track, after FAP 1 and 2 were replaced by what they show; by default as it was sent.
    table : Fit, optional
        Computes FAPs of all groups that were not sent; by default :data:`PARTNERS` computes those of type 2.

    Returns
    -------
    FapTrack
    unreal : int
        As :func:`fill`.
    """
    track = track or decoded.track
    wanted = np.ones_like(track.mask)
    if table is None:
        group_of = [next(k for k, group in enumerate(fap.GROUPS) if number in group) for number in range(3, 69)]
        types = [
            np.broadcast_to(np.array(part.header.mask_types)[group_of], (len(part), 66)) for part in decoded.planes
        ]
        wanted[:, LOW_LEVEL] = np.concatenate(types) == INTERPOLATED
    values, unreal = fill(track.values, track.mask, wanted, table or PARTNERS)
    mask = track.mask.copy()
    mask[:, LOW_LEVEL] = True
    return replace(track, values=values, mask=mask), unreal
