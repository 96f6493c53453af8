"""Runs a command line in this process, in a given folder, as ``python -m fapengine`` would."""

import io
import os
import shlex
import signal
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fapengine.cli import main

WIDTH = "1000"
"""Columns of the terminal: so wide that no text is wrapped."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
OWN = (
    "FAPENGINE_TOKEN",
    "FAPENGINE_DEBUG",
    "ELEVENLABS_API_KEY",
    "CARTESIA_API_KEY",
    "INWORLD_API_KEY",
    "FISH_API_KEY",
)
"""Variables that change what the program does, and that a developer may have set."""


@dataclass(frozen=True)
class Ran:
    """How a command ended."""

    code: int
    out: bytes
    err: str


def run(command: str, folder: Path) -> Ran:
    """Run ``say "Hello." -o a.fap`` and the like in a folder."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="") for _ in range(2))
    with _in(folder), _streams(out, err), _argv(command), _signals_kept():
        try:
            main()
            code: object = 0
        except SystemExit as end:
            code = end.code
    number = code if isinstance(code, int) else 0 if code is None else 1
    return Ran(number, _content(out), _content(err).decode())


@contextmanager
def _in(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@contextmanager
def _streams(out: io.TextIOWrapper, err: io.TextIOWrapper) -> Iterator[None]:
    held = sys.stdin, sys.stdout, sys.stderr
    sys.stdin, sys.stdout, sys.stderr = io.TextIOWrapper(io.BytesIO()), out, err
    try:
        yield
    finally:
        out.flush()
        err.flush()
        sys.stdin, sys.stdout, sys.stderr = held


@contextmanager
def _argv(command: str) -> Iterator[None]:
    held, environment = sys.argv, dict(os.environ)
    sys.argv = ["fapengine", *shlex.split(command)]
    os.environ.update(COLUMNS=WIDTH, TERM="dumb", NO_COLOR="1")
    for name in OWN:
        os.environ.pop(name, None)
    try:
        with warnings.catch_warnings():
            yield
    finally:
        sys.argv = held
        _restore(environment)


def _restore(environment: Mapping[str, str]) -> None:
    for name in set(os.environ) - set(environment):
        del os.environ[name]
    os.environ.update(environment)


@contextmanager
def _signals_kept() -> Iterator[None]:
    held = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in held.items():
            signal.signal(number, handler)


def _content(stream: io.TextIOWrapper) -> bytes:
    stream.flush()
    return stream.buffer.getvalue()  # type: ignore[attr-defined, no-any-return]
