"""``fapengine score talk.mp4``: what a face detector sees in a film of our own head is what its FAPs say."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import fapengine
from fapengine.cli.main import app
from fapengine.errors import DataError, ResourceError
from fapengine.files.landmarks import VARIABLE, detector_python, landmarks_of
from fapengine.files.sound import save_wav
from fapengine.speech.formats.writing import WRITERS
from tests.unit.recognition.speech import BABY


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    made = fapengine.speak(BABY, rate_hz=25.0)
    made.save(folder / "talk.mp4", size=(256, 256))
    fapengine.save(made.track, folder / "talk.fap")
    (folder / "talk.TextGrid").write_bytes(WRITERS[".textgrid"](made.phones))
    return folder / "talk.mp4"


def scored(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, dict[str, dict[str, float]]]:
    app(["score", *map(str, words), "--json"], standalone_mode=False)
    found: dict[str, dict[str, dict[str, float]]] = json.loads(capsys.readouterr().out)
    return found


def test_a_film_is_scored_as_its_faps_are(film: Path, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        detector_python()
    except ResourceError:
        pytest.skip("face detector absent; make detector")
    truth, phones = film.with_suffix(".fap"), film.with_suffix(".TextGrid")
    found = scored(capsys, film, "--reference", truth, "--phones", phones)
    likeness = found["truth"]["likeness"]
    assert likeness["opening_r"] > 0.85
    assert 0.8 < likeness["opening_slope"] < 1.25
    assert likeness["width_r"] > 0.7
    assert abs(found["truth"]["timing"]["lag_ms"]) < 25
    assert found["phones"]["closures"]["recall"] >= 0.9
    assert found["behaviour"]["blinks"] == scored(capsys, truth)["behaviour"]["blinks"]
    assert found["intensity"]["windows"] > 0  # its own sound


def test_a_film_without_a_face_is_told(tmp_path: Path) -> None:
    try:
        detector_python()
    except ResourceError:
        pytest.skip("face detector absent; make detector")
    from fapengine.files.moving import write_moving

    grey = [np.full((64, 64, 3), 90 + n, np.uint8) for n in range(30)]
    write_moving(tmp_path / "grey.mp4", grey, rate_hz=25.0)
    with pytest.raises(DataError, match=r"grey\.mp4: video: only 0 of 30 frames show a face"):
        app(["score", str(tmp_path / "grey.mp4")], standalone_mode=False)


def test_without_a_detector_one_line_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(ResourceError, match=r"face detector: not found at .*nowhere. Install it with: make detector"):
        landmarks_of(tmp_path / "talk.mp4")


def test_a_python_without_mediapipe_and_a_file_without_pictures_are_told(
    film: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, sys.executable)
    with pytest.raises(ResourceError, match="has ended; does it have mediapipe"):
        landmarks_of(film)
    save_wav(tmp_path / "talk.wav", np.zeros(999, np.int16), 16_000)
    with pytest.raises(DataError, match="cannot be decoded as video"):
        landmarks_of(tmp_path / "talk.wav")
    (tmp_path / "bad.mp4").write_bytes(b"nothing")
    with pytest.raises(DataError, match="cannot be decoded as video"):
        landmarks_of(tmp_path / "bad.mp4")
