"""Whether a datagram's sender is where the datagram says that it comes from: a cookie there and back.

Anybody can write any address on a datagram. What is sent there in answer would hit somebody who never asked, and more
of it than was sent: a reflection. So an address that is not proved gets at most :data:`AMPLIFICATION` times the bytes
that came from it, as in QUIC (RFC 9000, section 8), until a hello brings back the cookie of a welcome.
"""

import hmac
from collections.abc import Callable, Hashable
from dataclasses import dataclass

AMPLIFICATION = 3
"""Bytes that an address gets for each that came from it, before it is proved."""


def _nobody_is_asked(peer: Hashable) -> bool:
    return True


def _everybody_is_one(peer: Hashable) -> str:
    return ""


@dataclass(frozen=True, slots=True)
class Proof:
    """What is known of peers' addresses.

    Examples
    --------
    >>> proof = Proof(secret=b"of this run", is_sure_of=lambda peer: False)
    >>> proof.cookie_of("udp://192.0.2.1:9") == proof.cookie_of("udp://192.0.2.1:9") != proof.cookie_of("udp://192.0.2.2:9")
    True
    """

    secret: bytes = b""
    """Random bytes of this run of the server."""
    is_sure_of: Callable[[Hashable], bool] = _nobody_is_asked
    """Tells whether a peer needs no proof: a connection, or an address of this machine."""
    host_of: Callable[[Hashable], str] = _everybody_is_one
    """Host that a peer speaks from."""

    def cookie_of(self, peer: Hashable) -> int:
        """Give the number, 1 to 2**31 - 1, that only somebody who hears what is sent to a peer can know."""
        digest = hmac.digest(self.secret, str(peer).encode(), "sha256")
        return int.from_bytes(digest[:4]) >> 1 or 1
