"""Routing of packets: the session of the first message that has one, without decoding the rest."""

import struct
from collections.abc import Iterator

from fapengine.errors import DataError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, one_shot, schema

NAMELESS_SESSION = "face"
"""Session of the messages that have no name in them."""
MAX_ELEMENTS = 64
"""Messages of a bundle that are read."""
_LENGTH = struct.Struct(">i")


def session_of(packet: bytes) -> str | None:
    """Find the session of a datagram; None if none of its messages belongs to one.

    Examples
    --------
    >>> session_of(osc.message("/fap/1/hello", "s", "anna")), session_of(osc.message("/phoneme", "s", "m"))
    ('anna', 'face')
    >>> session_of(osc.message("/fap/1/ping", "ih", 0, 0)), session_of(b"#bundle")
    (None, None)
    """
    for message in _messages(packet, 0):
        spelled, tags_at = _string(message, 0)
        address = spelled.decode(errors="replace")
        if address in one_shot.ADDRESSES or address in one_shot.nameless():
            return NAMELESS_SESSION
        if schema.from_sender().get(address) in (None, schema.Ping):
            continue
        tags, at = _string(message, tags_at)
        session, _ = _string(message, at) if tags.startswith(b",s") else (b"", 0)
        if 1 <= len(session) <= schema.SESSION_BYTES:
            return session.decode(errors="replace")
    return None


def hello_of(packet: bytes) -> schema.Hello | None:
    """Decode the hello of a datagram, if there is a valid one."""
    address = schema.Hello.ADDRESS
    try:
        messages = osc.parse_packet(packet) if address.encode() in packet[:64] else ()
        wires = (codec.parse(schema.Hello, message) for message in messages if message.address == address)
        return next((wire for wire in wires if isinstance(wire, schema.Hello)), None)
    except DataError:
        return None


def _messages(packet: bytes, depth: int) -> Iterator[bytes]:
    if not packet.startswith(osc.BUNDLE):
        yield packet
        return
    at = len(osc.BUNDLE_HEAD)
    for _ in range(MAX_ELEMENTS):
        if at + _LENGTH.size > len(packet) or depth > osc.MAX_DEPTH:
            return
        size = _LENGTH.unpack_from(packet, at)[0]
        at += _LENGTH.size
        if size <= 0 or at + size > len(packet):
            return
        yield from _messages(packet[at : at + size], depth + 1)
        at += size


def _string(data: bytes, at: int) -> tuple[bytes, int]:
    """Return a string and the position after it; an empty one if there is none."""
    end = data.find(b"\0", at)
    return (data[at:end], (end & ~3) + 4) if end >= 0 else (b"", len(data))
