"""``fapengine serve``: what it is told, by file and by options; what it says of itself. Running it: tests/live."""

import io
import json
import logging
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.server.config import ServerConfig
from fapengine.server.logs import begin_log


def configured(monkeypatch: pytest.MonkeyPatch, *words: object) -> ServerConfig:
    """What the server is started with."""
    started: list[ServerConfig] = []
    monkeypatch.setattr("fapengine.cli.serve._start", started.append)
    monkeypatch.delenv("FAPENGINE_TOKEN", raising=False)
    result = CliRunner().invoke(app, ["serve", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return started[0]


def test_nothing_told_is_all_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    assert configured(monkeypatch) == ServerConfig()


def test_options_go_before_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.toml"
    path.write_text(
        '[listen]\nport = 1\nhost = "::1"\n[face]\nseed = 3\nrate_hz = 25\n[style]\nidle = false\n'
        '[voice]\nname = "de"\n[limits]\nstreams = 7\n[log]\nformat = "json"\n[[sink]]\nurl = "vmc://a"\n'
    )
    options = ("--port", 2, "--sink", "osc://b:1", "--fps", 30.0, "--without", "head-motion")
    config = configured(monkeypatch, "--config", path, *options)
    assert (config.listen.host, config.listen.port) == ("::1", 2)
    assert (config.face.seed, config.face.rate_hz) == (3, 30.0)
    assert (config.voice.name, config.limits.streams) == ("de", 7)
    assert config.sinks == ("vmc://a", "osc://b:1")
    assert (config.style.idle, config.style.head_motion, config.style.blinks) == (False, False, True)
    assert (config.log.format, config.log.level) == ("json", "info")


def test_every_option_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    config = configured(
        monkeypatch,
        *(
            "--host",
            "h",
            "--port",
            0,
            "--web-port",
            3,
            "--token",
            "t" * 16,
            "--metrics-port",
            4,
            "--log",
            "json",
            "--verbose",
        ),
        *("--profile", "p", "--head", "o", "--seed", 0, "--without", "all", "--play", "face", "--audio-device", "USB"),
    )
    listen = config.listen
    assert (listen.host, listen.port, listen.web_port, listen.metrics_port, listen.token) == ("h", 0, 3, 4, "t" * 16)
    assert (config.log.format, config.log.level) == ("json", "debug")
    assert (config.face.profile, config.face.head, config.face.seed) == ("p", "o", 0)
    assert (config.sound.session, config.sound.device) == ("face", "USB")
    assert not any((config.style.blinks, config.style.gaze, config.style.emphasis))
    assert configured(monkeypatch, "--web-port", 3, "--no-page").listen.web_port is None
    assert listen.provenance
    unmarked = configured(monkeypatch, "--without", "provenance")
    assert (unmarked.listen.provenance, unmarked.style) == (False, ServerConfig().style)
    assert configured(monkeypatch, "--token", "", "--play", "", "--audio-device", "") == ServerConfig()


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("--audio-device", "USB"), "--audio-device: requires --play SESSION"),
        (("--play", "x" * 33), "session: got"),
        (("--fps", "0.5"), r"^--fps: got 0.5, expected a number, 1 to 240"),
        (("--fps", "nan"), "^--fps: got nan"),
        (("--seed", "-1"), "^--seed: got -1"),
        (("--log", "xml"), "^--log: got 'xml', expected one of text, json"),
        (("--without", "ears"), "^--without: unknown value 'ears'; use one of blinks, head-motion"),
        (("--sink", "vmc:/x"), "^--sink: got 'vmc:/x'"),
    ],
)
def test_what_cannot_be(words: tuple[str, ...], what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match=what):
        configured(monkeypatch, *words)


def test_files_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match=r"absent.toml: cannot be read \(No such file"):
        configured(monkeypatch, "--config", tmp_path / "absent.toml")
    path = tmp_path / "a.toml"
    path.write_text("[listen]\nport = 'x'")
    with pytest.raises(DataError, match=r"a\.toml, listen\.port"):
        configured(monkeypatch, "--config", path)


def test_the_help_teaches() -> None:
    text = CliRunner().invoke(app, ["serve", "--help"], env={"COLUMNS": "200"}).output
    for word in ("/phoneme", "--sink", "vmc://127.0.0.1:39539", "docs/osc.md", "SIGTERM", "FAPENGINE_TOKEN"):
        assert word in text


@pytest.fixture
def log() -> io.StringIO:
    return io.StringIO()


@pytest.fixture(autouse=True)
def _quiet_again():
    root = logging.getLogger("fapengine")
    before = (list(root.handlers), root.level, root.propagate)
    yield
    root.handlers[:], root.level, root.propagate = before


def test_the_log_for_programs_is_an_object_a_line(log: io.StringIO) -> None:
    begin_log("info", "json", log)
    own = logging.getLogger("fapengine.server")
    own.debug("not told")
    own.info("%d faces", 2, extra={"session": "änna", "path": Path("x")})
    try:
        raise ValueError("broken")
    except ValueError:
        own.exception("trouble")
    first, second = (json.loads(line) for line in log.getvalue().splitlines())
    assert (first["level"], first["logger"], first["message"]) == ("info", "fapengine.server", "2 faces")
    assert (first["session"], first["path"]) == ("änna", "x")
    assert first["time"].endswith("Z")
    assert second["trouble"].endswith("ValueError: broken")


def test_the_log_for_people_has_the_time_and_the_message(log: io.StringIO) -> None:
    begin_log("warning", "text", log)
    own = logging.getLogger("fapengine.server")
    own.info("not told")
    own.warning("beware")
    try:
        raise ValueError("broken")
    except ValueError:
        own.exception("trouble")
    lines = log.getvalue().splitlines()
    assert lines[0][2] == lines[0][5] == ":"
    assert lines[0].endswith(" warning: beware")
    assert lines[-1] == "ValueError: broken"


def test_the_log_for_people_leaves_out_that_it_is_information(log: io.StringIO) -> None:
    begin_log("info", "text", log)
    logging.getLogger("fapengine.server").info("ready")
    assert log.getvalue().split(" ", 1)[1] == "ready\n"


@pytest.mark.parametrize("name", ["aiohttp", "prometheus_client"])
def test_without_its_extra_it_names_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ResourceError, match=rf'{name} is not installed\. .*: pip install "fapengine\[live\]"'):
        CliRunner().invoke(app, ["serve", "--port", "0", "--no-page"], catch_exceptions=False)
