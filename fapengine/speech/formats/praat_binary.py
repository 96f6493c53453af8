"""Praat's binary TextGrid: numbers big-endian, texts with their length before them.

Praat does not document the form; this is what it writes (compared with the same grid saved as text).
"""

import struct

from fapengine.errors import DataError, TruncatedError
from fapengine.speech.formats.tier import Tier

START = b"ooBinaryFile"


class _Bytes:
    """The bytes from the front to the back. Stateful."""

    def __init__(self, data: bytes) -> None:
        self._data, self.at = data, 0

    def take(self, count: int) -> bytes:
        if count < 0 or self.at + count > len(self._data):
            raise TruncatedError("TextGrid: the file ends inside a value", where=f"byte {self.at}")
        self.at += count
        return self._data[self.at - count : self.at]

    def number(self, form: str) -> float:
        return float(struct.unpack(f">{form}", self.take(struct.calcsize(form)))[0])

    def count(self) -> int:
        value = int(self.number("i"))
        if not 0 <= value <= len(self._data):
            raise DataError(f"count: got {value}, expected one the file can hold", where=f"byte {self.at - 4}")
        return value

    def name(self) -> str:
        """Text with one byte of length: the name of a class."""
        return self.take(self.take(1)[0]).decode("latin-1")

    def text(self) -> str:
        """Text with two bytes of length; a length of -1 means that UTF-16 follows."""
        length = int(self.number("h"))
        if length >= 0:
            return self.take(length).decode("latin-1")
        return self.take(2 * int(self.number("H"))).decode("utf-16-be", "replace")


def parse_binary_tiers(data: bytes) -> tuple[Tier, ...]:
    """Read every interval tier; point tiers are passed over.

    Raises
    ------
    DataError
        If this is another object, or damaged.
    """
    source = _Bytes(data)
    source.take(len(START))
    kind = source.name()
    if kind != "TextGrid":
        raise DataError(f"Praat: got a binary {kind[:40]!r}, expected a TextGrid", where="byte 12")
    source.take(16)  # the grid's times
    if source.take(1) == b"\0":
        return ()
    tiers: list[Tier] = []
    for _ in range(source.count()):
        kind, name = source.name(), source.text()
        source.take(16)  # the tier's times
        count = source.count()
        if kind == "IntervalTier":
            rows = tuple((source.number("d"), source.number("d"), source.text()) for _ in range(count))
            tiers.append(Tier(name, rows))
        elif kind == "TextTier":
            for _ in range(count):
                source.take(8), source.text()
        else:
            raise DataError(
                f"tier class: got {kind[:40]!r}, expected IntervalTier or TextTier", where=f"byte {source.at}"
            )
    return tuple(tiers)
