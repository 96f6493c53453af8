"""The wheel in Pyodide, CPython as WebAssembly: timings in; FAPs, streams and tables out, byte for byte as here.

npm has Pyodide, and numpy as emscripten-forge built it with the same compiler for the same Python. It has no scipy, so
this also shows what runs without it.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Any

from tests.unit.speech.samples import SAMPLES

PYODIDE = """
(async () => {
  const python = await require('pyodide').loadPyodide();
  python.FS.mkdir('/here');
  python.FS.mount(python.FS.filesystems.NODEFS, { root: process.argv[1] }, '/here');
  python.FS.chdir('/here/there');
  python.runPython("import sys; sys.path.insert(0, '/here/numpy')");
  python.runPython(process.argv[2]);
})().catch((error) => { console.error(String(error.message).slice(-3000)); process.exitCode = 1; });
"""
ABSENT = "import sys; sys.modules.update(dict.fromkeys(('espeakng_loader', 'numba', 'scipy')))"
"""Code that makes this Python lack what Pyodide lacks here."""
PROGRAM = """
import json, sys
sys.path.insert(0, "../wheel")
from fapengine.cli._small import main

ends = []
for words in JOBS:
    sys.argv = ["fapengine", *words]
    try:
        main()
        ends.append(0)
    except SystemExit as end:
        ends.append(end.code or 0)
import numpy
print(json.dumps({"ends": ends, "python": [*sys.version_info[:3]], "numpy": numpy.__version__, "on": sys.platform}))
"""
SAID = "_ 100/m 70/aI 140/b 60/eI 130/b 60/i 80/_ 200/f 90/aU 150/n 60/d 50/D 40/@ 60/v 70/oU 140/l 60/z 90/_ 150/"
FILES = {"said.pho": SAID.replace("/", "\n"), **{f"{name.replace(' ', '-')}.txt": SAMPLES[name] for name in SAMPLES}}
VERBS = [
    ["animate", "said.pho", "-o", "said.fap", "--expression", "joy:0.4", "--expression", "anger:0.5@1-1.8"],
    ["animate", "said.pho", "-o", "fast.fba", "--fps", "50", "--seed", "7"],
    ["encode", "said.fap", "-o", "said.fba", "--quant", "4", "--intra-every", "5"],
    ["encode", "said.fap", "-o", "small.fba", "--kbps", "4"],
    ["decode", "said.fba", "-o", "again.fap"],
    ["convert", "said.fap", "-o", "said.csv"],
    ["convert", "said.csv", "-o", "back.fap"],
    ["inspect", "said.fba"],
]
FORMATS_AT_LEAST = 40
"""Timing formats that need no voice: those of words alone are pronounced by espeak-ng."""
LACKING = ["convert", "said.fap", "-o", "said.vrma"]


def check_in_pyodide(root: Path) -> None:
    """Build the wheel, run the same verbs there and here, and compare what they wrote."""
    folder = (root / "pyodide").resolve()
    shutil.rmtree(folder, ignore_errors=True)
    packed = next((root / "node_modules/@emscripten-forge/numpy/pkg").glob("numpy-*.tar.gz"))
    with tarfile.open(packed) as archive:
        archive.extractall(folder, filter="data")
    next(folder.glob("lib/python3*/site-packages")).rename(folder / "numpy")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(build, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("fapengine-*.whl"))) as wheel:
        wheel.extractall(folder / "wheel")

    formats = [["animate", name, "-o", f"{name}.fap"] for name in FILES]
    jobs = [*VERBS, *formats, LACKING]
    program = f"JOBS = {jobs!r}\n{PROGRAM}"
    here, _ = _run([sys.executable, "-c", f"{ABSENT}\n{program}"], folder / "here", PYTHONPATH="")
    there, told = _run(
        ["node", "-e", PYODIDE, str(folder), program], folder / "there", NODE_PATH=str(root / "node_modules")
    )
    assert there["on"] == "emscripten"
    assert there["ends"] == here["ends"], (here["ends"], there["ends"])
    assert there["ends"][: len(VERBS)] == [0] * len(VERBS)
    assert there["ends"][-1] == 3
    assert "scipy is not installed. Install it with: pip install scipy" in told
    written = {path.name: path.read_bytes() for path in (folder / "there").iterdir()}
    assert written == {path.name: path.read_bytes() for path in (folder / "here").iterdir()}
    read = there["ends"][len(VERBS) : -1].count(0)
    assert read >= FORMATS_AT_LEAST
    python, counts = ".".join(map(str, there["python"])), f"{len(VERBS)} commands and {read} timing formats"
    print(f"Pyodide: Python {python}, numpy {there['numpy']}, no scipy: {counts}, {len(written) - len(FILES)} files")
    print(f"every byte of them is that of numpy {here['numpy']} here")


def _run(command: list[str], folder: Path, **environment: str) -> tuple[Any, str]:
    """The program's last line, and what it said of errors, run where the files are."""
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    whole = {**os.environ, **environment}
    done = subprocess.run(command, cwd=folder, env=whole, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


if __name__ == "__main__":
    check_in_pyodide(Path(sys.argv[1]))
