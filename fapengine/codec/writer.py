"""From planes to bytes: the layer of the encoder that makes no choices."""

import numpy as np

from fapengine.codec import kernels
from fapengine.codec.bits import END, OBJECT_START, PLANE_START, BitWriter, code
from fapengine.codec.fields import EXPRESSION_FIELDS, FIELD_FAPS, FIELD_NAMES, VISEME_FIELDS, Ints
from fapengine.codec.header import IntraHeader, write_intra_header
from fapengine.codec.planes import PlaneState
from fapengine.errors import UsageError

BITS_A_SYMBOL = 17
"""A symbol cannot cost more: 16 shifts of the coder, and its share of stuffing."""
PLANES_AT_ONCE = 512


class StreamWriter:
    """Planes in, bytes out.

    Stateful.

    Parameters
    ----------
    clamp : bool
        Code the nearest symbol where a value is out of range; otherwise that is an error.
    """

    def __init__(self, *, clamp: bool) -> None:
        self.state = PlaneState()
        self._clamp = clamp
        self._bytes = bytearray(code(OBJECT_START))
        self._rest: list[int] = []
        self._stuffed = False

    @property
    def bits(self) -> int:
        """Bits that wait to be taken."""
        return 8 * len(self._bytes) + len(self._rest)

    def intra(self, header: IntraHeader, target: Ints, flags: Ints) -> None:
        """Append an I plane; ``target`` (73,), ``flags`` (3,)."""
        self.state.begin_intra(header)
        out = BitWriter()
        write_intra_header(header, out)
        room = np.zeros(len(out.bits) + 75 * BITS_A_SYMBOL, np.uint8)
        room[: len(out.bits)] = out.bits
        state = self.state
        end = kernels.encode_plane(
            True, target, flags, state.fields, state.previous, state.models.encoding, self._clamp, room, len(out.bits)
        )
        self._append(room, end, target)

    def predicted(self, targets: Ints, flags: Ints, skips: Ints) -> None:
        """Append P planes: ``targets`` (T, 73), ``flags`` (T, 3), ``skips`` (T,)."""
        state = self.state
        for first in range(0, len(targets), PLANES_AT_ONCE):
            part = slice(first, first + PLANES_AT_ONCE)
            count = len(targets[part])
            header_bits = 8 * count + int(skips[part].sum()) // 3 + 4
            room = np.empty(count * 75 * BITS_A_SYMBOL + header_bits, np.uint8)
            end = kernels.encode_predicted(
                targets[part], flags[part], skips[part], state.fields, state.previous, state.models.encoding,
                self._clamp, room, 0,
            )  # fmt: skip
            self._append(room, end, targets[part])

    def plane_start_code(self) -> None:
        """Align, and announce the next plane by a start code."""
        self.align()
        self._bytes += code(PLANE_START)

    def align(self) -> None:
        """Stuff to a byte boundary: a 0, then ones; a whole byte where already there (FBA section 3)."""
        if not self._stuffed:
            self._rest += [0] + [1] * (7 - len(self._rest))
            self._pack()
            self._stuffed = True

    def finish(self) -> None:
        """Stuff, and write the end code."""
        self.align()
        self._bytes += code(END)

    def take(self) -> bytes:
        """Hand out the whole bytes written since the last call."""
        written = bytes(self._bytes)
        self._bytes.clear()
        return written

    def _append(self, room: np.ndarray[tuple[int], np.dtype[np.uint8]], end: int, targets: Ints) -> None:
        if end < 0:
            self._complain(-1 - end, targets)
        self._stuffed = False
        joined = np.concatenate([np.array(self._rest, np.uint8), room[:end]])
        whole = len(joined) // 8 * 8
        self._bytes += np.packbits(joined[:whole]).tobytes()
        self._rest = joined[whole:].tolist()

    def _pack(self) -> None:
        self._bytes += np.packbits(np.array(self._rest, np.uint8)).tobytes()
        self._rest = []

    def _complain(self, field: int, targets: Ints) -> None:
        column = np.atleast_2d(targets)[:, field]
        raise UsageError(
            f"FAP {FIELD_FAPS[field]} ({FIELD_NAMES[field]}): got values {column.min()}..{column.max()}, which "
            "leave the symbol range; send wider ranges, clamp, or raise the quantiser"
        )


def check_selects(targets: Ints, mask_viseme: bool, mask_expression: bool) -> None:
    """Refuse viseme and expression numbers that do not exist."""
    for on, fields, every, top, what in (
        (mask_viseme, VISEME_FIELDS, 1, 14, "viseme_select"),
        (mask_expression, EXPRESSION_FIELDS, 2, 6, "expression_select"),
    ):
        chosen = targets[:, fields][:, : 2 * every : every]
        if on and len(chosen) and (chosen.min() < 0 or chosen.max() > top):
            bad = int(np.argwhere((chosen < 0) | (chosen > top))[0, 0])
            raise UsageError(f"{what} in frame {bad}: must be 0 to {top}, got {chosen[bad].tolist()}")
