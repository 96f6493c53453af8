"""The layer of the encoder that makes no choices: planes to bytes."""

import numpy as np

from fapengine.codec import kernels
from fapengine.codec.bits import END, OBJECT_START, PLANE_START, Bits, code
from fapengine.codec.fields import Ints
from fapengine.codec.header import IntraHeader, intra_header_bits
from fapengine.codec.planes import SELECTS, PlaneState
from fapengine.errors import UsageError

BITS_A_PLANE = 75 * 17
"""Greatest size of a plane's data: a symbol costs at most 16 shifts of the coder and its part of the stuffing."""
PLANES_AT_ONCE = 512


class StreamWriter:
    """Writes planes to a stream.

    Stateful.

    Parameters
    ----------
    clamp : bool
        Code the nearest symbol for a value out of range, instead of an error.
    """

    def __init__(self, *, clamp: bool) -> None:
        self.state = PlaneState()
        self._clamp = clamp
        self._bytes = bytearray(code(OBJECT_START))
        self._rest: Bits = np.zeros(0, np.uint8)
        """Bits of the last, incomplete byte."""
        self._stuffed = False

    @property
    def bits(self) -> int:
        """Number of bits written since the last :meth:`take`."""
        return 8 * len(self._bytes) + len(self._rest)

    def intra(self, header: IntraHeader, target: Ints, flags: Ints) -> None:
        """Append an I plane; ``target`` (73,), ``flags`` (3,)."""
        state = self.state
        state.begin_intra(header)
        head = np.array(intra_header_bits(header), np.uint8)
        room = np.concatenate([head, np.zeros(BITS_A_PLANE, np.uint8)])
        end = kernels.loops.encode_plane(
            True, target, flags, state.fields, state.previous, state.encoding, self._clamp, room, len(head)
        )
        self._append(room, end, target)

    def predicted(self, targets: Ints, flags: Ints, skips: Ints) -> None:
        """Append P planes: ``targets`` (T, 73), ``flags`` (T, 3), ``skips`` (T,)."""
        state = self.state
        for first in range(0, len(targets), PLANES_AT_ONCE):
            part = slice(first, first + PLANES_AT_ONCE)
            count = len(targets[part])
            header_bits = 8 * count + int(skips[part].sum()) // 3 + 4
            room = np.empty(count * BITS_A_PLANE + header_bits, np.uint8)
            end = kernels.loops.encode_predicted(
                targets[part], flags[part], skips[part], state.fields, state.previous, state.encoding, self._clamp,
                room, 0,
            )  # fmt: skip
            self._append(room, end, targets[part])

    def plane_start_code(self) -> None:
        """Align, and write the start code of the next plane."""
        self.align()
        self._bytes += code(PLANE_START)

    def align(self) -> None:
        """Stuff to a byte boundary: a 0, then ones; a whole byte if already there (FBA section 3)."""
        if not self._stuffed:
            stuffing = np.array([0] + [1] * (7 - len(self._rest)), np.uint8)
            self._bytes += np.packbits(np.concatenate([self._rest, stuffing])).tobytes()
            self._rest = np.zeros(0, np.uint8)
            self._stuffed = True

    def finish(self) -> None:
        """Align, and write the end code."""
        self.align()
        self._bytes += code(END)

    def take(self) -> bytes:
        """Return the whole bytes written since the last call."""
        written = bytes(self._bytes)
        self._bytes.clear()
        return written

    def _append(self, room: Bits, end: int, targets: Ints) -> None:
        """Append ``room[:end]``; a negative ``end`` names the field that is out of range."""
        if end < 0:
            column = np.atleast_2d(targets)[:, -1 - end]
            raise UsageError(
                f"{self.state.names[-1 - end]}: values {column.min()} to {column.max()} are outside the symbol"
                " range; send wider ranges, clamp, or raise the quantiser"
            )
        self._stuffed = False
        joined = np.concatenate([self._rest, room[:end]])
        whole = len(joined) // 8 * 8
        self._bytes += np.packbits(joined[:whole]).tobytes()
        self._rest = joined[whole:].copy()


def check_selects(targets: Ints, mask_viseme: bool, mask_expression: bool) -> None:
    """Check that visemes and expressions exist."""
    masks = ((mask_viseme, "viseme_select"), (mask_expression, "expression_select"))
    for (is_sent, what), (top, fields) in zip(masks, SELECTS, strict=True):
        chosen = targets[:, fields]
        bad = np.flatnonzero(((chosen < 0) | (chosen > top)).any(axis=1))
        if is_sent and len(bad):
            raise UsageError(f"{what} in frame {bad[0]}: must be 0 to {top}, got {chosen[bad[0]].tolist()}")
