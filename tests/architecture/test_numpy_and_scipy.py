"""With numpy and scipy alone, and with numpy alone: timings in, FAPs, streams and tables out.

``make oracles`` does the same in a new environment that has nothing else, and in Pyodide.
"""

import subprocess
import sys
from pathlib import Path

import numpy
import pytest
from typer.testing import CliRunner

import fapengine
from fapengine.cli.main import app

pytestmark = pytest.mark.nightly
PACKAGES = {"scipy": ("numpy", "numpy.libs", "scipy", "scipy.libs"), "numpy": ("numpy", "numpy.libs")}
COMMANDS = [
    "animate a.pho -o a.fap", "encode a.fap -o a.fba --quant 4 --intra-every 5", "convert a.fap -o b.csv",
    "convert b.csv -o c.fap", "convert a.fap -o b.json --shapes rhubarb",
]  # fmt: skip
"""What :data:`SAVES` does, on the command line."""
SAVES = """
from fapengine import EncoderOptions, animate, load, save
animate("a.pho").save("a.fap")
save(load("a.fap"), "a.fba", encoding=EncoderOptions(quant=4, intra_every=5))
save(load("a.fap"), "b.csv")
save(load("b.csv"), "c.fap")
save(load("a.fap"), "b.json", shapes="rhubarb")
assert load("a.fba").rate_hz == 30
"""
LACKING = {
    'fapengine.animate("a.pho").save("a.mp4")': 'av is not installed. Install it with: pip install "fapengine[video]"',
    'fapengine.animate("a.wav")': "av is not installed. Install it with:",
    "fapengine.Server": 'Server: aiohttp is not installed. Install it with: pip install "fapengine[live]"',
}
START = """
import sys
from importlib.util import find_spec
sys.path.insert(0, sys.argv.pop(1))
assert not any(map(find_spec, ("typer", "rich", "msgspec", "PIL", "av", "moderngl", "fapengine_native")))
import fapengine
"""


@pytest.fixture(scope="module", params=PACKAGES)
def site(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """A folder that has numpy and fapengine, scipy or not, and no other library."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "fapengine").symlink_to(Path(fapengine.__file__).parent)
    installed = Path(numpy.__file__).parent.parent
    for name in PACKAGES[request.param]:
        if (installed / name).exists():
            (folder / name).symlink_to(installed / name)
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.pho").write_text("_ 100\nb 80\na 150\n_ 100\n")
    (tmp_path / "a.wav").write_bytes(b"RIFF")
    return tmp_path


def run(program: str, site: Path, folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run a program in a Python that has this site alone."""
    command = [sys.executable, "-I", "-S", "-c", f"{START}\n{program}", str(site), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)


def test_python_writes_what_the_command_line_writes(site: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = run(SAVES, site, folder)
    assert done.returncode == 0, done.stderr
    names = [words.split()[3] for words in COMMANDS]
    written = {name: (folder / name).read_bytes() for name in names}
    monkeypatch.chdir(folder)
    for words in COMMANDS:
        Path(words.split()[3]).unlink()
    for words in COMMANDS:
        result = CliRunner().invoke(app, words.split())
        assert result.exit_code == 0, result.output
    assert {name: (folder / name).read_bytes() for name in names} == written


@pytest.mark.parametrize("statement", LACKING)
def test_a_missing_library_is_named(statement: str, site: Path, folder: Path) -> None:
    last = run(statement, site, folder).stderr.splitlines()[-1]
    assert last.startswith("fapengine.errors.ResourceError: ")
    assert LACKING[statement] in last


def test_every_name_of_the_interface_but_the_server_is_there(site: Path, folder: Path) -> None:
    program = "print(*(getattr(fapengine, name) for name in fapengine.__all__ if name != 'Server'))"
    done = run(program, site, folder)
    assert done.returncode == 0, done.stderr


def test_the_command_line_says_what_it_lacks(site: Path, folder: Path) -> None:
    done = run("from fapengine.cli import main; main()", site, folder, "animate", "a.pho")
    lack = "fapengine: command line: typer is not installed. Install it with: pip install typer\n"
    assert (done.returncode, done.stderr) == (3, lack)
