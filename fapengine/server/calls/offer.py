"""What a caller offers, looked at before any library reads it: how much, and of what kind.

The addresses in an offer are taken out. A server that asked them would knock at any door that a stranger names; it
needs none of them, for a caller's own checks come from where the caller is, and prove it (peer-reflexive candidates,
RFC 8445, 7.3.1.3).
"""

from dataclasses import dataclass
from typing import Literal

from fapengine.errors import DataError

MAX_OFFER = 64 << 10
"""Bytes of an offer; a browser's are about 6 KiB."""
MAX_LINE, MAX_LINES = 2048, 1500
Kind = Literal["audio", "video"]


@dataclass(frozen=True, slots=True)
class Offer:
    """A session description without addresses."""

    sdp: str
    kinds: tuple[Kind, ...]
    """Its media, in order: at most one of each."""


def read_offer(data: bytes) -> Offer:
    r"""Look at an offer: any bytes.

    Raises
    ------
    DataError
        If it is too long, no SDP, or not of one sound and one picture at most.

    Examples
    --------
    >>> offer = read_offer(b"v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 111\r\na=candidate:1 1 udp 1 10.0.0.1 9 typ host\r\n")
    >>> offer.kinds, offer.sdp
    (('audio',), 'v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 111\r\n')
    """
    if len(data) > MAX_OFFER:
        raise DataError(f"offer: got {len(data)} bytes, expected at most {MAX_OFFER}")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise DataError("offer: got bytes that are no UTF-8, expected SDP") from error
    lines = text.replace("\r\n", "\n").split("\n")
    if lines[0] != "v=0":
        raise DataError(f"offer: got {lines[0]!r:.60} at first, expected SDP, 'v=0'")
    if len(lines) > MAX_LINES or max(map(len, lines)) > MAX_LINE:
        raise DataError(f"offer: got more than {MAX_LINES} lines or {MAX_LINE} letters in one")
    kinds: list[Kind] = []
    for line in lines:
        if not line.startswith("m="):
            continue
        kind = line[2:].partition(" ")[0]
        if kind == "audio" and "audio" not in kinds:
            kinds.append("audio")
        elif kind == "video" and "video" not in kinds:
            kinds.append("video")
        else:
            raise DataError(f"offer: got {kind!r:.40} beside {kinds}, expected one audio and one video at most")
    if not kinds:
        raise DataError("offer: got no media, expected audio or video")
    kept = [line for line in lines if not line.startswith(("a=candidate:", "a=end-of-candidates"))]
    return Offer("\r\n".join(kept), tuple(kinds))
