"""The watchdog where a system cannot fork: a program of its own puts faces to rest as the forked one does."""

import os
import socket

import pytest

from fapengine.server.watchdog import start_watchdog


@pytest.mark.parametrize("is_good", [True, False])
def test_a_program_puts_open_faces_to_rest(is_good: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "fork")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        watchdog = start_watchdog([f"osc://127.0.0.1:{receiver.getsockname()[1]}"], 60.0)
        assert watchdog.child is not None
        watchdog.tell(("face",))
        watchdog.end(is_good=is_good)
        assert watchdog.child.process.returncode == 0
        receiver.setblocking(False)
        if is_good:
            with pytest.raises(BlockingIOError):
                receiver.recv(65536)
        else:
            assert b"/fap" in receiver.recv(65536)
