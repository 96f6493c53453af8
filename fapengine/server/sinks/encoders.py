"""Encoders of frames for each kind of receiver: values in, datagrams out. Sockets are in the other modules.

Those of sinks take an address, the frame rate in Hz, and epochs, and raise UsageError if an option's value is wrong.

When a face goes away a neutral frame follows, so that no receiver keeps its mouth open. The first frame is neutral too,
because an earlier server may have been killed.
"""

from collections.abc import Callable, Mapping
from secrets import randbits
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fapengine.codec.encoder import Encoder, EncoderOptions
from fapengine.errors import UsageError
from fapengine.host.listeners import HubFrames
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.server.sinks.kinds import SinkAddress
from fapengine.wire import fap_osc, livelink, osc, rtp, vmc, vrchat, vts
from fapengine.wire.fap_osc import FapFrame, SessionFrames
from fapengine.wire.shapes import ArkitFollower, PresetFollower, VisemeFollower, encode_weights

REFRESH_S = 1.0
"""Interval at which receivers of changes are sent everything."""
MAX_REPEATED = 120
"""Maximum number of planes that are repeated for skipped frames."""

PERFORMER_PORT = 39540
"""Port of VMC programs that move their model themselves and read shapes only; see :mod:`fapengine.wire.vmc`."""

Faps = NDArray[np.int32]
Epochs = Mapping[str, int] | None
"""Epoch of each session (:mod:`fapengine.server.ownership`), if several processes show sessions."""


class FrameEncoder(Protocol):
    """An encoder: frames of the hub in, datagrams out. Stateful."""

    def encode(self, frames: HubFrames) -> list[bytes]:
        """Return the datagrams of a frame."""

    def resume(self, numbers: Mapping[str, int]) -> None:
        """Continue the frames of an encoder that ended, at these frame numbers of sessions."""


class SingleFaceEncoder:
    """An encoder of one session. Stateful.

    Parameters
    ----------
    write : callable
        Turns frame number, time in s and FAPs (68,) into datagrams.
    session : str, optional
        By default the first open session, until it closes.
    """

    def __init__(self, write: Callable[[int, float, Faps], list[bytes]], session: str | None = None) -> None:
        self._write = write
        self._wanted = session
        self.session = session or ""
        """Name of the session shown last."""
        self._shown: str | None = None
        self._rests = False

    def encode(self, frames: HubFrames) -> list[bytes]:
        """Return the session's datagrams; without a session, a neutral frame once, then nothing."""
        gone = self._shown is not None and self._shown not in frames.sessions
        if gone:
            self._shown = None
        elif self._shown is None and frames.sessions:
            first = frames.sessions[0] if self._wanted is None else self._wanted
            self._shown = first if first in frames.sessions else None
            self.session = self._shown or self.session
        if self._shown is not None:
            self._rests = False
            return self._write(frames.number, frames.time_s, frames.faps[frames.sessions.index(self._shown)])
        if self._rests:
            return []
        self._rests = True
        return self._write(frames.number, frames.time_s, np.zeros(fap.FAP_COUNT, np.int32))

    def resume(self, numbers: Mapping[str, int]) -> None:
        """Do nothing: each datagram is complete."""


class OscFrameEncoder:
    """An encoder of ``/fap/1/frame`` for all sessions, or for one. Stateful."""

    def __init__(self, address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> None:
        self._session = address.session
        self._stream = SessionFrames(epochs=epochs)
        self._shown: tuple[str, ...] = ()

    def resume(self, numbers: Mapping[str, int]) -> None:
        """Continue the frame numbers of sessions."""
        self._stream.begin_at(numbers)

    def encode(self, frames: HubFrames) -> list[bytes]:
        """Return a message for each session, and a neutral one for each that has closed."""
        sessions, faps = frames.sessions, frames.faps
        if self._session is not None:
            rows = [row for row, session in enumerate(sessions) if session == self._session]
            sessions, faps = tuple(sessions[row] for row in rows), faps[rows]
        time_us = round(1e6 * frames.time_s)
        gone = () if sessions == self._shown else tuple(name for name in self._shown if name not in set(sessions))
        self._shown = sessions
        if gone:
            at_rest = np.vstack([faps, np.zeros((len(gone), fap.FAP_COUNT), np.int32)])
            return self._stream.encode(sessions + gone, at_rest, time_us)
        return self._stream.encode(sessions, faps, time_us)


def named_faps(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> SingleFaceEncoder:
    """Return an encoder of ``/fap/<n>``, one message per FAP."""
    mask = np.arange(1, fap.FAP_COUNT + 1) >= 3
    nothing = {"visemes": np.zeros(fap_osc.VISEME_WIDTH), "expressions": np.zeros(fap_osc.EXPRESSION_WIDTH)}

    def write(number: int, time_s: float, faps: Faps) -> list[bytes]:
        values = np.where(mask, faps, 0)
        return fap_osc.encode_named(
            FapFrame(session="face", number=0, time_us=0, values=values, mask=mask, **nothing)  # type: ignore[arg-type]
        )

    return SingleFaceEncoder(write, address.session)


def vmc_face(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> SingleFaceEncoder:
    """Return an encoder of VMC: the shapes that changed, head and eyes; all shapes once per second.

    ``names`` are ``arkit`` (Perfect Sync), ``pascal``, or ``vrm0`` or ``vrm1``: an avatar's presets.
    """
    spelling = address.options.get("names", "arkit")
    spellings = {
        "arkit": ARKIT_NAMES, "pascal": vmc.PASCAL_NAMES, "vrm0": vmc.VRM0_SHOWN, "vrm1": vmc.VRM1_SHOWN,
    }  # fmt: skip
    if spelling not in spellings:
        raise UsageError(f"names: got {spelling!r}, expected one of {', '.join(spellings)}")
    follower = PresetFollower(rate_hz) if spelling.startswith("vrm") else ArkitFollower()
    changed = vmc.ChangedShapes(spellings[spelling], every=max(1, round(REFRESH_S * rate_hz)))
    begin_s: list[float] = []

    def write(number: int, time_s: float, faps: Faps) -> list[bytes]:
        weights = changed.of(follower.follow(faps))
        if address.port == PERFORMER_PORT:
            return vmc.encode_shapes(weights)
        begin_s[:] = begin_s or [time_s]
        return vmc.encode_frame(weights, time_s=time_s - begin_s[0], bones=vmc.head_and_eyes(faps))

    return SingleFaceEncoder(write, address.session)


def vrchat_face(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> SingleFaceEncoder:
    """Return an encoder of VRChat's parameters: those that changed, and all once per second."""
    prefix = address.options.get("prefix", "")
    osc.head(f"/{prefix}", "f")
    follower = ArkitFollower()
    every = max(1, round(REFRESH_S * rate_hz))
    last: dict[int, bytes] = {}
    written = 0

    def write(number: int, time_s: float, faps: Faps) -> list[bytes]:
        nonlocal written
        weights = follower.follow(faps)
        datagrams = [*vrchat.encode_unified(weights, prefix=prefix), *vrchat.encode_eyes(faps, weights)]
        due = [data for index, data in enumerate(datagrams) if last.get(index) != data or written % every == 0]
        last.update(enumerate(datagrams))
        written += 1
        return due

    return SingleFaceEncoder(write, address.session)


def livelink_face(address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> SingleFaceEncoder:
    """Return an encoder of a Live Link Face subject, named by default as the session, or ``fapengine``.

    The address must have the ``device``, a UUID.
    """
    name = address.options.get("name") or address.session or "fapengine"
    subject = livelink.Subject(name, address.options["device"])
    follower = ArkitFollower()
    rate = (round(1000 * rate_hz), 1000)

    def write(number: int, time_s: float, faps: Faps) -> list[bytes]:
        values = livelink.livelink_values(follower.follow(faps), faps)
        return [livelink.encode_face(subject, values, number=number & 0x7FFFFFFF, rate=rate)]

    return SingleFaceEncoder(write, address.session)


def weights_face(session: str | None = None, *, rate_hz: float = 60.0) -> SingleFaceEncoder:
    """Return an encoder of weights as JSON (:mod:`fapengine.wire.shapes`)."""
    shapes, mouth = ArkitFollower(), VisemeFollower(rate_hz)

    def write(number: int, time_s: float, faps: Faps) -> list[bytes]:
        return [encode_weights(face.session, time_s, shapes.follow(faps), mouth.follow(faps), faps)]

    face = SingleFaceEncoder(write, session)
    return face


def vts_face(dialog: vts.VtsDialog, session: str | None = None, *, rate_hz: float = 60.0) -> SingleFaceEncoder:
    """Return an encoder of requests of VTube Studio's API."""
    shapes, mouth = ArkitFollower(), VisemeFollower(rate_hz)

    def write(number: int, time_s: float, faps: Faps) -> list[bytes]:
        return [dialog.inject(vts.vts_values(shapes.follow(faps), mouth.follow(faps), faps)).encode()]

    return SingleFaceEncoder(write, session)


class FbaFrameEncoder:
    """An encoder of one face as an MPEG-4 face stream: one plane per frame, each after its start code. Stateful.

    Every :attr:`SinkAddress.intra_s` there is an I plane, where a receiver can begin: it replaces the plane's start
    code by an object start code (:func:`joined`). A frame follows twice after a skipped one, so that the stream keeps
    its time.
    """

    def __init__(self, address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> None:
        self._encoder = Encoder(rate_hz=rate_hz, options=EncoderOptions(plane_start_codes="all"))
        self._every = max(1, round(address.intra_s * rate_hz))
        self._planes = 0
        self._last_number: int | None = None
        self._resumes = False
        self._face = SingleFaceEncoder(self._write, address.session)

    def encode(self, frames: HubFrames) -> list[bytes]:
        """Return the planes of a frame: one, or more after skipped frames."""
        return self._face.encode(frames)

    def resume(self, numbers: Mapping[str, int]) -> None:
        """Begin with an I plane inside a stream."""
        self._resumes = True

    def request_intra(self) -> None:
        """Make the next plane an I plane."""
        self._planes = 0

    def _write(self, number: int, time_s: float, faps: Faps) -> list[bytes]:
        missed = 0 if self._last_number is None else number - self._last_number - 1
        self._last_number = number
        return [self._plane(faps) for _ in range(1 + min(max(missed, 0), MAX_REPEATED))]

    def _plane(self, faps: Faps) -> bytes:
        if self._planes % self._every == 0:
            self._encoder.request_intra()
        self._planes += 1
        plane = self._encoder.frame(faps)
        return continued(plane) if self._resumes else plane


class RtpFrameEncoder:
    """An encoder of that stream as RTP packets of the MPEG-4 visual payload, from random numbers on (RFC 3550).

    Stateful.
    """

    def __init__(self, address: SinkAddress, rate_hz: float, epochs: Epochs = None) -> None:
        self._planes = FbaFrameEncoder(address, rate_hz)
        self._sender = rtp.RtpSender(ssrc=randbits(32), sequence=randbits(16), time=randbits(32))
        self._frame_s = 1 / rate_hz

    def encode(self, frames: HubFrames) -> list[bytes]:
        """Return the packets of a frame."""
        planes = self._planes.encode(frames)
        return [
            packet
            for before, plane in zip(range(len(planes) - 1, -1, -1), planes, strict=True)
            for packet in self._sender.plane(plane, frames.time_s - before * self._frame_s)
        ]

    def resume(self, numbers: Mapping[str, int]) -> None:
        """Do nothing: receivers treat another SSRC as another stream."""


OBJECT_START, PLANE_START = b"\x00\x00\x01\xba", b"\x00\x00\x01\xbb"


def joined(plane: bytes) -> bytes | None:
    """Turn a plane into the beginning of a stream; None if it is not an I plane.

    Examples
    --------
    >>> joined(bytes.fromhex("000001bb a033")).hex(), joined(bytes.fromhex("000001bb 27ff")) is None
    ('000001baa033', True)
    """
    if plane.startswith(OBJECT_START):
        return plane
    return OBJECT_START + plane[4:] if plane.startswith(PLANE_START) and plane[4] & 0x80 else None


def continued(plane: bytes) -> bytes:
    """Turn the beginning of a stream into an I plane inside one; other planes stay as they are.

    Examples
    --------
    >>> continued(bytes.fromhex("000001ba a033")).hex()
    '000001bba033'
    """
    return PLANE_START + plane[4:] if plane.startswith(OBJECT_START) else plane
