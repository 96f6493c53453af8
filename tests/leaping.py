"""Virtual time: an event loop that never waits, whose time leaps to the next thing that is due."""

import asyncio
import queue
import selectors
import time
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from threading import Lock
from typing import Any, TypeVar

import pytest

from tests.patient import packets_under_way

Result = TypeVar("Result")


def run_leaping(work: Coroutine[Any, Any, Result]) -> Result:
    """Run a coroutine on a loop of its own, and close it."""
    loop = LeapingLoop()
    try:
        return loop.run_until_complete(work)
    finally:
        loop.close()


async def until(is_so: Callable[[], object]) -> None:
    """Wait until something is so that needs no time but the machine's: time stands still meanwhile."""
    while not is_so():
        await asyncio.sleep(0)


class LeapingLoop(asyncio.SelectorEventLoop):
    """Stateful: its time stands still while anything is worked on, in threads too, so a busy machine is not seen."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.working = 0
        """Number of things that threads work on."""
        self._lock = Lock()
        super().__init__(_Leaping(self))

    def time(self) -> float:
        return self.now_s

    def works(self, more: int) -> None:
        """Count things that a thread begins (1) or has done (-1)."""
        with self._lock:
            self.working += more

    @contextmanager
    def stands_still(self) -> Iterator[None]:
        """Let no time pass: what is waited for is sure to come, however late the kernel delivers it."""
        self.works(1)
        try:
            yield
        finally:
            self.works(-1)

    def run_in_executor(self, executor: Executor | None, func: Any, *args: Any) -> "asyncio.Future[Any]":
        future = super().run_in_executor(executor, func, *args)
        self.works(1)
        future.add_done_callback(lambda _: self.works(-1))
        return future

    def lend(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Have this process go by the loop's time, and the loop wait for the decoding threads of aiortc."""
        from aiortc import clock, rtcrtpreceiver

        begun_s, begun = time.time(), clock.current_datetime()
        loop = self

        class Tasks(queue.Queue[Any]):
            """Queue of what a thread decodes; it takes the next one when it has told of the one before."""

            has_taken = False

            def put(self, task: Any, block: bool = True, timeout: float | None = None) -> None:
                loop.works(1)
                super().put(task, block, timeout)

            def get(self, block: bool = True, timeout: float | None = None) -> Any:
                loop.works(-int(self.has_taken))
                task = super().get(block, timeout)
                self.has_taken = task is not None
                if not self.has_taken:  # the thread ends
                    loop.works(-1)
                return task

        monkeypatch.setattr(time, "monotonic", self.time)
        monkeypatch.setattr(time, "time", lambda: begun_s + self.now_s)
        monkeypatch.setattr(clock, "current_datetime", lambda: begun + clock.datetime.timedelta(seconds=self.now_s))
        monkeypatch.setattr(rtcrtpreceiver, "queue", type("queue", (), {"Queue": Tasks}))


class _Leaping(selectors.SelectSelector):
    def __init__(self, loop: LeapingLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        is_working = self._loop.working  # asked first: a thread that ends meanwhile has told the loop, below
        if (ready := super().select(0)) or timeout == 0:
            return ready
        if is_working or timeout is None:
            return super().select(0.005)
        if packets_under_way():
            return super().select(0.0005)
        if ready := super().select(0):  # delivered before they were looked for
            return ready
        self._loop.now_s += timeout
        return super().select(0)
