"""A server in use, of which a part is killed at a random moment: faces rest, the others go on, nothing is left over."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.browser.chromium import FLAGS, OWN, find_chromium
from tests.faults.processes import Marked, becomes, command_of, left_over, pids
from tests.live.stage import Ear, Sender
from tests.processes import free_port

PARTS = (
    "server", "voice", "ear", "guard", "sender", *(("browser",) if find_chromium() else ()), "worker", "parent",
)  # fmt: skip
WITH_WORKERS = ("worker", "parent")
"""Parts of a server with two workers; the others are those of one process."""
SPEAKERS = ("anna", "berta", "carl")
SOON = 9_000
"""Looks within which happens what should happen at once: a machine may have ten times the work that it can do."""
AGAIN = 150
"""Looks after which a text is sent again."""
WORKERS, WORKER = 2, "fapengine.server.cluster.worker"
"""How many, and how their command lines say so."""
OPEN = 40
"""FAP 3 of an open mouth."""


class World:
    """A server of one process or of two workers, a sender and a browser, each started when it is needed.

    At the end nothing of them is left.

    Stateful.
    """

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self._folder, self._rng = folder, rng
        self._all = ExitStack()
        self._marked: dict[str, Marked] = {}
        self._ear = Ear.open()
        self._port = self._page = 0
        self._probes = 0
        self._has_workers = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._all.close()
        self._ear.close()

    def once(self, part: str) -> str:
        """Kill a part at a random moment; "" or what is wrong then."""
        try:
            self._begin(with_browser=part == "browser", with_workers=part in WITH_WORKERS)
            time.sleep(self._rng.uniform(0.0, 2.0))
            process = self._found(part)
            os.kill(process, signal.SIGKILL)
            return "; ".join(getattr(self, f"_without_{part}")())
        except AssertionError as error:
            self._end_all()
            return str(error)

    # What is so afterwards --------------------------------------------------------------------------------------------

    def _without_server(self) -> list[str]:
        server = self._marked["server"]
        server.process.wait()
        wrong = self._not_at_rest(SPEAKERS)
        wrong += [f"{line} runs on" for line in left_over(server.mark)]
        self._end_all()
        return wrong

    _without_parent = _without_server

    def _without_worker(self) -> list[str]:
        """Its faces speak again, in another worker; it is started again."""
        self._ear.listen()
        self._ear.frames.clear()
        wrong = [
            f"{name} does not speak after the end of a worker"
            for name in ("anna", "carl")
            if not self._becomes(lambda name=name: max(self._ear.jaw(name), default=0) > OPEN)
        ]
        if not self._becomes(lambda: len(self._workers()) == WORKERS):
            wrong.append("a worker is not started again")
        return wrong + self._not_alive()

    def _without_voice(self) -> list[str]:
        wrong = self._not_alive()
        sender = Sender(("127.0.0.1", self._port))
        name = self._new_name()
        self._ear.frames.clear()
        for _ in range(SOON // AGAIN):  # the text that the dead one had is spoken by the next
            sender.tell("/fap/1/text", "sss", name, "Mama mama mama.", "")
            if becomes(lambda: max(self._ear.jaw(name), default=0) >= OPEN, AGAIN):
                break
        else:
            wrong.append("no text is spoken after its end")
        sender.close()
        return wrong

    def _without_ear(self) -> list[str]:
        wrong = self._not_alive()
        try:
            self._found("ear")  # for the sound that comes next
        except AssertionError as error:
            wrong.append(f"{error} after its end")
        return wrong

    def _without_guard(self) -> list[str]:
        wrong = self._not_alive()
        self._end_all()  # so that there is one again
        return wrong

    def _without_sender(self) -> list[str]:
        sender = self._marked.pop("sender")
        sender.process.wait()
        wrong = [f"{line} runs on" for line in left_over(sender.mark)]
        return wrong + self._not_at_rest(("anna", "carl")) + self._not_alive()

    def _without_browser(self) -> list[str]:
        browser = self._marked.pop("browser")
        browser.process.wait()
        return [f"{line} runs on" for line in left_over(browser.mark)] + self._not_alive()

    def _not_at_rest(self, sessions: Sequence[str]) -> list[str]:
        """Sessions whose last frames are not at rest, though they had time."""

        def rests(session: str) -> bool:
            self._ear.listen()
            latest = self._ear.frames.get(session, [])[-1:]
            return not latest or not latest[0].values.any()

        if self._becomes(lambda: all(map(rests, sessions))):
            return []
        return [
            f"{session} does not rest: {self._ear.frames[session][-1]}" for session in sessions if not rests(session)
        ]

    def _not_alive(self) -> list[str]:
        """Whether a face that comes now is shown, and speaks."""
        if (code := self._marked["server"].process.poll()) is not None:
            log = self._log.read_text()[-1500:]
            self._end_all()
            return [f"the server has ended with {code}: {log}"]
        sender, name = Sender(("127.0.0.1", self._port)), self._new_name()
        sender.tell("/fap/1/hello", "sissi", name, 1, "ipa", "", 1)
        sender.utter(name, 0, "mama")
        found = self._becomes(lambda: max(self._ear.jaw(name), default=0) > OPEN)
        sender.close()
        return [] if found else ["a face that comes now does not speak"]

    def _becomes(self, true: Callable[[], bool]) -> bool:
        return becomes(true, SOON)

    def _new_name(self) -> str:
        self._probes += 1
        return f"probe{self._probes}"

    # Who is there -----------------------------------------------------------------------------------------------------

    def _begin(self, *, with_browser: bool, with_workers: bool) -> None:
        if with_workers != self._has_workers:
            self._end_all()
        self._has_workers = with_workers
        if "server" not in self._marked:
            self._start_server()
        if "sender" not in self._marked:
            command = [sys.executable, "-m", "tests.faults.talker", str(self._port)]
            self._marked["sender"] = self._all.enter_context(Marked.start(command, self._folder))
        if with_browser:
            self._start_browser()
        self._ear.listen()  # frames of a server that has ended may wait in the socket: they say nothing of this one
        self._ear.frames.clear()
        speaks = self._becomes(lambda: max(self._ear.jaw("anna"), default=0) > OPEN)
        assert speaks, f"nobody speaks: {self._log.read_text()[-1500:]}"

    def _start_server(self) -> None:
        self._page = free_port()
        self._log = self._folder / "server.log"
        command = [
            sys.executable, "-m", "fapengine", "serve", "--log", "json", "--port", "0", "--web-port", str(self._page),
            "--without", "all", "--sink", f"osc://127.0.0.1:{self._ear.port}",
        ]  # fmt: skip
        if self._has_workers:
            command += ["--workers", str(WORKERS)]
        with self._log.open("w") as log:
            server = Marked.start(command, self._folder, stdout=log, stderr=log)
        self._marked["server"] = self._all.enter_context(server)
        ready = self._becomes(lambda: '"ready"' in self._log.read_text() or server.process.poll() is not None)
        assert ready, "the server does not start"
        found = re.search(r"127\.0\.0\.1:(\d+) \(UDP", self._log.read_text())
        assert found, self._log.read_text()
        self._port = int(found[1])

    def _start_browser(self) -> None:
        path = find_chromium()
        assert path is not None
        url = f"http://127.0.0.1:{self._page}/?session=anna"
        flags = [*FLAGS, *OWN, f"--user-data-dir={self._folder / self._new_name()}", url]
        browser = Marked.start([path, *flags], self._folder, stderr=subprocess.DEVNULL)
        self._marked["browser"] = self._all.enter_context(browser)
        time.sleep(self._rng.uniform(0.5, 4.0))  # before it has loaded the page, or after that

    def _found(self, part: str) -> int:
        """Number of the process of a part."""
        if part == "worker":
            assert self._becomes(lambda: len(self._workers()) == WORKERS), "there are not all workers"
            return self._rng.choice(self._workers())
        if part in ("server", "parent", "sender", "browser"):
            return self._marked["server" if part == "parent" else part].process.pid
        spelled = {
            "voice": "fapengine.voices.process",
            "ear": "fapengine.recognition.process",
            "guard": "fapengine serve",
        }
        server = self._marked["server"]

        def found() -> list[int]:
            return [
                number for number in pids(server.mark)
                if number != server.process.pid and spelled[part] in command_of(number)
            ]  # fmt: skip

        assert self._becomes(lambda: bool(found())), f"there is no {part}"
        return found()[0]

    def _workers(self) -> list[int]:
        """Numbers of the processes of the workers."""
        server = self._marked["server"]
        return [number for number in pids(server.mark) if WORKER in command_of(number)]

    def _end_all(self) -> None:
        for marked in self._marked.values():
            with suppress(ProcessLookupError):
                marked.process.kill()
            for number in pids(marked.mark):
                with suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
            marked.process.wait()
        self._marked.clear()
