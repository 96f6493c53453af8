"""Programs that tests start: none outlives the tests, even if these are killed."""

import ctypes
import signal
import subprocess
from collections.abc import Sequence
from typing import Any

PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """Have the kernel end this process when its parent ends. For ``preexec_fn``.

    It also hears Ctrl-C again, which shells switch off for what they run in the background.
    """
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def start(command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
    """Start a program as ``subprocess.Popen`` does; it ends with this process."""
    return subprocess.Popen(command, preexec_fn=end_with_parent, **options)
