"""The mark in images, films and heads that says, to machines, that they are synthetic.

It is the *digital source type* of the IPTC (https://cv.iptc.org/newscodes/digitalsourcetype/), as XMP (ISO 16684-1)
where a format has a place for it. Media of ours are *trained algorithmic media*: "created algorithmically using a model
derived from sampled content", as the speaker profile and the head are learned from recordings and scans.

With a certificate, images and films also get a signed claim of the same content (C2PA), without a
time stamp of a server.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from fapengine._late import Late
from fapengine.errors import DataError, ResourceError, UsageError

_USE = "c2pa-python", "a signature"
c2pa = Late("c2pa", *_USE)
x509 = Late("cryptography.x509", *_USE)
serialization = Late("cryptography.hazmat.primitives.serialization", *_USE)

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
ONE_PIXEL_GIF = b"GIF89a\1\0\1\0\0\0\0,\0\0\0\0\1\0\1\0\0\2\2D\1\0" + GIF_END
"""One pixel, which is signed to try a certificate."""
SIGNABLE = {
    ".png": "image/png", ".webp": "image/webp", ".gif": "image/gif", ".mp4": "video/mp4", ".mov": "video/quicktime",
}  # fmt: skip
"""Media type of what can be signed."""
ALGORITHMS = {"RSAPrivateKey": "ps256", "Ed25519PrivateKey": "ed25519", "secp256r1": "es256", "secp384r1": "es384",
              "secp521r1": "es512"}  # fmt: skip
"""C2PA's name of the algorithm of each kind of key."""
_is_wanted: ContextVar[bool] = ContextVar("provenance", default=True)


@contextmanager
def provenance(wanted: bool) -> Iterator[None]:
    """Write files without the mark inside the block, in this thread, if it is not ``wanted`` here or around it."""
    before = _is_wanted.set(wanted and _is_wanted.get())
    try:
        yield
    finally:
        _is_wanted.reset(before)


@dataclass(slots=True)
class _Signer:
    """What signs. Stateful: it counts."""

    key: Any
    """``c2pa.Signer``."""
    count: int = field(default=0, init=False)


_signer: ContextVar[_Signer | None] = ContextVar("signer", default=None)


@contextmanager
def signing(certificates: Path, key: Path) -> Iterator[None]:
    """Sign the images and films that are written inside the block, in this thread.

    Parameters
    ----------
    certificates : Path
        PEM: the signer's, which must allow signatures of e-mails (as C2PA asks), and those of its issuers.
    key : Path
        PEM: the signer's private key, without a password.

    Raises
    ------
    UsageError
        If a file is not what it should be, or nothing was signed.
    ResourceError
        If a file cannot be read, or c2pa-python is not installed.
    """
    if not mark():
        raise UsageError("sign: got a certificate, but the mark that it signs is left out; expected one of the two")
    before = _signer.set(_Signer(_key_of(certificates, key)))
    try:
        yield
        signer = _signer.get()
        if signer and not signer.count:
            raise UsageError(f"sign: nothing that was written can be signed, expected {', '.join(SIGNABLE)}")
    finally:
        _signer.reset(before)


def _key_of(certificates: Path, key: Path) -> Any:
    load = serialization.load_pem_private_key  # a missing library is reported before a missing file
    try:
        chain, own = certificates.read_bytes(), key.read_bytes()
    except OSError as error:
        raise ResourceError(f"sign: {error.filename} cannot be read ({error.strerror})") from error
    try:
        secret: Any = load(own, None)
        first = x509.load_pem_x509_certificates(chain)[0]
        if first.public_key() != secret.public_key():
            raise ValueError("the first certificate is not that of the key")
        kind = secret.curve.name if hasattr(secret, "curve") else type(secret).__name__.strip("_")
        plain = secret.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        signer = c2pa.Signer.from_info(c2pa.C2paSignerInfo(ALGORITHMS[kind].encode(), chain, plain, None))
        with c2pa.Builder(_claim(SYNTHETIC)) as builder:  # C2PA looks at the certificates when it signs
            builder.sign(signer, SIGNABLE[".gif"], BytesIO(ONE_PIXEL_GIF), BytesIO())
        return signer
    except (ValueError, TypeError, KeyError, c2pa.C2paError) as error:
        raise UsageError(f"sign: {certificates} and {key} cannot sign ({error})") from error


def check_signable(*paths: Path) -> None:
    """Refuse files of which none can be signed, before they are made; a name without an ending is a folder."""
    if paths and _signer.get() and not any(path.suffix in SIGNABLE or not path.suffix for path in paths):
        raise UsageError(f"sign: got {paths[0].name}, expected a name that ends with {', '.join(SIGNABLE)}")


def sign(path: Path, suffix: str, source: str = SYNTHETIC) -> None:
    """Sign a complete file within :func:`signing`; raises DataError if C2PA refuses it."""
    signer = _signer.get()
    if signer is None:
        return
    try:
        with c2pa.Builder(_claim(source)) as builder, TemporaryFile() as signed, path.open("r+b") as file:
            builder.sign(signer.key, SIGNABLE[suffix], file, signed)
            for each in (signed, file):
                each.seek(0)
            shutil.copyfileobj(signed, file)
    except c2pa.C2paError as error:
        raise DataError(f"sign: C2PA does not sign {path.name} ({error})") from error
    signer.count += 1


def _claim(source: str) -> str:
    created = {"action": "c2pa.created", "digitalSourceType": source}
    return json.dumps({
        "claim_generator_info": [{"name": "fapengine"}],
        "assertions": [{"label": "c2pa.actions.v2", "data": {"actions": [created]}}],
    })  # fmt: skip


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
    """Add the mark to a complete file, which is otherwise unchanged, and sign it within :func:`signing`.

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
    sign(path, suffix, source)


def _marked_webp(data: bytes, packet: bytes) -> bytes:
    chunks = bytearray(data[12:])
    if chunks[:4] == b"VP8 ":  # a single frame (RFC 6386, 9.1)
        width, height = (int.from_bytes(chunks[at : at + 2], "little") & 0x3FFF for at in (14, 16))
        size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
        chunks[:0] = b"VP8X" + (10).to_bytes(4, "little") + bytes(4) + size
    chunks[8] |= WEBP_HAS_XMP
    chunks += b"XMP " + len(packet).to_bytes(4, "little") + packet + bytes(len(packet) % 2)
    return b"RIFF" + (len(chunks) + 4).to_bytes(4, "little") + b"WEBP" + chunks
