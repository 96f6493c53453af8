"""A sound card of software: PulseAudio's null sink, which plays to nobody, in real time."""

import os
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from fapengine.files.heads import HeadInfo, save_head
from fapengine.mesh.head import build_head

ALSA = "</usr/share/alsa/alsa.conf>\npcm.!default { type pulse }\nctl.!default { type pulse }\n"


@pytest.fixture(scope="session")
def null_sink(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mapping[str, str]]:
    """Environment of a process that plays there.

    ALSA's own null device will not do: it fetches sound 600 times faster than it would be heard, so no clock can be
    made of it. Without ``norewinds`` the sink may sleep for 2 s before the first buffer.
    """
    folder = tmp_path_factory.mktemp("pulse")
    (folder / "run").mkdir(mode=0o700)
    (folder / "alsa.conf").write_text(ALSA)
    environment = {
        **os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder / "run"),
        "PULSE_RUNTIME_PATH": str(folder / "run"), "PULSE_SERVER": f"unix:{folder / 'socket'}",
        "ALSA_CONFIG_PATH": str(folder / "alsa.conf"),
    }  # fmt: skip
    command = [
        "pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--disallow-exit", "--use-pid-file=no",
        "--log-level=error", "-L", f"module-native-protocol-unix socket={folder / 'socket'} auth-anonymous=1",
        "-L", "module-null-sink rate=48000 norewinds=1",
    ]  # fmt: skip
    with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as server:
        try:
            _wait_for(folder / "socket", server)
            yield environment
        finally:
            server.terminate()


def _wait_for(socket: Path, server: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + 10
    while not socket.exists():
        if server.poll() is not None or time.monotonic() > until:
            pytest.fail(f"pulseaudio does not start (code {server.poll()}); .ci/system-packages installs it")
        time.sleep(0.05)


@pytest.fixture(scope="session")
def virtual_display() -> Iterator[str]:
    """Name of a display of software (Xvfb), for processes that open a window."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        with os.fdopen(read) as pipe:
            yield f":{pipe.readline().strip()}"
        server.terminate()


@pytest.fixture(scope="session")
def coarse_head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A head that loads quickly, for ``--head``."""
    folder = tmp_path_factory.mktemp("heads") / "coarse"
    save_head(folder, build_head(level="coarse"), HeadInfo(source="our own", licence="Apache-2.0"))
    return folder
