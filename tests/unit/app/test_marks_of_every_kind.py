"""Every kind of file that is written says that it is synthetic, or has no place for it; else its bytes are the same.

A new row of ``OUTPUT_KINDS`` fails here until it is one or the other. ICT-FaceKit's shapes come with its notice.
"""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from pxr import Sdf

from fapengine.app.motion import save
from fapengine.app.outputs import OUTPUT_KINDS
from fapengine.app.scene_files import Into, export_head
from fapengine.files.provenance import NAME, SYNTHETIC, XMP_BOX, provenance
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.ict_notice import ICT_COPYRIGHT

HEAD = "default:level=coarse"
WITHOUT_A_PLACE = {".fap", ".fba", ".csv", ".json", ".tsv", ".xml", ".dat", ".wav"}
TRACK = FapTrack.from_values(np.arange(4)[:, None] * (np.arange(68) > 1) * 30, rate_hz=25.0)
SOUND = np.zeros(4000, np.int16), 16_000


def boxes(data: bytes) -> bytes:
    assert data[-len(XMP_BOX) :] != XMP_BOX
    at = data.rindex(b"uuid" + XMP_BOX) - 4
    assert at + int.from_bytes(data[at : at + 4], "big") == len(data)
    return data[:at]


def png(data: bytes) -> bytes:
    at, kept = 8, data[:8]
    while at < len(data):
        size = 12 + int.from_bytes(data[at : at + 4], "big")
        kept += data[at : at + size] if data[at + 4 : at + 8] != b"iTXt" else b""
        at += size
    return kept


def gif(data: bytes) -> bytes:
    return data[: data.index(b"\x21\xff\x0bXMP DataXMP")] + b"\x3b"


def webp(data: bytes) -> bytes:
    kept = bytearray(data[12 : data.rindex(b"XMP ")])
    kept[8] &= ~4
    return b"RIFF" + struct.pack("<I", len(kept) + 4) + b"WEBP" + kept


def packets(data: bytes, path: Path) -> list[bytes]:
    """Of Matroska, whose tags come before them, with numbers drawn anew for each file."""
    path.write_bytes(data)
    with av.open(str(path)) as container:
        return [bytes(packet) for packet in container.demux()]


def glb(data: bytes) -> tuple[object, bytes]:
    size = int.from_bytes(data[12:16], "little")

    def kept(value: object) -> object:
        if isinstance(value, dict):
            found = {key: kept(each) for key, each in value.items() if key != NAME}
            return {key: each for key, each in found.items() if each != {}}
        return [kept(each) for each in value] if isinstance(value, list) else value

    return kept(json.loads(data[20 : 20 + size])), data[20 + size :]


def usd(data: bytes, path: Path) -> list[str]:
    path.write_bytes(data)
    text = Sdf.Layer.OpenAsAnonymous(str(path)).ExportToString()
    return [line for line in text.splitlines() if NAME not in line]


STRIPPED: dict[str, Callable[[bytes, Path], object]] = {
    **dict.fromkeys((".mp4", ".mov"), lambda data, _: boxes(data)),
    **dict.fromkeys((".png", "", "frame_%04d.png"), lambda data, _: png(data)),
    **dict.fromkeys((".webm", ".mkv"), packets),
    **dict.fromkeys((".glb", ".vrm", ".vrma"), lambda data, _: glb(data)),
    **dict.fromkeys((".usda", ".usdc", ".usd"), usd),
    ".gif": lambda data, _: gif(data),
    ".webp": lambda data, _: webp(data),
}
"""A file without its mark, and how one without any compares."""
IS_UNMARKED_AS_IS = {".mp4", ".mov", ".png", "", "frame_%04d.png", ".gif", ".webp"}


def said(data: bytes, path: Path) -> str:
    """What ``strings`` shows, and USD's own tool of a compressed file."""
    path.write_bytes(data)
    text = Sdf.Layer.OpenAsAnonymous(str(path)).ExportToString() if path.suffix in (".usdc", ".usd") else ""
    return data.decode("latin-1") + text


def has_notice(text: str) -> bool:
    return ICT_COPYRIGHT in text and "Permission is hereby granted" in text


@pytest.fixture(scope="module")
def avatar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("avatar") / "avatar.glb"
    with provenance(False):
        export_head(HEAD, path)
    return path


@pytest.mark.parametrize("kind", OUTPUT_KINDS, ids=lambda kind: kind.ending or "folder")
def test_kind(kind: object, avatar: Path, tmp_path: Path) -> None:
    ending = kind.ending  # type: ignore[attr-defined]
    written = {}
    for is_marked in (True, False):
        folder = tmp_path / str(is_marked)
        path = folder / (ending if "%" in ending else f"a{ending}")
        into = None
        if ending.startswith(".usd"):
            into = Into(Path(HEAD))
        elif kind.takes_avatar and ending != ".vrma":  # type: ignore[attr-defined]
            into = Into(avatar)
        shapes = next(iter(kind.shapes), None)  # type: ignore[attr-defined]
        save(TRACK, path, sound=SOUND, into=into, shapes=shapes, size=(64, 64), head=HEAD, provenance=is_marked)
        (written[is_marked], *_) = [each.read_bytes() for each in sorted(folder.rglob("*")) if each.is_file()]
    scratch = tmp_path / f"scratch{ending if '%' not in ending else '.png'}"
    if ending in WITHOUT_A_PLACE:
        assert written[True] == written[False]
        assert NAME.encode() not in written[True]
        return
    assert SYNTHETIC in said(written[True], scratch)
    assert SYNTHETIC not in said(written[False], scratch)
    if into is not None:  # the head's shapes are in the file
        assert all(has_notice(said(data, scratch)) for data in written.values())
    strip = STRIPPED[ending]
    plain = written[False] if ending in IS_UNMARKED_AS_IS else strip(written[False], scratch)
    assert strip(written[True], scratch) == plain


@pytest.mark.nightly
@pytest.mark.parametrize("ending", [".glb", ".vrm", ".usdc"])
def test_heads_carry_notice_and_mark(ending: str, tmp_path: Path) -> None:
    written = {}
    for is_marked in (True, False):
        with provenance(is_marked):
            export_head(HEAD, tmp_path / str(is_marked) / f"head{ending}")
        written[is_marked] = (tmp_path / str(is_marked) / f"head{ending}").read_bytes()
    scratch = tmp_path / f"scratch{ending}"
    for is_marked, data in written.items():
        assert (SYNTHETIC in said(data, scratch)) == is_marked
        assert has_notice(said(data, scratch))
    assert STRIPPED[ending](written[True], scratch) == STRIPPED[ending](written[False], scratch)
