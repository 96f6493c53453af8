"""A receiver of a face stream over RTP, to read back what :class:`fapengine.wire.rtp.RtpSender` sends."""

from collections.abc import Sequence
from dataclasses import dataclass

from fapengine.codec.bits import OBJECT_START, PLANE_START, PREFIX, code
from fapengine.codec.decoder import Decoder
from fapengine.codec.planes import Frame
from fapengine.errors import DataError
from fapengine.wire.rtp import HEADER, MARKER, VERSION

MAX_PLANE = 65_536
"""Bytes of a plane that the receiver gathers; real ones have some hundred."""
REORDERED = 8
"""Packets held back while an earlier one may still come."""


@dataclass(frozen=True, slots=True)
class RtpPacket:
    """A packet taken apart."""

    sequence: int
    time: int
    ssrc: int
    is_last: bool
    """The plane ends with it."""
    payload: bytes


def parse_packet(data: bytes) -> RtpPacket:
    """Take a packet apart.

    Raises
    ------
    DataError
        If it is none, or is encrypted or extended in a way that is not read here.
    """
    if len(data) <= HEADER.size:
        raise DataError(f"RTP: got {len(data)} bytes, expected more than {HEADER.size}", where="byte 0")
    first, second, sequence, time, ssrc = HEADER.unpack_from(data)
    if first != VERSION:
        raise DataError(f"RTP: got {first:#04x}, expected {VERSION:#04x}: version 2 and nothing added", where="byte 0")
    return RtpPacket(sequence, time, ssrc, bool(second & MARKER), data[HEADER.size :])


@dataclass(slots=True)
class RtpCounts:
    """Counts of a receiver.

    Stateful.
    """

    taken: int = 0
    """Packets of the stream."""
    lost: int = 0
    """Packets that never came, or came too late."""
    unused: int = 0
    """Planes that came, but could not be shown, since one before them was lost."""
    refused: int = 0
    """Datagrams that are no packet, and planes that are damaged."""


class RtpReceiver:
    """Packets in, frames out, in order.

    Stateful.
    """

    def __init__(self) -> None:
        self.counts = RtpCounts()
        self._ssrc: int | None = None
        self._next = 0
        self._held: dict[int, RtpPacket] = {}
        self._pieces: list[bytes] = []
        self._torn = False
        """Packets of the plane that is being gathered are missing."""
        self._decoder: Decoder | None = None

    def packet(self, data: bytes) -> Sequence[tuple[int, Frame]]:
        """Take a datagram; gives the frames that it completes, each with its time in 1/90000 s.

        Datagrams of no use are counted, never an error: anybody may send to a port.
        """
        try:
            packet = parse_packet(data)
        except DataError:
            self.counts.refused += 1
            return ()
        if packet.ssrc != self._ssrc:
            self._begin(packet)
        ahead = (packet.sequence - self._next) & 0xFFFF
        if ahead >= 0x8000 or packet.sequence in self._held:
            return ()  # late or twice; what was late is counted as lost
        self._held[packet.sequence] = packet
        frames: list[tuple[int, Frame]] = []
        while self._held:
            if self._next not in self._held:
                if len(self._held) <= REORDERED:
                    break
                self._miss(min(self._held, key=lambda number: (number - self._next) & 0xFFFF))
            frames += self._in_order(self._held.pop(self._next))
        return frames

    def _begin(self, packet: RtpPacket) -> None:
        """Follow a stream that is new, or has begun anew."""
        self._ssrc, self._next = packet.ssrc, packet.sequence
        self._held.clear()
        self._pieces, self._torn, self._decoder = [], False, None

    def _miss(self, following: int) -> None:
        self.counts.lost += (following - self._next) & 0xFFFF
        self._next = following
        self._torn, self._decoder = bool(self._pieces) or self._torn, None
        self._pieces = []

    def _in_order(self, packet: RtpPacket) -> list[tuple[int, Frame]]:
        self.counts.taken += 1
        self._next = (packet.sequence + 1) & 0xFFFF
        self._pieces.append(packet.payload)
        if sum(map(len, self._pieces)) > MAX_PLANE:
            self._pieces, self._torn = [], True
        if not packet.is_last:
            return []
        plane, torn = b"".join(self._pieces), self._torn
        self._pieces, self._torn = [], False
        return [] if torn else [(packet.time, frame) for frame in self._decoded(plane)]

    def _decoded(self, plane: bytes) -> list[Frame]:
        is_later = plane.startswith(code(PLANE_START))
        begins = plane.find(code(OBJECT_START)) if plane.startswith(PREFIX) and not is_later else -1
        if begins >= 0:
            plane, self._decoder = plane[begins:], Decoder()
        elif is_later and self._decoder is None and plane[4:5] >= b"\x80":
            plane, self._decoder = code(OBJECT_START) + plane[4:], Decoder()  # an I plane: where one can begin
        if self._decoder is None:
            self.counts.unused += 1
            return []
        try:
            return self._decoder.feed(plane)
        except DataError:
            self.counts.refused += 1
            self._decoder = None
            return []
