"""``fapengine serve --listen-audio``: what this machine's microphone hears moves a face."""

import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fapengine.ears.protocol import RATE_HZ
from fapengine.files.sound import save_wav
from tests.live.stage import Ear, Serve, wait
from tests.processes import start
from tests.unit.ears.speech import BABY, FAPU_MM, spoken

PLAY = "import sounddevice, sys, wave; w = wave.open(sys.argv[1]); import numpy; \
sounddevice.play(numpy.frombuffer(w.readframes(w.getnframes()), 'i2'), w.getframerate(), blocking=True)"


def test_what_the_microphone_hears_moves_a_face(null_sink: Mapping[str, str], tmp_path: Path) -> None:
    """The sink's monitor is PulseAudio's only source, so it is the microphone."""
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear, 0, "--listen-audio", "default", environment=null_sink)
    assert server.where["listens"].startswith("face: ")
    path = tmp_path / "baby.wav"
    save_wav(path, np.concatenate([np.zeros(RATE_HZ, np.int16), spoken("rms", BABY).samples]), RATE_HZ)

    def opening() -> np.ndarray:
        ear.listen()
        values = np.array([frame.values for frame in ear.frames.get("face", [])]).reshape(-1, 68)
        return -(values[:, 3] + values[:, 4]) * FAPU_MM

    wait(lambda: len(opening()) > 60)
    time.sleep(1.0)  # the ear starts
    assert np.abs(opening()).max() < 0.5  # nobody speaks
    with start([sys.executable, "-c", PLAY, str(path)], env=null_sink, stderr=subprocess.DEVNULL) as playing:
        wait(lambda: opening().max() > 5)
        assert playing.wait(20) == 0
    wait(lambda: bool(np.abs(opening()[-20:]).max() < 0.5))
    mouth = opening()
    spoke = mouth[np.flatnonzero(mouth > 1)[0] :]
    shut = np.flatnonzero((spoke[1:-1] < 0.5) & (spoke[:-2] >= 0.5))
    assert len(shut) >= 4  # of the eight p b m of the sentence
    assert server.end(15) == 0
    ear.close()


def test_a_microphone_that_is_not_there_is_told() -> None:
    command = [sys.executable, "-m", "fapengine", "serve", "--no-page", "--port", "0", "--listen-audio", "no such one"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 3
    assert "microphone: " in done.stderr
    assert "Traceback" not in done.stderr
