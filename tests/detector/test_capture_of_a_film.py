"""``fapengine capture talk.mp4``: a film of our own head comes back as the FAPs that moved it."""

import json
from pathlib import Path

import numpy as np
import pytest

import fapengine
from fapengine.cli.main import app
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.landmarks import detector_python
from fapengine.files.video import inspect_film
from fapengine.mpeg4 import fap
from fapengine.mpeg4.codable import to_codable
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack

RATE_HZ = 25.0
TEXT = "Bright sunshine shimmers on the ocean, and my baby moves a big yellow boat. We were away a year ago."
WAVES = {49: (8, 1.3), 48: (4, 0.9), 50: (4, 0.7), 23: (14, 2.1), 24: (14, 2.1), 25: (7, 1.1), 26: (7, 1.1)}
"""Turns of the head and the eyes: FAP to degrees and rad/s."""
SMILE_S = (2.0, 4.0)


@pytest.fixture(scope="module")
def truth() -> FapTrack:
    """Speech with blinks and a smile, a head that turns and eyes that wander."""
    smile = fapengine.Mood(fapengine.Expression.JOY, 0.45, *SMILE_S)
    values = fapengine.speak(TEXT, rate_hz=RATE_HZ, expressions=[smile]).track.values.astype(float)
    time = np.arange(len(values)) / RATE_HZ
    for number, (degrees, speed) in WAVES.items():
        values[:, fap.column(number)] = np.deg2rad(degrees) * np.sin(speed * time) / AU_RAD
    return FapTrack.of(to_codable(values), rate_hz=RATE_HZ)


@pytest.fixture(scope="module")
def film(truth: FapTrack, tmp_path_factory: pytest.TempPathFactory) -> Path:
    try:
        detector_python()
    except ResourceError:
        pytest.skip("face detector absent; make detector")
    path = tmp_path_factory.mktemp("film") / "talk.mp4"
    return fapengine.save(truth, path, size=(384, 384))


def test_a_film_of_our_head_comes_back(film: Path, truth: FapTrack, capsys: pytest.CaptureFixture[str]) -> None:
    output, beside = film.with_suffix(".fap"), film.with_name("beside.mp4")
    app(["capture", str(film), "-o", str(output), "--overlay", str(beside), "--json"], standalone_mode=False)
    facts = json.loads(capsys.readouterr().out)
    assert facts["seen"] == 1.0
    assert facts["rate_hz"] == RATE_HZ
    found = fapengine.load(output).values.astype(float)
    wanted = truth.values.astype(float)
    assert len(found) == len(wanted)

    def alike(numbers: dict[int, int], frames: np.ndarray | slice = slice(None)) -> float:
        one, other = (
            sum(sign * values[frames, fap.column(number)] for number, sign in numbers.items())
            for values in (found, wanted)
        )
        return float(np.corrcoef(one, other)[0, 1])

    time = np.arange(len(wanted)) / RATE_HZ
    plain = (time < SMILE_S[0]) | (time > SMILE_S[1] + 0.2)  # our smile lifts the cheeks into the lids: no FAP's work
    assert alike({4: -1, 5: -1}) >= 0.95  # 0.982: opening of the inner lips
    assert alike({53: 1, 54: 1}) >= 0.9  # 0.969: width
    assert alike({19: 1, 20: 1}, plain) >= 0.95  # 0.968: lids
    for number in (23, 24, 25, 26):
        assert alike({number: 1}) >= 0.8  # 0.99, 0.94, 0.84, 0.82: gaze
    for number in (48, 49, 50):
        off = np.rad2deg((found - wanted)[:, fap.column(number)] * AU_RAD)
        assert np.sqrt((off**2).mean()) < 2  # 1.3, 0.7, 0.3 degrees
    info = inspect_film(beside)
    assert info is not None
    assert (info.width, info.height) == (384 + 480, 480)


def test_a_film_becomes_a_take(film: Path) -> None:
    take = film.with_suffix(".npz")
    app(["capture", str(film), "-o", str(take)], standalone_mode=False)
    from fapengine.files.recordings import load_markers

    markers = load_markers(take).markers
    assert {"8.1", "8.2", "8.3", "8.4", "2.2", "2.3", "2.1"} <= set(markers.labels)
    assert 50 < np.linalg.norm(np.ptp(markers.positions_mm[0], axis=0)) < 300


def test_what_cannot_be_captured_is_told(tmp_path: Path) -> None:
    def refused(kind: type[Exception], message: str, *words: object) -> None:
        with pytest.raises(kind, match=message):
            app(["capture", *map(str, words)], standalone_mode=False)

    out = tmp_path / "out.fap"
    (tmp_path / "marks.json").write_text(json.dumps([[[0.5, 0.5, 0.0]] * 478]))
    refused(DataError, "need the size of their pictures", tmp_path / "marks.json", "-o", out)
    refused(UsageError, "expected both", tmp_path / "marks.json", "--size", "640x480", "-o", out)
    (tmp_path / "notes.txt").write_text("hello")
    refused(UsageError, "got ending '.txt'", tmp_path / "notes.txt", "-o", out)
    refused(UsageError, "expected webcam, or webcam:1", "webcam:front", "-o", out)
    refused(UsageError, "expected a film", "webcam", "-o", out, "--overlay", tmp_path / "beside.mp4")
