"""The web side of an agent: its page, and whose offers are answered. Who answers is a stand-in."""

import asyncio
import json
from typing import Any

import pytest
from aiohttp import ClientSession, web

from fapengine.agents.web import application
from fapengine.cli.agent import agent
from fapengine.errors import UsageError
from fapengine.server.web.access import Access

OFFER = {"type": "offer", "sdp": "v=0"}
ASKED = (("OPTIONS", None), ("POST", OFFER))


class StandInVisitors:
    """Answers every offer but the broken one."""

    def __init__(self) -> None:
        self.is_full = False
        self.seen: list[Any] = []

    def may_talk(self, connection: str | None) -> bool:
        return connection == "one" or not self.is_full

    async def offer(self, sdp: str, connection: str | None, *, restarts: bool) -> dict[str, str]:
        if sdp == "broken":
            raise ValueError(sdp)
        self.seen.append((sdp, connection, restarts))
        return {"sdp": "v=0", "type": "answer", "pc_id": "one"}

    async def candidate(self, connection: str, line: str, mid: str | None, index: int | None) -> None:
        if connection != "one":
            raise KeyError(connection)
        if line == "broken":
            raise ValueError(line)
        self.seen.append((line, mid, index))


def answers(
    *requests: tuple[str, str, Any, dict[str, str]],
    visitors: StandInVisitors | None = None,
    token: str | None = None,
    origins: tuple[str, ...] = (),
) -> list[tuple[int, str]]:
    async def asked() -> list[tuple[int, str]]:
        runner = web.AppRunner(application(visitors or StandInVisitors(), Access(token, origins)))
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        host, port = runner.addresses[0][:2]
        found = []
        async with ClientSession(f"http://{host}:{port}") as http:
            for method, path, body, headers in requests:
                data = body if isinstance(body, str | None) else json.dumps(body)
                async with http.request(method, path, data=data, headers=headers) as answer:
                    found.append((answer.status, await answer.text()))
        await runner.cleanup()
        return found

    return asyncio.run(asked())


def test_the_page_and_its_files_are_there() -> None:
    found = answers(*(("GET", path, None, {}) for path in ("/", "/agent.js", "/call.css", "/icon.svg", "/main.js")))
    assert [status for status, _ in found] == [200, 200, 200, 200, 404]
    assert 'src="agent.js"' in found[0][1]


def test_offers_and_candidates_reach_the_agent() -> None:
    visitors = StandInVisitors()
    late = {"pc_id": "one", "candidates": [{"candidate": "candidate:1", "sdp_mid": "0", "sdp_mline_index": 0}]}
    again = OFFER | {"pc_id": "one", "restart_pc": True}
    found = answers(
        ("POST", "/api/offer", OFFER, {}), ("PATCH", "/api/offer", late, {}), ("POST", "/api/offer", again, {}),
        visitors=visitors,
    )  # fmt: skip
    assert [status for status, _ in found] == [200, 200, 200]
    assert json.loads(found[0][1]) == {"sdp": "v=0", "type": "answer", "pc_id": "one"}
    assert visitors.seen == [("v=0", None, False), ("candidate:1", "0", 0), ("v=0", "one", True)]


def test_others_are_refused() -> None:
    elsewhere = {"Origin": "http://example.org"}
    found = answers(
        ("POST", "/api/offer", OFFER, elsewhere), ("PATCH", "/api/offer", {"pc_id": "one"}, elsewhere),
        ("POST", "/api/offer", "no JSON", {}), ("POST", "/api/offer", "[]", {}), ("POST", "/api/offer", {"sdp": 1}, {}),
        ("POST", "/api/offer", OFFER | {"sdp": "broken"}, {}),
        ("PATCH", "/api/offer", {"pc_id": "two", "candidates": [{"candidate": ""}]}, {}),
        ("PATCH", "/api/offer", {"pc_id": "one", "candidates": 3}, {}),
        ("PATCH", "/api/offer", {"pc_id": "one"}, {}),
        ("PATCH", "/api/offer", {"pc_id": "one", "candidates": [{"candidate": "broken"}]}, {}),
        ("POST", "/api/offer", OFFER | {"pc_id": {}}, {}), ("POST", "/api/offer", "[" * 100_000, {}),
        ("POST", "/api/offer", "{", {"Content-Type": "application/json; charset=none"}),
    )  # fmt: skip
    assert [status for status, _ in found] == [403, 403, 400, 400, 400, 400, 404, *[400] * 6]
    token = {"Authorization": "Bearer secret"}
    found = answers(("POST", "/api/offer", OFFER, {}), ("POST", "/api/offer", OFFER, token), token="secret")
    assert [status for status, _ in found] == [403, 200]


def test_when_it_is_full_only_known_connections_are_answered() -> None:
    visitors = StandInVisitors()
    visitors.is_full = True
    found = answers(
        *(("POST", "/api/offer", OFFER | {"pc_id": who}, {}) for who in (None, "two", "one")), visitors=visitors
    )
    assert [status for status, _ in found] == [503, 503, 200]


def test_pages_of_a_site_that_is_named_are_answered() -> None:
    there, elsewhere = {"Origin": "https://example.org"}, {"Origin": "https://example.com"}
    requests = [(method, "/api/offer", body, who) for who in (there, elsewhere) for method, body in ASKED]
    found = answers(*requests, origins=("https://example.org",))
    assert [status for status, _ in found] == [204, 200, 204, 403]


def test_the_command_refuses_sites_and_tokens_as_the_server_does() -> None:
    with pytest.raises(UsageError, match="origins: got 'https"):
        agent(origin=["https://example.org/"])
    with pytest.raises(UsageError, match="token: got 3 characters"):
        agent(token="abc", host="0.0.0.0")
