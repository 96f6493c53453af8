"""Work that runs beside its owner: the loop itself holds no task, so somebody must until it ends."""

import asyncio
from collections.abc import Coroutine
from typing import Any


class Tasks(set[asyncio.Task[Any]]):
    """Running tasks; each leaves when it has ended. Stateful."""

    def start(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        """Start a task on the running loop."""
        task = asyncio.get_running_loop().create_task(work)
        self.add(task)
        task.add_done_callback(self.discard)
        return task

    def cancel(self) -> None:
        """Cancel all of them."""
        for task in tuple(self):
            task.cancel()

    async def close(self) -> None:
        """Cancel all of them, and wait until they have ended, whatever they raise."""
        self.cancel()
        await asyncio.gather(*self, return_exceptions=True)
