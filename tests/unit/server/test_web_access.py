"""Who may send requests: tokens that are guessed, on a clock that is an argument."""

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from fapengine.server.web import access as rules
from fapengine.server.web.access import FORGET_S, MAX_WRONG, Access


class Remote:
    """In place of a connection's transport."""

    def __init__(self, address: str) -> None:
        self._address = address

    def get_extra_info(self, name: str, default: object = None) -> object:
        return (self._address, 9) if name == "peername" else default


def status(access: Access, token: str, address: str = "192.0.2.1", named: str | None = None) -> int:
    query = f"?token={token}" if token else ""
    headers = {"Host": "h"} if named is None else {"Host": "h", "X-Forwarded-For": named}
    try:
        access.admit(make_mocked_request("GET", f"/setup.json{query}", headers, transport=Remote(address)))
    except web.HTTPException as error:
        return error.status
    return 200


def test_an_address_that_guesses_must_wait_and_others_need_not() -> None:
    now_s = 0.0
    access = Access("the right token", clock=lambda: now_s)
    assert [status(access, f"guess{n}") for n in range(MAX_WRONG + 90)] == [403] * MAX_WRONG + [429] * 90
    assert status(access, "the right token") == 429  # else guessing would go on
    assert status(access, "the right token", "192.0.2.2") == 200
    assert (access.counts.wrong, access.counts.delayed) == (MAX_WRONG, 91)
    now_s = FORGET_S
    assert status(access, "the right token") == 200


def test_callers_behind_a_proxy_have_addresses_of_their_own_if_it_is_believed() -> None:
    proxies = ("192.0.2.1", "192.0.2.9")
    for believed, others in (((), 429), (proxies, 200)):
        access = Access("the right token", clock=lambda: 0.0, proxies=believed)
        for n in range(MAX_WRONG):  # what a caller makes up stands before what the proxies add
            status(access, f"guess{n}", named=f"198.51.100.{n}, 203.0.113.1, 192.0.2.9")
        assert status(access, "the right token", named="198.51.100.99, 203.0.113.1, 192.0.2.9") == 429
        assert status(access, "the right token", named="203.0.113.2") == others
    assert status(access, "the right token", "203.0.113.1", named="203.0.113.2") == 429  # not from a proxy
    assert status(access, "the right token", named="") == 200  # the proxy itself


def test_a_page_with_an_old_token_locks_nobody_out() -> None:
    access = Access("the right token", clock=lambda: 0.0)
    assert {status(access, "old") for _ in range(10 * MAX_WRONG)} == {403}
    assert {status(access, "") for _ in range(10 * MAX_WRONG)} == {403}
    assert status(access, "the right token") == 200


def test_as_many_addresses_are_remembered_as_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "MAX_ADDRESSES", 40)
    access = Access("the right token", clock=lambda: 0.0)
    for n in range(50):
        status(access, "guess", f"address {n}")
    assert list(access._wrong) == [f"address {n}" for n in range(10, 50)]
