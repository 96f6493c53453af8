"""``fapengine view`` and ``say --live`` as somebody at a desk meets them: a display, a sound card, a process."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from fapengine.app import view
from fapengine.app.view import Source
from fapengine.cli.main import app
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.motion import save_fap
from fapengine.files.pictures import load_picture
from fapengine.files.sound import save_wav
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import RenderOptions
from fapengine.render.live import Quality


def run(environment: Mapping[str, str], display: str, *arguments: object) -> dict[str, float]:
    command = [sys.executable, "-m", "fapengine", *map(str, arguments), "--json"]
    done = subprocess.run(
        command, env={**environment, "DISPLAY": display}, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return json.loads(done.stdout)


def test_a_window_opens_speaks_and_closes(
    null_sink: Mapping[str, str], virtual_display: str, coarse_head: Path, tmp_path: Path
) -> None:
    """All that is real: display, sound card, voice, process."""
    shot = tmp_path / "shot.png"
    answer = run(
        null_sink, virtual_display, "view", "--say", "Mama.", "--duration", "1.5", "--screenshot", shot,
        "--size", "560x300", "--fps", "30", "--head", coarse_head,
    )  # fmt: skip
    assert answer["frames"] > 0
    picture = load_picture(shot)
    assert picture.shape == (300, 560, 3)
    assert np.ptp(picture[:, :300], axis=(0, 1)).min() > 100  # a face, not a wall


class FakeWindow:
    """A window of which only the calls are seen."""

    made: "list[FakeWindow]"
    keys: tuple[str, ...] = ()
    """Keys that are pressed at the third frame."""

    def __init__(self, mesh: object, drawing: RenderOptions, **options: object) -> None:
        self.options = options
        self.shown: list[np.ndarray] = []
        self.closes_after = 10**9
        self.is_closed = False
        self.busy_s, self.rate_hz, self.name = 0.004, 50.0, ""
        self.quality = Quality(scale=0.7)
        self.made.append(self)

    def __enter__(self) -> "FakeWindow":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        return len(self.shown) < self.closes_after

    def show(self, faps: np.ndarray) -> list[str]:
        self.shown.append(faps.copy())
        return list(self.keys) if len(self.shown) == 3 else []

    def title(self, text: str) -> None:
        self.name = text

    def picture(self) -> np.ndarray:
        return np.zeros((4, 4, 3), np.uint8)

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> list[FakeWindow]:
    FakeWindow.made = []
    for place in ("fapengine.app.view", "fapengine.app.say_live"):
        monkeypatch.setattr(f"{place}.FaceWindow", FakeWindow)
    monkeypatch.setattr("fapengine.files.heads.load.load_levels", lambda name: (None, []))
    monkeypatch.setattr("fapengine.app.say_live.load_levels", lambda name: (None, []))
    return FakeWindow.made


def test_a_file_with_its_sound_is_shown_and_paused(
    windows: list[FakeWindow], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(FakeWindow, "keys", (" ", "x"))
    monkeypatch.setattr("fapengine.app.view.STATUS_S", 0.0)
    save_fap(tmp_path / "a.fap", FapTrack.from_values(np.zeros((30, 68), int), rate_hz=30.0))
    save_wav(tmp_path / "a.wav", np.zeros(8000, np.int16), 8000)
    call(
        "view",
        tmp_path / "a.fap",
        "--audio",
        tmp_path / "a.wav",
        "--silent",
        "--duration",
        "0.3",
        "--screenshot",
        tmp_path / "s.png",
    )
    (window,) = windows
    assert window.is_closed
    title, status, pace = window.name.split(" – ")
    assert title == "fapengine, a.fap"
    assert status.endswith("of 1.00 s, 30 Hz, paused")
    assert pace == "50 fps, 4.0 ms a frame at 70 %"
    assert window.options["hold_hz"] == 60.0
    assert (tmp_path / "s.png").exists()
    assert 5 < len(window.shown) < 40


def test_a_window_s_time_begins_with_its_first_image_however_long_that_takes(
    windows: list[FakeWindow], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In virtual time: an image takes 4 ms, the first 60 s."""
    now_s = [1000.0]

    class Ticking:
        frames, skipped = 0, 0

        def __init__(self, rate_hz: float) -> None: ...

        def wait(self) -> None:
            self.frames += 1

    class Still(Source):
        title = "still"

        def frame(self, display_latency_s: float) -> np.ndarray:
            now_s[0] += 0.004 if windows[0].shown else 60.0
            return np.zeros(68, np.int32)

        def status(self) -> str:
            return ""

        def close(self) -> None: ...

    monkeypatch.setattr(view, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(view, "Ticks", Ticking)
    told = view.run_window(None, [], Still, RenderOptions(), seconds=2.0)  # type: ignore[arg-type]
    assert told["seconds"] == pytest.approx(2.0, abs=0.01)
    assert told["frames"] == len(windows[0].shown) - 1 == pytest.approx(500, abs=1)


def test_our_own_face_speaks_in_a_window(windows: list[FakeWindow]) -> None:
    call("view", "--say", "Papa.", "--silent", "--duration", "1.2", "--without", "all")
    assert not windows[0].shown[0].any()
    assert any(faps.any() for faps in windows[0].shown)
    call("say", "Papa.", "--live", "--window", "--silent", "--fps", "60", "--without", "all")
    opened = [-(faps[fap.column(51)] + faps[fap.column(52)]) for faps in windows[1].shown]
    assert max(opened) > 80
    assert abs(opened[-1]) < 5
    assert windows[1].is_closed


def test_a_window_that_is_closed_ends_the_speech(windows: list[FakeWindow], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeWindow, "is_open", property(lambda self: len(self.shown) < 5))
    call("say", "This is a long sentence that nobody hears to its end.", "--live", "--window", "--silent")
    assert len(windows[0].shown) == 5


def test_frames_of_a_port_are_shown(windows: list[FakeWindow]) -> None:
    call("view", "osc://127.0.0.1:0", "--duration", "0.2")
    assert windows[0].name.startswith("fapengine, port ")


def test_a_server_that_is_not_there_is_told_of(windows: list[FakeWindow], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeWindow, "is_open", property(lambda window: "no server: no answer" not in window.name))
    with pytest.raises(ResourceError, match=r"^server: no answer from 127.0.0.1:9: is fapengine serve running there"):
        call("view", "http://127.0.0.1:9/", "--duration", "60")
    assert "no server: no answer" in windows[0].name
    assert windows[0].is_closed


def call(*arguments: object) -> None:
    result = CliRunner().invoke(app, [*map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--audio", "a.wav"), "--audio: got a.wav, expected a file of FAPs before it"),
        (("http://127.0.0.1:1/", "--audio", "a.wav"), "--audio: got"),
        (("--size", "big"), "--size: got 'big'"),
        (("--camera", "behind"), "--camera: got 'behind'"),
    ],
)
def test_refuses(arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        call("view", *arguments)


def test_refuses_what_is_no_source(tmp_path: Path) -> None:
    from fapengine.app.view import open_file, open_url

    for url, message in (
        ("osc://127.0.0.1", "expected osc://HOST:PORT"),
        ("osc://127.0.0.1:x", "expected osc://HOST:PORT"),
    ):
        with pytest.raises(UsageError, match=message):
            open_url(url, silent=True)
    save_fap(tmp_path / "none.fap", FapTrack.from_values(np.zeros((0, 68), int), rate_hz=30.0))
    with pytest.raises(DataError, match="no frame"):
        open_file(tmp_path / "none.fap", silent=True)


@pytest.mark.parametrize("source", [(), ("http://127.0.0.1:9/",), ("a.fap", "--audio", "a.wav")])
def test_a_wrong_device_is_told_of_before_a_window_opens(windows: list[FakeWindow], source: tuple[str, ...]) -> None:
    with pytest.raises(ResourceError, match="sound: "):
        call("view", *source, "--audio-device", "no such card", "--duration", "0.5")
    assert not windows


def test_a_stream_is_no_sink_of_a_single_face() -> None:
    with pytest.raises(UsageError, match=r"--sink: got 'fba\+tcp://127.0.0.1:1', expected one that sends datagrams"):
        call("say", "Hi.", "--live", "--no-window", "--silent", "--sink", "fba+tcp://127.0.0.1:1")


def test_a_window_that_is_wished_for_must_open(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise ResourceError("window: no display")

    monkeypatch.setattr("fapengine.app.say_live.FaceWindow", refuse)
    with pytest.raises(ResourceError, match="no display"):
        call("say", "Hi.", "--live", "--window", "--silent")


def test_ctrl_c_ends_the_speech_with_a_mouth_that_is_shut(
    windows: list[FakeWindow], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted(FakeWindow):
        def show(self, faps: np.ndarray) -> list[str]:
            super().show(faps)
            if len(self.shown) == 40:
                raise KeyboardInterrupt
            return []

    monkeypatch.setattr("fapengine.app.say_live.FaceWindow", Interrupted)
    text = "This is a sentence that is interrupted in its midst by somebody."
    call("say", text, "--live", "--window", "--silent", "--without", "all")
    opened = [-(faps[fap.column(51)] + faps[fap.column(52)]) for faps in windows[0].shown]
    assert max(opened) > 80
    assert abs(opened[-1]) < 5
    assert len(opened) < 80
