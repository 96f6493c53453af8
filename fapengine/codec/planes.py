"""Planes: the state that encoder and decoder share, and what the decoder returns (frames, blocks of planes, losses).

The state holds the ranges, steps, predictions and adaptive models of the fields.

Bodies
------
A body next to a face, or alone in a plane, is decoded only to find where it ends: no length is sent. Its header has the
layout of a face's, with 24 groups of body animation parameters (BAPs) instead of 10 of FAPs; their arithmetic data are
one segment, coded as a face's low-level FAPs are, group by group. The default ranges of BAPs are not known: a stream
that codes a BAP without having sent its four ranges is refused. Source of groups, scales and order: a public decoder of
the reference family (FBA section 16).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import read_rows
from fapengine.codec import kernels as k
from fapengine.codec.bits import BitReader, Bits
from fapengine.codec.fields import (
    EXPRESSION_FIELDS,
    FIELD_FAPS,
    FIELD_NAMES,
    LOW_LEVEL_FIELDS,
    SIGNS,
    UNIT,
    VISEME_FIELDS,
    Bools,
    Ints,
    apply_sent,
    default_ranges,
)
from fapengine.codec.header import IntraHeader, read_parameter_fields
from fapengine.errors import UnsupportedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FAP_2_EXPRESSIONS, VISEMES

SELECTS = ((len(VISEMES) - 1, (0, 1)), (len(FAP_2_EXPRESSIONS) - 1, (3, 5)))
"""Greatest value of viseme and expression selects, and their fields."""
BLENDS = (2, 4, 6)
"""Fields of blends and intensities."""
BLEND_TOP = 63
INT32_TOP = 2**31 - 1
STEPS = np.array([row.quantiser_step for row in fap.FAPS], np.int64)


class FieldState:
    """A table of coded fields, the last value of each, their adaptive models, and the registers of the coder.

    Stateful.
    """

    names: Sequence[str]
    """Name of each field, for error messages."""

    def __init__(self) -> None:
        count = len(self.names)
        self.fields: Ints = np.zeros((count, 8), np.int64)
        """(count, 8); the columns are named in :mod:`fapengine.codec.kernels`."""
        self.fields[:, k.STEP] = 1
        self.fields[:, k.MIN_VALUE], self.fields[:, k.MAX_VALUE] = -INT32_TOP, INT32_TOP
        self.previous: Ints = np.zeros(count, np.int64)
        self.found: Ints = np.zeros((4, count), np.int64)
        """The plane decoded last: values, ranks of symbols, and room for a second attempt."""
        self.flags: Ints = np.zeros(3, np.int64)
        """viseme_def, init_face, expression_def of that plane."""
        self._base: Ints = np.zeros(count, np.int64)
        self._counts, self._tree = np.zeros((2, 1), np.int32)
        self._totals: Ints = np.zeros(count, np.int64)
        self._coder: Ints = np.zeros(8, np.int64)
        self._positions: Ints = np.zeros(16, np.int64)

    @property
    def encoding(self) -> tuple[Any, ...]:
        """Arrays for the encoding loops."""
        return self._base, self._counts, self._tree, self._totals, self._coder

    @property
    def decoding(self) -> tuple[Any, ...]:
        """Arrays for the decoding loops."""
        return *self.encoding, self._positions

    def decode(self, intra: bool, bits: Bits, at: int, costs: NDArray[np.float64]) -> tuple[int, int]:
        """Decode the arithmetic data of one plane into ``found``; call :meth:`keep` to keep it.

        Parameters
        ----------
        bits : (N,) uint8
            Each 0 or 1; the plane begins at ``at``.
        costs : (FIELD_COUNT,) or (0,) float64
            Bits that each field takes are added to it.

        Returns
        -------
        status, end : int
            As :func:`~fapengine.codec.kernels.decode_settled`.
        """
        status, end = k.loops.decode_settled(
            intra, bits, at, self.fields, self.previous, self.decoding, self.found, self.flags, costs
        )
        return int(status), int(end)

    def keep(self, intra: bool) -> None:
        """Keep the plane decoded last: the next plane is predicted from it."""
        k.loops.keep_plane(intra, self.found, self.fields, self.previous, self.decoding)

    def _set_ranges(self, fields: slice, ranges: Ints) -> None:
        """Set the ranges of fields, (4, N) in symbols, and make the P models of all coded fields uniform."""
        i_max, i_min, p_max, p_min = ranges
        table = self.fields
        table[fields, k.I_MIN], table[fields, k.I_COUNT] = i_min, i_max - i_min + 1
        table[fields, k.P_MIN], table[fields, k.P_COUNT] = p_min, p_max - p_min + 1
        sizes = np.where(table[:, k.ON] != 0, table[:, k.P_COUNT] + 1, 0)
        self._base[1:] = np.cumsum(sizes)[:-1]
        room = int(sizes.sum()) + 1
        if room > len(self._counts):
            self._counts, self._tree = np.zeros((2, room), np.int32)
        k.loops.reset_models(table, self._base, self._counts, self._tree, self._totals)


class PlaneState(FieldState):
    """State of a face: set by I planes, changed by P planes.

    Stateful.
    """

    names = tuple(f"FAP {number} ({name})" for number, name in zip(FIELD_FAPS, FIELD_NAMES, strict=True))

    def __init__(self) -> None:
        super().__init__()
        for top, selects in SELECTS:
            self.fields[selects, k.MIN_VALUE], self.fields[selects, k.MAX_VALUE] = 0, top
        self.mask: Bools = np.zeros(fap.FAP_COUNT, bool)
        self.quant = 1
        self.ranges: Ints | None = None
        """(4, 66) in symbols; None before the first I plane."""

    def begin_intra(self, header: IntraHeader) -> None:
        """Set mask, quantiser and ranges, and reset the models (FBA sections 5 and 8)."""
        # Deviation: a decoder of the reference family loads the table again when FAP 4's I range was set to 0..0; here
        # ranges once set persist, and our encoder never sends 0..0 for FAP 4.

        before = default_ranges(header.quant) if self.ranges is None else self.ranges
        self.ranges = apply_sent(before, header.ranges, header.mask[2:], header.quant)
        self.mask, self.quant = header.mask, header.quant
        f = self.fields
        f[:, k.ON] = header.mask[np.array(FIELD_FAPS) - 1]
        for top, selects in SELECTS:
            f[selects, k.STEP] = 1
            f[selects, k.I_MIN : k.MIN_VALUE] = 0, top + 1, -top, 2 * top + 1
        top = blend_limit(header.quant)
        f[BLENDS, k.STEP] = max(header.quant, 1)
        f[BLENDS, k.I_MIN : k.MIN_VALUE] = 0, top + 1, -top, 2 * top + 1
        f[LOW_LEVEL_FIELDS, k.STEP] = STEPS * header.quant if header.quant else 1
        self._set_ranges(LOW_LEVEL_FIELDS, self.ranges)


def blend_limit(quant: int) -> int:
    """Largest symbol B of blends and intensities (FBA section 5).

    Examples
    --------
    >>> blend_limit(8), blend_limit(0)
    (8, 63)
    """
    return (BLEND_TOP + quant // 2) // quant if quant else BLEND_TOP


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One decoded plane."""

    number: int
    """Frame number from 0; skipped frames count."""
    time_s: float
    """Time according to the frame rates and time codes sent; from 0 without a time code."""
    intra: bool
    header: IntraHeader
    """Header of the I plane in force: masks, quantiser."""
    row: Ints
    """(73,) int64, values in the order of :mod:`fapengine.codec.fields`, FAPU; 0 where never sent."""
    flags: Ints
    """(3,) viseme_def, init_face, expression_def."""

    def fap(self, number: int) -> int:
        """Value of a low-level FAP, 3 to 68, in FAPU."""
        if not 3 <= number <= 68:
            raise UsageError(f"FAP: must be 3 to 68, got {number}")
        return int(self.row[LOW_LEVEL_FIELDS.start + number - 3])

    @property
    def values(self) -> Ints:
        """(68,) FAPU; 0 in the columns of FAP 1 and 2 and of FAPs that are not sent."""
        return np.concatenate([[0, 0], np.where(self.header.mask[2:], self.row[LOW_LEVEL_FIELDS], 0)])

    @property
    def viseme(self) -> tuple[int, ...]:
        """Select1, select2, blend, def; zeros where FAP 1 is not sent. The blend is not clamped."""
        return (*self.row[VISEME_FIELDS].tolist(), int(self.flags[0])) if self.header.mask[0] else (0,) * 4

    @property
    def expression(self) -> tuple[int, ...]:
        """Select1, intensity1, select2, intensity2, init_face, def; zeros where FAP 2 is not sent."""
        if not self.header.mask[1]:
            return (0,) * 6
        return (*self.row[EXPRESSION_FIELDS].tolist(), *self.flags[1:].tolist())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Planes:
    """N planes of one kind under one header."""

    header: IntraHeader
    intra: bool
    values: Ints
    """(N, 73) int64."""
    flags: Ints
    """(N, 3) int64."""
    extents: Ints
    """(N, 3) int64: first bit, bit after the last, frames skipped after it."""
    numbers: Ints
    """(N,) int64, frame numbers."""
    times_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)

    def split(self, at: int) -> "tuple[Planes, Planes]":
        """Split before plane ``at``."""
        names = ("values", "flags", "extents", "numbers", "times_s")
        head = replace(self, **{name: getattr(self, name)[:at] for name in names})
        return head, replace(self, **{name: getattr(self, name)[at:] for name in names})

    def frames(self) -> Iterator[Frame]:
        """One :class:`Frame` per plane."""
        for n in range(len(self)):
            yield Frame(
                int(self.numbers[n]), float(self.times_s[n]), self.intra, self.header, self.values[n], self.flags[n]
            )


@dataclass(slots=True)
class Loss:
    """A part of the stream that could not be decoded; its end is filled in when it is found.

    Stateful.
    """

    start_bit: int
    end_bit: int | None
    """First bit that could be decoded again; None while the search continues."""
    frames_dropped: int
    """Frames that had been decoded and were discarded, since damage is detected late."""
    reason: str


BODY_GROUPS: tuple[tuple[int, ...], ...] = tuple(
    tuple(map(int, row)) for row in read_rows("fapengine.codec", "bap_groups.csv")
)
"""BAP numbers of the 24 groups, in the order in which they are coded."""
CODED_BAPS = tuple(chain.from_iterable(BODY_GROUPS))
SCALES = (
    0, 1, 2, 3, 5, 7, 9, 11, 14, 17, 20, 23, 27, 31, 35, 39, 43, 47, 52, 57, 62, 67, 72, 77, 82, 88, 94, 100, 106, 113,
    120, 127,
)  # fmt: skip
"""Factor of a BAP's quantiser step for each bap_quant; ranges are divided by it too, by 1 for bap_quant 0."""


class BodyState(FieldState):
    """State of a body: set by I planes, changed by P planes.

    Stateful.
    """

    names = tuple(f"BAP {number}" for number in CODED_BAPS)

    def __init__(self) -> None:
        super().__init__()
        self.begun = False
        """An I plane with a body has been read."""
        self._ranges: Ints = np.zeros((4, len(CODED_BAPS)), np.int64)
        self._sent: Bools = np.zeros(self._ranges.shape, bool)

    def begin_intra(self, reader: BitReader) -> None:
        """Read the fields of a body up to the arithmetic data, set mask and ranges, and reset the models."""
        section = "FBA section 16"
        read = read_parameter_fields(
            reader, BODY_GROUPS, BODY_GROUPS, prefix="body ", name="BAP", clauses=(section, section)
        )
        scale = SCALES[read.quant] or 1
        for side, magnitudes in enumerate(read.ranges):
            for number, magnitude in (magnitudes or {}).items():
                place = side, CODED_BAPS.index(number)
                self._ranges[place], self._sent[place] = magnitude * UNIT // scale * SIGNS[side], True
        mask = np.array([read.mask[number] for number in CODED_BAPS])
        unknown = np.flatnonzero(mask & ~self._sent.all(0))
        if len(unknown):
            what = f"{self.names[unknown[0]]}: range is missing, and its default range is not known"
            raise UnsupportedError(what, where=reader.where(), clause=section)
        self.fields[:, k.ON] = mask
        self._set_ranges(slice(None), self._ranges)
        self.begun = True
