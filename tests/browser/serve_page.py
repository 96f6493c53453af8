"""Serves the page with a real engine and voice, for the tests of this folder: serve_page.py PORT [TOKEN]."""

import asyncio
import contextlib
import signal
import sys

import numpy as np
from aiohttp import web

from fapengine.files.profiles import load_profile
from fapengine.live.engine.engine import Engine
from fapengine.live.server.hub import Hub
from fapengine.live.web.app import make_app
from fapengine.mesh.head import build_head
from fapengine.trajectory.style import Style


async def serve(port: int, token: str | None, style: Style) -> None:
    engine = Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1), style=style)
    hub = Hub(engine)
    runner = web.AppRunner(make_app(hub, build_head(), token=token, profile="grid_s1_en"), access_log=None)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, hub.stop)
    print("ready", flush=True)
    await hub.run()
    await runner.cleanup()


if __name__ == "__main__":
    still = Style(blinks=False, head_motion=False, gaze=False, idle=False, emphasis=False)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(int(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None, still))
