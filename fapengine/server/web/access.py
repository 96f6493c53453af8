"""Who may send HTTP requests.

Only pages of this server, and of the origins that its configuration names, may send requests; other pages are refused.
Without a token, a host name that is not an address is refused too, because anyone can make a name resolve to this
machine (DNS rebinding). With one, an address that has tried :data:`MAX_WRONG` other tokens must wait, even if its next
one is right. A page that repeats an old token does not count, so that it locks no client out.
"""

import hmac
import ipaddress
import time
from collections import OrderedDict
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Protocol
from urllib.parse import urlsplit

from aiohttp import web

from fapengine._counters import Counts

MAX_WRONG, FORGET_S = 10, 60.0
"""Different wrong tokens of an address after which it must wait, and time after which each is forgotten."""
MAX_ADDRESSES = 4096


class _CountsRefused(Protocol):
    refused: int


@dataclass(slots=True)
class AccessCounts(Counts):
    """Counts of requests with wrong tokens. Stateful."""

    METRIC = "tokens", "HTTP requests with tokens that were not accepted, by kind."

    wrong: int = 0
    delayed: int = 0
    """Requests that were not looked at, because their address had tried too many."""


@dataclass(slots=True)
class Access:
    """The rule for requests to all web ports of a server. Stateful."""

    token: str | None = None
    """Secret that a request must present; None: none, but then the host must be an address."""
    origins: tuple[str, ...] = ()
    """Other sites whose pages are allowed: ``"https://example.org"``."""
    clock: Callable[[], float] = time.monotonic
    proxies: tuple[str, ...] = ()
    """Addresses of proxies that are believed."""
    counts: AccessCounts = field(default_factory=AccessCounts)
    _wrong: OrderedDict[str, dict[int, float]] = field(default_factory=OrderedDict)
    """Address to the wrong tokens that it has tried, as hashes, each with its time."""

    def admit(self, request: web.Request, counts: _CountsRefused | None = None) -> None:
        """Refuse a request that is not allowed, and count it.

        Raises HTTPForbidden if its page, its host or its token is not allowed; HTTPTooManyRequests if its address has
        tried too many tokens.
        """
        origin, host = request.headers.get("Origin"), request.host
        try:
            if origin is not None and origin.partition("://")[2] != host and origin not in self.origins:
                raise web.HTTPForbidden(text=f"Pages of {origin} may not use this server.")
            if self.token is not None:
                self._check(request, self.token)
            elif not _is_address(host):
                reason = f"The host name {host!r} is not allowed: use the IP address, or start the server with a token."
                raise web.HTTPForbidden(text=reason)
        except web.HTTPException:
            if counts is not None:
                counts.refused += 1
            raise

    def allow(self, request: web.Request, methods: str) -> web.Response:
        """Answer a browser that asks whether a page of another site may send requests; this needs no permission."""
        headers = {}
        if request.headers.get("Origin") in self.origins:
            headers = {
                "Access-Control-Allow-Methods": methods,
                "Access-Control-Allow-Headers": "Authorization, Content-Type",
            }
        return web.Response(status=204, headers=headers)

    def caller(self, request: web.Request) -> str:
        """Address of who asks: see :func:`caller_of`."""
        return caller_of(request, self.proxies)

    def _check(self, request: web.Request, token: str) -> None:
        given = request.query.get("token") or request.headers.get("Authorization", "").removeprefix("Bearer ")
        address, now_s, key = self.caller(request), self.clock(), hash(given)
        tried = {one: at_s for one, at_s in self._wrong.get(address, {}).items() if now_s - at_s < FORGET_S}
        if len(tried) >= MAX_WRONG and key not in tried:
            self.counts.delayed += 1
            left_s = FORGET_S - now_s + min(tried.values())
            raise web.HTTPTooManyRequests(text="Too many wrong tokens.", headers={"Retry-After": f"{left_s:.0f}"})
        if hmac.compare_digest(given.encode("utf-8", "surrogateescape"), token.encode()):
            return
        if given:
            self.counts.wrong += 1
            tried.setdefault(key, now_s)
            self._wrong[address] = tried
            self._wrong.move_to_end(address)
            if len(self._wrong) > MAX_ADDRESSES:
                self._wrong.popitem(last=False)
        raise web.HTTPForbidden(text="The token is missing or wrong: open the address that the server printed.")


def caller_of(request: web.Request, proxies: Collection[str]) -> str:
    """Address of who asks: that of the connection, or the last that the proxies which are believed did not add."""
    address = request.remote or ""
    named = ",".join(request.headers.getall("X-Forwarded-For", ())).split(",")
    while address in proxies and named and (last := named.pop().strip()):
        address = last
    return address


def _is_address(host: str) -> bool:
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or name.endswith(".localhost") or bool(ipaddress.ip_address(name))
    except ValueError:
        return False
