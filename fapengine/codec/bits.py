"""Plain bits: fields of fixed length, most significant bit first, one bit a byte while in work."""

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import ConformanceError, TruncatedError

Bits = NDArray[np.uint8]


def unpack(data: bytes) -> Bits:
    """Spread bytes into bits: (8 * N,) uint8 of 0 and 1."""
    return np.unpackbits(np.frombuffer(data, np.uint8))


def place(bit: int) -> str:
    """Spell a bit position for a message.

    Examples
    --------
    >>> place(51)
    'byte 6, bit 3'
    """
    return f"byte {bit // 8}, bit {bit % 8}"


class BitReader:
    """A position in an array of bits.

    Stateful.

    Parameters
    ----------
    bits : (N,) uint8
        One bit a byte.
    position : int
        Next bit to read.
    origin : int
        Number of bits of the stream before ``bits``; for messages only.
    """

    def __init__(self, bits: Bits, position: int = 0, origin: int = 0) -> None:
        self._bits = bits
        self.position = position
        self._origin = origin

    def read(self, count: int, what: str) -> int:
        """Read an unsigned number of ``count`` bits.

        Raises
        ------
        TruncatedError
            If the bits end before it does.
        """
        end = self.position + count
        if end > len(self._bits):
            left = len(self._bits) - self.position
            raise TruncatedError(f"{what}: got {left} bits, expected {count}", where=self.where())
        number = 0
        for bit in self._bits[self.position : end].tolist():
            number = 2 * number + bit
        self.position = end
        return number

    def expect_marker(self, what: str, clause: str) -> None:
        """Read a bit that must be 1.

        Raises
        ------
        ConformanceError
            If it is 0.
        """
        where = self.where()
        if not self.read(1, what):
            raise ConformanceError(f"{what}: got marker bit 0, expected 1", where=where, clause=clause)

    def where(self) -> str:
        """Place of the next bit in the whole stream."""
        return place(self._origin + self.position)


class BitWriter:
    """Collects bits.

    Stateful.
    """

    def __init__(self) -> None:
        self.bits: list[int] = []

    def write(self, number: int, count: int) -> None:
        """Append an unsigned number in ``count`` bits; it must fit."""
        self.bits.extend((number >> (count - 1 - k)) & 1 for k in range(count))
