"""The page as part of the whole server: what comes in by OSC is seen there, and counted."""

import asyncio
import json

import aiohttp
import numpy as np
import pytest

from fapengine.mesh.default_head.head import build_head
from fapengine.mpeg4 import fap
from fapengine.server.config import Listen
from fapengine.server.server import Server
from fapengine.server.web import site as web_site
from fapengine.server.web.messages import FRAME
from tests.english import english
from tests.live.stage import Sender, config_of, on_a_loop, until


def test_what_a_sender_says_is_seen_on_the_page_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_site, "IDLE_S", 0.2)  # a page that is connected is not idle

    async def main() -> None:
        config = config_of(token="t")
        listen = Listen(port=0, web_port=0, metrics_port=0, token="t")
        server = Server(type(config)(listen=listen, style=config.style), english(), build_head())
        await server.start()
        running = asyncio.create_task(server.run())
        page, metrics = (f"http://{host}:{port}" for host, port in server.sites)
        sender, jaws, kinds = Sender(server.osc_address), [0], set()

        async def watch(socket: aiohttp.ClientWebSocketResponse) -> None:
            async for message in socket:
                if message.type is aiohttp.WSMsgType.BINARY:
                    assert message.data[:4] == b"\1\0\0\0"
                    jaws.append(int(np.frombuffer(message.data, "<i4", offset=FRAME.size - 4 * 68)[fap.column(3)]))
                else:
                    kinds.add(json.loads(message.data)["type"])

        async with aiohttp.ClientSession() as client:
            async with client.get(f"{page}/") as answer:
                assert "<title>fapengine</title>" in await answer.text()
            socket = await client.ws_connect(f"{page}/ws?session=anna&token=t")
            watching = asyncio.create_task(watch(socket))
            sender.tell("/fap/1/hello", "sissis", "anna", 1, "ipa", "", 1, "t")
            sender.utter("anna", 0, "mama")
            await until(lambda: max(jaws) > 50)
            async with client.get(f"{metrics}/metrics", headers={"Authorization": "Bearer t"}) as answer:
                told = await answer.text()
            assert "fapengine_pages 1.0" in told
            assert 'fapengine_page_total{kind="connected"} 1.0' in told
            server.stop()
            await running
            await watching
        assert socket.close_code == 1001
        assert jaws[-1] == 0  # it comes to rest before it goes
        assert kinds >= {"hello", "begin", "phones", "event", "cancel"}
        sender.close()

    on_a_loop(main)
