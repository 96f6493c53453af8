"""OSC packets on a byte stream: SLIP (OSC 1.1) and 4-byte lengths (OSC 1.0), both bounded.

Layout::

    SLIP, RFC 1055   C0 packet C0; inside the packet C0 becomes DB DC, and DB becomes DB DD
    lengths          int32 big-endian length, packet

Both decoders are stateful: ``feed`` takes bytes, in any pieces, and returns the packets that are now complete;
``close`` checks that the stream ended between packets. Neither holds more than ``max_packet`` bytes. SLIP
resynchronizes after damage, so a bad packet is dropped and counted; a bad length ends the stream.
"""

import struct

from fapengine.errors import DataError, TruncatedError, UsageError

MAX_PACKET = 65_536
"""Bytes; a client that announces more is refused before anything is stored."""

END, ESC, ESC_END, ESC_ESC = 0xC0, 0xDB, 0xDC, 0xDD


def encode_slip(packet: bytes) -> bytes:
    """Frame one packet, with END before and after.

    Examples
    --------
    >>> encode_slip(bytes.fromhex("01 c0 db 02")).hex(" ")
    'c0 01 db dc db dd 02 c0'
    """
    escaped = packet.replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc")
    return b"\xc0" + escaped + b"\xc0"


class SlipDecoder:
    """A decoder of SLIP: bytes in, packets out.

    Stateful.

    Parameters
    ----------
    max_packet : int, bytes
        Longer packets are dropped.

    Attributes
    ----------
    dropped : int
        Packets that were too long or had an invalid escape.
    """

    def __init__(self, *, max_packet: int = MAX_PACKET) -> None:
        self.dropped = 0
        self._max = max_packet
        self._packet = bytearray()
        self._escaped = False
        self._bad = False

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes; return the packets that they complete, without empty ones."""
        packets: list[bytes] = []
        pieces = data.split(b"\xc0")
        for number, piece in enumerate(pieces):
            self._take(piece)
            if number < len(pieces) - 1:
                self._end(packets)
        return packets

    def close(self) -> None:
        """End the stream. Raises TruncatedError if it ends inside a packet."""
        if self._packet or self._escaped or self._bad:
            raise TruncatedError(f"SLIP: ends {len(self._packet)} bytes into a packet, expected END", clause="RFC 1055")

    def _take(self, piece: bytes) -> None:
        if self._bad or not piece:
            return
        if self._escaped:
            piece, self._escaped = b"\xdb" + piece, False
        if piece.endswith(b"\xdb"):
            piece, self._escaped = piece[:-1], True
        first, *rest = piece.split(b"\xdb")
        self._packet += first
        for part in rest:
            if part[:1] not in (b"\xdc", b"\xdd"):
                self._spoil()
                return
            self._packet.append(END if part[0] == ESC_END else ESC)
            self._packet += part[1:]
        if len(self._packet) > self._max:
            self._spoil()

    def _spoil(self) -> None:
        self._bad = True
        self._packet.clear()

    def _end(self, packets: list[bytes]) -> None:
        if self._bad or self._escaped:
            self.dropped += 1
        elif self._packet:
            packets.append(bytes(self._packet))
        self._packet.clear()
        self._bad = self._escaped = False


def encode_length(packet: bytes) -> bytes:
    """Prefix a packet with its length.

    Raises UsageError if the packet is empty: a receiver may take it for the end of the stream.
    """
    if not packet:
        raise UsageError("packet: must not be empty")
    return struct.pack(">i", len(packet)) + packet


class LengthDecoder:
    """A decoder of lengths before packets: bytes in, packets out.

    Stateful.

    Parameters
    ----------
    max_packet : int, bytes
        A longer length breaks the stream.
    """

    def __init__(self, *, max_packet: int = MAX_PACKET) -> None:
        self._max = max_packet
        self._held = bytearray()
        self._broken = ""

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes; return the packets that they complete.

        Raises
        ------
        DataError
            If a length is not in 1..``max_packet``. Packets before it are returned first; then the next call of
            ``feed`` or ``close`` raises. The caller must close the connection.
        """
        if self._broken:
            raise DataError(self._broken, clause="OSC 1.0")
        self._held += data
        packets: list[bytes] = []
        here = 0
        while len(self._held) - here >= 4:
            (size,) = struct.unpack_from(">i", self._held, here)
            if not 1 <= size <= self._max:
                self._broken = f"packet length: got {size}, expected 1 to {self._max}"
                here = len(self._held)
                break
            if len(self._held) - here - 4 < size:
                break
            packets.append(bytes(self._held[here + 4 : here + 4 + size]))
            here += 4 + size
        del self._held[:here]
        if self._broken and not packets:
            raise DataError(self._broken, clause="OSC 1.0")
        return packets

    def close(self) -> None:
        """End the stream. Raises TruncatedError if it ends inside a packet; DataError if a length was wrong."""
        if self._broken:
            raise DataError(self._broken, clause="OSC 1.0")
        if self._held:
            raise TruncatedError(f"packet: the stream ends after {len(self._held)} bytes of it", clause="OSC 1.0")
