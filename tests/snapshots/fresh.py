"""Calls functions in processes that nothing has used before, and that start in a few milliseconds.

A voice speaks a little differently the second time in one process, and a cache may hide what a first call does. So one
process imports everything and loads what is slow but has no state; each call is made in a copy of it (fork), which then
ends. Neither a voice nor OpenGL is used before the copy is made.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import ParamSpec, TypeVar

from tests.processes import start

P = ParamSpec("P")
T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[2]
WARM = (
    "animate talk.pho -o talk.fap",
    "encode talk.fap -o talk.fba --max-error-mm 0.5",
    "decode talk.fba -o back.fap",
    "convert talk.fap -o talk.csv",
    "convert talk.csv -o back.fap",
    "inspect talk.fba --json",
    "score talk.fap --phones talk.pho --json",
)
"""Commands that load what others need as well."""
MODULES = ("av", "matplotlib.backends.backend_agg", "matplotlib.figure", "scipy.signal", "scipy.sparse.linalg")
"""Of others, which would be imported by dozens of calls."""


class Fresh:
    """The process that is copied. Stateful."""

    def __enter__(self) -> "Fresh":
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        environment["FAPENGINE_RENDERER"] = "gl"  # as in tests/conftest.py
        environment.setdefault("FAPENGINE_CACHE", str(ROOT / "out" / "cache"))
        self._folder = tempfile.TemporaryDirectory()
        self._process = start(
            [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
            env=environment, start_new_session=True,
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()
        self._folder.cleanup()

    def call(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function of a module in a new copy."""
        wish, answer = (Path(self._folder.name) / name for name in ("wish", "answer"))
        wish.write_bytes(pickle.dumps((function, args, kwargs)))
        answer.unlink(missing_ok=True)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{wish}\t{answer}\n")
        self._process.stdin.flush()
        status = self._process.stdout.readline().strip()
        if not answer.exists():
            raise AssertionError(
                f"{function.__name__}{args}: its process ended with {status or 'the one it was a copy of'}"
            )
        is_well, value = pickle.loads(answer.read_bytes())
        if not is_well:
            raise AssertionError(value)
        return value  # type: ignore[no-any-return]


def _warm_up() -> None:
    import fapengine
    from tests.snapshots import api, inputs, jobs, texts  # noqa: F401
    from tests.snapshots.run import run

    for name in MODULES:
        import_module(name)

    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "talk.pho").write_text("m 100\na 200\nb 100\n")
        for command in WARM:
            run(command, Path(folder))
    for head in ("default", "woman"):
        fapengine.load_head(head)


def _serve() -> None:
    """Copy this process for every line, until there are no more."""
    told = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    _warm_up()
    for line in sys.stdin:
        wish, answer = map(Path, line.rstrip("\n").split("\t"))
        child = os.fork()
        if not child:
            _answer(wish, answer)
        _, status = os.waitpid(child, 0)
        told.write(f"{os.waitstatus_to_exitcode(status)}\n")
        told.flush()


def _answer(wish: Path, answer: Path) -> None:
    code = 0
    try:
        function, args, kwargs = pickle.loads(wish.read_bytes())
        try:
            value = (True, function(*args, **kwargs))
        except Exception:  # noqa: BLE001  # the caller hears of it
            value = (False, traceback.format_exc())
        answer.write_bytes(pickle.dumps(value))
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
        code = 1
    finally:
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    _serve()
