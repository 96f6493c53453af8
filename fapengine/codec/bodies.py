"""The body in a face-and-body stream: its bits are read to their end, so that the face behind them can be.

Theory of operation
-------------------
Body animation parameters (BAPs) lie behind the FAPs of a plane, or alone in a plane. They have no length of their own:
where they end is only known when they have been decoded. Their header is laid out as a face's, with 24 groups of BAPs
instead of 10 of FAPs; their arithmetic data are one segment, coded as a face's low-level FAPs are, group by group.
Values are not kept, for nothing here moves a body.

The default ranges of BAPs are not known. A stream that codes a BAP without having sent its four ranges is refused.

Source of groups, scales and order: a public decoder of the reference family (FBA section 16).
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from fapengine.codec import kernels as k
from fapengine.codec.bits import BitReader, Bits
from fapengine.codec.fields import UNIT, Bools, Ints
from fapengine.codec.header import LIST_MARKER_EVERY, expect_predictive
from fapengine.codec.planes import INT32_TOP, Models
from fapengine.errors import ConformanceError, UnsupportedError


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


@dataclass(frozen=True, slots=True, eq=False)
class BodyHeader:
    """What only I planes carry, for a body."""

    quant: int
    """bap_quant, 0..31."""
    mask: Bools
    """(296,) bool in the order of :data:`CODED_BAPS`: coded BAPs."""
    ranges: tuple[Ints | None, ...]
    """I maximum, I minimum, P maximum, P minimum: (296,) magnitudes in units of 60, or None where not sent."""


def read_body_header(reader: BitReader) -> BodyHeader:
    """Read the fields of the body, up to the arithmetic data."""
    quant = reader.read(5, "bap_quant")
    mask: list[bool] = []
    for index, group in enumerate(BODY_GROUPS, start=1):
        reader.expect_marker(f"mask of body group {index}", "FBA section 16")
        where = reader.where()
        kind = reader.read(2, f"mask type of body group {index}")
        if kind == 2:
            raise ConformanceError(
                f"mask type of body group {index}: got 2, expected 0, 1 or 3", where=where, clause="FBA section 16"
            )
        mask += [kind == 3 or (kind == 1 and bool(reader.read(1, f"mask of BAP {number}"))) for number in group]
    reader.read(1, "suggested_gender")
    expect_predictive(reader)
    flags = [reader.read(1, f"is_{name}") for name in ("i_new_max", "i_new_min", "p_new_max", "p_new_min")]
    coded = np.array(mask)
    return BodyHeader(quant, coded, tuple(_read_list(reader, coded) if flag else None for flag in flags))


def _read_list(reader: BitReader, mask: Bools) -> Ints:
    magnitudes, column = np.zeros(len(CODED_BAPS), np.int64), 0
    for group in BODY_GROUPS:
        for nth, number in enumerate(group):
            if nth % LIST_MARKER_EVERY == 0:
                reader.expect_marker(f"ranges at BAP {number}", "FBA section 16")
            if mask[column]:
                magnitudes[column] = reader.read(5, f"range of BAP {number}")
            column += 1
    return magnitudes


class BodyState:
    """What the I planes of a body set and its P planes change.

    Stateful.
    """

    def __init__(self) -> None:
        count = len(CODED_BAPS)
        self.begun = False
        """An I plane with a body has been read."""
        self.fields: Ints = np.zeros((count, 8), np.int64)
        self.fields[:, k.STEP] = 1
        self.fields[:, k.MIN_VALUE], self.fields[:, k.MAX_VALUE] = -INT32_TOP, INT32_TOP
        self.previous: Ints = np.zeros(count, np.int64)
        self.models = Models(count)
        self._ranges: Ints = np.zeros((4, count), np.int64)
        self._sent: Bools = np.zeros((4, count), bool)
        self._found: Ints = np.zeros((4, count), np.int64)

    def begin_intra(self, header: BodyHeader, where: str) -> None:
        """Take over mask and ranges, and forget the models."""
        scale = SCALES[header.quant] or 1
        for side, magnitudes in enumerate(header.ranges):
            if magnitudes is not None:
                bounds = magnitudes * UNIT // scale * (-1 if side % 2 else 1)
                self._ranges[side, header.mask] = bounds[header.mask]
                self._sent[side, header.mask] = True
        unknown = np.flatnonzero(header.mask & ~self._sent.all(0))
        if len(unknown):
            raise UnsupportedError(
                f"BAP {CODED_BAPS[unknown[0]]}: range is missing, and its default range is not known", where=where,
                clause="FBA section 16",
            )  # fmt: skip
        i_max, i_min, p_max, p_min = self._ranges
        self.fields[:, k.ON] = header.mask
        self.fields[:, k.I_MIN], self.fields[:, k.I_COUNT] = i_min, i_max - i_min + 1
        self.fields[:, k.P_MIN], self.fields[:, k.P_COUNT] = p_min, p_max - p_min + 1
        self.models.reset(self.fields)
        self.begun = True

    def decode(self, intra: bool, bits: Bits, at: int) -> tuple[int, int]:
        """Decode the arithmetic data of one plane, if the bits at hand settle it; :meth:`keep` makes it count.

        Returns
        -------
        status, end : int
            As :func:`~fapengine.codec.kernels.decode_settled`.
        """
        return k.decode_settled(
            intra, bits, at, self.fields, self.previous, self.models.decoding, self._found, np.zeros(3, np.int64),
            np.zeros(0),
        )  # fmt: skip

    def keep(self, intra: bool) -> None:
        """Take the plane decoded last for good."""
        k.keep_plane(intra, self._found, self.fields, self.previous, self.models.decoding)
