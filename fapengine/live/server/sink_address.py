"""What sinks are told as: URLs.

::

    osc://HOST:PORT[?session=NAME]                       /fap/1/frame of all sessions, or of one; UDP
    named://HOST:PORT[?session=NAME]                     /fap/<n>, a message a FAP; UDP
    vmc://HOST:PORT[?session=NAME&names=N]               VSeeFace, Warudo, ...: port 39539, or 39540 for shapes alone;
                                                         names arkit, pascal, vrm0 or vrm1
    vrchat://HOST:PORT[?session=NAME&prefix=P]           VRChat's parameters: port 9000
    livelink://HOST:PORT[?session=NAME&name=N&device=U]  Unreal and other Live Link Face receivers: port 11111
    fba://HOST:PORT[?session=NAME&intra=S]               MPEG-4 face stream, a plane a datagram; UDP
    fba+tcp://HOST:PORT[?session=NAME&intra=S]           the same for all who connect here, each from an I plane on
    rtp://HOST:PORT[?session=NAME&intra=S]               the same over RTP, in the MPEG-4 visual payload; UDP
    ws-json://[HOST]:PORT[?session=NAME]                 JSON of 52 shapes, 15 visemes and the head, over a WebSocket,
                                                         for all who connect here
    vts://HOST[?session=NAME&token_file=FILE]            VTube Studio: port 8001
    camera://[?session=NAME&size=N&fps=N&device=D]       pictures, for a virtual camera of this machine
    rtmp://HOST[:PORT]/PATH[?session=NAME&size=N&fps=N&kbit_s=N]   video and sound, H.264 and AAC, to a media server
    srt://HOST:PORT[?session=NAME&...&streamid=S&passphrase=P&latency=N&mode=M]   the same as MPEG-TS

Without a session, one face shows the first that is open; cameras and streams show the page's, "face". A port may be
left out where one is named here.
"""

from dataclasses import dataclass, field
from typing import Protocol
from urllib.parse import parse_qsl, urlsplit

from fapengine.errors import UsageError
from fapengine.live.wire import livelink, vmc, vrchat, vts

PORTS = {"vmc": vmc.MARIONETTE_PORT, "vrchat": vrchat.PORT, "livelink": livelink.PORT, "vts": vts.PORT, "rtmp": 1935}
OPTIONS = {
    "osc": (), "named": (), "vmc": ("names",), "vrchat": ("prefix",), "livelink": ("name", "device"),
    "fba": ("intra",), "fba+tcp": ("intra",), "rtp": ("intra",),
    "ws-json": (), "vts": ("token_file",),
    "camera": ("size", "fps", "device"), "rtmp": ("size", "fps", "kbit_s"),
    "srt": ("size", "fps", "kbit_s", "streamid", "passphrase", "latency", "mode"),
}  # fmt: skip
FILMS = ("camera", "rtmp", "srt")
"""Kinds that are sent pictures instead of FAPs."""
SOCKETS = ("ws-json", "vts")
"""Kinds that hold WebSockets."""
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class SinkAddress:
    """Where frames go, and what kind."""

    kind: str
    host: str
    port: int
    session: str | None = None
    options: dict[str, str] = field(default_factory=dict)
    path: str = field(default="", repr=False)
    """Behind the port; a stream's key is in it, so it is shown nowhere."""

    def __str__(self) -> str:
        if self.kind == "camera":
            return "camera://" + (f"?session={self.session}" if self.session else "")
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}://{host}:{self.port}" + (f"?session={self.session}" if self.session else "")


@dataclass(slots=True)
class SinkCounts:
    """Counts of a sink.

    Stateful.
    """

    sent: int = 0
    """Datagrams, or planes times streams."""
    dropped: int = 0
    """Datagrams or planes that the system, or a slow reader, did not take."""


class Sink(Protocol):
    """Sends frames until it is closed."""

    address: SinkAddress
    counts: SinkCounts

    async def close(self) -> None:
        """Send no more."""
        ...


def parse_sink(url: str) -> SinkAddress:
    """Read a sink's URL.

    Raises
    ------
    UsageError
        If it is none of those above.

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
    kinds = ", ".join(f"{kind}://" for kind in OPTIONS)
    is_camera = parts.scheme == "camera"
    has_path = bool(parts.path.strip("/")) != (parts.scheme == "rtmp")
    host = parts.hostname or (LOOPBACK if parts.scheme == "ws-json" else "")
    if parts.scheme not in OPTIONS or bool(host) == is_camera or has_path or parts.username:
        raise UsageError(
            f"sink: got {url!r:.100}, expected KIND://HOST:PORT, KIND one of {kinds}; rtmp has a path, too"
        )
    if is_camera:
        port = 0
    port = PORTS.get(parts.scheme) if port is None else port
    if port is None:
        raise UsageError(f"sink: got {url!r:.100} without a port, expected {parts.scheme}://{parts.hostname}:PORT")
    session = query.pop("session", None)
    unknown = [name for name in query if name not in OPTIONS[parts.scheme]]
    if unknown:
        allowed = ", ".join(("session", *OPTIONS[parts.scheme]))
        raise UsageError(f"sink {parts.scheme}: got {unknown[0]!r:.40}, expected one of {allowed}")
    return SinkAddress(parts.scheme, host, port, session, query, parts.path)
