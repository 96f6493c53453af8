"""The body in a face-and-body stream: it is decoded to find where it ends, and its values are ignored.

Theory of operation
-------------------
Body animation parameters (BAPs) follow the FAPs of a plane, or are alone in a plane. No length is sent: only decoding
shows where they end. Their header has the layout of a face's, with 24 groups of BAPs instead of 10 of FAPs; their
arithmetic data are one segment, coded as a face's low-level FAPs are, group by group.

The default ranges of BAPs are not known. A stream that codes a BAP without having sent its four ranges is refused.

Source of groups, scales and order: a public decoder of the reference family (FBA section 16).
"""

from itertools import chain

import numpy as np

from fapengine.codec import kernels as k
from fapengine.codec.bits import BitReader
from fapengine.codec.fields import SIGNS, UNIT, Bools, Ints
from fapengine.codec.header import read_parameter_fields
from fapengine.codec.planes import FieldState
from fapengine.errors import UnsupportedError


def _span(first: int, last: int) -> tuple[int, ...]:
    return tuple(range(first, last + 1))


BODY_GROUPS: tuple[tuple[int, ...], ...] = (
    (1, 2, 3), (4, 6, 10, 14), (5, 7, 11, 15), (8, 12, 16, 18, 20, 22), (9, 13, 17, 19, 21, 23),
    (32, 34, 36, 38, 42), (33, 35, 37, 39, 43), (24, 26, 28, 30, 40, 44, 46), (25, 27, 29, 31, 41, 45, 47),
    (*_span(48, 50), *_span(60, 62), *_span(87, 89), *_span(114, 116)),
    (*_span(54, 56), *_span(72, 74), *_span(99, 101), *_span(108, 110), *_span(120, 122)),
    (*_span(57, 59), *_span(66, 68), *_span(81, 83), *_span(93, 95), *_span(105, 107), *_span(117, 119)),
    (*_span(63, 65), *_span(69, 71), *_span(75, 77), *_span(90, 92), *_span(102, 104), *_span(111, 113)),
    (*_span(51, 53), *_span(78, 80), *_span(84, 86), *_span(96, 98)),
    (125, 131, 133, 137, 143, 145, 149, 155, 157, 161, 167, 169, 171, 173, 177, 179),
    (126, 132, 134, 138, 144, 146, 150, 156, 158, 162, 168, 170, 172, 174, 178, 180),
    (123, 127, 129, 135, 139, 141, 147, 151, 153, 159, 163, 165, 175),
    (124, 128, 130, 136, 140, 142, 148, 152, 154, 160, 164, 166, 176),
    _span(181, 186), _span(187, 208), _span(209, 230), _span(231, 252), _span(253, 274), _span(275, 296),
)  # fmt: skip
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
