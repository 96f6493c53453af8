"""Headless Chromium by its DevTools protocol: as little as the tests of this folder need."""

import asyncio
import base64
import io
import itertools
import os
import shutil
import tempfile
from ctypes.util import find_library
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
from PIL import Image

from tests.processes import end_with_parent

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run", "--disable-extensions",
    "--disable-background-networking", "--disable-component-update", "--mute-audio", "--hide-scrollbars",
    "--autoplay-policy=no-user-gesture-required", "--remote-debugging-port=0",
    "--disable-gpu-watchdog",  # on busy cores the drawing starts too late for it, and WebGL would be switched off
)  # fmt: skip
MESA = ("--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist")
"""Draw with the same software OpenGL as the desktop renderer: twice as fast as the browser's own."""
OWN = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Draw with the software renderer that the browser brings along, where Mesa's OpenGL ES is not installed."""
START_LIMIT_S = float(os.environ.get("BROWSER_START_LIMIT_S", "300"))
"""For all that a start takes."""
CALL_LIMIT_S = 900.0


def find_chromium() -> str | None:
    """Path of a browser, if there is one."""
    asked = os.environ.get("CHROMIUM")
    return asked or next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """Stateful: one browser and one page in it."""

    def __init__(self, size: tuple[int, int], *flags: str) -> None:
        self._size, self._flags = size, flags
        self._numbers = itertools.count(1)
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._reader: asyncio.Task[None] | None = None
        self.complaints: list[str] = []
        """Errors and warnings of the console, and exceptions nobody caught."""
        self.workers: dict[str, str] = {}
        """Kinds of the page's workers by their sessions, after a call of ``Target.setAutoAttach`` with ``flatten``."""

    @property
    def pid(self) -> int:
        """Number of the process that started the others."""
        return self._process.pid

    async def __aenter__(self) -> "Browser":
        path = find_chromium()
        assert path is not None
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        graphics = MESA if find_library("GLESv2") and find_library("EGL") else OWN
        window = f"--window-size={self._size[0]},{self._size[1]}"
        flags = (*FLAGS, *self._flags, *graphics, window, f"--user-data-dir={self._folder.name}")
        self._log = (Path(self._folder.name) / "log").open("wb")
        surroundings = {**os.environ, "EGL_PLATFORM": "surfaceless", "LP_NUM_THREADS": "2"}
        self._process = await asyncio.create_subprocess_exec(
            path,
            *flags,
            "about:blank",
            stdout=asyncio.subprocess.DEVNULL,
            stderr=self._log,
            env=surroundings,
            preexec_fn=end_with_parent,
        )
        self._session = aiohttp.ClientSession()
        try:
            async with asyncio.timeout(START_LIMIT_S):
                await self._connect()
        except BaseException as error:
            await self.__aexit__()
            if isinstance(error, TimeoutError):
                raise AssertionError(f"the browser {path} does not come up within {START_LIMIT_S:g} s") from error
            raise
        return self

    async def _connect(self) -> None:
        port = await self._port()
        async with self._session.get(f"http://127.0.0.1:{port}/json") as answer:
            target = next(page for page in await answer.json() if page["type"] == "page")
        self._socket = await self._session.ws_connect(target["webSocketDebuggerUrl"], max_msg_size=0)
        self._reader = asyncio.create_task(self._read())
        for domain in ("Page", "Runtime", "Log", "Network"):
            await self.call(f"{domain}.enable")

    async def __aexit__(self, *_: object) -> None:
        if self._reader is not None:
            self._reader.cancel()
            await asyncio.gather(self._reader, return_exceptions=True)
        if self._socket is not None:
            await self._socket.close()
        await self._session.close()
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()
        self._log.close()
        self._folder.cleanup()

    async def call(self, method: str, session: str | None = None, **params: object) -> dict[str, Any]:
        """Call a method of the protocol; the session of a worker, if not of the page: :attr:`workers`."""
        number = next(self._numbers)
        self._answers[number] = asyncio.get_running_loop().create_future()
        assert self._socket is not None
        of_worker = {"sessionId": session} if session else {}
        await self._socket.send_json({"id": number, "method": method, "params": params, **of_worker})
        async with asyncio.timeout(CALL_LIMIT_S):
            answer = await self._answers[number]
        assert "error" not in answer, f"{method}: {answer['error']}"
        return answer["result"]

    async def open(self, url: str) -> None:
        """Go to an address."""
        self.complaints.clear()
        await self.call("Page.navigate", url=url)

    async def run(self, code: str) -> Any:
        """Evaluate JavaScript in the page; promises are awaited."""
        answer = await self.call(
            "Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True, userGesture=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    async def until(self, condition: str, limit_s: float = 120.0) -> None:
        """Wait until an expression is true in the page."""
        loop = asyncio.get_running_loop()
        stop_s = loop.time() + limit_s
        while not await self._holds(condition):
            assert loop.time() < stop_s, f"it never became so: {condition}; the page complains: {self.complaints}"
            await asyncio.sleep(0.03)

    async def _holds(self, condition: str) -> bool:
        try:
            return bool(await self.run(f"Boolean({condition})"))
        except AssertionError:  # the page is not there yet
            return False

    async def picture(self) -> np.ndarray:
        """(H, W, 3) uint8: what the window shows."""
        shot = await self.call("Page.captureScreenshot", format="png")
        with Image.open(io.BytesIO(base64.b64decode(shot["data"]))) as image:
            return np.asarray(image.convert("RGB"))

    async def _port(self) -> int:
        place = Path(self._folder.name) / "DevToolsActivePort"
        while not (place.exists() and place.read_text().strip()):
            assert self._process.returncode is None, "the browser stopped"
            await asyncio.sleep(0.05)
        return int(place.read_text().split()[0])

    async def _read(self) -> None:
        assert self._socket is not None
        async for message in self._socket:
            said = message.json()
            if "id" in said:
                waiting = self._answers.pop(said["id"])
                if not waiting.done():
                    waiting.set_result(said)
                continue
            match said["method"], said.get("params", {}):
                case "Runtime.exceptionThrown", params:
                    self.complaints.append(str(params["exceptionDetails"]))
                case "Runtime.consoleAPICalled", {"type": "error" | "warning" | "assert"} as params:
                    self.complaints.append(str([one.get("value", one.get("description")) for one in params["args"]]))
                case "Target.attachedToTarget", params:
                    self.workers[params["sessionId"]] = params["targetInfo"]["type"]
                case "Target.detachedFromTarget", params:
                    self.workers.pop(params["sessionId"], None)
                case "Log.entryAdded", {"entry": {"level": "error" | "warning"} as entry}:
                    self.complaints.append(f"{entry['text']} {entry.get('url', '')}")
