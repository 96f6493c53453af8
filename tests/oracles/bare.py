"""A new environment with numpy and scipy alone: the core and the small command line run there."""

import subprocess
import sys
import venv
from pathlib import Path

PACKAGES = ("numpy", "scipy")
COMMANDS = (
    "animate a.pho -o a.fap", "encode a.fap -o a.fba", "decode a.fba -o b.fap", "convert b.fap -o b.csv",
    "inspect a.fba",
)  # fmt: skip


def check_bare_environment(root: Path) -> None:
    """Make it, and run the verbs that need no more."""
    folder = (root / "bare").resolve()
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    (folder / "a.pho").write_text("_ 100\nb 80\na 150\n_ 100\n")
    for command in COMMANDS:
        program = f"import sys; sys.path.insert(0, {str(Path.cwd())!r}); from fapengine.cli import main; main()"
        done = subprocess.run([python, "-c", program, *command.split()], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert (folder / "a.fap").read_bytes()[:3] == b"2.1"
    print(f"bare environment: {', '.join(PACKAGES)}; {len(COMMANDS)} verbs ran")
