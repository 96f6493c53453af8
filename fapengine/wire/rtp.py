"""A face stream over RTP, in the MPEG-4 visual payload (RFC 6416, which replaced RFC 3016).

Layout of a packet::

    byte 0       80: version 2, no padding, no extension, no contributing sources
    byte 1       marker (1 bit: last packet of a plane), payload type (7 bits)
    bytes 2-3    sequence number
    bytes 4-7    time of the plane in units of 1/90000 s, with an offset of the sender's choice
    bytes 8-11   SSRC: number of the stream
    byte 12 on   bytes of the face stream, start codes and all; a plane never shares a packet with another

The visual headers precede the first plane, and ``config=`` of the session description repeats them. A P plane depends
on all planes before it, so a receiver that misses a packet shows its last frame until the next I plane: with one per
second, a loss costs half a second on average.
"""

import struct

from fapengine.codec.elementary import LEVELS, visual_headers

CLOCK_HZ = 90_000
PAYLOAD_TYPE = 96
"""First dynamic payload type."""
HEADER = struct.Struct(">BBHII")
VERSION, MARKER = 0x80, 0x80
MAX_PAYLOAD = 1200
"""Bytes; with all headers it passes every usual network without fragmentation."""
PROFILE = LEVELS[-1].profile


def session_description(host: str, port: int, *, profile: int = PROFILE) -> str:
    r"""Return the session description that a receiver needs (SDP, RFC 8866).

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
    """Encoder of planes as packets.

    Stateful.

    Parameters
    ----------
    ssrc, sequence, time : int
        Number of the stream and its first numbers: random, so that streams do not collide.
    """

    def __init__(self, *, ssrc: int, sequence: int = 0, time: int = 0) -> None:
        self._ssrc, self._sequence, self._time = ssrc & 0xFFFFFFFF, sequence & 0xFFFF, time
        self._begun = False

    def plane(self, data: bytes, time_s: float) -> list[bytes]:
        """Encode one plane.

        Parameters
        ----------
        data : bytes
            With its start code.
        time_s : float
            Time to show it.
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
