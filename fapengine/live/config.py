"""One TOML for everything that ``fapengine serve`` can be told: :data:`EXAMPLE` shows all of it."""

from dataclasses import dataclass, field, fields
from typing import Any

from fapengine._toml import TomlTable, parse_toml
from fapengine.errors import UsageError
from fapengine.live.engine.session import Limits
from fapengine.trajectory.style import Style

EXAMPLE = """\
[listen]
host = "127.0.0.1"      # "0.0.0.0": the whole network may speak; set a token then
port = 9110             # OSC: UDP and TCP
web_port = 8110         # the page; 0: none
metrics_port = 0        # Prometheus text at /metrics; 0: none
token = ""              # what senders and pages must know; "": nobody is asked

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

[sound]
session = ""            # whose voice this machine's loudspeaker plays, "face" say; "": nobody's, pages play their own
device = ""             # its number, or a part of its name; "": the system's

[limits]
sessions = 1000
utterances = 32         # of a session, queued
queued_s = 600.0        # of an utterance, and how far ahead one may begin
silence_s = 2.0         # an utterance without an end is over when nothing more comes for so long
wait_s = 30.0           # one whose turn it is and whose sound does not come is given up
idle_close_s = 120.0    # a session that nobody talks to or watches is closed
packets_a_peer = 256    # waiting to be understood
streams = 256           # TCP connections

[log]
level = "info"          # debug, info, warning, error
format = "text"         # or "json": one object a line

[[sink]]
url = "vmc://127.0.0.1:39539"
"""
"""Every key, with its default; every one may be left out. And one sink."""
OSC_PORT, WEB_PORT = 9110, 8110
LEVELS = ("debug", "info", "warning", "error")
FORMATS = ("text", "json")
MAX_PORT = 65_535
RATES_HZ = (1.0, 240.0)


@dataclass(frozen=True, slots=True)
class Listen:
    """Where the server can be reached."""

    host: str = "127.0.0.1"
    port: int = OSC_PORT
    """OSC, UDP and TCP; 0: any free one."""
    web_port: int | None = WEB_PORT
    """The page; None: none, 0: any free one."""
    metrics_port: int | None = None
    """Prometheus text; None: none, 0: any free one."""
    token: str | None = None


@dataclass(frozen=True, slots=True)
class Face:
    """Who speaks, and how it looks."""

    profile: str = "grid_s1_en"
    head: str = "default"
    rate_hz: float = 60.0
    seed: int = 1


@dataclass(frozen=True, slots=True)
class VoiceChoice:
    """Who speaks texts."""

    name: str = "en-us"
    rate_wpm: int = 160


@dataclass(frozen=True, slots=True)
class SoundChoice:
    """Whose voice is heard where the server runs."""

    session: str | None = None
    """None: nobody's."""
    device: str | None = None
    """Number or a part of its name; None: the system's."""


@dataclass(frozen=True, slots=True)
class Caps:
    """What one server holds at most."""

    sessions: int = 1000
    utterances: int = 32
    queued_s: float = 600.0
    silence_s: float = 2.0
    wait_s: float = 30.0
    idle_close_s: float = 120.0
    packets_a_peer: int = 256
    streams: int = 256

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
class Log:
    """What is told, and how."""

    level: str = "info"
    format: str = "text"


@dataclass(frozen=True, slots=True)
class ServeConfig:
    """Everything; see the module."""

    listen: Listen = field(default_factory=Listen)
    face: Face = field(default_factory=Face)
    style: Style = field(default_factory=Style)
    voice: VoiceChoice = field(default_factory=VoiceChoice)
    sound: SoundChoice = field(default_factory=SoundChoice)
    limits: Caps = field(default_factory=Caps)
    log: Log = field(default_factory=Log)
    sinks: tuple[str, ...] = ()
    """URLs; see :mod:`fapengine.live.server.sinks`."""


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
    table = parse_toml(data, name)
    config = ServeConfig(
        listen=_listen(table.table("listen", needed=False)),
        face=_face(table.table("face", needed=False)),
        style=_style(table.table("style", needed=False)),
        voice=_voice(table.table("voice", needed=False)),
        sound=_sound(table.table("sound", needed=False)),
        limits=_caps(table.table("limits", needed=False)),
        log=_log(table.table("log", needed=False)),
        sinks=tuple(_sink(one) for one in table.tables("sink", needed=False)),
    )
    table.finish()
    return config


def _listen(table: TomlTable) -> Listen:
    web_port = _port(table, "web_port", WEB_PORT)
    made = Listen(
        host=table.take("host", str, "127.0.0.1"),
        port=_port(table, "port", OSC_PORT),
        web_port=web_port or None,
        metrics_port=_port(table, "metrics_port", 0) or None,
        token=(table.take("token", str, "") or None),
    )
    table.finish()
    return made


def _face(table: TomlTable) -> Face:
    own = Face()
    made = Face(
        table.take("profile", str, own.profile),
        table.take("head", str, own.head),
        _between(table, "rate_hz", float, own.rate_hz, *RATES_HZ),
        _between(table, "seed", int, own.seed, 0, 2**63 - 1),
    )
    table.finish()
    return made


def _style(table: TomlTable) -> Style:
    own = Style()
    given: dict[str, Any] = {}
    for one in fields(Style):
        if table.has(one.name):
            given[one.name] = table.take(one.name, type(getattr(own, one.name)))
            try:
                Style(**given)
            except UsageError as error:
                raise table.fail(one.name, str(error)) from error
    table.finish()
    return Style(**given)


def _voice(table: TomlTable) -> VoiceChoice:
    own = VoiceChoice()
    made = VoiceChoice(table.take("name", str, own.name), _between(table, "rate_wpm", int, own.rate_wpm, 80, 450))
    table.finish()
    return made


def _sound(table: TomlTable) -> SoundChoice:
    made = SoundChoice(table.take("session", str, "") or None, table.take("device", str, "") or None)
    table.finish()
    return made


def _caps(table: TomlTable) -> Caps:
    own = Caps()
    made = Caps(
        sessions=_between(table, "sessions", int, own.sessions, 1, 100_000),
        utterances=_between(table, "utterances", int, own.utterances, 1, 10_000),
        queued_s=_between(table, "queued_s", float, own.queued_s, 1.0, 86_400.0),
        silence_s=_between(table, "silence_s", float, own.silence_s, 0.1, 3600.0),
        wait_s=_between(table, "wait_s", float, own.wait_s, 0.1, 3600.0),
        idle_close_s=_between(table, "idle_close_s", float, own.idle_close_s, 1.0, 86_400.0),
        packets_a_peer=_between(table, "packets_a_peer", int, own.packets_a_peer, 1, 100_000),
        streams=_between(table, "streams", int, own.streams, 1, 10_000),
    )
    table.finish()
    return made


def _log(table: TomlTable) -> Log:
    own = Log()
    made = Log(_one_of(table, "level", own.level, LEVELS), _one_of(table, "format", own.format, FORMATS))
    table.finish()
    return made


def _sink(table: TomlTable) -> str:
    url: str = table.take("url", str)
    table.finish()
    return url


def _port(table: TomlTable, key: str, default: int) -> int:
    port: int = _between(table, key, int, default, 0, MAX_PORT)
    return port


def _between(table: TomlTable, key: str, kind: type, default: Any, low: float, high: float) -> Any:
    value = table.take(key, kind, default)
    if not low <= value <= high:
        raise table.fail(key, f"got {value}, expected {low:g}..{high:g}")
    return value


def _one_of(table: TomlTable, key: str, default: str, choices: tuple[str, ...]) -> str:
    value: str = table.take(key, str, default)
    if value not in choices:
        raise table.fail(key, f"got {value!r:.40}, expected one of {', '.join(choices)}")
    return value
