"""What windows are tested with: a display of software, and a head that loads quickly."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from fapengine.files.heads.folder import HeadInfo, save_head
from fapengine.mesh.default_head.head import build_head
from tests.processes import start


@pytest.fixture(scope="session")
def virtual_display() -> Iterator[str]:
    """Name of a display of software (Xvfb), for processes that open a window."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"]
    with start(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
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
