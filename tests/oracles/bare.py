"""A new environment with numpy and scipy alone: the Python interface plans, codes and converts there."""

import subprocess
import sys
import venv
from pathlib import Path

PACKAGES = ("numpy", "scipy")
PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
from fapengine import animate, load, save
animate("a.pho").save("a.fap")
save(load("a.fap"), "a.fba")
save(load("a.fba"), "b.csv")
"""


def check_bare_environment(root: Path) -> None:
    """Make it, and run a program there."""
    folder = (root / "bare").resolve()
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    (folder / "a.pho").write_text("_ 100\nb 80\na 150\n_ 100\n")
    done = subprocess.run([python, "-c", PROGRAM, str(Path.cwd())], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (folder / "a.fap").read_bytes()[:3] == b"2.1"
    print(f"bare environment: {', '.join(PACKAGES)}; plans, codes and converts")
