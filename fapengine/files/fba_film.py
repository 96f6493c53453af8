"""A voice and its face stream in one MP4 file: an MPEG-4 visual track (object type 0x20) beside the sound.

Each plane is a sample of its own; the visual headers stand before the first one. FFmpeg's library writes and reads the
file (PyAV). Players that know no faces play the voice alone.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.codec.elementary import AccessUnit, visual_headers
from fapengine.codec.startcodes import OBJECT_START, SEQUENCE_START, code
from fapengine.errors import DataError, ResourceError
from fapengine.files.paths import replacing
from fapengine.files.video import SOUND_RATE_HZ, STRANGERS, encoded_sound, time_of

if TYPE_CHECKING:
    import av
else:
    av = Late("av", "av", "video and sound files")

SIDE = 16
"""Width and height that the track states; the format wants some."""
CLOCK_HZ = 90_000


def write_fba_film(
    path: Path,
    units: Sequence[AccessUnit],
    *,
    rate_hz: float,
    profile: int,
    sound: tuple[NDArray[np.int16], int] | None = None,
) -> None:
    """Write a face stream, and sound from time 0, into one MP4 file.

    Parameters
    ----------
    path : Path
    units : sequence of AccessUnit
        Of the whole stream.
    rate_hz : float
        Frames a second.
    profile : int
        Byte of the sequence header (:data:`~fapengine.codec.elementary.LEVELS`).
    sound : ((N,) int16, int), optional
        Mono samples and their rate.

    Raises
    ------
    ResourceError
        If the file cannot be written.
    """
    try:
        with (
            replacing(path) as new,
            av.open(str(new), "w", format="mp4", options={"movflags": "faststart"}) as container,
        ):
            rate = Fraction(rate_hz).limit_denominator(1001)
            face: Any = container.add_mux_stream("mpeg4", rate=rate, width=SIDE, height=SIDE)
            packets = [_packets(face, units, rate, visual_headers(profile))]
            if sound:
                voice: Any = container.add_stream("aac", rate=SOUND_RATE_HZ, layout="mono")
                packets.append(encoded_sound(voice, *sound))
            for packet in heapq.merge(*packets, key=time_of):
                container.mux(packet)
    except (av.FFmpegError, OSError) as error:
        raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error


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
    """Take the face stream out of an MP4 file, with its visual headers; None where it holds none.

    Raises
    ------
    DataError
        If the file cannot be read as a film.
    """
    try:
        with path.open("rb") as file, av.open(file, mode="r", options=STRANGERS) as container:
            for stream in container.streams.video:
                if stream.codec.name != "mpeg4":
                    continue
                data = b"".join(bytes(packet) for packet in container.demux(stream))
                if data.startswith((code(SEQUENCE_START), code(OBJECT_START))) and code(OBJECT_START) in data[:64]:
                    return data
                container.seek(0)
    except (av.FFmpegError, ValueError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DataError(f"{path}: cannot be read as an MP4 file ({reason})") from error
    return None
