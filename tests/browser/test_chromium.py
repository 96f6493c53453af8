"""A browser that does not come up: the tests that want it fail at once, all for the one start that was tried."""

import os
import subprocess
import sys
from pathlib import Path

from tests.browser import test_page

HANGS = """#!/bin/sh
echo "$$" >> "{starts}"
exec sleep 1000
"""


def test_it_is_tried_once_and_leaves_nothing(tmp_path: Path) -> None:
    starts, browser = tmp_path / "starts", tmp_path / "chromium"
    browser.write_text(HANGS.format(starts=starts))
    browser.chmod(0o755)
    command = [
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", "face",
        test_page.__file__,
    ]  # fmt: skip
    surroundings = {**os.environ, "CHROMIUM": str(browser), "BROWSER_START_LIMIT_S": "0.5"}
    done = subprocess.run(command, capture_output=True, text=True, env=surroundings, timeout=300, check=False)
    tried = starts.read_text().split()
    assert len(tried) == 1
    assert not Path(f"/proc/{tried[0]}").exists()
    assert "no tests ran" not in done.stdout
    assert done.stdout.count("\nERROR ") > 3, done.stdout
    assert done.stdout.count("does not come up within 0.5 s") >= done.stdout.count("\nERROR ")
