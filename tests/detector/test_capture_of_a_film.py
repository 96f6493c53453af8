"""``fapengine capture talk.mp4``: a film of our own head comes back as the FAPs that moved it."""

import asyncio
import json
import threading
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest

import fapengine
from fapengine.app import watch_live as watching
from fapengine.app.watch_live import watch_live
from fapengine.cli.main import app
from fapengine.clients.websocket_viewer import WebSocketViewer
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.landmarks import Detector, detector_python
from fapengine.files.video import inspect_film
from fapengine.host.host import Host
from fapengine.mesh.default_head.head import build_head
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack, to_codable
from tests.live.stage import Ear, config_of, running, until
from tests.patient import PatientClock

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
    return FapTrack.from_values(to_codable(values), rate_hz=RATE_HZ)


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


def test_what_cannot_be_captured_is_told(film: Path, tmp_path: Path) -> None:
    def refused(kind: type[Exception], message: str, *words: object) -> None:
        with pytest.raises(kind, match=message):
            app(["capture", *map(str, words)], standalone_mode=False)

    out = tmp_path / "out.fap"
    (tmp_path / "marks.json").write_text(json.dumps([[[0.5, 0.5, 0.0]] * 478]))
    refused(DataError, "need the size of their images", tmp_path / "marks.json", "-o", out)
    refused(UsageError, "size and rate are required", tmp_path / "marks.json", "--size", "640x480", "-o", out)
    (tmp_path / "notes.txt").write_text("hello")
    refused(UsageError, "got ending '.txt'", tmp_path / "notes.txt", "-o", out)
    refused(UsageError, "--output: missing", "webcam")
    refused(UsageError, "--overlay: cannot be used live", "webcam", "--window", "--overlay", out)
    refused(UsageError, "expected webcam or a video", tmp_path / "marks.json", "--sink", "vmc://127.0.0.1")
    refused(ResourceError, "no answer", film, "--to", "http://127.0.0.1:9/")
    refused(UsageError, "expected webcam, or webcam:1", "webcam:front", "-o", out)
    refused(UsageError, "expected a video", "webcam", "-o", out, "--overlay", tmp_path / "beside.mp4")


def heard_opening(ear: Ear, session: str) -> tuple[np.ndarray, np.ndarray]:
    """Times in s, and openings of the inner lips, of the frames that a receiver was sent."""
    ear.listen()
    frames = ear.frames[session]
    times_s = np.array([frame.time_us for frame in frames]) / 1e6
    return times_s, np.array([-frame.values[fap.column(4)] - frame.values[fap.column(5)] for frame in frames])


class HeldDetector(Detector):
    """A detector while which no time passes. Stateful."""

    clock: PatientClock

    def find(self, picture: np.ndarray) -> np.ndarray:
        try:
            return super().find(picture)
        finally:
            self.clock.free("picture")


class Screen:
    """Nothing is seen; when it is closed, time passes again. Stateful."""

    display_latency_s = 0.0

    def __init__(self, clock: PatientClock) -> None:
        self._clock = clock

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._clock.free(threading.current_thread())

    def show(self, faps: np.ndarray, position_s: float) -> bool:
        return True


def test_a_film_in_place_of_a_camera_moves_other_programs_and_a_session_now(
    film: Path, truth: FapTrack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Webcam in, avatars move: an OSC sink of our own, and the session of a server with a sink of its own.

    Time stands still while a picture is looked at or FAPs are on their way, and waits for every frame.
    """
    kept, clock = tmp_path / "kept.fap", PatientClock()
    monkeypatch.setattr(HeldDetector, "clock", clock, raising=False)
    monkeypatch.setattr(watching, "Detector", HeldDetector)
    send = WebSocketViewer.send

    def sent(link: WebSocketViewer, kind: str, **values: Any) -> None:
        if kind == "perform":
            clock.allow("link")
        send(link, kind, **values)

    monkeypatch.setattr(WebSocketViewer, "send", sent)

    def sleep(seconds: float) -> None:
        clock.sleep(seconds)
        if threading.current_thread().name == "fapengine-camera":  # the next picture is there
            clock.allow("picture")

    async def play(own: Ear, served: Ear) -> dict[str, object]:
        config = config_of(f"osc://127.0.0.1:{served.port}")
        config = replace(config, listen=replace(config.listen, web_port=0))
        async with running(config, build_head(), clock) as server:
            take = Host.perform

            def taken(host: Host, values: Mapping[int, int], now_s: float) -> None:
                take(host, values, now_s)
                if host.engine is server.hub.engine:
                    clock.free("link")

            monkeypatch.setattr(Host, "perform", taken)
            watch = partial(
                watch_live, str(film), lambda: Screen(clock), sinks=(f"osc://127.0.0.1:{own.port}",), output=kept,
                server=f"http://127.0.0.1:{server.sites[0][1]}/?session=anna", clock=clock, sleep=sleep,
            )  # fmt: skip
            done = await asyncio.to_thread(watch)
            clock.free("link")
            await until(lambda: abs(heard_opening(served, "anna")[1][-1]) <= 1)
            return done

    wanted = -truth.values[:, fap.column(4)] - truth.values[:, fap.column(5)].astype(float)
    length_s = len(wanted) / RATE_HZ
    with closing(Ear.open()) as own, closing(Ear.open()) as served:
        done = asyncio.run(play(own, served))
        heard = [heard_opening(own, "face"), heard_opening(served, "anna")]
    assert done["known"]
    assert done["seen"] == 1.0
    assert (done["pictures"], done["late"], done["skipped"]) == (len(wanted), 0, 0)
    assert length_s < done["seconds"]
    for times_s, opening in heard:

        def alike(start_s: float, times_s: np.ndarray = times_s, opening: np.ndarray = opening) -> float:
            at_s = times_s - start_s
            inside = (at_s > 2.5) & (at_s < length_s)  # before, the face at rest is not known
            there = np.interp(at_s[inside], np.arange(len(wanted)) / RATE_HZ, wanted)
            moves = inside.sum() > 20 and np.ptp(opening[inside]) > 0
            return float(np.corrcoef(opening[inside], there)[0, 1]) if moves else 0.0

        starts_s = np.arange(times_s[0], times_s[-1] - length_s + 0.1, 0.02)  # the detector takes a while to begin
        assert max(alike(start_s) for start_s in starts_s) >= 0.75  # 0.84 to 0.94, by how frames and pictures fall
        assert abs(opening[-1]) <= 1  # it eased to rest
    assert len(fapengine.load(kept)) == done["frames"] + done["skipped"]
