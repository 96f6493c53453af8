"""Sinks: their URLs, and one row for each kind. URLs, help, shell completion, errors and documentation follow the rows.

To add a kind, write what opens it in a module of this package, and name that in a row here. :mod:`.opening` imports the
module when a sink is opened, so that the help does not wait for its libraries.
"""

from dataclasses import dataclass, field
from typing import Literal, Protocol
from urllib.parse import parse_qsl, urlsplit

from fapengine._counters import Counts, metric
from fapengine.errors import UsageError

LOOPBACK = "127.0.0.1"
MAX_INTRA_S = 60.0


@dataclass(frozen=True, slots=True)
class SinkAddress:
    """The destination of frames, and the kind of sink that sends them there."""

    kind: str
    host: str
    port: int
    session: str | None = None
    options: dict[str, str] = field(default_factory=dict)
    path: str = field(default="", repr=False)
    """Path after the port. It may contain the key of a stream, so it is shown nowhere."""

    def __str__(self) -> str:
        place = f"{self.url_host}:{self.port}" if self.host else ""
        return f"{self.kind}://{place}" + (f"?session={self.session}" if self.session else "")

    @property
    def url_host(self) -> str:
        """Host as a URL contains it."""
        return f"[{self.host}]" if ":" in self.host else self.host

    @property
    def intra_s(self) -> float:
        """Interval of I planes of a face stream, s.

        Raises UsageError if the option is not a number, or out of range.
        """
        text = self.options.get("intra", "1")
        try:
            value = float(text)
        except ValueError as error:
            raise UsageError(f"sink {self.kind}: intra: got {text!r:.40}, expected seconds") from error
        if not 0 < value <= MAX_INTRA_S:
            raise UsageError(f"sink {self.kind}: intra: got {value} s, expected 0 to {MAX_INTRA_S:g}")
        return value

    def whole(self, name: str, default: int, low: int, high: int) -> int:
        """Return an option that is a whole number. Raises UsageError if it is not a whole number, or out of range."""
        text = self.options.get(name, str(default))
        if not text.isdecimal() or not low <= int(text[:9]) <= high:
            raise UsageError(f"sink {self.kind}: {name}: got {text!r:.40}, expected a whole number {low} to {high}")
        return int(text)


@dataclass(slots=True)
class SinkCounts(Counts):
    """Counts of a sink. Stateful."""

    sent: int = metric("sent", "Datagrams or planes that sinks sent.")
    """Planes: times streams."""
    dropped: int = metric("unsent", "Those that could not be sent.")
    """Those that the system, or a slow reader, did not accept."""


class Sink(Protocol):
    """Sends frames until it is closed."""

    address: SinkAddress
    counts: SinkCounts

    async def close(self) -> None:
        """Stop sending."""


@dataclass(frozen=True, slots=True)
class SinkKind:
    """One kind of sink."""

    name: str
    opens: str
    """``module:function`` of this package that opens it, of the type that :mod:`.opening` gives for the medium."""
    receivers: str
    """Programs that read it, as the help names them."""
    port: int | None = None
    """Default port; None: a URL must have one."""
    options: tuple[str, ...] = ()
    """Names allowed after ``?``, besides ``session``."""
    medium: Literal["datagrams", "connections", "video"] = "datagrams"
    """Every frame over UDP, from any process; connections, which belong to one process; or images and audio."""
    has_host: bool = True
    """False for a device of this machine, which has neither host nor port."""
    default_host: str = ""
    has_path: bool = False
    takes_all_sessions: bool = False
    """True if it sends all sessions, False if one face."""

    @property
    def spelled(self) -> str:
        """The URL, as help and documentation show it: ``vmc://HOST[:39539]``."""
        if not self.has_host:
            return f"{self.name}://"
        host = "[HOST]" if self.default_host else "HOST"
        port = ":PORT" if self.port is None else f"[:{self.port}]"
        return f"{self.name}://{host}{port}" + ("/PATH" if self.has_path else "")


SINK_KINDS = (
    SinkKind("osc", "encoders:OscFrameEncoder", "programs that know FAPs, /fap/1/frame of all sessions or of one",
             takes_all_sessions=True),
    SinkKind("named", "encoders:named_faps", "patches, /fap/<n>, one message per FAP"),
    SinkKind("vmc", "encoders:vmc_face",
             "VSeeFace, Warudo and others; names is arkit, pascal, vrm0 or vrm1; port 39540 gets shapes alone",
             port=39539, options=("names",)),
    SinkKind("vrchat", "encoders:vrchat_face", "VRChat's parameters", port=9000, options=("prefix",)),
    SinkKind("livelink", "opening:livelink", "Unreal and other Live Link Face receivers",
             port=11111, options=("name", "device")),
    SinkKind("fba", "encoders:FbaFrameEncoder",
             "an MPEG-4 face stream, one plane per datagram; intra is the interval of I planes in s",
             options=("intra",)),
    SinkKind("fba+tcp", "face_streams:FaceStreams.open", "the same stream over TCP, for all who connect here",
             options=("intra",), medium="connections"),
    SinkKind("rtp", "encoders:RtpFrameEncoder", "the same stream over RTP, in the MPEG-4 visual payload",
             options=("intra",)),
    SinkKind("ws-json", "websockets:WeightStreams.open",
             "game engines and scripts, JSON of 52 shapes, 15 visemes and the head over a WebSocket, for all who"
             " connect here", medium="connections", default_host=LOOPBACK),
    SinkKind("vts", "websockets:VtsSink", "VTube Studio", port=8001, options=("token_file",), medium="connections"),
    SinkKind("camera", "video:CameraSink", "a virtual camera of this machine",
             options=("size", "fps", "device"), medium="video", has_host=False),
    SinkKind("rtmp", "video:StreamSink.open", "a media server, H.264 and AAC",
             port=1935, options=("size", "fps", "kbit_s"), medium="video", has_path=True),
    SinkKind("srt", "video:StreamSink.open", "a media server, the same as MPEG-TS",
             options=("size", "fps", "kbit_s", "streamid", "passphrase", "latency", "mode"), medium="video"),
)  # fmt: skip
"""Every kind, in the order in which they are listed. Those of video show the session ``face`` by default."""
_BY_NAME = {kind.name: kind for kind in SINK_KINDS}
SINK_NAMES = tuple(_BY_NAME)


def kind_of(address: SinkAddress) -> SinkKind:
    """Return the row of an address."""
    return _BY_NAME[address.kind]


def parse_sink(url: str) -> SinkAddress:
    """Read a sink's URL, ``KIND://HOST:PORT?session=NAME&OPTION=VALUE``.

    Raises UsageError if it is not a URL of a kind in :data:`SINK_KINDS`.

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
    if port == 0 and kind.medium == "datagrams":
        raise UsageError(f"sink: got {url!r:.100} with port 0, expected 1 to 65535")
    session = query.pop("session", None)
    if session is not None:
        from fapengine.wire.fap_osc import MAX_SESSION_BYTES  # the help needs no NumPy

        if not 1 <= (size := len(session.encode(errors="replace"))) <= MAX_SESSION_BYTES:
            raise UsageError(f"sink: got a session of {size} bytes, expected 1 to {MAX_SESSION_BYTES}")
    unknown = [name for name in query if name not in kind.options]
    if unknown:
        allowed = ", ".join(("session", *kind.options))
        raise UsageError(f"sink {kind.name}: got {unknown[0]!r:.40}, expected one of {allowed}")
    return SinkAddress(kind.name, host, port, session, query, parts.path)
