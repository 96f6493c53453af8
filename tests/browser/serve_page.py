"""Serves the page with a real engine and voice, for the tests of this folder.

    python -m tests.browser.serve_page PORT HEAD [options]

HEAD is a folder in which the head is kept, so that only the first start builds it.
"""

import argparse
import asyncio
import contextlib
import signal
from pathlib import Path

import numpy as np
from aiohttp import web

from fapengine.engine.engine import Engine
from fapengine.files.heads.folder import HeadInfo, save_head
from fapengine.files.heads.load import load_head
from fapengine.files.profiles import load_profile
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.mesh.default_head.head import build_head
from fapengine.server.calls.calls import Calls, add_calls
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.web.access import Access
from fapengine.server.web.app import make_app
from fapengine.trajectory.style import Style
from tests.patient import PatientClock

BEHIND_S, PAUSE_S = 0.3, 0.03


async def serve(
    port: int, folder: Path, style: Style, *, token: str | None, origins: list[str], takes_calls: bool
) -> None:
    if not folder.exists():
        save_head(folder, build_head(), HeadInfo(source="our own", licence="Apache-2.0"))
    engine = Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1), style=style)
    clock = PatientClock()
    hub = Hub(engine, clock=clock)
    hearing = Hearing(hub)
    access = Access(token, tuple(origins))
    app = make_app(hub, load_head(str(folder)), access=access, profile="grid_s1_en", hearing=hearing)
    studio = Studio(hub, hearing)
    calls = Calls(hub, studio, hearing, form=FilmForm(size=(256, 256)), most=4)
    if takes_calls:
        add_calls(app, calls, access)
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, hub.stop)
    print("ready", flush=True)

    def hear(now_s: float, due_s: float) -> None:
        """Let time stand still for a while where a recognizer is behind, as on a busy machine."""
        hearing.tick(now_s)
        if any(one.recognizer.waiting_s > BEHIND_S for one in hearing._sessions.values()):
            clock.allow(hearing)
            loop.call_later(PAUSE_S, clock.free, hearing)

    await hub.run(hear)
    await calls.close()
    await studio.close()
    hearing.close()
    await runner.cleanup()


if __name__ == "__main__":
    still = Style.speech_only()
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
