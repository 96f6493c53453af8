"""A server with the page, and a browser to look at it: one of each for all tests here."""

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fapengine.files.sound import save_wav
from fapengine.recognition.protocol import RATE_HZ
from tests.browser.chromium import Browser, find_chromium
from tests.conftest import NO_BROWSER
from tests.processes import free_port, start
from tests.unit.recognition.speech import BABY, spoken

SIZE = (900, 620)
MICROPHONE = ("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream")
"""Flags of a browser whose microphone is a file, over and over, and which asks nobody for leave."""
OWN_TURNS = "&turns=browser"
"""Query of a page whose pictures are drawn when the browser asks for them."""
FEW_TURNS = f"""
    if (!location.search.includes("{OWN_TURNS}")) {{
        window.requestAnimationFrame = (turn) => setTimeout(() => turn(performance.now()), 50);
        window.cancelAnimationFrame = clearTimeout;
    }}
"""
"""The screen turns 20 times a second: drawn by software, 60 would take two processors from all other tests."""
PROGRAM, ROOT = "tests.browser.serve_page", Path(__file__).resolve().parents[2]


class Server:
    """Stateful: the page's server in a process of its own, always on the same port."""

    def __init__(self, folder: Path) -> None:
        self._head = folder / "head"
        self.port, site_port = free_port(), free_port()
        self.site = f"http://127.0.0.1:{site_port}"
        """Origin of somebody else's pages, which may show its faces."""
        self.url = f"http://127.0.0.1:{self.port}/"
        self.start()

    def start(self, *arguments: str) -> None:
        command = [sys.executable, "-m", PROGRAM, str(self.port), str(self._head), "--origin", self.site, *arguments]
        self.process = start(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()

    def end(self) -> int:
        """Ask it to stop; its exit code."""
        self.process.terminate()
        self.process.communicate(timeout=300)
        return self.process.returncode


class Page:
    """Stateful: the browser without ``await``."""

    def __init__(self, runner: asyncio.Runner, browser: Browser, server: Server) -> None:
        self._runner, self._browser, self.server = runner, browser, server

    @property
    def complaints(self) -> list[str]:
        return self._browser.complaints

    def open(self, session: str = "face", query: str = "") -> None:
        """Open the page and wait until frames come."""
        self._runner.run(self._browser.open(f"{self.server.url}?session={session}{query}"))
        self.until("document.body.dataset.connection === 'connected' && page.session.jitterBuffer.frames.length > 3")
        # As many pixels as the window has, however slow the machine: pictures are compared.
        self.run("page.picture.budget.add = () => false; page.picture.budget.scale = 1; page.picture.resized = true")

    def go(self, url: str) -> None:
        self._runner.run(self._browser.open(url))

    def run(self, code: str) -> Any:
        return self._runner.run(self._browser.run(code))

    def until(self, condition: str, limit_s: float = 300.0) -> None:
        self._runner.run(self._browser.until(condition, limit_s))

    def picture(self) -> np.ndarray:
        return self._runner.run(self._browser.picture())

    def call(self, method: str, **params: object) -> dict[str, Any]:
        return self._runner.run(self._browser.call(method, **params))

    def key(self, key: str) -> None:
        """Press a key as a hand would."""
        known = {
            "Escape": (27, ""),
            "Enter": (13, "\r"),
            "Tab": (9, ""),
            "ArrowLeft": (37, ""),
            "ArrowRight": (39, ""),
            "ArrowUp": (38, ""),
            "ArrowDown": (40, ""),
            " ": (32, " "),
        }
        code, text = known.get(key, (ord(key[0].upper()), key))
        for kind in ("keyDown", "keyUp"):
            typed = {"text": text} if text and kind == "keyDown" else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **typed)

    def sleep(self, seconds: float) -> None:
        self._runner.run(asyncio.sleep(seconds))


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    if find_chromium() is None:
        pytest.skip(NO_BROWSER)
    made = Server(tmp_path_factory.mktemp("page"))
    yield made
    made.kill()


@pytest.fixture(scope="package")
def _browser(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    if find_chromium() is None:
        pytest.skip(NO_BROWSER)
    sound = tmp_path_factory.mktemp("microphone") / "baby.wav"
    pause = np.zeros(RATE_HZ, np.int16)
    save_wav(sound, np.concatenate([spoken("rms", BABY).samples, pause]), RATE_HZ)
    with asyncio.Runner() as runner:
        browser = Browser(SIZE, *MICROPHONE, f"--use-file-for-fake-audio-capture={sound}")
        runner.run(browser.__aenter__())
        runner.run(browser.call("Page.addScriptToEvaluateOnNewDocument", source=FEW_TURNS))
        try:
            yield Page(runner, browser, request.getfixturevalue("server"))
        finally:
            runner.run(browser.__aexit__())


@pytest.fixture
def page(_browser: Page) -> Iterator[Page]:
    """The browser as the test before left it; no test may leave a complaint in the console.

    A page that is left while it loads may complain of its own server, which is gone, in the middle of the next test.
    """
    _browser.complaints.clear()
    yield _browser
    origin = _browser.run("location.origin")
    assert [said for said in _browser.complaints if "net::ERR_" not in said or origin in said] == []
