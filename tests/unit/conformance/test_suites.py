"""The suites pass on our own programs, and fail, with a sentence, on ones that are broken on purpose."""

import asyncio
import json
import re
import shlex
import socket
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from fapengine.clients.sender import Client
from fapengine.clients.websocket_viewer import WebSocketViewer
from fapengine.codec.encoder import encode
from fapengine.codec.fapfile import format_fap
from fapengine.conformance import osc as suites
from fapengine.conformance import page
from fapengine.conformance.__main__ import SUITES, main
from fapengine.conformance.cases import run
from fapengine.conformance.fba import DECODER_CASES, ENCODER_CASES, Program
from fapengine.server.config import Listen
from fapengine.server.intake.listeners import bound
from fapengine.speech.phone_track import Phone
from fapengine.wire import osc
from fapengine.wire.speech_osc import receiver, schema
from tests.leaping import run_leaping, until
from tests.live.stage import config_of, on_a_loop, running

ROOT = Path(__file__).resolve().parents[3]
LIMIT_S = 300.0
"""A sender that never does what is waited for would be listened to for ever."""
DECODER = (
    "import sys; from pathlib import Path; from fapengine.codec.decoder import decode; from fapengine.codec.fapfile \
import format_fap; Path(sys.argv[2]).write_text(format_fap(decode(Path(sys.argv[1]).read_bytes()).track))"
)
ENCODER = (
    "import sys; from pathlib import Path; from fapengine.codec.encoder import encode; from fapengine.codec.fapfile \
import parse_fap; Path(sys.argv[2]).write_bytes(encode(parse_fap(Path(sys.argv[1]).read_bytes())))"
)


def failed(verdicts: list) -> list[str]:
    return [f"{verdict.number}: {verdict.found}" for verdict in verdicts if verdict.outcome != "pass"]


def verdicts_of_server(cases: tuple, subject: Callable[[tuple[str, int], str], object], **listen: object) -> list:
    """Run a suite against a whole server."""
    found: list = []

    async def body() -> None:
        head = None
        config = replace(config_of(), listen=Listen(port=0, **listen))
        if config.listen.web_port is not None:
            from fapengine.mesh.default_head.head import build_head

            head = build_head()
        async with running(config, head) as server:
            site = "http://{}:{}/".format(*server.sites[0]) if server.sites else ""
            asked = subject(server.osc_address, site)
            with asked if isinstance(asked, suites.OscServer) else nullcontext():
                found.extend(await asyncio.to_thread(run, cases, asked))

    on_a_loop(body)
    return found


def test_our_own_server_passes_osc_with_a_token() -> None:
    found = verdicts_of_server(
        suites.SERVER_CASES[:-1], lambda osc, site: suites.OscServer(*osc, token="word"), web_port=None, token="word"
    )
    assert failed(found) == []


def test_a_server_that_miscounts_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pongs have other numbers."""

    def ping(self: receiver.OscReceiver, wire: schema.Ping, arrival: object) -> None:
        answer(self, replace(wire, number=wire.number + 1), arrival)

    answer = receiver.OscReceiver._ping
    monkeypatch.setattr(receiver.OscReceiver, "_ping", ping)
    cases = tuple(case for case in suites.SERVER_CASES if case.number in ("1.1", "1.4"))
    found = verdicts_of_server(cases, lambda osc, site: suites.OscServer(*osc), web_port=None)
    assert [verdict.outcome for verdict in found] == ["pass", "fail"]
    assert "no /fap/1/pong came, but /fap/1/pong" in found[1].found


def test_our_own_page_passes() -> None:
    found = verdicts_of_server(page.SERVER_CASES, lambda osc, site: page.PageServer(site), web_port=0)
    assert failed(found) == []


def heard_of(
    speaking: Callable[[int], AbstractContextManager[object]], is_enough: Callable[[suites.Heard], bool]
) -> list[str]:
    """What fails of somebody who speaks to a port."""
    with bound("127.0.0.1", 0, socket.SOCK_DGRAM) as own, speaking(own.getsockname()[1]):
        return failed(run(suites.SENDER_CASES, suites.listen(own, LIMIT_S, until=is_enough)))


def test_our_own_sender_passes_and_one_that_never_repeats_fails() -> None:
    @contextmanager
    def ours(port: int) -> Iterator[None]:
        with Client("127.0.0.1", port, session="anna") as face:
            face.send_phones([Phone(label, 0.1 * n, 0.1 * n + 0.1) for n, label in enumerate("mamama")])
            yield

    assert heard_of(ours, lambda heard: not failed(run(suites.SENDER_CASES, heard))) == []

    @contextmanager
    def once(port: int) -> Iterator[None]:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.connect(("127.0.0.1", port))
            own.send(osc.message("/fap/1/hello", "s", "anna"))
            own.send(osc.message("/fap/1/phones", "siiiisiiif", "anna", 0, 0, 2, 1, "m", 0, 100, 0, 1.0))
            own.send(osc.message("/fap/1/nonsense", "s", "anna"))
            yield

    found = {line[:3] for line in heard_of(once, lambda heard: len(heard.packets) == 3)}
    assert found == {"1.1", "1.3", "1.4", "1.5", "2.1", "2.2", "2.4", "2.5"}


def watched(
    connect: Callable[[str, list[str]], Coroutine[None, None, None]], monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """What fails of somebody who connects to an address, given the texts that have arrived; in virtual time."""
    note, came = page._note, []

    def noted(client: page.PageClient, data: str | bytes) -> None:
        note(client, data)
        came.append(data)

    monkeypatch.setattr(page, "_note", noted)

    async def body() -> page.PageClient:
        lines: list[str] = []
        watching = asyncio.create_task(page.watch(0, 3.0, lines.append))
        await until(lambda: lines)
        await connect(re.search(r"ws://[\d.:]+/ws", lines[0])[0], came)  # type: ignore[index]
        return await watching

    return failed(run(page.CLIENT_CASES, run_leaping(body())))


def test_our_own_viewer_passes_as_a_client_and_one_that_says_nonsense_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    async def ours(url: str, came: list[str]) -> None:
        viewer = WebSocketViewer(url)  # it goes by the real clock
        try:
            await until(lambda: came)
            await asyncio.sleep(0.5)
            await until(lambda: viewer.counts.refused and viewer.counts.frames >= 20)
            count = len(came)
            await asyncio.sleep(1.0)  # the suite disconnects it
            await until(lambda: len(came) > count)
        finally:
            await asyncio.to_thread(viewer.close)

    assert watched(ours, monkeypatch) == []

    async def broken(url: str, came: list[str]) -> None:
        import aiohttp

        async with aiohttp.ClientSession() as client, client.ws_connect(url) as socket:
            await socket.send_str('{"type": "blink", "misspelt": 1}')
            await until(lambda: came)

    assert {line[:3] for line in watched(broken, monkeypatch)} == {"1.2", "1.3", "1.4", "2.1"}


class Called(Program):
    """A coder in this process: starting one for each case takes long."""

    def run(self, data: bytes, source: str, target: str) -> bytes:
        from fapengine.codec.decoder import decode
        from fapengine.codec.fapfile import parse_fap
        from fapengine.conformance.cases import BreachError
        from fapengine.errors import DataError

        try:
            if source == ".fap":
                return encode(parse_fap(data))[: -1 if self.command == "cut" else None]
            track = decode(data).track
        except DataError as error:
            raise BreachError(str(error)) from error
        if self.command == "off by one":
            track = replace(track, values=track.values + track.mask)
        return format_fap(track).encode()


def test_our_own_coders_pass_and_broken_ones_fail() -> None:
    assert failed(run(DECODER_CASES, Called(""))) == []
    assert failed(run(ENCODER_CASES, Called(""))) == []
    off = run(DECODER_CASES, Called("off by one"))
    assert [one.number for one in off if one.outcome == "pass"] == ["2.1", "2.2"]
    assert "frame 0, FAP 4: got" in off[0].found


@pytest.mark.parametrize(("suite", "code"), [("fba-decoder", DECODER), ("fba-encoder", ENCODER)])
def test_a_coder_is_a_command(
    suite: str, code: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    module = f"fapengine.conformance.fba.{'DECODER' if 'decoder' in suite else 'ENCODER'}_CASES"
    cases = DECODER_CASES if "decoder" in suite else ENCODER_CASES
    monkeypatch.setattr(module, cases[:1])
    assert main([suite, f"{shlex.quote(sys.executable)} -c {shlex.quote(code)} {{in}} {{out}}", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["cases"][0]["outcome"] == "pass"
    assert main([suite, "false {in} {out}"]) == 1
    assert "1 failed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["osc-server", "nonsense"], 2, "expected HOST:PORT"),
        (["osc-sender", "99999"], 2, "expected a port"),
        (["osc-server", "no.such.host.invalid:9"], 1, "ResourceError"),
    ],
)
def test_wrong_use_is_one_line(words: list[str], code: int, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == code
    out = capsys.readouterr()
    assert told in out.err + out.out
    assert "Traceback" not in out.err


def test_cases_have_numbers_and_sections_that_are_there() -> None:
    for cases in (
        suites.SERVER_CASES,
        suites.SENDER_CASES,
        page.SERVER_CASES,
        page.CLIENT_CASES,
        DECODER_CASES,
        ENCODER_CASES,
    ):
        assert len({case.number for case in cases}) == len(cases)
        for case in cases:
            name, _, section = case.section.partition(": ")
            headings = re.findall(r"^#+ (.*)$", (ROOT / name).read_text(), re.M)
            assert section in headings or any(heading.replace(". ", " ", 1) == section for heading in headings), case


def test_every_suite_is_told_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    told = capsys.readouterr().out
    assert all(suite in told for suite in SUITES)
