"""What the decoder hands out: frames, blocks of planes, and losses."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fapengine.codec.fields import EXPRESSION_FIELDS, LOW_LEVEL_FIELDS, VISEME_FIELDS, Ints
from fapengine.codec.header import IntraHeader
from fapengine.errors import UsageError


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
        """Value of a low-level FAP, 3..68, in FAPU.

        Raises
        ------
        UsageError
            For any other number.
        """
        if not 3 <= number <= 68:
            raise UsageError(f"FAP: got {number}, expected 3..68")
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
