"""``fapengine serve``: what it is told, by file and by options; what it says of itself. Running it: tests/live."""

import io
import json
import logging
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fapengine.cli._serve_config import configured
from fapengine.cli.main import app
from fapengine.errors import DataError, UsageError
from fapengine.live.config import ServeConfig
from fapengine.live.server.logs import begin_log

NOTHING: dict[str, Any] = {
    "host": None, "port": None, "web_port": None, "no_page": False, "sink": [], "token": None, "metrics": None,
    "log": None, "verbose": False, "profile": None, "head": None, "fps": None, "seed": None, "without": [],
    "sound": None, "device": None,
}  # fmt: skip


def test_nothing_told_is_all_by_default() -> None:
    assert configured(None, NOTHING) == ServeConfig()


def test_options_go_before_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(
        '[listen]\nport = 1\nhost = "::1"\n[face]\nseed = 3\nrate_hz = 25\n[style]\nidle = false\n'
        '[log]\nformat = "json"\n[[sink]]\nurl = "vmc://a"\n'
    )
    config = configured(path, NOTHING | {"port": 2, "sink": ["osc://b:1"], "fps": 30.0, "without": ["head-motion"]})
    assert (config.listen.host, config.listen.port) == ("::1", 2)
    assert (config.face.seed, config.face.rate_hz) == (3, 30.0)
    assert config.sinks == ("vmc://a", "osc://b:1")
    assert (config.style.idle, config.style.head_motion, config.style.blinks) == (False, False, True)
    assert (config.log.format, config.log.level) == ("json", "info")


def test_every_option_arrives() -> None:
    told = {
        "host": "h", "port": 0, "web_port": 3, "token": "t", "metrics": 4, "log": "json", "verbose": True,
        "profile": "p", "head": "o", "seed": 0, "without": ["all"], "sound": "face", "device": "USB",
    }  # fmt: skip
    config = configured(None, NOTHING | told)
    listen = config.listen
    assert (listen.host, listen.port, listen.web_port, listen.metrics_port, listen.token) == ("h", 0, 3, 4, "t")
    assert (config.log.format, config.log.level) == ("json", "debug")
    assert (config.face.profile, config.face.head, config.face.seed) == ("p", "o", 0)
    assert (config.sound.session, config.sound.device) == ("face", "USB")
    assert not any((config.style.blinks, config.style.gaze, config.style.emphasis))
    assert configured(None, NOTHING | {"web_port": 3, "no_page": True}).listen.web_port is None
    assert configured(None, NOTHING | {"token": "", "sound": "", "device": ""}) == ServeConfig()


@pytest.mark.parametrize(
    ("told", "what"),
    [
        ({"device": "USB"}, r"--device: got 'USB', expected --sound SESSION"),
        ({"sound": "x" * 33}, "session: got"),
        ({"fps": 0.5}, r"--fps: got 0.5, expected 1..240"),
        ({"fps": float("nan")}, "--fps: got nan"),
        ({"log": "xml"}, "--log: got 'xml', expected text or json"),
        ({"without": ["ears"]}, "--without: got 'ears', expected one of blinks, head-motion"),
        ({"sink": ["vmc:/x"]}, "sink: got 'vmc:/x'"),
    ],
)
def test_what_cannot_be(told: dict[str, object], what: str) -> None:
    with pytest.raises(UsageError, match=what):
        configured(None, NOTHING | told)


def test_files_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"--config: got .*absent.toml, expected a file that can be read: No such file"
    ):
        configured(tmp_path / "absent.toml", NOTHING)
    path = tmp_path / "a.toml"
    path.write_text("[listen]\nport = 'x'")
    with pytest.raises(DataError, match=r"a\.toml, listen\.port"):
        configured(path, NOTHING)


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
