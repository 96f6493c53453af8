"""One TOML for everything: its defaults are the documented ones, and every wrong key is named."""

import re
import tomllib

import pytest

from fapengine.errors import DataError, UsageError
from fapengine.server.config import Face, Listen, ServerConfig, overridden, parse_config
from tests.serve_example import EXAMPLE


def test_nothing_told_is_all_by_default() -> None:
    assert parse_config(b"", "a.toml") == ServerConfig()
    assert ServerConfig().limits.engine.sessions == 1000


def test_the_documented_example_says_the_defaults() -> None:
    config = parse_config(EXAMPLE.encode(), "a.toml")
    assert config.sinks == ("vmc://127.0.0.1:39539",)
    assert config == ServerConfig(sinks=config.sinks)


def test_the_documented_example_has_every_key() -> None:
    keys = {table: set(values) for table, values in tomllib.loads(EXAMPLE).items() if isinstance(values, dict)}
    for table, values in keys.items():
        for name in type(getattr(ServerConfig(), table)).__slots__:
            assert name in values or re.search(rf"\b{name}\b", EXAMPLE) or name in ("method", "emphasis"), name


def test_every_key_is_taken() -> None:
    config = parse_config(
        b"""
        [listen]
        host = "::1"
        port = 1
        web_port = 0
        metrics_port = 2
        token = "t"
        [face]
        profile = "p"
        head = "h"
        rate_hz = 30
        seed = 5
        [style]
        jaw = 2
        blinks = false
        method = "paper"
        [voice]
        name = "de"
        rate_wpm = 100
        [sound]
        session = "face"
        device = "3"
        [limits]
        sessions = 2
        utterances = 3
        queued_s = 4
        silence_s = 1
        wait_s = 8
        idle_close_s = 5
        packets_per_sender = 6
        streams = 7
        [log]
        level = "debug"
        format = "json"
        [[sink]]
        url = "osc://a:1"
        [[sink]]
        url = "osc://b:2"
        """,
        "a.toml",
    )
    assert (config.listen.host, config.listen.port, config.listen.web_port) == ("::1", 1, None)
    assert (config.listen.metrics_port, config.listen.token) == (2, "t")
    assert (config.face.profile, config.face.head, config.face.rate_hz, config.face.seed) == ("p", "h", 30.0, 5)
    assert (config.style.jaw, config.style.blinks, config.style.method) == (2.0, False, "paper")
    assert (config.voice.name, config.voice.rate_wpm) == ("de", 100)
    assert (config.sound.session, config.sound.device) == ("face", "3")
    assert (config.limits.engine.sessions, config.limits.engine.utterances, config.limits.engine.queued_s) == (2, 3, 4)
    assert (config.limits.engine.silence_s, config.limits.engine.wait_s) == (1, 8)
    assert (config.limits.idle_close_s, config.limits.packets_per_sender, config.limits.streams) == (5, 6, 7)
    assert (config.log.level, config.log.format) == ("debug", "json")
    assert config.sinks == ("osc://a:1", "osc://b:2")


def test_sites_that_may_show_faces_are_named_as_browsers_name_them() -> None:
    config = parse_config(b'listen = {origins = ["https://a.example", "http://b.example:8080"]}', "a.toml")
    assert config.listen.origins == ("https://a.example", "http://b.example:8080")
    with pytest.raises(UsageError, match=r"origins: got 'a\.example/x'"):
        Listen(origins=("a.example/x",))
    with pytest.raises(UsageError, match=r"proxies: got 'proxy', expected addresses such as '127\.0\.0\.1'"):
        Listen(proxies=("proxy",))


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("x", "a.toml", "is not TOML"),
        ("[listn]", "a.toml, listn", "'listn' is unknown"),
        ("[listen]\nprot = 1", "a.toml, listen.prot", "'prot' is unknown"),
        ("[listen]\nport = 70000", "a.toml, listen.port", "got 70000, expected a whole number, 0 to 65535"),
        ("[listen]\nport = true", "a.toml, listen.port", "expected a whole number, 0 to 65535"),
        ("[listen]\nweb_port = -1", "a.toml, listen.web_port", "got -1"),
        ("[listen]\nmetrics_port = 'x'", "a.toml, listen.metrics_port", "expected a whole number, 0 to 65535"),
        ("[face]\nrate_hz = 0", "a.toml, face.rate_hz", "expected a number, 1 to 240"),
        ("[face]\nrate_hz = nan", "a.toml, face.rate_hz", "expected a number, 1 to 240"),
        ("[face]\nfps = 30", "a.toml, face.fps", "unknown"),
        ("[style]\njaw = 9", "a.toml, style.jaw", "must be 0 to 3, got 9.0"),
        ("[style]\nblinks = 1", "a.toml, style.blinks", "got 1, expected true or false"),
        ("[style]\nteeth = 1", "a.toml, style.teeth", "unknown"),
        ("[voice]\nrate_wpm = 1", "a.toml, voice.rate_wpm", "got 1, expected a whole number, 80 to 449"),
        ("[voice]\nx = 1", "a.toml, voice.x", "unknown"),
        ("[limits]\nsessions = 0", "a.toml, limits.sessions", "got 0, expected a whole number, 1 to 100000"),
        ("[limits]\nx = 0", "a.toml, limits.x", "unknown"),
        ("[log]\nlevel = 'loud'", "a.toml, log.level", "expected one of debug, info"),
        ("[log]\nx = 'loud'", "a.toml, log.x", "unknown"),
        ("[[sink]]\nurl = 1", "a.toml, sink[0].url", "got 1, expected a string"),
        ("[[sink]]\nurl = 'osc://a:1'\nx = 1", "a.toml, sink[0].x", "unknown"),
        ("[[sink]]\nurl = 'vmc:/x'", "a.toml, sink[0]", "sink: got 'vmc:/x'"),
        (f"[sound]\nsession = '{33 * 'x'}'", "a.toml, sound.session", "got 'xxx"),
        ("[sink]\nurl = 'osc://a:1'", "a.toml, sink", "got {'url': 'osc://a:1'}, expected a list"),
    ],
)
def test_what_is_wrong_is_named(text: str, where: str, what: str) -> None:
    with pytest.raises(DataError, match=re.escape(what)) as caught:
        parse_config(text.encode(), "a.toml")
    assert caught.value.where == where


def test_a_configuration_made_in_python_is_checked_too() -> None:
    with pytest.raises(UsageError, match=r"^rate_hz: got 1000\.0, expected a number, 1 to 240$"):
        Face(rate_hz=1000.0)
    with pytest.raises(UsageError, match=r"^port: got '9', expected a whole number,"):
        overridden(Listen(), port="9")
    assert overridden(Listen(), port=None, token="") == Listen()


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "faces.example"])
def test_a_token_that_other_machines_can_guess_is_long(host: str) -> None:
    with pytest.raises(
        UsageError, match=f"token: got 15 characters, expected at least 16: other machines reach {host}"
    ):
        Listen(host=host, token="a" * 15)
    assert Listen(host=host, token="a" * 16).token == "a" * 16
    for own in ("127.0.0.1", "::1", "localhost"):
        assert Listen(host=own, token="a").token == "a"
