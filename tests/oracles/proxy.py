"""Callers behind Debian's nginx: each has places of its own where the server believes it, whatever they claim to be.

python -m tests.oracles.proxy
"""

import asyncio
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import aiohttp

from fapengine.mesh.default_head.head import build_head
from fapengine.server.config import Caps, Listen, ServerConfig
from fapengine.server.server import Server
from tests.english import english
from tests.processes import free_port, start

CONFIG = """
daemon off;
pid {folder}/pid;
error_log stderr;
events {{}}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    server {{
        listen 127.0.0.1:{port};
        location / {{
            proxy_pass http://127.0.0.1:{behind};
            proxy_http_version 1.1;
            proxy_set_header Host $http_host;
            proxy_set_header Upgrade $http_upgrade;
            proxy_set_header Connection $http_connection;
            proxy_set_header X-Forwarded-For $proxy_add_x_forwarded_for;
        }}
    }}
}}
"""
PLACES = 3
LIMIT_S = 60.0


@contextmanager
def nginx(behind: int) -> Iterator[int]:
    """Run a proxy on a port of this machine, before another port."""
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "conf").write_text(CONFIG.format(folder=folder, port=port, behind=behind))
        process = start(["nginx", "-p", folder, "-c", f"{folder}/conf"], stderr=subprocess.PIPE, text=True)
        try:
            yield port
        finally:
            process.terminate()
            told = process.communicate()[1]
            assert process.returncode == 0, told


PAGES: list[aiohttp.ClientWebSocketResponse] = []
"""Pages that are kept open."""


async def asked(port: int, address: str, claims: str | None = None) -> tuple[int, aiohttp.ClientSession]:
    """Open a page's WebSocket from an address of this machine, and keep it; the status of the answer."""
    own = aiohttp.TCPConnector(local_addr=(address, 0))
    client = aiohttp.ClientSession(connector=own, headers={"X-Forwarded-For": claims} if claims else {})
    try:
        PAGES.append(await client.ws_connect(f"http://127.0.0.1:{port}/ws?session=anna"))
    except aiohttp.WSServerHandshakeError as error:
        return error.status, client
    return 101, client


async def answers(proxies: tuple[str, ...]) -> list[int]:
    """Let callers of two addresses take places through the proxy; the status of each answer."""
    limits = Caps(connections_per_address=PLACES)
    listen = Listen(port=0, web_port=0, proxies=proxies)
    server = Server(ServerConfig(listen=listen, limits=limits), english(), build_head())
    await server.start()
    running = asyncio.create_task(server.run())
    clients = []
    try:
        with nginx(server.sites[0][1]) as port:
            async with asyncio.timeout(LIMIT_S):
                while True:
                    try:
                        (await asyncio.open_connection("127.0.0.1", port))[1].close()
                        break
                    except ConnectionRefusedError:
                        await asyncio.sleep(0.05)
                found = []
                for address in (PLACES + 1) * ["127.0.0.2"] + ["127.0.0.3"]:
                    status, client = await asked(port, address)
                    found.append(status)
                    clients.append(client)
                status, client = await asked(port, "127.0.0.2", "127.0.0.9")
                found.append(status)
                await client.close()
                await clients[0].close()
                while server.doors["page"]._inside["127.0.0.2" if proxies else "127.0.0.1"] == PLACES:
                    await asyncio.sleep(0.05)
                status, client = await asked(port, "127.0.0.2")
                clients.append(client)
                return [*found, status]
    finally:
        for client in clients:
            await client.close()
        server.stop()
        await running


def check_behind_nginx() -> None:
    """Fail if a caller behind a proxy takes the places of another, or gets more by what it claims to be."""
    if shutil.which("nginx") is None:
        print("nginx: not on this machine; Debian has it")
        return
    believed, unknown = asyncio.run(answers(("127.0.0.1",))), asyncio.run(answers(()))
    assert believed == [101, 101, 101, 503, 101, 503, 101], believed
    assert unknown == [101, 101, 101, 503, 503, 503, 101], unknown  # all are one address
    print("nginx: callers have places of their own where it is believed, and share them where it is not")


if __name__ == "__main__":
    sys.exit(check_behind_nginx())
