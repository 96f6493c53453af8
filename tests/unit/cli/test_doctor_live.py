"""``fapengine doctor``: each part where it works, and where it does not."""

import os
import re
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from fapengine.audio import device
from fapengine.cli import _doctor_live as doctor
from fapengine.cli._doctor_live import LackError
from fapengine.cli.doctor import Finding, _print_table
from fapengine.errors import ResourceError

NULL_DEVICE = "</usr/share/alsa/alsa.conf>\npcm.!default { type null }\n"


def looked_at(part: str, environment: Mapping[str, str]) -> tuple[bool, str]:
    """Look at a part in a process of its own: whether it works, and what was found."""
    code = (
        "import sys\nfrom fapengine.cli import _doctor_live as doctor\n"
        f"try:\n    print(doctor.{part}())\n"
        "except doctor.LackError as lack:\n    print(*lack.args, sep='; ')\n    sys.exit(9)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode in (0, 9), done.stderr
    return done.returncode == 0, done.stdout


def test_a_display_and_a_sound_card_work(null_sink: Mapping[str, str], virtual_display: str) -> None:
    works, found = looked_at("window", {**null_sink, "DISPLAY": virtual_display})
    assert works
    assert " on " in found
    works, found = looked_at("sound", null_sink)
    assert works
    assert "ms of latency, followed; devices: " in found


def test_an_ear_and_a_microphone_are_found(null_sink: Mapping[str, str]) -> None:
    works, found = looked_at("recognizer", null_sink)
    assert works or ": too slow for live audio" in found  # of a machine that has too much to do
    assert re.match(r"both, [0-9.]+ x real time, ready in [0-9.]+ s[\n:]", found)
    works, found = looked_at("microphone", null_sink)  # the sink's monitor
    assert works
    assert "(default)" in found


def test_without_an_input_there_is_no_microphone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "devices", lambda direction: [])
    with pytest.raises(LackError, match="no input device"):
        doctor.microphone()


def test_no_display_and_a_device_that_keeps_no_time(tmp_path: Path) -> None:
    (tmp_path / "alsa.conf").write_text(NULL_DEVICE)
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    works, found = looked_at("window", bare)
    assert not works
    assert "xvfb-run" in found
    works, found = looked_at("sound", {**bare, "ALSA_CONFIG_PATH": str(tmp_path / "alsa.conf")})
    assert not works
    assert "plays faster than real time" in found


def test_a_port_is_free_or_taken() -> None:
    for kind, name in ((socket.SOCK_DGRAM, "UDP"), (socket.SOCK_STREAM, "TCP")):
        with socket.socket(socket.AF_INET, kind) as mine:
            mine.bind(("127.0.0.1", 0))
            if kind == socket.SOCK_STREAM:
                mine.listen()
            port = mine.getsockname()[1]
            with pytest.raises(LackError) as lack:
                doctor.port_in(port)
            assert lack.value.args[0].startswith(f"{name} port is in use")
            assert str(port) in lack.value.args[1]
            if kind == socket.SOCK_DGRAM:
                assert doctor.port_out(port).startswith("a program is receiving")
        assert doctor.port_in(port) == "free"
        assert doctor.port_out(port).startswith("no program is receiving")


def test_an_extra_that_is_not_there() -> None:
    assert doctor.extra("numpy", "json").startswith("numpy ")
    with pytest.raises(ImportError):
        doctor.extra("no_such_module")


class Device:
    name = "Card"


def test_no_device_and_one_that_does_not_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "devices", list)
    with pytest.raises(LackError) as lack:
        doctor.sound()
    assert lack.value.args[0] == "PortAudio works, but has no output device"

    def refuse(rate_hz: int) -> None:
        raise ResourceError("sound: Device unavailable")

    monkeypatch.setattr(device, "devices", lambda: [Device()] * 5)
    monkeypatch.setattr(device, "Player", refuse)
    with pytest.raises(LackError) as lack:
        doctor.sound()
    assert lack.value.args[0] == "Card, Card, Card and 2 more; sound: Device unavailable"


def test_a_device_that_opens_and_does_not_play(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stuck:
        description = "Card, 22050 Hz"
        clock = device.PlaybackClock(22_050)

        def __init__(self, rate_hz: int) -> None:
            pass

        def __enter__(self) -> "Stuck":
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def is_settled(self, now_s: float) -> bool:
            return False

    monkeypatch.setattr(device, "devices", lambda: [Device()])
    monkeypatch.setattr(device, "Player", Stuck)
    monkeypatch.setattr(doctor, "SETTLE_S", 0.05)
    with pytest.raises(LackError) as lack:
        doctor.sound()
    assert lack.value.args[0] == "Card, 22050 Hz: opens, but does not play"


def test_only_what_drawing_needs_is_marked_as_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    _print_table([
        Finding("renderer", False, "no EGL", "install it"),
        Finding("virtual camera", False, "no module", "pip install"),
        Finding("video", True, "PyAV"),
    ])  # fmt: skip
    lines = capsys.readouterr().out.splitlines()
    assert [line[0] for line in lines if line.strip() and line[0] != " "] == ["✗", "–", "✓", "–"]
    assert "→ pip install" in lines[3]
