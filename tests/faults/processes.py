"""Processes that carry a mark, so that all that came of them can be found, whoever their parent is by now."""

import os
import secrets
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tests.processes import start

MARK = "FAPENGINE_FAULT"
LOOK_S = 0.02
GONE = 5_000
"""Looks after which a process that has lost its parent has ended."""


def becomes(true: Callable[[], object], looks: int) -> bool:
    """Whether something becomes true within so many looks.

    Looks are counted, not seconds: where the processes that are waited for get no processor, this one gets none either.
    """
    for _ in range(looks):
        if true():
            return True
        time.sleep(LOOK_S)
    return bool(true())


@dataclass
class Marked:
    """A program, and the mark of all processes that come of it. At the end all of them are killed.

    Stateful.
    """

    process: "subprocess.Popen[Any]"
    mark: str

    @classmethod
    def start(cls, command: Sequence[str], folder: Path, **options: Any) -> "Marked":
        mark = secrets.token_hex(8)
        root = str(Path(__file__).resolve().parents[2])
        environment = {
            **os.environ, MARK: mark, "PYTHONPATH": os.pathsep.join([root, *sys.path]), "PYTHONFAULTHANDLER": "1",
        }  # fmt: skip
        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True, **options}
        return cls(start(command, cwd=folder, env=environment, **options), mark)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number in pids(self.mark):
            with suppress(ProcessLookupError):
                os.kill(number, 9)
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            if pipe is not None:
                pipe.close()


def pids(mark: str) -> list[int]:
    """Numbers of the living processes with a mark."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with suppress(OSError):
                if f"{MARK}={mark}".encode() in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
    return found


def left_over(mark: str) -> list[str]:
    """Command lines of processes with a mark that do not end, though their first one has."""
    if becomes(lambda: not pids(mark), GONE):
        return []
    return [command_of(number)[:200] for number in pids(mark)]


def command_of(number: int) -> str:
    """Command line of a process."""
    with suppress(OSError):
        return Path(f"/proc/{number}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return "?"
