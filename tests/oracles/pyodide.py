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
ABSENT = "import sys; sys.modules.update(dict.fromkeys(('espeakng_loader', 'scipy')))"
"""Code that makes this Python lack what Pyodide lacks here."""
PROGRAM = """
import json, sys
sys.path.insert(0, "../wheel")
import numpy
import fapengine
from fapengine import EncoderOptions, animate, load, save

errors = []
for statement in STATEMENTS:
    try:
        exec(statement)
        errors.append("")
    except (fapengine.FapEngineError, ImportError) as error:
        errors.append(str(error))
print(json.dumps(
    {"errors": errors, "python": [*sys.version_info[:3]], "numpy": numpy.__version__, "on": sys.platform}
))
"""
SAID = "_ 100/m 70/aI 140/b 60/eI 130/b 60/i 80/_ 200/f 90/aU 150/n 60/d 50/D 40/@ 60/v 70/oU 140/l 60/z 90/_ 150/"
FILES = {"said.pho": SAID.replace("/", "\n"), **{f"{name.replace(' ', '-')}.txt": SAMPLES[name] for name in SAMPLES}}
STATEMENTS = [
    'animate("said.pho", expressions=["joy:0.4", "anger:0.5@1-1.8"]).save("said.fap")',
    'animate("said.pho", rate_hz=50, seed=7).save("fast.fba")',
    'save(load("said.fap"), "said.fba", encoding=EncoderOptions(quant=4, intra_every=5))',
    'save(load("said.fap"), "small.fba", kbit_s=4)',
    'save(load("said.fba"), "again.fap")',
    'save(load("said.fap"), "said.csv")',
    'save(load("said.csv"), "back.fap")',
]
FORMATS_AT_LEAST = 40
"""Timing formats that need no voice: those of words alone are pronounced by espeak-ng."""
LACKING = 'save(load("said.fap"), "said.vrma")'


def check_in_pyodide(root: Path) -> None:
    """Build the wheel, run the same program there and here, and compare what they wrote."""
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

    formats = [f"animate({name!r}).save({f'{name}.fap'!r})" for name in FILES]
    program = f"STATEMENTS = {[*STATEMENTS, *formats, LACKING]!r}\n{PROGRAM}"
    here = _run([sys.executable, "-c", f"{ABSENT}\n{program}"], folder / "here", PYTHONPATH="")
    modules = str(root / "node_modules")
    there = _run(["node", "-e", PYODIDE, str(folder), program], folder / "there", NODE_PATH=modules)
    errors = there["errors"]
    assert there["on"] == "emscripten"
    assert list(map(bool, errors)) == list(map(bool, here["errors"])), (here["errors"], errors)
    assert not any(errors[: len(STATEMENTS)]), errors
    assert "scipy" in errors[-1]
    written = {path.name: path.read_bytes() for path in (folder / "there").iterdir()}
    assert written == {path.name: path.read_bytes() for path in (folder / "here").iterdir()}
    read = errors[len(STATEMENTS) : -1].count("")
    assert read >= FORMATS_AT_LEAST
    python, counts = ".".join(map(str, there["python"])), f"{len(STATEMENTS)} statements and {read} timing formats"
    print(f"Pyodide: Python {python}, numpy {there['numpy']}, no scipy: {counts}, {len(written) - len(FILES)} files")
    print(f"every byte of them is that of numpy {here['numpy']} here")


def _run(command: list[str], folder: Path, **environment: str) -> Any:
    """Return what the program printed in its last line, run where the files are."""
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    whole = {**os.environ, **environment}
    done = subprocess.run(command, cwd=folder, env=whole, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    check_in_pyodide(Path(sys.argv[1]))
