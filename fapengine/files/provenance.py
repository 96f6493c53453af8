"""The mark in images, films and heads that says, to machines, that they are synthetic.

It is the *digital source type* of the IPTC (https://cv.iptc.org/newscodes/digitalsourcetype/), as XMP (ISO 16684-1)
where a format has a place for it. Media of ours are *trained algorithmic media*: "created algorithmically using a model
derived from sampled content", as the speaker profile and the head are learned from recordings and scans.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

VOCABULARY = "http://cv.iptc.org/newscodes/digitalsourcetype/"
SYNTHETIC = VOCABULARY + "trainedAlgorithmicMedia"
COMPOSITE = VOCABULARY + "compositeSynthetic"
"""A recorded person beside a synthetic face."""
NAME = "digitalSourceType"
PNG_KEY = "XML:com.adobe.xmp"
"""Keyword of the text that contains XMP (XMP specification part 3, 1.1.5)."""
XMP_BOX = bytes.fromhex("be7acfcb97a942e89c71999491e3afac")
"""Type of the ``uuid`` box that contains XMP in MP4 and MOV (XMP specification part 3, 1.2.7)."""
WEBP_HAS_XMP = 0x04
"""Flag of the chunk ``VP8X``, which comes first in a file with more than a frame (RFC 9649, 2.7)."""
GIF_END = b"\x3b"
_is_wanted: ContextVar[bool] = ContextVar("provenance", default=True)


@contextmanager
def provenance(wanted: bool) -> Iterator[None]:
    """Write files without the mark inside the block, in this thread, if it is not ``wanted`` here or around it."""
    before = _is_wanted.set(wanted and _is_wanted.get())
    try:
        yield
    finally:
        _is_wanted.reset(before)


def mark(source: str = SYNTHETIC) -> dict[str, str]:
    """Return the mark as a name and a value; nothing if it is switched off."""
    return {NAME: source} if _is_wanted.get() else {}


def xmp(source: str = SYNTHETIC) -> bytes:
    """Return the mark as an XMP packet; empty if it is switched off."""
    if not mark():
        return b""
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about=""'
        ' xmlns:Iptc4xmpExt="http://iptc.org/std/Iptc4xmpExt/2008-02-29/"'
        f' Iptc4xmpExt:DigitalSourceType="{source}"/></rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
    ).encode()


def mark_film(path: Path, suffix: str, source: str = SYNTHETIC) -> None:
    """Add the mark to a complete file, which is otherwise unchanged.

    Parameters
    ----------
    path : Path
    suffix : str
        Its format: .mp4, .mov, .gif and .webp have a place for XMP; Matroska has tags instead, which FFmpeg writes.
    source : str
        Term of the vocabulary.
    """
    packet = xmp(source)
    if not packet:
        return
    with path.open("r+b") as file:
        if suffix in (".mp4", ".mov"):
            file.seek(0, 2)
            file.write((len(packet) + 24).to_bytes(4, "big") + b"uuid" + XMP_BOX + packet)
        elif suffix == ".gif":  # an application extension, with the trailer that lets readers skip it
            file.seek(-1, 2)
            file.write(b"\x21\xff\x0bXMP DataXMP" + packet + b"\x01" + bytes(range(255, -1, -1)) + b"\0" + GIF_END)
        elif suffix == ".webp":
            marked = _marked_webp(file.read(), packet)
            file.seek(0)
            file.write(marked)


def _marked_webp(data: bytes, packet: bytes) -> bytes:
    chunks = bytearray(data[12:])
    if chunks[:4] == b"VP8 ":  # a single frame (RFC 6386, 9.1)
        width, height = (int.from_bytes(chunks[at : at + 2], "little") & 0x3FFF for at in (14, 16))
        size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
        chunks[:0] = b"VP8X" + (10).to_bytes(4, "little") + bytes(4) + size
    chunks[8] |= WEBP_HAS_XMP
    chunks += b"XMP " + len(packet).to_bytes(4, "little") + packet + bytes(len(packet) % 2)
    return b"RIFF" + (len(chunks) + 4).to_bytes(4, "little") + b"WEBP" + chunks
