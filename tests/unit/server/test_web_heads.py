"""Heads for pages: made beside the server, one after the other, and not kept."""

import asyncio
import gzip
import threading
from collections.abc import Sequence

import pytest

from fapengine.errors import ResourceError
from fapengine.files.heads.load import load_head
from fapengine.server.web import page_files
from fapengine.server.web.page_files import NICENESS, Heads, head_binary


class Maker:
    """In place of a child process. Stateful."""

    made: list[str]
    now = most = 0

    def __init__(self, _: str, command: Sequence[str]) -> None:
        module, niceness, name = command[-3:]
        assert (module, niceness) == ("fapengine.server.web.page_files", str(NICENESS))
        self.name, self.may_end, self.is_closed = name, threading.Event(), False
        Maker.made.append(name)
        Maker.now += 1
        Maker.most = max(Maker.most, Maker.now)

    def ask(self, _: object) -> tuple[object, bytes]:
        if self.name == "endless":
            assert self.may_end.wait(300)
            raise EOFError
        return {}, self.name.encode()

    def close(self) -> None:
        Maker.now -= not self.is_closed
        self.is_closed = True
        self.may_end.set()


def test_heads_are_made_one_at_a_time_and_the_latest_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_files, "Child", Maker)
    Maker.made = []

    async def main() -> None:
        own = Heads()
        names = ["woman", "woman", "man", "child", "older", "older"]
        assert await asyncio.gather(*map(own.packed, names)) == [name.encode() for name in names]
        assert Maker.made == ["woman", "man", "child", "older"]
        assert (Maker.most, Maker.now) == (1, 0)
        endless = asyncio.create_task(own.packed("endless"))
        await asyncio.sleep(0)
        own.close()
        with pytest.raises(ResourceError, match="head: its process has ended"):
            await endless
        assert Maker.now == 0

    asyncio.run(main())


def test_the_process_makes_the_same_head_as_this_one() -> None:
    assert gzip.decompress(asyncio.run(Heads().packed("default"))) == head_binary(load_head("default"))
