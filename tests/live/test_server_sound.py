"""``fapengine serve --play``: the server's voice is heard where the server runs, and the face moves with it."""

import sys
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.live import sound_ear
from tests.live.stage import JAW, Ear, Sender, Serve, wait
from tests.patient import TRIES
from tests.processes import start

LOUD = 300.0
"""Of 32,768; silence is 0 at a null sink."""
QUIET_S = 0.6
TEXT, TEXT_S = 8 * "Papa, papa, papa. ", 15.9


def test_a_text_is_heard_and_seen_and_stops_when_it_is_told_to(null_sink: Mapping[str, str], tmp_path: Path) -> None:
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear, 0, "--play", "face", environment=null_sink)
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
    for _ in range(TRIES):
        begun_s = sound()[-1][0]
        ear.frames.clear()
        sender.tell("/tts/text", "s", TEXT)
        wait(lambda: max(ear.jaw("face"), default=0) > 50 and len(_loud_s(sound(), begun_s)) > 0)  # noqa: B023
        onset_s = _loud_s(sound(), begun_s)[0]
        opened_s = next(frame.time_us * 1e-6 for frame in ear.frames["face"] if frame.values[JAW] > 50)
        sender.tell("/tts/stop")
        told_s = time.monotonic()
        wait(lambda: ear.jaw("face")[-1] == 0)
        wait(lambda: sound()[-1][0] > told_s + QUIET_S and all(loud < LOUD for _, loud in sound()[-10:]))  # noqa: B023
        assert _loud_s(sound(), begun_s)[-1] < onset_s + 0.8 * TEXT_S  # not all was said
        if abs(opened_s - onset_s) < 0.5:  # the mouth opens with the voice, each by its own clock
            break
    else:
        pytest.fail(f"the mouth opened at {opened_s}, the voice began at {onset_s}")
    sender.close()


def _loud_s(sound: list[tuple[float, float]], begun_s: float) -> list[float]:
    """When something was heard."""
    return [at for at, loud in sound if at > begun_s and loud > LOUD]
