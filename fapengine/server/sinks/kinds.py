"""Kinds of sinks: one row each. URLs, help texts, shell completion, errors and the tables of the documents follow it.

To add a kind, write its encoder (:mod:`.encoders`) or a module of its own, and add a row. A kind is one of three:
:class:`DatagramKind` sends every frame over UDP, :class:`ConnectionKind` holds connections, :class:`VideoKind` is sent
images and sound. Libraries are imported when a sink is opened, so that the help does not wait for them.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, assert_never
from urllib.parse import parse_qsl, urlsplit

from fapengine.errors import UsageError
from fapengine.server.sinks.address import Sink, SinkAddress

if TYPE_CHECKING:
    from fapengine.host.hub import Hub
    from fapengine.server.film.film import Studio
    from fapengine.server.sinks.datagrams import DatagramSink
    from fapengine.server.sinks.encoders import FrameEncoder

LOOPBACK = "127.0.0.1"
MAX_INTRA_S = 60.0
PERFORMER_PORT = 39540
"""Port of VMC programs that move their model themselves and take shapes alone; :mod:`fapengine.wire.vmc` has it too."""
Epochs = Mapping[str, int] | None
"""Epoch of each session (:mod:`fapengine.server.ownership.placement`), where several processes show sessions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    name: str
    receivers: str
    """Programs that read it, as the help says it."""
    port: int | None = None
    """Port where the address has none; None: it must have one."""
    options: tuple[str, ...] = ()
    """Names that may stand after ``?``, besides ``session``."""
    has_host: bool = True
    """False for a device of this machine, which has neither host nor port."""
    default_host: str = ""
    has_path: bool = False
    takes_all_sessions: bool = False
    """Whether it sends all sessions; else one face."""

    @property
    def spelled(self) -> str:
        """The URL, as help and documents show it: ``vmc://HOST[:39539]``."""
        if not self.has_host:
            return f"{self.name}://"
        host = "[HOST]" if self.default_host else "HOST"
        port = ":PORT" if self.port is None else f"[:{self.port}]"
        return f"{self.name}://{host}{port}" + ("/PATH" if self.has_path else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class DatagramKind(_Kind):
    """A kind that sends every frame as datagrams; any process may send them."""

    encoder: "Callable[[SinkAddress, float, Epochs], FrameEncoder]"
    """Makes the encoder of an address; the number is the frame rate in Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConnectionKind(_Kind):
    """A kind that holds connections, which belong to one process."""

    open: "Callable[[Hub, SinkAddress], Awaitable[Sink]]"


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoKind(_Kind):
    """A kind that is sent images and sound of a head, which a studio draws."""

    open: "Callable[[Studio, SinkAddress, str], Awaitable[Sink]]"


SinkKind = DatagramKind | ConnectionKind | VideoKind


def _osc(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from fapengine.server.sinks.encoders import OscFrameEncoder

    return OscFrameEncoder(address.session, epochs)


def _named(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from fapengine.server.sinks.encoders import named_faps

    return named_faps(address.session)


def _vmc(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from fapengine.server.sinks.encoders import vmc_face

    return vmc_face(
        address.session,
        spelling=address.options.get("names", "arkit"),
        performer=address.port == PERFORMER_PORT,
        rate_hz=rate_hz,
    )


def _vrchat(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from fapengine.server.sinks.encoders import vrchat_face

    return vrchat_face(address.session, prefix=address.options.get("prefix", ""), rate_hz=rate_hz)


def _livelink(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from socket import gethostname
    from uuid import NAMESPACE_DNS, uuid5

    from fapengine.server.sinks.encoders import livelink_face

    device = address.options.get("device") or str(uuid5(NAMESPACE_DNS, f"fapengine.{gethostname()}")).upper()
    return livelink_face(device, address.session, name=address.options.get("name", ""), rate_hz=rate_hz)


def _fba(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from fapengine.server.sinks.encoders import FbaFrameEncoder

    return FbaFrameEncoder(address.session, rate_hz=rate_hz, intra_s=address.seconds("intra", 1.0, MAX_INTRA_S))


def _rtp(address: SinkAddress, rate_hz: float, epochs: Epochs) -> "FrameEncoder":
    from secrets import randbits

    from fapengine.server.sinks.encoders import RtpFrameEncoder

    first = {"ssrc": randbits(32), "sequence": randbits(16), "time": randbits(32)}
    intra_s = address.seconds("intra", 1.0, MAX_INTRA_S)
    return RtpFrameEncoder(address.session, rate_hz=rate_hz, intra_s=intra_s, **first)


async def _fba_tcp(hub: "Hub", address: SinkAddress) -> Sink:
    from fapengine.server.sinks.face_streams import FaceStreams

    return await FaceStreams.open(hub, address, address.seconds("intra", 1.0, MAX_INTRA_S))


async def _ws_json(hub: "Hub", address: SinkAddress) -> Sink:
    from fapengine.server.sinks.websockets import WeightStreams

    return await WeightStreams.open(hub, address)


async def _vts(hub: "Hub", address: SinkAddress) -> Sink:
    from fapengine.server.sinks.websockets import VtsSink

    return VtsSink(hub, address)


async def _camera(studio: "Studio", address: SinkAddress, head: str) -> Sink:
    from fapengine.server.sinks.video import open_camera

    return await open_camera(studio, address, head)


async def _stream(studio: "Studio", address: SinkAddress, head: str) -> Sink:
    from fapengine.server.sinks.video import open_stream

    return await open_stream(studio, address, head)


SINK_KINDS: tuple[SinkKind, ...] = (
    DatagramKind(
        name="osc",
        receivers="programs that know FAPs, /fap/1/frame of all sessions or of one",
        encoder=_osc,
        takes_all_sessions=True,
    ),
    DatagramKind(name="named", receivers="patches, /fap/<n>, one message per FAP", encoder=_named),
    DatagramKind(
        name="vmc",
        receivers="VSeeFace, Warudo and others; names is arkit, pascal, vrm0 or vrm1; port 39540 gets shapes alone",
        port=39539,
        options=("names",),
        encoder=_vmc,
    ),
    DatagramKind(name="vrchat", receivers="VRChat's parameters", port=9000, options=("prefix",), encoder=_vrchat),
    DatagramKind(
        name="livelink",
        receivers="Unreal and other Live Link Face receivers",
        port=11111,
        options=("name", "device"),
        encoder=_livelink,
    ),
    DatagramKind(
        name="fba",
        receivers="an MPEG-4 face stream, one plane per datagram; intra is the interval of I planes in s",
        options=("intra",),
        encoder=_fba,
    ),
    ConnectionKind(
        name="fba+tcp",
        receivers="the same stream over TCP, for all who connect here",
        options=("intra",),
        open=_fba_tcp,
    ),
    DatagramKind(
        name="rtp",
        receivers="the same stream over RTP, in the MPEG-4 visual payload",
        options=("intra",),
        encoder=_rtp,
    ),
    ConnectionKind(
        name="ws-json",
        receivers="game engines and scripts, JSON of 52 shapes, 15 visemes and the head over a WebSocket, for all who"
        " connect here",
        default_host=LOOPBACK,
        open=_ws_json,
    ),
    ConnectionKind(name="vts", receivers="VTube Studio", port=8001, options=("token_file",), open=_vts),
    VideoKind(
        name="camera",
        receivers="a virtual camera of this machine",
        has_host=False,
        options=("size", "fps", "device"),
        open=_camera,
    ),
    VideoKind(
        name="rtmp",
        receivers="a media server, H.264 and AAC",
        port=1935,
        has_path=True,
        options=("size", "fps", "kbit_s"),
        open=_stream,
    ),
    VideoKind(
        name="srt",
        receivers="a media server, the same as MPEG-TS",
        options=("size", "fps", "kbit_s", "streamid", "passphrase", "latency", "mode"),
        open=_stream,
    ),
)
"""Every kind, in the order in which they are listed. Those of video show the session ``face`` where none is named."""
_BY_NAME = {kind.name: kind for kind in SINK_KINDS}
SINK_NAMES = tuple(_BY_NAME)


def kind_of(address: SinkAddress) -> SinkKind:
    """Find the row of an address."""
    return _BY_NAME[address.kind]


def parse_sink(url: str) -> SinkAddress:
    """Read a sink's URL, ``KIND://HOST:PORT?session=NAME&OPTION=VALUE``.

    Raises
    ------
    UsageError
        If it is not one of a kind in :data:`SINK_KINDS`.

    Examples
    --------
    >>> parse_sink("vmc://127.0.0.1")
    SinkAddress(kind='vmc', host='127.0.0.1', port=39539, session=None, options={})
    """
    try:
        parts = urlsplit(url)
        port = parts.port
        query = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)))
    except ValueError as error:
        raise UsageError(f"sink: got {url!r:.100}, expected KIND://HOST:PORT ({error})") from error
    kind = _BY_NAME.get(parts.scheme)
    if kind is None:
        names = ", ".join(f"{name}://" for name in SINK_NAMES)
        raise UsageError(f"sink: got {url!r:.100}, expected KIND://HOST:PORT, KIND one of {names}")
    host = parts.hostname or kind.default_host
    if bool(host) != kind.has_host or bool(parts.path.strip("/")) != kind.has_path or parts.username:
        raise UsageError(f"sink: got {url!r:.100}, expected {kind.spelled}")
    if not kind.has_host:
        port = 0
    port = kind.port if port is None else port
    if port is None:
        raise UsageError(f"sink: got {url!r:.100} without a port, expected {kind.name}://{parts.hostname}:PORT")
    session = query.pop("session", None)
    unknown = [name for name in query if name not in kind.options]
    if unknown:
        allowed = ", ".join(("session", *kind.options))
        raise UsageError(f"sink {kind.name}: got {unknown[0]!r:.40}, expected one of {allowed}")
    return SinkAddress(kind.name, host, port, session, query, parts.path)


def datagram_sink(hub: "Hub", address: SinkAddress, epochs: Epochs = None) -> "DatagramSink":
    """Begin to send datagrams.

    Raises
    ------
    UsageError
        If the kind does not send datagrams, or an option's value is wrong.
    ResourceError
        If the host is unknown.
    """
    from fapengine.server.sinks.datagrams import DatagramSink

    kind = kind_of(address)
    if not isinstance(kind, DatagramKind):
        raise UsageError(
            f"sinks: got {str(address)!r}, expected one that sends datagrams; `fapengine serve` has the others"
        )
    # Before a session is shown here, another worker may show it.
    waits_for = address.session if epochs is not None else None
    return DatagramSink(hub, address, kind.encoder(address, hub.pacer.rate_hz, epochs), waits_for=waits_for)


async def open_sink(
    hub: "Hub",
    address: SinkAddress,
    epochs: Epochs = None,
    studio: "Studio | None" = None,
    head: str = "default",
) -> Sink:
    """Begin to send. Images of a head are drawn by a studio.

    Raises
    ------
    UsageError
        If an option's value is wrong.
    ResourceError
        If the host is unknown, the port taken, or a library or a device is missing.
    """
    kind = kind_of(address)
    match kind:
        case DatagramKind():
            return datagram_sink(hub, address, epochs)
        case ConnectionKind():
            return await kind.open(hub, address)
        case VideoKind():
            if studio is None:
                raise UsageError(f"sink {address}: nothing draws its images here")
            return await kind.open(studio, address, head)
        case _:
            assert_never(kind)
