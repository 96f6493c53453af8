"""``fapengine serve --sound``: the server's voice is heard where the server runs, and the face moves with it."""

import sys
import time
from collections.abc import Mapping
from pathlib import Path

from tests.live import sound_ear
from tests.live.stage import Ear, Sender, Serve, wait
from tests.processes import start

LOUD = 300.0
"""Of 32,768; silence is 0 at a null sink."""


def test_a_text_is_heard_and_seen_and_stops_when_it_is_told_to(null_sink: Mapping[str, str], tmp_path: Path) -> None:
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear, 0, "--sound", "face", environment=null_sink)
    assert server.where["sound"].startswith("face: ")
    heard = tmp_path / "heard"
    with heard.open("w") as file:
        listening = start([sys.executable, sound_ear.__file__], env=null_sink, stdout=file)
        try:
            _use(ear, server, heard)
        finally:
            listening.kill()
            listening.wait()
    assert "trouble" not in server.log.read_text()
    ear.close()


def _use(ear: Ear, server: Serve, heard: Path) -> None:
    def sound() -> list[tuple[float, float]]:
        lines = heard.read_text().splitlines(keepends=True)
        return [(float(at), float(loud)) for at, loud in (line.split() for line in lines if line.endswith("\n"))]

    wait(lambda: len(sound()) > 10)
    assert max(loud for _, loud in sound()) < LOUD
    sender = Sender(server.address)
    sender.tell("/tts/text", "s", "Papa, papa, papa, papa, papa, papa, papa, papa, papa.")
    opened: list[float] = []

    def look() -> None:
        if not opened and max(ear.jaw("face")[-1:], default=0) > 50:
            opened.append(time.monotonic())

    wait(lambda: bool(opened) and any(loud > LOUD for _, loud in sound()), work=look)
    onset_s = next(at for at, loud in sound() if loud > LOUD)
    assert abs(opened[0] - onset_s) < 0.3  # the mouth opens with the voice
    time.sleep(0.5)
    sender.tell("/tts/stop")
    told_s = time.monotonic()
    wait(lambda: ear.jaw("face")[-1] == 0)
    wait(lambda: sound()[-1][0] > told_s + 0.6)
    assert max(loud for at, loud in sound() if at > told_s + 0.4) < LOUD
    assert any(loud > LOUD for at, loud in sound() if told_s - 0.4 < at < told_s)
    sender.close()
