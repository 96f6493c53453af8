"""``fapengine serve --mic`` and ``say --live --mic``: what this machine's microphone hears moves a face."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from fapengine.files.sound import save_wav
from fapengine.recognition.protocol import RATE_HZ
from tests.live.stage import Ear, Serve, wait
from tests.processes import start
from tests.unit.recognition.speech import BABY, FAPU_MM, spoken

PLAY = "import sounddevice, sys, wave; w = wave.open(sys.argv[1]); import numpy; \
sounddevice.play(numpy.frombuffer(w.readframes(w.getnframes()), 'i2'), w.getframerate(), blocking=True, loop=True)"


@contextmanager
def playing(path: Path, environment: Mapping[str, str]) -> Iterator[None]:
    """Play a sound over and over: a busy machine may not hear all of it at once."""
    with start([sys.executable, "-c", PLAY, str(path)], env=environment, stderr=subprocess.DEVNULL) as player:
        try:
            yield
            assert player.poll() is None
        finally:
            player.kill()


def test_what_the_microphone_hears_moves_a_face(null_sink: Mapping[str, str], tmp_path: Path) -> None:
    """The sink's monitor is PulseAudio's only source, so it is the microphone."""
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear, 0, "--mic", "default", environment=null_sink)
    assert server.where["listens"].startswith("face: ")
    path = tmp_path / "baby.wav"
    save_wav(path, np.concatenate([np.zeros(RATE_HZ, np.int16), spoken("rms", BABY).samples]), RATE_HZ)

    open_mm: list[float] = []

    def opening() -> np.ndarray:
        ear.listen()
        more = ear.frames.get("face", [])[len(open_mm) :]
        open_mm.extend(-(frame.values[3] + frame.values[4]) * FAPU_MM for frame in more)
        return np.array(open_mm)

    wait(lambda: len(opening()) > 120)  # the recognizer has started
    assert np.abs(opening()).max() < 0.5  # nobody speaks

    def shut() -> int:
        mouth = opening()
        return int(((mouth[1:-1] < 0.5) & (mouth[:-2] >= 0.5)).sum())

    with playing(path, null_sink):
        wait(lambda: opening().max() > 2 and shut() >= 4, 300.0)  # of the eight p b m of the sentence
    wait(lambda: bool(np.abs(opening()[-20:]).max() < 0.5))
    assert server.end(signal.SIGTERM) == 0
    ear.close()


def test_you_say_it(null_sink: Mapping[str, str], tmp_path: Path) -> None:
    ear = Ear.open()
    path = tmp_path / "baby.wav"
    save_wav(path, spoken("rms", BABY).samples, RATE_HZ)
    command = [sys.executable, "-m", "fapengine", "say", "--live", "--mic", "--no-window", "--json"]
    command += ["--sink", f"osc://127.0.0.1:{ear.port}", "--without", "all", "--articulation", "1.2"]
    with start(command, env=null_sink, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as face:
        wait(lambda: len(ear.jaw("face")) > 60)
        with playing(path, null_sink):
            wait(lambda: max(ear.jaw("face")) > 20, 300.0)
        wait(lambda: not any(ear.jaw("face")[-20:]))
        face.send_signal(signal.SIGINT)
        out, err = face.communicate(timeout=300)
    assert face.returncode == 0, err.decode()
    told = json.loads(out)
    assert told["heard_s"] > 0
    assert told["phones"] > 0
    assert told["frames"] > 0
    values = np.array([frame.values for frame in ear.frames["face"]])
    assert values.shape[1] == 68
    ear.close()


@pytest.mark.parametrize(
    "words",
    [
        ["serve", "--no-page", "--port", "0", "--mic", "no such one"],
        ["say", "--live", "--mic-device", "no such one", "--no-window"],
    ],
)
def test_a_microphone_that_is_not_there_is_told(words: list[str]) -> None:
    command = [sys.executable, "-m", "fapengine", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 3
    assert "microphone: " in done.stderr
    assert "Traceback" not in done.stderr
