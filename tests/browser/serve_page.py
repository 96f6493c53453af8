"""Serves the page with a real engine and voice, for the tests of this folder: serve_page.py PORT HEAD [options].

HEAD is a folder in which the head is kept, so that only the first start builds it.
"""

import argparse
import asyncio
import contextlib
import signal
from pathlib import Path

import numpy as np
from aiohttp import web

from fapengine.files.heads.folder import HeadInfo, save_head
from fapengine.files.heads.load import load_head
from fapengine.files.profiles import load_profile
from fapengine.live.calls.calls import Calls
from fapengine.live.calls.handlers import add_calls
from fapengine.live.engine.engine import Engine
from fapengine.live.film.film import FilmForm, Studio
from fapengine.live.hub.hearing import Hearing
from fapengine.live.hub.hub import Hub
from fapengine.live.web.app import make_app
from fapengine.mesh.default_head.head import build_head
from fapengine.trajectory.style import Style


async def serve(
    port: int, folder: Path, style: Style, *, token: str | None, origins: list[str], takes_calls: bool
) -> None:
    if not folder.exists():
        save_head(folder, build_head(), HeadInfo(source="our own", licence="Apache-2.0"))
    engine = Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1), style=style)
    hub = Hub(engine)
    hearing = Hearing(hub)
    app = make_app(
        hub, load_head(str(folder)), token=token, profile="grid_s1_en", hearing=hearing, origins=tuple(origins)
    )
    studio = Studio(hub, hearing)
    calls = Calls(hub, studio, hearing, form=FilmForm(size=(256, 256)), most=4)
    if takes_calls:
        add_calls(app, calls, token, tuple(origins))
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, hub.stop)
    print("ready", flush=True)
    await hub.run(lambda now_s, due_s: hearing.tick(now_s))
    await calls.close()
    await studio.close()
    hearing.close()
    await runner.cleanup()


if __name__ == "__main__":
    still = Style(blinks=False, head_motion=False, gaze=False, idle=False, emphasis=False)
    parser = argparse.ArgumentParser()
    parser.add_argument("port", type=int)
    parser.add_argument("head", type=Path)
    parser.add_argument("--token")
    parser.add_argument("--origin", action="append", default=[])
    parser.add_argument("--no-calls", action="store_true")
    told = parser.parse_args()
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(
            serve(told.port, told.head, still, token=told.token, origins=told.origin, takes_calls=not told.no_calls)
        )
