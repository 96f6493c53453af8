"""A face stream over RTP, in the MPEG-4 visual payload (RFC 6416, which took the place of RFC 3016).

Layout of a packet::

    byte 0       80: version 2, no padding, no extension, no contributing sources
    byte 1       marker (1 bit: last packet of a plane), payload type (7 bits)
    bytes 2-3    sequence number
    bytes 4-7    time of the plane in units of 1/90000 s, from a number of the sender's choice
    bytes 8-11   SSRC: which stream
    byte 12 on   bytes of the face stream, start codes and all; a plane never shares a packet with another

The visual headers stand before the first plane, and ``config=`` of the session description repeats them. A P plane
means something only behind all planes before it, so a receiver that misses a packet shows its last frame until the next
I plane: with one a second, a loss costs half a second on average.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from fapengine.codec.decoder import Decoder
from fapengine.codec.elementary import LEVELS, visual_headers
from fapengine.codec.frames import Frame
from fapengine.codec.startcodes import OBJECT_START, PLANE_START, PREFIX, code
from fapengine.errors import DataError

CLOCK_HZ = 90_000
PAYLOAD_TYPE = 96
"""First of the dynamic ones."""
HEADER = struct.Struct(">BBHII")
VERSION, MARKER = 0x80, 0x80
MAX_PAYLOAD = 1200
"""Bytes; with all headers it passes every usual network unbroken."""
MAX_PLANE = 65_536
"""Bytes of a plane that a receiver gathers; real ones have some hundred."""
REORDERED = 8
"""Packets that a receiver holds back while an earlier one may still come."""
PROFILE = LEVELS[-1].profile


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


def session_description(host: str, port: int, *, profile: int = PROFILE) -> str:
    r"""Write what a receiver must know (SDP, RFC 8866).

    Examples
    --------
    >>> print(session_description("127.0.0.1", 5004).replace("\r", ""))
    v=0
    o=- 0 0 IN IP4 127.0.0.1
    s=fapengine
    c=IN IP4 127.0.0.1
    t=0 0
    m=video 5004 RTP/AVP 96
    a=rtpmap:96 MP4V-ES/90000
    a=fmtp:96 profile-level-id=98;config=000001B062000001B523
    <BLANKLINE>
    """
    net = "IP6" if ":" in host else "IP4"
    lines = (
        "v=0", f"o=- 0 0 IN {net} {host}", "s=fapengine", f"c=IN {net} {host}", "t=0 0",
        f"m=video {port} RTP/AVP {PAYLOAD_TYPE}", f"a=rtpmap:{PAYLOAD_TYPE} MP4V-ES/{CLOCK_HZ}",
        f"a=fmtp:{PAYLOAD_TYPE} profile-level-id={profile};config={visual_headers(profile).hex().upper()}",
    )  # fmt: skip
    return "".join(f"{line}\r\n" for line in lines)


class RtpSender:
    """Planes in, packets out.

    Stateful.

    Parameters
    ----------
    ssrc, sequence, time : int
        Which stream it is, and its first numbers: chosen at random by the caller, so that streams do not meet.
    """

    def __init__(self, *, ssrc: int, sequence: int = 0, time: int = 0) -> None:
        self._ssrc, self._sequence, self._time = ssrc & 0xFFFFFFFF, sequence & 0xFFFF, time
        self._begun = False

    def plane(self, data: bytes, time_s: float) -> list[bytes]:
        """Pack one plane.

        Parameters
        ----------
        data : bytes
            From its start code on.
        time_s : float
            When it is shown.
        """
        if not self._begun:
            data = visual_headers(PROFILE) + data
        self._begun = True
        time = (self._time + round(time_s * CLOCK_HZ)) & 0xFFFFFFFF
        pieces = [data[at : at + MAX_PAYLOAD] for at in range(0, len(data), MAX_PAYLOAD)]
        packets = []
        for n, piece in enumerate(pieces):
            marker = MARKER if n == len(pieces) - 1 else 0
            packets.append(HEADER.pack(VERSION, marker | PAYLOAD_TYPE, self._sequence, time, self._ssrc) + piece)
            self._sequence = (self._sequence + 1) & 0xFFFF
        return packets


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

    Examples
    --------
    >>> from fapengine.codec.encoder import Encoder, EncoderOptions
    >>> encoder = Encoder(rate_hz=25.0, options=EncoderOptions(plane_start_codes="all"))
    >>> sender, receiver = RtpSender(ssrc=1), RtpReceiver()
    >>> shown = [receiver.packet(each) for each in sender.plane(encoder.frame([0] * 68), 0.04)]
    >>> [(time, frame.fap(3)) for frames in shown for time, frame in frames]
    [(3600, 0)]
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
