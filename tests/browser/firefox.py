"""Firefox on a virtual display, with a virtual sound card, by WebDriver BiDi: as little as
``python -m tests.browser.oracles`` needs. Without a card, no time passes for an AudioContext.
"""

import asyncio
import contextlib
import itertools
import json
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import aiohttp

from tests.processes import end_with_parent
from tests.sound_card import null_sink

NAMES = ("firefox-esr", "firefox")
# Sound in a process of its own stood still in every second run that ended tracks: its thread of PulseAudio and the one
# that answers the page waited for each other. In the page's process that is rarer.
PREFERENCES = {
    "media.autoplay.default": 0, "media.autoplay.blocking_policy": 0, "webgl.force-enabled": True,
    "datareporting.policy.dataSubmissionEnabled": False, "app.update.enabled": False,
    "browser.shell.checkDefaultBrowser": False, "toolkit.telemetry.enabled": False, "dom.ipc.forkserver.enable": False,
    "media.cubeb.sandbox": False, "security.sandbox.content.level": 0,
}  # fmt: skip
START_LIMIT_S, CALL_LIMIT_S = 300.0, 300.0


def find_firefox() -> str | None:
    """Path of a browser, if there is one, and a display for it. The variable FIREFOX names one elsewhere."""
    asked = os.environ.get("FIREFOX")
    found = asked or next((path for name in NAMES if (path := shutil.which(name))), None)
    return found if shutil.which("Xvfb") else None


class Firefox:
    """Stateful: one browser and one page in it."""

    def __init__(self) -> None:
        self._numbers = itertools.count(1)
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self.complaints: list[str] = []
        """Errors of the console, and exceptions nobody caught."""

    @property
    def pid(self) -> int:
        """Number of the process that started the others."""
        return self._process.pid

    async def __aenter__(self) -> "Firefox":
        path = find_firefox()
        assert path is not None
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        lines = (f'user_pref("{name}", {json.dumps(value)});' for name, value in PREFERENCES.items())
        (Path(self._folder.name) / "user.js").write_text("\n".join(lines))
        self._card = contextlib.ExitStack()
        (sound := Path(self._folder.name) / "sound").mkdir()
        card = self._card.enter_context(null_sink(sound))
        surroundings = {**card, "LIBGL_ALWAYS_SOFTWARE": "1", "DISPLAY": await self._display()}
        self._process = await asyncio.create_subprocess_exec(
            path, "--no-remote", "--remote-debugging-port=0", "--profile", self._folder.name,
            stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE, preexec_fn=end_with_parent,
            env=surroundings,
        )  # fmt: skip
        async with asyncio.timeout(START_LIMIT_S):
            address = await self._address()
        self._session = aiohttp.ClientSession()
        self._socket = await self._session.ws_connect(f"{address}/session", max_msg_size=0)
        self._tasks = [asyncio.create_task(self._read()), asyncio.create_task(self._drain())]
        await self.call("session.new", capabilities={})
        await self.call("session.subscribe", events=["log.entryAdded"])
        tree = await self.call("browsingContext.getTree")
        self._context = tree["contexts"][0]["context"]
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._socket.close()
        await self._session.close()
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await self._process.wait()
        self._screen.kill()
        await self._screen.wait()
        self._card.close()
        self._folder.cleanup()

    async def call(self, method: str, **params: object) -> dict[str, Any]:
        """Call a method of the protocol."""
        number = next(self._numbers)
        self._answers[number] = asyncio.get_running_loop().create_future()
        await self._socket.send_json({"id": number, "method": method, "params": params})
        try:
            async with asyncio.timeout(CALL_LIMIT_S):
                answer = await self._answers[number]
        except TimeoutError:
            self._answers.pop(number).cancel()
            raise AssertionError(f"{method}: no answer within {CALL_LIMIT_S:g} s; {self.complaints}") from None
        assert answer["type"] == "success", f"{method}: {answer}"
        return answer["result"]

    async def open(self, url: str) -> None:
        """Go to an address."""
        self.complaints.clear()
        await self.call("browsingContext.navigate", context=self._context, url=url, wait="complete")

    async def run(self, code: str) -> Any:
        """Evaluate JavaScript in the page, what JSON can say of it; promises are awaited."""
        answer = await self.call(
            "script.evaluate", expression=f"(async () => JSON.stringify(await ({code})))()", awaitPromise=True,
            target={"context": self._context}, userActivation=True,
        )  # fmt: skip
        assert answer["type"] == "success", answer
        value = answer["result"].get("value")
        return None if value is None else json.loads(value)

    async def until(self, condition: str, limit_s: float = 60.0) -> None:
        """Wait until an expression is true in the page."""
        loop = asyncio.get_running_loop()
        stop_s = loop.time() + limit_s
        while not await self._holds(condition):
            assert loop.time() < stop_s, f"it never became so: {condition}; the page complains: {self.complaints}"
            await asyncio.sleep(0.05)

    async def _holds(self, condition: str) -> bool:
        try:
            return bool(await self.run(f"Boolean({condition})"))
        except AssertionError:  # the page is not there yet
            return False

    async def _display(self) -> str:
        """Open a virtual display, for without one it has no WebGL; its name."""
        self._screen = await asyncio.create_subprocess_exec(
            "Xvfb", "-displayfd", "1", "-screen", "0", "1280x900x24",
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL, preexec_fn=end_with_parent,
        )  # fmt: skip
        assert self._screen.stdout is not None
        return f":{(await self._screen.stdout.readline()).decode().strip()}"

    async def _address(self) -> str:
        assert self._process.stderr is not None
        while line := (await self._process.stderr.readline()).decode("utf-8", "replace"):
            if found := re.search(r"WebDriver BiDi listening on (ws://\S+)", line):
                return found[1]
        raise AssertionError("the browser stopped")

    async def _drain(self) -> None:
        assert self._process.stderr is not None
        while await self._process.stderr.readline():
            pass

    async def _read(self) -> None:
        async for message in self._socket:
            said = message.json()
            if "id" in said and said["id"] is not None:
                if waiting := self._answers.pop(said["id"], None):
                    waiting.set_result(said)
            elif said.get("method") == "log.entryAdded" and said["params"]["level"] == "error":
                self.complaints.append(said["params"]["text"])
