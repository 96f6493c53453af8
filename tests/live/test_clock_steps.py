"""Clocks that step under a server that speaks: libfaketime, of Debian's package ``faketime``, moves them.

Both clocks go on an hour and a day, as after the sleep of a virtual machine; that of the wall goes back, too. A
monotonic clock never goes back: Linux promises it, and timers of asyncio rest on it.
"""

import os
import re
import signal
import sys
from pathlib import Path

import pytest

from fapengine.wire import osc
from tests.faults.processes import becomes
from tests.live.stage import Ear, Sender
from tests.processes import start

pytestmark = pytest.mark.nightly
LIBRARY = next((path for path in Path("/usr/lib").glob("*/faketime/libfaketime.so.1")), None)
OPEN = 40
"""FAP 3 of an open mouth."""
SOON = 9_000
"""Looks within which a server does what it should at once."""


def now_s(asker: Sender, number: int) -> float:
    """Ask a server for the time of its clock, which it has then seen."""
    answers: list[osc.Message] = []
    asker.tell("/fap/1/ping", "ih", number, 0)
    assert becomes(lambda: answers.extend(asker.answers()) or answers, SOON)
    assert answers[0].address == "/fap/1/pong"
    assert answers[0].arguments[0] == number
    return 1e-6 * float(answers[0].arguments[2])


@pytest.mark.skipif(LIBRARY is None, reason="libfaketime is not installed: apt-get install faketime")
@pytest.mark.parametrize(
    ("only_wall", "steps"), [(False, ("+3600s", "+90000s")), (True, ("-3600s", "+86400s", "+0"))], ids=("both", "wall")
)
def test_a_server_speaks_on_when_clocks_step(tmp_path: Path, only_wall: bool, steps: tuple[str, ...]) -> None:
    faked, log, ear = tmp_path / "faked", tmp_path / "log", Ear.open()
    faked.write_text("+0\n")
    names = {"LD_PRELOAD": str(LIBRARY), "FAKETIME_TIMESTAMP_FILE": str(faked), "FAKETIME_NO_CACHE": "1"}
    names |= {"FAKETIME_DONT_FAKE_MONOTONIC": "1", "DONT_FAKE_MONOTONIC": "1"} if only_wall else {}
    command = [sys.executable, "-m", "fapengine", "serve", "--log", "json", "--port", "0", "--web-port", "0"]
    command += ["--without", "all", "--sink", f"osc://127.0.0.1:{ear.port}"]
    with log.open("w") as out:
        server = start(command, stdout=out, stderr=out, env={**os.environ, **names})
    try:
        assert becomes(lambda: '"ready"' in log.read_text() or server.poll() is not None, SOON), log.read_text()
        found = re.search(r"127\.0\.0\.1:(\d+) \(UDP", log.read_text())
        assert found, log.read_text()
        sender, asker = Sender(("127.0.0.1", int(found[1]))), Sender(("127.0.0.1", int(found[1])))
        begun_s = now_s(asker, -1)
        sender.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
        for number, offset in enumerate(("+0", *steps)):
            new = tmp_path / "new"
            new.write_text(f"{offset}\n")
            new.replace(faked)
            stepped_s = now_s(asker, number) - begun_s
            assert only_wall or stepped_s >= int(offset[1:].removesuffix("s")), f"{offset}: {stepped_s:.0f} s"
            ear.listen()
            ear.frames.clear()
            sender.utter("anna", number, "mama")
            assert becomes(lambda: max(ear.jaw("anna"), default=0) > OPEN, SOON), f"{offset}: {log.read_text()}"
            assert becomes(lambda: ear.jaw("anna")[-1] == 0, SOON), f"{offset}: the mouth does not close again"
        sender.close()
        asker.close()
        server.send_signal(signal.SIGTERM)
        assert becomes(lambda: server.poll() is not None, SOON), "it does not end"
        assert server.returncode in (0, 128 + signal.SIGTERM), log.read_text()
        assert "error" not in {line.split('"level": "')[1].split('"')[0] for line in log.read_text().splitlines()}
    finally:
        server.kill()
        server.wait()
        ear.socket.close()
