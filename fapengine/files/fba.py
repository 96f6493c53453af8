"""FBA streams, alone or with speech in an MP4 file, and encoder parameter files.

In MP4 the face stream is an MPEG-4 visual track (object type 0x20) next to the audio. Each plane is one sample; the
visual headers precede the first one. FFmpeg's library writes and reads the file (PyAV). Players without face support
play the audio alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.codec.bits import OBJECT_START, SEQUENCE_START, code
from fapengine.codec.decoder import Decoded, Errors, decode
from fapengine.codec.elementary import AccessUnit, visual_headers
from fapengine.codec.epf import PlaneOrder, parse_epf
from fapengine.codec.fit import Fit, parse_fit
from fapengine.errors import DataError
from fapengine.files.paths import is_mp4, naming, read_bytes
from fapengine.files.video import av, decodable, mux, reading, writing

SIDE = 16
"""Width and height stated by the track; the format requires some."""
CLOCK_HZ = 90_000


def write_fba_film(
    path: Path,
    units: Sequence[AccessUnit],
    *,
    rate_hz: float,
    profile: int,
    sound: tuple[NDArray[np.int16], int] | None = None,
) -> None:
    """Write a face stream, and audio from time 0, into one MP4 file.

    Parameters
    ----------
    path : Path
    units : sequence of AccessUnit
        The whole stream.
    rate_hz : float
        Frame rate.
    profile : int
        Byte of the sequence header (:data:`~fapengine.codec.elementary.LEVELS`).
    sound : ((N,) int16, int), optional
        Mono samples and their rate.

    Raises
    ------
    ResourceError
        If the file cannot be written.
    """
    with writing(path, {"movflags": "faststart"}, "mp4") as container:
        rate = Fraction(rate_hz).limit_denominator(1001)
        face = container.add_mux_stream("mpeg4", rate=rate, width=SIDE, height=SIDE)
        mux(container, _packets(face, units, rate, visual_headers(profile)), "aac", sound)


def _packets(stream: Any, units: Sequence[AccessUnit], rate: Fraction, headers: bytes) -> Iterator[Any]:
    for n, unit in enumerate(units):
        packet = av.Packet(headers + unit.data if n == 0 else unit.data)
        following = units[n + 1].frame if n + 1 < len(units) else unit.frame + 1
        packet.stream, packet.time_base = stream, Fraction(1, CLOCK_HZ)
        packet.pts = packet.dts = round(unit.frame * CLOCK_HZ / rate)
        packet.duration = round((following - unit.frame) * CLOCK_HZ / rate)
        packet.is_keyframe = unit.intra
        yield packet


def read_fba_film(path: Path) -> bytes | None:
    """Extract the face stream from an MP4 file, with its visual headers; None without one.

    Raises
    ------
    DataError
        If the file cannot be read as a video.
    """
    with reading(path, "read as an MP4 file") as container:
        for stream in decodable(container):
            if stream.codec.name != "mpeg4":
                continue
            data = b"".join(bytes(packet) for packet in container.demux(stream))
            if data.startswith((code(SEQUENCE_START), code(OBJECT_START))) and code(OBJECT_START) in data[:64]:
                return data
            container.seek(0)
    return None


def load_fba(path: Path, *, errors: Errors = "strict", with_costs: bool = False) -> Decoded:
    """Decode an ``.fba`` file, or the face stream of an MP4 file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it cannot be decoded; the message names it.
    """
    with naming(path):
        return decode(read_stream(path), errors=errors, with_costs=with_costs)


def read_stream(path: Path) -> bytes:
    """Read the bytes of a face stream, from an ``.fba`` file or an MP4 file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is an MP4 file without a face stream.
    """
    data = read_bytes(path)
    if not is_mp4(data):
        return data
    stream = read_fba_film(path)
    if stream is None:
        raise DataError("an MP4 file without a face stream; expected an MPEG-4 visual track with a face object")
    return stream


def load_epf(path: Path) -> tuple[PlaneOrder, ...]:
    """Read an ``.epf`` file.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is not a parameter file; the message names it.
    """
    with naming(path):
        return parse_epf(read_bytes(path))


def load_fit(path: Path) -> Fit:
    """Read a FAP interpolation table (``.fit``); errors as :func:`load_epf`."""
    with naming(path):
        return parse_fit(read_bytes(path))
