"""Planes: the state that encoder and decoder share, and what the decoder returns (frames, blocks of planes, losses).

The state is ranges, steps, predictors and models of the 73 fields.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.codec import kernels as k
from fapengine.codec.fields import (
    EXPRESSION_FIELDS,
    FIELD_COUNT,
    LOW_LEVEL_FIELDS,
    VISEME_FIELDS,
    Bools,
    Ints,
    apply_sent,
    default_ranges,
)
from fapengine.codec.header import IntraHeader
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.visemes import FAP_2_EXPRESSIONS, VISEMES

VISEME_TOP, EXPRESSION_TOP = len(VISEMES) - 1, len(FAP_2_EXPRESSIONS) - 1
BLEND_TOP = 63
INT32_TOP = 2**31 - 1
STEPS = np.array([row.quantiser_step for row in fap.FAPS], np.int64)


class Models:
    """The adaptive models of a table of fields, and the registers of the coder that uses them.

    Stateful.
    """

    def __init__(self, fields: int) -> None:
        self._base: Ints = np.zeros(fields, np.int64)
        self._counts = np.zeros(1, np.int32)
        self._tree = np.zeros(1, np.int32)
        self._totals: Ints = np.zeros(fields, np.int64)
        self._coder: Ints = np.zeros(8, np.int64)
        self._behind: Ints = np.zeros(16, np.int64)

    @property
    def encoding(self) -> tuple[Any, ...]:
        """Arrays that the encoding loops want."""
        return self._base, self._counts, self._tree, self._totals, self._coder

    @property
    def decoding(self) -> tuple[Any, ...]:
        """Arrays that the decoding loops want."""
        return *self.encoding, self._behind

    def reset(self, fields: Ints) -> None:
        """Make the P models of all fields that are on uniform."""
        sizes = np.where(fields[:, k.ON] != 0, fields[:, k.P_COUNT] + 1, 0)
        self._base[1:] = np.cumsum(sizes)[:-1]
        room = int(sizes.sum()) + 1
        if room > len(self._counts):
            self._counts, self._tree = np.zeros(room, np.int32), np.zeros(room, np.int32)
        k.reset_models(fields, self._base, self._counts, self._tree, self._totals)


class PlaneState:
    """What an I plane sets and P planes change.

    Stateful.
    """

    def __init__(self) -> None:
        self.fields: Ints = np.zeros((FIELD_COUNT, 8), np.int64)
        self.fields[:, k.MIN_VALUE], self.fields[:, k.MAX_VALUE] = -INT32_TOP, INT32_TOP
        for start, top in ((VISEME_FIELDS.start, VISEME_TOP), (EXPRESSION_FIELDS.start, EXPRESSION_TOP)):
            for select in self._selects(start):
                self.fields[select, k.MIN_VALUE], self.fields[select, k.MAX_VALUE] = 0, top
        self.previous: Ints = np.zeros(FIELD_COUNT, np.int64)
        self.mask: Bools = np.zeros(fap.FAP_COUNT, bool)
        self.quant = 1
        self.ranges: Ints | None = None
        """(4, 66) in symbols; None before the first I plane."""
        self.models = Models(FIELD_COUNT)

    @staticmethod
    def _selects(start: int) -> tuple[int, int]:
        return (0, 1) if start == 0 else (start, start + 2)

    def begin_intra(self, header: IntraHeader) -> None:
        """Take over mask, quantiser and ranges, and forget the models (FBA sections 5 and 8)."""
        # Deviation: a decoder of the reference family loads the table again when FAP 4's I range was set to 0..0; here
        # ranges once set persist, and our encoder never sends 0..0 for FAP 4.

        if self.ranges is None:
            self.ranges = default_ranges(header.quant)
        apply_sent(self.ranges, header.ranges, header.mask[2:], header.quant)
        self.mask, self.quant = header.mask, header.quant
        f = self.fields
        f[VISEME_FIELDS, k.ON] = header.mask[0]
        f[EXPRESSION_FIELDS, k.ON] = header.mask[1]
        f[LOW_LEVEL_FIELDS, k.ON] = header.mask[2:]
        for select in self._selects(0):
            self._fixed(select, VISEME_TOP, 1)
        for select in self._selects(EXPRESSION_FIELDS.start):
            self._fixed(select, EXPRESSION_TOP, 1)
        step = max(header.quant, 1)
        for blended in (2, 4, 6):
            self._fixed(blended, blend_limit(header.quant), step)
        f[LOW_LEVEL_FIELDS, k.STEP] = STEPS * header.quant if header.quant else 1
        i_max, i_min, p_max, p_min = self.ranges
        f[LOW_LEVEL_FIELDS, k.I_MIN], f[LOW_LEVEL_FIELDS, k.I_COUNT] = i_min, i_max - i_min + 1
        f[LOW_LEVEL_FIELDS, k.P_MIN], f[LOW_LEVEL_FIELDS, k.P_COUNT] = p_min, p_max - p_min + 1
        self.models.reset(f)

    def _fixed(self, field: int, top: int, step: int) -> None:
        self.fields[field, [k.STEP, k.I_MIN, k.I_COUNT, k.P_MIN, k.P_COUNT]] = step, 0, top + 1, -top, 2 * top + 1


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
    """Frame number from 0; grows by 1 and by the frames skipped."""
    time_s: float
    """Time by the frame rates and time codes sent; from 0 where there is no time code."""
    intra: bool
    header: IntraHeader
    """Header of the I plane in force: masks, quantiser."""
    row: Ints
    """(73,) int64, values in the order of :mod:`fapengine.codec.fields`, FAPU; 0 where never sent."""
    flags: Ints
    """(3,) viseme_def, init_face, expression_def."""

    def fap(self, number: int) -> int:
        """Value of a low-level FAP, 3..68, in FAPU."""
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
        """Select1, intensity1, select2, intensity2, init_face, def; likewise."""
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
    """(N, 3) int64: first bit, bit behind, frames skipped after it."""
    numbers: Ints
    """(N,) int64, frame numbers."""
    times_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)

    def split(self, at: int) -> "tuple[Planes, Planes]":
        """Cut in two."""
        names = ("values", "flags", "extents", "numbers", "times_s")
        head = replace(self, **{name: getattr(self, name)[:at] for name in names})
        return head, replace(self, **{name: getattr(self, name)[at:] for name in names})

    def frames(self) -> Iterator[Frame]:
        """One :class:`Frame` a plane."""
        for n in range(len(self)):
            yield Frame(
                int(self.numbers[n]), float(self.times_s[n]), self.intra, self.header, self.values[n], self.flags[n]
            )


@dataclass(slots=True)
class Loss:
    """A stretch of the stream that could not be decoded; its end is filled in when it is found.

    Stateful.
    """

    start_bit: int
    end_bit: int | None
    """First bit that could be decoded again; None while it is sought."""
    frames_dropped: int
    """Frames that had been decoded and were thrown away, since damage is seen late."""
    reason: str
