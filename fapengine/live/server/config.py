"""One TOML for everything that ``fapengine serve`` can be told: :data:`EXAMPLE` shows all of it."""

import re
from dataclasses import dataclass, field, fields, replace
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from fapengine._strict_toml import Between, Checked, parse_toml
from fapengine.errors import UsageError
from fapengine.live.engine.session import Limits
from fapengine.live.server.sink_address import FILMS, parse_sink
from fapengine.live.wire.speech_osc.schema import check_session
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice

EXAMPLE = """\
[listen]
host = "127.0.0.1"      # "0.0.0.0": the whole network may speak; set a token then
port = 9110             # OSC: UDP and TCP
web_port = 8110         # the page; 0: none
metrics_port = 0        # Prometheus text at /metrics; 0: none
token = ""              # what senders and pages must know; "": nobody is asked
origins = []            # sites whose pages may show these faces, "https://example.org" say; the server's own may always
workers = 1             # processes, one for each core that shall show faces; each has limits of its own

[face]
profile = "grid_s1_en"  # whose way of speaking
head = "default"        # whose face the page shows
rate_hz = 60.0          # frames a second
seed = 1                # chance of blinks and head motion

[style]                 # at first; senders change it with /param
articulation = 1.0      # also jaw, lips: 0 to 3; loudness_db: -20 to 20
blinks = true           # also head_motion, gaze, idle, emphasis

[voice]
name = "en-us"          # speaks /tts/text and the page's text box
rate_wpm = 160
ssml = false            # whether its texts are SSML, whose tags are obeyed

[sound]
session = ""            # whose voice this machine's loudspeaker plays, "face" say; "": nobody's, pages play their own
device = ""             # its number, or a part of its name; "": the system's
microphone = ""         # what this hears moves a face: "default", a number or a part of its name; "": none
listens = "face"        # the session that it moves
ear = ""                # what hears: "small", "sphinx", "both" or an ONNX model; "": the best installed

[calls]
on = false              # WebRTC at the page's port: /whep shows a face, /whip lets sound move it, /call.html is a page
host = ""               # address of this machine for calls; "": the one by which the caller asked
most = 8                # calls at a time
size = 512              # of the picture, pixels each way
rate_hz = 30.0          # pictures a second

[limits]
sessions = 1000
utterances = 32         # of a session, queued
queued_s = 600.0        # of an utterance, and how far ahead one may begin
silence_s = 2.0         # an utterance without an end is over when nothing more comes for so long
wait_s = 30.0           # one whose turn it is and whose sound does not come is given up
idle_close_s = 120.0    # a session that nobody talks to or watches is closed
packets_a_peer = 256    # waiting to be understood
streams = 256           # TCP connections of senders
connections = 512       # connections of the page, and as many of the metrics
connections_an_address = 128  # of any one of them, from one address
ears = 4                # sessions that are moved by sound, each a process; 0: none

[bus]
url = ""                # of NATS, "nats://10.0.0.5:4222": machines share their sessions; "": this one is alone
host = ""               # address at which others reach this machine; "": where it listens, or of its way to NATS
name = "fapengine"      # machines that share have the same
replicas = 1            # copies that a NATS of several servers keeps

[log]
level = "info"          # debug, info, warning, error
format = "text"         # or "json": one object a line

[[sink]]
url = "vmc://127.0.0.1:39539"
"""
"""Every key, with its default; every one may be left out. And one sink."""
OSC_PORT, WEB_PORT = 9110, 8110
RATES_HZ = (1.0, 240.0)
Port = Annotated[int, Between(0, 65_535)]


@dataclass(frozen=True, slots=True)
class Listen(Checked):
    """Where the server can be reached."""

    host: str = "127.0.0.1"
    port: Port = OSC_PORT
    """OSC, UDP and TCP; 0: any free one."""
    web_port: Port | None = WEB_PORT
    """The page; None: none, 0: any free one. In the file 0 is none."""
    metrics_port: Port | None = None
    """Prometheus text; None: none, 0: any free one. In the file 0 is none."""
    token: str | None = None
    """Word that senders and pages must know; None or "": nobody is asked."""
    origins: tuple[str, ...] = ()
    """Sites whose pages may show these faces beside the server's own: ``"https://example.org"``."""
    workers: Annotated[int, Between(1, 256)] = 1
    """Processes that show faces (:mod:`fapengine.live.server.workers`)."""

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        object.__setattr__(self, "token", self.token or None)
        for origin in self.origins:
            if not re.fullmatch(r"https?://[^/\s]+", origin):
                raise UsageError(f"origins: got {origin!r}, expected sites such as 'https://example.org'")


@dataclass(frozen=True, slots=True)
class Face(Checked):
    """Who speaks, and how it looks."""

    profile: str = "grid_s1_en"
    head: str = "default"
    rate_hz: Annotated[float, Between(RATES_HZ[0], RATES_HZ[1])] = 60.0
    seed: Annotated[int, Between(0, 2**63 - 1)] = 1


@dataclass(frozen=True, slots=True)
class SoundChoice(Checked):
    """Whose voice is heard where the server runs."""

    session: str | None = None
    """Session that the loudspeaker plays; None or "": none."""
    device: str | None = None
    """Number of the sound device or a part of its name; None or "": the system's."""
    microphone: str | None = None
    """Microphone that moves a face: ``"default"``, its number or a part of its name; None or "": none."""
    listens: str = "face"
    """Session that the microphone moves."""
    ear: str | None = None
    """Name of an ear (:mod:`fapengine.ears.choice`) or an ONNX model; None or "": the best that is installed."""

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        object.__setattr__(self, "session", self.session or None)
        object.__setattr__(self, "device", self.device or None)
        object.__setattr__(self, "microphone", self.microphone or None)
        object.__setattr__(self, "ear", self.ear or None)
        check_session(self.listens)
        if self.session is not None:
            check_session(self.session)


@dataclass(frozen=True, slots=True)
class CallChoice(Checked):
    """WebRTC: who may watch a face as pictures and sound, or move it by sound."""

    on: bool = False
    host: str | None = None
    """Address of this machine at which callers reach it; None or "": the one by which they asked."""
    most: Annotated[int, Between(1, 1000)] = 8
    size: Annotated[int, Between(64, 2048)] = 512
    """Width and height of the picture, pixels; even."""
    rate_hz: Annotated[float, Between(1.0, 120.0)] = 30.0

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        object.__setattr__(self, "host", self.host or None)
        if self.size % 2:
            raise UsageError(f"size: got {self.size}, expected an even number")
        if self.host is not None:
            try:
                ip_address(self.host)
            except ValueError as error:
                raise UsageError(f"host: got {self.host!r:.60}, expected an address such as '192.0.2.7'") from error


@dataclass(frozen=True, slots=True)
class Caps(Checked):
    """What one server holds at most."""

    sessions: Annotated[int, Between(1, 100_000)] = 1000
    utterances: Annotated[int, Between(1, 10_000)] = 32
    queued_s: Annotated[float, Between(1.0, 86_400.0)] = 600.0
    silence_s: Annotated[float, Between(0.1, 3600.0)] = 2.0
    wait_s: Annotated[float, Between(0.1, 3600.0)] = 30.0
    idle_close_s: Annotated[float, Between(1.0, 86_400.0)] = 120.0
    packets_a_peer: Annotated[int, Between(1, 100_000)] = 256
    streams: Annotated[int, Between(1, 10_000)] = 256
    connections: Annotated[int, Between(1, 10_000)] = 512
    connections_an_address: Annotated[int, Between(1, 10_000)] = 128
    ears: Annotated[int, Between(0, 64)] = 4

    @property
    def engine(self) -> Limits:
        """The engine's part."""
        return Limits(
            sessions=self.sessions,
            utterances=self.utterances,
            queued_s=self.queued_s,
            silence_s=self.silence_s,
            wait_s=self.wait_s,
        )


@dataclass(frozen=True, slots=True)
class BusChoice(Checked):
    """With whom the sessions are shared (:mod:`fapengine.live.server.bus`)."""

    url: str | None = None
    """Addresses of NATS, with ``,`` between them; None or "": this machine is alone."""
    host: str | None = None
    """Address at which other machines and senders reach this one; None or "": that at which it listens."""
    name: str = "fapengine"
    """Common name of the machines that share sessions."""
    replicas: Annotated[int, Between(1, 5)] = 1
    """Copies of what NATS keeps."""

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        object.__setattr__(self, "url", self.url or None)
        object.__setattr__(self, "host", self.host or None)
        for one in self.url.split(",") if self.url else ():
            if not re.fullmatch(r"(nats|tls|ws|wss)://[^/\s]+/?", one):
                raise UsageError(f"bus: got {one.rpartition('@')[2]!r:.80}, expected nats://HOST:PORT")
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", self.name):
            raise UsageError(f"bus name: got {self.name!r:.80}, expected letters, digits, - and _")


@dataclass(frozen=True, slots=True)
class Log(Checked):
    """What is told, and how."""

    level: Literal["debug", "info", "warning", "error"] = "info"
    format: Literal["text", "json"] = "text"


@dataclass(frozen=True, slots=True)
class ServeConfig:
    """Configuration of a :class:`fapengine.Server`; :data:`EXAMPLE` shows all of it as TOML."""

    listen: Listen = field(default_factory=Listen)
    face: Face = field(default_factory=Face)
    style: Style = field(default_factory=Style)
    voice: VoiceChoice = field(default_factory=VoiceChoice)
    sound: SoundChoice = field(default_factory=SoundChoice)
    calls: CallChoice = field(default_factory=CallChoice)
    limits: Caps = field(default_factory=Caps)
    bus: BusChoice = field(default_factory=BusChoice)
    log: Log = field(default_factory=Log)
    sinks: tuple[str, ...] = ()
    """URLs; see :mod:`fapengine.live.server.sink_address`."""

    @property
    def has_parent(self) -> bool:
        """Whether workers show the faces, and a parent gives them their sessions."""
        return self.listen.workers > 1 or self.bus.url is not None

    def __post_init__(self) -> None:
        for url in self.sinks if self.has_parent else ():
            if parse_sink(url).kind in FILMS:
                given = "a bus" if self.bus.url else f"workers = {self.listen.workers}"
                raise UsageError(f"sink {parse_sink(url)}: got {given}, expected a server of one process with it")


@dataclass(frozen=True, slots=True)
class _Sink:
    url: str

    def __post_init__(self) -> None:
        parse_sink(self.url)


@dataclass(frozen=True, slots=True)
class _Document:
    """A configuration as its file spells it."""

    listen: Listen = field(default_factory=Listen)
    face: Face = field(default_factory=Face)
    style: Style = field(default_factory=Style)
    voice: VoiceChoice = field(default_factory=VoiceChoice)
    sound: SoundChoice = field(default_factory=SoundChoice)
    calls: CallChoice = field(default_factory=CallChoice)
    limits: Caps = field(default_factory=Caps)
    bus: BusChoice = field(default_factory=BusChoice)
    log: Log = field(default_factory=Log)
    sink: tuple[_Sink, ...] = ()


def parse_config(data: bytes, name: str) -> ServeConfig:
    """Read a configuration.

    Parameters
    ----------
    data : bytes
        TOML.
    name : str
        Of the file, for messages.

    Raises
    ------
    DataError
        If it is no TOML, or a key is unknown, of the wrong type or out of range; ``where`` is file and key.

    Examples
    --------
    >>> config = parse_config(b'sink = [{url = "vrchat://127.0.0.1"}]', "mine.toml")
    >>> config.listen.port, config.face.rate_hz, config.sinks
    (9110, 60.0, ('vrchat://127.0.0.1',))
    """
    document = parse_toml(data, _Document, name)
    parts = {field.name: getattr(document, field.name) for field in fields(document)}
    sinks = tuple(sink.url for sink in parts.pop("sink"))
    listen = document.listen
    parts["listen"] = replace(listen, web_port=listen.web_port or None, metrics_port=listen.metrics_port or None)
    return ServeConfig(**parts, sinks=sinks)


Part = TypeVar("Part", Listen, Face, VoiceChoice, SoundChoice, CallChoice, Caps, BusChoice, Log)


def load_config(path: Path) -> ServeConfig:
    """Read a configuration's file: see :func:`parse_config`.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it is wrong.
    """
    try:
        return parse_config(path.read_bytes(), str(path))
    except OSError as error:
        raise UsageError(f"config: got {path}, expected a file that can be read: {error.strerror}") from error


def overridden(part: Part, **changes: Any) -> Part:
    """Put what is not None in place of a dataclass' own fields: options go before the file.

    Raises
    ------
    UsageError
        If a change is of the wrong type or out of range.

    Examples
    --------
    >>> overridden(Face(), profile=None, rate_hz=30.0).rate_hz
    30.0
    """
    return replace(part, **{name: change for name, change in changes.items() if change is not None})
