"""The TOML configuration of ``fapengine serve``; docs/reference/configuration.md shows every key."""

import re
from dataclasses import dataclass, field, fields, replace
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from fapengine import speaking
from fapengine._strict_toml import MAX_BYTES, Between, Checked, check_fields, parse_toml
from fapengine.engine.session import Limits
from fapengine.errors import UsageError
from fapengine.files.paths import read_bytes
from fapengine.server.sinks.kinds import kind_of, parse_sink
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice
from fapengine.wire.speech_osc.schema import check_session

OSC_PORT, WEB_PORT = 9110, 8110
MIN_TOKEN = 16
"""Characters of a token, where other machines reach the server."""
Port = Annotated[int, Between(0, 65_535)]


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


class _Section(Checked):
    """Base of sections: an empty string means None where None is allowed."""

    __slots__ = ()

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        for one in fields(self):  # type: ignore[arg-type]  # of a dataclass
            if one.type == str | None and getattr(self, one.name) == "":
                object.__setattr__(self, one.name, None)


@dataclass(frozen=True, slots=True)
class Listen(_Section):
    """Addresses and access."""

    host: str = "127.0.0.1"
    port: Port = OSC_PORT
    """OSC over UDP and TCP; 0: any free port."""
    web_port: Port | None = WEB_PORT
    """Web page; None: no page, 0: any free port. In the file, 0 means no page."""
    metrics_port: Port | None = None
    """Prometheus metrics; None: off, 0: any free port. In the file, 0 means off."""
    token: str | None = None
    """Secret that senders and pages must present; None or "": none is needed."""
    origins: tuple[str, ...] = ()
    """Other sites whose pages may show these faces: ``"https://example.org"``."""
    proxies: tuple[str, ...] = ()
    """Addresses of reverse proxies whose ``X-Forwarded-For`` names who asks: ``"127.0.0.1"``."""
    workers: Annotated[int, Between(1, 256)] = 1
    """Worker processes (:mod:`fapengine.server.cluster.workers`)."""
    provenance: bool = True
    """Whether pages, callers and RTMP servers get the mark of :mod:`fapengine.files.provenance`."""

    def __post_init__(self) -> None:
        _Section.__post_init__(self)
        for origin in self.origins:
            if not re.fullmatch(r"https?://[^/\s]+", origin):
                raise UsageError(f"origins: got {origin!r}, expected sites such as 'https://example.org'")
        for proxy in self.proxies:
            try:
                ip_address(proxy)
            except ValueError as error:
                raise UsageError(f"proxies: got {proxy!r}, expected addresses such as '127.0.0.1'") from error
        if self.token is not None and len(self.token) < MIN_TOKEN and not _is_loopback(self.host):
            raise UsageError(
                f"token: got {len(self.token)} characters, expected at least {MIN_TOKEN}:"
                f" other machines reach {self.host}"
            )


@dataclass(frozen=True, slots=True)
class Face(Checked):
    """Speaker profile, head and frame rate."""

    profile: speaking.ProfileName = speaking.DEFAULT_PROFILE
    head: str = "default"
    rate_hz: speaking.Fps = 60.0
    seed: speaking.Seed = 1


@dataclass(frozen=True, slots=True)
class SoundChoice(_Section):
    """Audio devices of the server's machine, and the recognizer."""

    session: str | None = None
    """Session that is played on the audio output; None or "": none."""
    device: str | None = None
    """Audio output: its number or part of its name; None or "": the default."""
    microphone: str | None = None
    """Microphone that drives a face: ``"default"``, its number or part of its name; None or "": none."""
    listens: str = "face"
    """Session that the microphone drives."""
    recognizer: str | None = None
    """Name of a recognizer (:mod:`fapengine.recognition.choice`) or an ONNX model; None or "": the best installed."""

    def __post_init__(self) -> None:
        _Section.__post_init__(self)
        check_session(self.listens)
        if self.session is not None:
            check_session(self.session)


@dataclass(frozen=True, slots=True)
class CallChoice(_Section):
    """WebRTC: faces as video and audio, and audio that drives them."""

    on: bool = False
    host: str | None = None
    """IP address of this machine for calls; None or "": the one that the caller used."""
    max_calls: Annotated[int, Between(1, 1000)] = 8
    size: Annotated[int, Between(64, 2048)] = 512
    """Width and height of the image in pixels; even."""
    rate_hz: Annotated[float, Between(1.0, 120.0)] = 30.0

    def __post_init__(self) -> None:
        _Section.__post_init__(self)
        if self.size % 2:
            raise UsageError(f"size: got {self.size}, expected an even number")
        if self.host is not None:
            try:
                ip_address(self.host)
            except ValueError as error:
                raise UsageError(f"host: got {self.host!r:.60}, expected an address such as '192.0.2.7'") from error


@dataclass(frozen=True, slots=True)
class Caps(Checked):
    """Limits of one server process."""

    sessions: Annotated[int, Between(1, 100_000)] = 1000
    utterances: Annotated[int, Between(1, 10_000)] = 32
    queued_s: Annotated[float, Between(1.0, 86_400.0)] = 600.0
    silence_s: Annotated[float, Between(0.1, 3600.0)] = 2.0
    wait_s: Annotated[float, Between(0.1, 3600.0)] = 30.0
    idle_close_s: Annotated[float, Between(1.0, 86_400.0)] = 120.0
    packets_per_sender: Annotated[int, Between(1, 100_000)] = 256
    streams: Annotated[int, Between(1, 10_000)] = 256
    connections: Annotated[int, Between(1, 10_000)] = 512
    connections_per_address: Annotated[int, Between(1, 10_000)] = 128
    recognizers: Annotated[int, Between(0, 64)] = 4

    @property
    def engine(self) -> Limits:
        """The limits that the engine applies."""
        return Limits(**{one.name: getattr(self, one.name) for one in fields(Limits) if hasattr(self, one.name)})


@dataclass(frozen=True, slots=True)
class BusChoice(_Section):
    """Sessions shared with other servers (:mod:`fapengine.server.cluster.bus`)."""

    url: str | None = None
    """URLs of NATS servers, separated by commas; None or "": sessions are not shared."""
    host: str | None = None
    """Address at which other machines and senders reach this one; None or "": the address it listens on."""
    name: str = "fapengine"
    """Common name of the servers that share sessions."""
    replicas: Annotated[int, Between(1, 5)] = 1
    """Copies that NATS keeps."""

    def __post_init__(self) -> None:
        _Section.__post_init__(self)
        for one in self.url.split(",") if self.url else ():
            if not re.fullmatch(r"(nats|tls|ws|wss)://[^/\s]+/?", one):
                raise UsageError(f"bus: got {one.rpartition('@')[2]!r:.80}, expected nats://HOST:PORT")
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", self.name):
            raise UsageError(f"bus name: got {self.name!r:.80}, expected letters, digits, - and _")


@dataclass(frozen=True, slots=True)
class Log(Checked):
    """Level and format of the log."""

    level: Literal["debug", "info", "warning", "error"] = "info"
    format: Literal["text", "json"] = "text"


@dataclass(frozen=True, slots=True)
class _Parts:
    """Sections that are the same in Python and in the file."""

    listen: Listen = field(default_factory=Listen)
    face: Face = field(default_factory=Face)
    style: Style = field(default_factory=Style)
    voice: VoiceChoice = field(default_factory=VoiceChoice)
    sound: SoundChoice = field(default_factory=SoundChoice)
    calls: CallChoice = field(default_factory=CallChoice)
    limits: Caps = field(default_factory=Caps)
    bus: BusChoice = field(default_factory=BusChoice)
    log: Log = field(default_factory=Log)


@dataclass(frozen=True, slots=True)
class ServerConfig(_Parts):
    """Configuration of a :class:`fapengine.Server`; docs/reference/configuration.md shows it as TOML."""

    sinks: tuple[str, ...] = ()
    """URLs; see :mod:`fapengine.server.sinks.kinds`."""

    @property
    def has_parent(self) -> bool:
        """Whether worker processes show the faces, and a parent assigns sessions to them."""
        return self.listen.workers > 1 or self.bus.url is not None

    def __post_init__(self) -> None:
        check_fields(self)
        for url in self.sinks if self.has_parent else ():
            if kind_of(parse_sink(url)).medium == "video":
                given = "a bus" if self.bus.url else f"workers = {self.listen.workers}"
                raise UsageError(f"sink {parse_sink(url)}: got {given}, expected a server of one process with it")


@dataclass(frozen=True, slots=True)
class _Sink:
    url: str

    def __post_init__(self) -> None:
        parse_sink(self.url)


@dataclass(frozen=True, slots=True)
class _Document(_Parts):
    """The sections of a configuration file."""

    sink: tuple[_Sink, ...] = ()


def parse_config(data: bytes, name: str) -> ServerConfig:
    """Read a configuration.

    Raises DataError if it is not TOML, or a key is unknown, of the wrong type or out of range (``where`` is file and
    key).

    Parameters
    ----------
    data : bytes
        TOML.
    name : str
        Name of the file, for error messages.

    Examples
    --------
    >>> config = parse_config(b'sink = [{url = "vrchat://127.0.0.1"}]', "mine.toml")
    >>> config.listen.port, config.face.rate_hz, config.sinks
    (9110, 60.0, ('vrchat://127.0.0.1',))
    """
    document = parse_toml(data, _Document, name)
    parts = {one.name: getattr(document, one.name) for one in fields(_Parts)}
    listen = document.listen
    parts["listen"] = replace(listen, web_port=listen.web_port or None, metrics_port=listen.metrics_port or None)
    return ServerConfig(**parts, sinks=tuple(sink.url for sink in document.sink))


Part = TypeVar("Part", Listen, Face, Style, VoiceChoice, SoundChoice, CallChoice, Caps, BusChoice, Log)


def load_config(path: Path) -> ServerConfig:
    """Read a configuration file; see :func:`parse_config`.

    Raises UsageError if the file cannot be read; DataError if it is not a valid configuration.
    """
    return parse_config(read_bytes(path, MAX_BYTES), str(path))


def overridden(part: Part, **changes: Any) -> Part:
    """Replace fields of a dataclass by the changes that are not None; command-line options override the file.

    Raises UsageError if a change is of the wrong type or out of range.

    Examples
    --------
    >>> overridden(Face(), profile=None, rate_hz=30.0).rate_hz
    30.0
    """
    return replace(part, **{name: change for name, change in changes.items() if change is not None})
