"""Built-in heads for pages, made by child processes of high niceness, one at a time, so that no face waits for them."""

import asyncio
import gzip

from fapengine._child import NICENESS, Child, Parent, command, end_soon_with_parent
from fapengine.errors import ResourceError


class Heads:
    """Heads by name, compressed; only the latest is kept. Stateful; close it."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()
        self._latest: tuple[str, bytes] = "", b""
        self._child: Child | None = None
        self._is_closed = False

    async def packed(self, name: str) -> bytes:
        """Return the file of a head (:mod:`.page_files`), compressed by gzip.

        Raises
        ------
        ResourceError
            If its process cannot be started, or has ended.
        """
        async with self._turn:
            if self._is_closed:
                raise ResourceError("head: the server stops")
            if self._latest[0] != name:
                self._child = Child("head", command(__name__, name, niceness=NICENESS))
                try:
                    self._latest = name, (await asyncio.to_thread(self._child.ask, {}))[1]
                except EOFError as error:
                    raise ResourceError("head: its process has ended") from error
                finally:
                    self._child.close()
            return self._latest[1]

    def close(self) -> None:
        """End the process that makes a head."""
        self._is_closed = True
        if self._child is not None:
            self._child.close()


def main(parent: Parent, name: str) -> None:
    """Make the head; the child's program."""
    from fapengine.files.heads.load import load_head
    from fapengine.server.web.page_files import head_binary

    end_soon_with_parent()
    for _ in parent.messages():
        parent.tell({}, gzip.compress(head_binary(load_head(name)), 6, mtime=0))
