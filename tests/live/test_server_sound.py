"""``fapengine serve --play``: the server's voice is heard where the server runs, and the face moves with it."""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.live import sound_ear
from tests.live.stage import JAW, Ear, Sender, Serve, wait
from tests.patient import TRIES
from tests.processes import start

LOUD = 300.0
"""Of 32,768; silence is 0 at a null sink."""
QUIET = 50
"""Pieces of sound, 1 s, that are all quiet only when nobody speaks."""
TEXT = 200 * "Papa, papa, papa. "
"""It lasts 397 s, longer than ``wait`` does: who is quiet before was stopped."""


@dataclass
class Heard:
    """A server that plays, who is shown its face, and who hears its sound card."""

    server: Serve
    ear: Ear
    sender: Sender
    file: Path

    def sound(self) -> list[tuple[float, float]]:
        """When each piece of 20 ms was heard, s, and its loudness."""
        lines = self.file.read_text().splitlines(keepends=True)
        return [(float(at), float(loud)) for at, loud in (line.split() for line in lines if line.endswith("\n"))]

    def loud_s(self, begun: int) -> list[float]:
        """When something was heard, of all pieces but so many."""
        return [at for at, loud in self.sound()[begun:] if loud > LOUD]

    def say(self) -> int:
        """Let the face speak until it is heard and seen; return how many pieces of sound came before."""
        begun = len(self.sound())
        self.ear.frames.clear()
        self.sender.tell("/tts/text", "s", TEXT)
        wait(lambda: max(self.ear.jaw("face"), default=0) > 50 and len(self.loud_s(begun)) > 0)
        return begun

    def stop(self) -> None:
        """Stop it; return when nothing is heard and the mouth is shut."""
        self.sender.tell("/tts/stop")
        wait(lambda: self.ear.jaw("face")[-1] == 0 and all(loud < LOUD for _, loud in self.sound()[-QUIET:]))


@pytest.fixture
def heard(null_sink: Mapping[str, str], tmp_path: Path) -> Iterator[Heard]:
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear, 0, "--play", "face", environment=null_sink)
    with (tmp_path / "heard").open("w") as file:
        listening = start([sys.executable, sound_ear.__file__], env=null_sink, stdout=file)
        try:
            yield Heard(server, ear, Sender(server.address), tmp_path / "heard")
        finally:
            listening.kill()
            listening.wait()


def test_a_text_is_heard_and_seen_and_stops_when_it_is_told_to(heard: Heard) -> None:
    assert heard.server.where["sound"].startswith("face: ")
    wait(lambda: len(heard.sound()) > 10)
    assert max(loud for _, loud in heard.sound()) < LOUD
    heard.say()
    heard.stop()
    assert "trouble" not in heard.server.log.read_text()


@pytest.mark.nightly
def test_the_mouth_opens_with_the_voice(heard: Heard) -> None:
    """Each by its own clock: on a machine with nothing else to do, once is enough."""
    wait(lambda: len(heard.sound()) > 10)
    for _ in range(TRIES):
        onset_s = heard.loud_s(heard.say())[0]
        opened_s = next(frame.time_us * 1e-6 for frame in heard.ear.frames["face"] if frame.values[JAW] > 50)
        heard.stop()
        if abs(opened_s - onset_s) < 0.5:
            return
    pytest.fail(f"the mouth opened at {opened_s}, the voice began at {onset_s}")
