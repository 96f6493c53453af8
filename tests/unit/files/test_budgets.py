"""Small files that ask for much: each is refused in one line, before it costs time or memory."""

import io
import struct
import zipfile
import zlib

import numpy as np
import pytest

from fapengine._strict_toml import MAX_BYTES
from fapengine.capture.arrays import parse_npz
from fapengine.errors import DataError, UsageError
from fapengine.files import pictures
from fapengine.files.pictures import load_picture, save_png
from fapengine.server.config import parse_config
from fapengine.speech.formats.registry import parse_timings

TEXTGRID = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = {end}
tiers? <exists>
size = 1
item []:
    item [1]:
        class = "IntervalTier"
        name = "phones"
        xmin = 0
        xmax = {end}
        intervals: size = 2
        intervals [1]:
            xmin = 0
            xmax = 1
            text = "m"
        intervals [2]:
            xmin = 1
            xmax = {end}
            text = "{last}"
"""


@pytest.mark.parametrize("last", ["", "a"])
def test_timings_may_be_as_long_as_what_they_hold(last: str) -> None:
    assert parse_timings(TEXTGRID.format(end=650, last=last).encode()).duration_s == 650
    with pytest.raises(DataError, match=r"TextGrid: got \d labels in 86000 s, expected at most (660|720) s for so few"):
        parse_timings(TEXTGRID.format(end=86000, last=last).encode())


def packed(shape: tuple[int, ...], kind: type) -> bytes:
    """An archive of zeros, written without making them."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": np.lib.format.dtype_to_descr(np.dtype(kind)), "fortran_order": False, "shape": shape}
    )
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file, file.open("positions.npy", "w") as member:
        member.write(head.getvalue())
        for _ in range(shape[0] // 1000):
            member.write(bytes(1000 * shape[1] * 3 * np.dtype(kind).itemsize))
    return archive.getvalue()


def test_an_archive_may_unpack_to_as_much_as_motion_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(np, "load", lambda *_, **__: pytest.fail("it was unpacked"))
    data = packed((6000, 600, 3), np.uint8)
    assert len(data) < 20_000
    with pytest.raises(DataError, match=r"NPZ: 864\d+ bytes of numbers in an archive of \d+; must be at most 671"):
        parse_npz(data)


def test_motion_that_packs_well_is_read() -> None:
    archive = io.BytesIO()
    np.savez_compressed(archive, positions=np.zeros((20_000, 40, 3), np.float32), labels=np.array(["a"] * 40))
    assert parse_npz(archive.getvalue()).positions.shape == (20_000, 40, 3)


def png(width: int, height: int) -> bytes:
    """The head of a picture of this size, and nothing of it."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (png(13_000, 13_000), "got 13000x13000 pixels, expected at most 67108864"),
        (png(40_000, 40_000), "cannot be read|pixels, expected at most"),
        (png(10, 10), "image: cannot be read"),
        (png(10, 10)[:30], "image: cannot be read|image: got no PNG"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "image: got no PNG or JPEG"),
        (b"", "image: got no PNG or JPEG"),
    ],
)
def test_pictures_are_small_and_whole_or_refused_in_a_line(tmp_path, data, message) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(data)
    with pytest.raises(DataError, match=message) as caught:
        load_picture(path)
    assert "\n" not in str(caught.value)


def test_whatever_a_decoder_raises_the_file_is_at_fault(tmp_path, monkeypatch) -> None:
    path = tmp_path / "picture.png"
    save_png(path, np.zeros((4, 4, 3), np.uint8))
    assert load_picture(path).shape == (4, 4, 3)
    for error in (ValueError("a\nb"), SyntaxError("broken"), struct.error("short"), MemoryError()):
        monkeypatch.setattr(pictures.Image, "open", lambda *_, error=error, **__: (_ for _ in ()).throw(error))
        with pytest.raises(DataError, match="image: cannot be read") as caught:
            load_picture(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(UsageError, match="cannot be read"):
        load_picture(tmp_path / "absent.png")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b".".join([b"a"] * 50_000) + b" = 1", "a key of more than 500 parts"),
        (b"[" + b".".join([b"a"] * 50_000) + b"]", "a key of more than 500 parts"),
        (b"a = " + b"[" * 5000, "nested too deeply"),
        (b"a = " + b"{a=" * 5000, "nested too deeply"),
        (b"#" * (MAX_BYTES + 1), "bytes, expected at most"),
    ],
    ids=["key", "table", "lists", "tables", "long"],
)
def test_toml_is_flat_and_short_or_refused(data: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_config(data, "mine.toml")
