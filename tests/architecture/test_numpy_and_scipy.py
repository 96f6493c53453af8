"""With numpy and scipy alone, and with numpy alone: timings in, FAPs, streams and tables out.

``make oracles`` does the same in a new environment that has nothing else, and in Pyodide.
"""

import json
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
VERBS = [
    ["animate", "a.pho", "-o", "a.fap"],
    ["encode", "a.fap", "-o", "a.fba", "--quant", "4", "--intra-every", "5"],
    ["decode", "a.fba", "-o", "b.fap"],
    ["convert", "b.fap", "-o", "b.csv"],
    ["convert", "b.csv", "-o", "c.fap"],
    ["convert", "b.fap", "-o", "b.json", "--shapes", "rhubarb"],
]
LOOKS = {"a.fap": "FAP", "a.fba": "FBA", "a.pho": "pho", "grid_s1_en": "profile"}
REFUSED = [
    (["say", "Hello."], 3, "say: typer and rich are not installed"),
    (["animate", "a.pho", "-o", "a.fap", "--jaw", "1"], 3, "--jaw: typer and rich are not installed"),
    (["animate", "a.pho", "-o", "a.mp4"], 3, 'av is not installed. Install it with: pip install "fapengine[video]"'),
    (["inspect", "a.wav"], 3, "av is not installed. Install it with:"),
    (["decode", "a.pho", "-o", "x.fap"], 1, "start code"),
    (["encode", "a.pho", "-o", "a.pho"], 2, "a.pho"),
]
PROGRAM = """
import json, sys
from importlib.util import find_spec
sys.path.insert(0, sys.argv[1])
from fapengine.cli import main

assert not any(map(find_spec, ("typer", "rich", "msgspec", "PIL", "av", "moderngl", "numba")))

for words in json.loads(sys.argv[2]):
    sys.argv = ["fapengine", *words]
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code or 0
    print("CODE", code, flush=True)
    print("CODE", code, file=sys.stderr, flush=True)
"""
PYTHON = """
import sys
sys.path.insert(0, sys.argv[1])
import fapengine
said = fapengine.animate("a.pho", expressions={"joy": 0.4})
fapengine.save(said.track, "python.fap")
assert fapengine.load("python.fap").equals(said.track)
lacking = []
for name in fapengine.__all__:
    try:
        getattr(fapengine, name)
    except fapengine.ResourceError as error:
        lacking.append(str(error))
print(*lacking, sep="\\n")
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


def run(program: str, site: Path, folder: Path, *arguments: str) -> tuple[list[str], list[str]]:
    """Lines of both streams of a Python that knows this site alone."""
    command = [sys.executable, "-I", "-S", "-c", program, str(site), *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), done.stderr.splitlines()


def test_verbs_write_what_the_whole_command_line_writes(
    site: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, err = run(PROGRAM, site, folder, json.dumps(VERBS))
    assert [line for line in out if line.startswith("CODE")] == ["CODE 0"] * len(VERBS), err
    names = [words[3] for words in VERBS]
    written = {name: (folder / name).read_bytes() for name in names}
    monkeypatch.chdir(folder)
    for words in VERBS:
        (folder / words[3]).unlink()
    for words in VERBS:
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
    assert {name: (folder / name).read_bytes() for name in names} == written


def test_inspect_says_what_a_file_is(site: Path, folder: Path) -> None:
    run(PROGRAM, site, folder, json.dumps(VERBS[:2]))
    out, _ = run(PROGRAM, site, folder, json.dumps([["inspect", name] for name in LOOKS]))
    told = [json.loads(line)["format"] for line in out if line.startswith("{")]
    assert told == list(LOOKS.values())


def test_what_is_lacking_is_said_in_a_line(site: Path, folder: Path) -> None:
    _, err = run(PROGRAM, site, folder, json.dumps([words for words, _, _ in REFUSED]))
    told = list(zip(err[::2], err[1::2], strict=True))
    assert len(told) == len(REFUSED), err
    for (line, code), (_, expected, text) in zip(told, REFUSED, strict=True):
        assert line.startswith("fapengine: ")
        assert (code, text in line) == (f"CODE {expected}", True), line


def test_scipy_is_missed_in_a_line(site: Path, folder: Path) -> None:
    out, err = run(PROGRAM, site, folder, json.dumps([VERBS[0], ["convert", "a.fap", "-o", "a.vrma"]]))
    if (site / "scipy").exists():
        assert out[-1] == "CODE 0"
    else:
        assert err[-2:] == ["fapengine: scipy is not installed. Install it with: pip install scipy", "CODE 3"]


def test_python_s_front_door_opens(site: Path, folder: Path) -> None:
    out, _ = run(PYTHON, site, folder)
    (line,) = out
    assert line.startswith('Server: aiohttp is not installed. Install it with: pip install "fapengine[live]"')
    assert (folder / "python.fap").is_file()
