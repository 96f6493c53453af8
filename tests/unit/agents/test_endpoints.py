"""Servers of models: what is asked, and what is said of those that cannot be used. The server is a stub."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from aiohttp import web

from fapengine.agents.endpoints import Endpoint
from fapengine.errors import FapEngineError, ResourceError, UsageError

Models = Callable[[web.Request], Awaitable[web.Response]]


async def two(request: web.Request) -> web.Response:
    if request.headers.get("Authorization", "") not in ("", "Bearer right"):
        raise web.HTTPUnauthorized
    return web.json_response({"data": [{"id": "small"}, {"id": "large"}]})


async def locked(_: web.Request) -> web.Response:
    raise web.HTTPUnauthorized


async def a_page(_: web.Request) -> web.Response:
    return web.Response(text="<!doctype html>")


async def nothing(_: web.Request) -> web.Response:
    raise web.HTTPNotFound


def ask(models: Models, model: str | None = None, key: str | None = None) -> Endpoint:
    async def asked() -> Endpoint:
        app = web.Application()
        app.add_routes([web.get("/v1/models", models)])
        runner = web.AppRunner(app)
        await runner.setup()
        try:
            await web.TCPSite(runner, "127.0.0.1", 0).start()
            host, port = runner.addresses[0][:2]
            return await Endpoint("llm", f"http://{host}:{port}/v1/", model, key).checked()
        finally:
            await runner.cleanup()

    return asyncio.run(asked())


@pytest.mark.parametrize(
    ("models", "model", "chosen"),
    [(two, None, "small"), (two, "large", "large"), (nothing, "any", "any"), (a_page, "any", "any")],
)
def test_the_model_is_the_one_asked_for_or_the_first(models: Models, model: str | None, chosen: str) -> None:
    assert ask(models, model).model == chosen


def test_the_key_is_sent_and_not_shown() -> None:
    endpoint = ask(two, key="right")
    assert (endpoint.key, "right" in repr(endpoint)) == ("right", False)


@pytest.mark.parametrize(
    ("models", "model", "key", "kind", "said"),
    [
        (locked, None, None, ResourceError, "answered 401: a key is missing; set it in FAPENGINE_LLM_KEY"),
        (two, None, "wrong", ResourceError, "answered 401: the key is refused; set it in FAPENGINE_LLM_KEY"),
        (two, "huge", None, UsageError, "llm_model: got 'huge', expected one of small, large"),
        (nothing, None, None, UsageError, "llm_model: missing; .*/models answered 404 and lists no models"),
        (a_page, None, None, UsageError, "llm_model: missing; .*/models answered 200 and lists no models"),
    ],
)
def test_what_is_wrong_is_said(
    models: Models, model: str | None, key: str | None, kind: type[FapEngineError], said: str
) -> None:
    with pytest.raises(kind, match=said):
        ask(models, model, key)


def test_a_server_that_is_not_there() -> None:
    with pytest.raises(ResourceError, match=r"stt: http://127\.0\.0\.1:1/v1 cannot be reached .*is the server running"):
        asyncio.run(Endpoint("stt", "http://127.0.0.1:1/v1").checked())


@pytest.mark.parametrize("url", ["127.0.0.1:11434", "ftp://host/v1", "http://", ""])
def test_an_address_is_a_url(url: str) -> None:
    with pytest.raises(UsageError, match=r"llm: got .*, expected a URL such as http://"):
        Endpoint("llm", url)
