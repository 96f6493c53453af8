"""Files say that they are synthetic, as programs of others read it; without the mark they are the same otherwise."""

import struct
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from fapengine.files.moving import write_moving
from fapengine.files.pictures import save_png
from fapengine.files.provenance import COMPOSITE, SYNTHETIC, VOCABULARY, XMP_BOX, mark, provenance, xmp

FRAMES = np.random.default_rng(1).integers(0, 255, (3, 64, 64, 3), np.uint8)
SUFFIXES = (".mp4", ".mov", ".webm", ".mkv", ".gif", ".webp")


def film(path: Path, *, frames: int = 3, source: str = SYNTHETIC) -> bytes:
    write_moving(path, list(FRAMES[:frames]), rate_hz=10.0, source=source)
    return path.read_bytes()


def pixels(path: Path) -> list[np.ndarray]:
    if path.suffix == ".webp":  # FFmpeg writes animated WebP, and does not read it
        with Image.open(path) as image:
            return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def as_av_reads(path: Path) -> str:
    with av.open(str(path)) as container:
        return {key.lower(): value for key, value in container.metadata.items()}.get("digitalsourcetype", "")


def as_boxes(path: Path) -> str:
    """Walk the boxes of an MP4 (ISO/IEC 14496-12, 4.2)."""
    data, at = path.read_bytes(), 0
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        assert 8 <= size <= len(data) - at
        if kind == b"uuid" and data[at + 8 : at + 24] == XMP_BOX:
            return source_of(data[at + 24 : at + size])
        at += size
    return ""


def as_blocks(path: Path) -> str:
    """Skip the extension of a GIF as a decoder does that does not know it (GIF89a, 26): the trailer follows."""
    data = path.read_bytes()
    start = at = data.index(b"\x21\xff\x0bXMP DataXMP") + 14
    while data[at]:
        at += 1 + data[at]
    assert data[at:] == b"\0\x3b"
    return source_of(data[start:at])


def as_pillow_reads(path: Path) -> str:
    with Image.open(path) as image:
        image.load()
        return source_of(image.info.get("xmp") or image.info.get("XML:com.adobe.xmp", "").encode())


def source_of(packet: bytes | tuple[bytes, int]) -> str:
    text = packet if isinstance(packet, bytes) else packet[0]
    start = text.find(VOCABULARY.encode())
    return text[start : text.index(b'"', start)].decode() if start >= 0 else ""


READERS: dict[str, Callable[[Path], str]] = {
    ".mp4": as_boxes, ".mov": as_boxes, ".webm": as_av_reads, ".mkv": as_av_reads, ".webp": as_pillow_reads,
    ".gif": as_blocks,
}  # fmt: skip


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_films_are_marked_and_the_same_without_the_mark(suffix: str, tmp_path: Path) -> None:
    on, off = tmp_path / f"on{suffix}", tmp_path / f"off{suffix}"
    marked = film(on)
    with provenance(False):
        plain = film(off)
    assert READERS[suffix](on) == SYNTHETIC
    assert VOCABULARY.encode() not in plain
    if suffix in (".mp4", ".mov"):
        assert marked.startswith(plain)
    np.testing.assert_array_equal(pixels(on), pixels(off))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_shows_a_person_too_is_a_composite(suffix: str, tmp_path: Path) -> None:
    film(tmp_path / f"pair{suffix}", source=COMPOSITE)
    assert READERS[suffix](tmp_path / f"pair{suffix}") == COMPOSITE


def test_a_webp_of_one_frame_is_no_animation_and_marked(tmp_path: Path) -> None:
    path = tmp_path / "one.webp"
    film(path, frames=1)
    assert as_pillow_reads(path) == SYNTHETIC
    with Image.open(path) as image:
        assert image.size == (64, 64)
        shown = np.asarray(image.convert("RGB"))
    with provenance(False):
        film(tmp_path / "plain.webp", frames=1)
    with Image.open(tmp_path / "plain.webp") as plain:
        np.testing.assert_array_equal(shown, np.asarray(plain.convert("RGB")))


def test_images_are_marked_and_diagrams_are_not(tmp_path: Path) -> None:
    save_png(tmp_path / "face.png", FRAMES[0])
    save_png(tmp_path / "chart.png", FRAMES[0], source=None)
    with provenance(False):
        save_png(tmp_path / "plain.png", FRAMES[0])
    assert as_pillow_reads(tmp_path / "face.png") == SYNTHETIC
    assert (tmp_path / "chart.png").read_bytes() == (tmp_path / "plain.png").read_bytes()
    write_moving(tmp_path / "all", list(FRAMES), rate_hz=10.0)
    assert {as_pillow_reads(path) for path in (tmp_path / "all").iterdir()} == {SYNTHETIC}


def test_the_switch_ends_with_its_block_and_nothing_inside_switches_it_on() -> None:
    with provenance(False):
        with provenance(True):
            assert (mark(), xmp()) == ({}, b"")
        assert not mark()
    assert mark() == {"digitalSourceType": SYNTHETIC}
