"""Whose a packet is: the session of its first message that has one, without understanding the rest."""

import struct
from collections.abc import Iterator
from functools import lru_cache

from fapengine.engine import commands
from fapengine.engine.command_table import Command
from fapengine.errors import DataError
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, one_shot_messages, schema

NAMELESS_SESSION = "face"
"""Session of the messages that name none."""
MAX_ELEMENTS = 64
"""Messages of a bundle that are looked at."""
_LENGTH = struct.Struct(">i")


def session_of(packet: bytes) -> str | None:
    """Find the session that a datagram speaks to; None where none of its messages is for a session.

    Examples
    --------
    >>> session_of(osc.message("/fap/1/hello", "s", "anna")), session_of(osc.message("/phoneme", "s", "m"))
    ('anna', 'face')
    >>> session_of(osc.message("/fap/1/ping", "ih", 0, 0)), session_of(b"#bundle")
    (None, None)
    """
    for message in _messages(packet, 0):
        address, tags_at = _string(message, 0)
        named = _addresses(commands.COMMANDS).get(address)
        if named is None:
            continue
        if not named:
            return NAMELESS_SESSION
        tags, at = _string(message, tags_at)
        session, _ = _string(message, at) if tags.startswith(b",s") else (b"", 0)
        if 1 <= len(session) <= schema.SESSION_BYTES:
            return session.decode(errors="replace")
    return None


def hello_of(packet: bytes) -> schema.Hello | None:
    """Read the hello of a datagram, if there is one and it is well-formed."""
    if schema.Hello.ADDRESS.encode() not in packet[:64]:
        return None
    try:
        for message in osc.parse_packet(packet):
            if message.address == schema.Hello.ADDRESS:
                hello = codec.parse(schema.Hello, message)
                return hello if isinstance(hello, schema.Hello) else None
    except DataError:
        return None
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
    """Read a string and where the next argument begins; empty where there is none."""
    end = data.find(b"\0", at)
    return (data[at:end], (end & ~3) + 4) if end >= 0 else (b"", len(data))


@lru_cache(maxsize=4)
def _addresses(listed: tuple[type[Command], ...]) -> dict[bytes, bool]:
    """Address of every message that is for a session, and whether it names that."""
    named = {address.encode(): True for address, kind in schema.from_sender().items() if kind is not schema.Ping}
    without = (*one_shot_messages.ADDRESSES, *one_shot_messages.nameless())
    return named | {address.encode(): False for address in without}
