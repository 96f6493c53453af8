"""A sound card of software, for programs that play."""

import contextlib
import os
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.processes import start

ALSA = "</usr/share/alsa/alsa.conf>\npcm.!default { type pulse }\nctl.!default { type pulse }\n"
START_LIMIT_S = 300.0


@contextlib.contextmanager
def null_sink(folder: Path) -> Iterator[Mapping[str, str]]:
    """PulseAudio's null sink, with its files in a folder: environment of a process that plays there, to nobody.

    ALSA's own null device will not do: it fetches sound 600 times faster than it would be heard, so no clock can be
    made of it. Without ``norewinds`` the sink may sleep for 2 s before the first buffer.
    """
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
    with start(command, env=environment, stderr=subprocess.DEVNULL) as server:
        try:
            _wait_for(folder / "socket", server)
            yield environment
        finally:
            server.terminate()


def _wait_for(socket: Path, server: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + START_LIMIT_S
    while not socket.exists():
        stopped = server.poll() is not None or time.monotonic() > until
        assert not stopped, f"pulseaudio does not start (code {server.poll()}); .ci/system-packages installs it"
        time.sleep(0.05)
