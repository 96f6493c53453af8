"""Debian with Python and nothing else, without OpenGL: the installed wheels write a video there.

python -m tests.oracles.bare_debian FOLDER, as root, with Debian's debootstrap. The folder keeps Debian and the wheels
of other projects for the next run.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

SUITE, PYTHON = "bookworm", "3.11"
"""Debian 12 and its Python."""
WANTED = "fapengine[fast,video,voice]"
SOURCES = (".", "./native", "docopt")
"""What has no wheel: ours, and what num2words requires."""
OPENGL = ("libEGL.so*", "libGL.so*", "libGLX*.so*", "libOSMesa.so*")


def check_bare_debian(folder: Path) -> None:
    """Install both wheels into a new environment of a bare Debian, speak, and look at the video and at doctor."""
    if not shutil.which("debootstrap") or os.geteuid():
        print("bare Debian: debootstrap is absent, or this is not root, NOT TRIED")
        return
    root, wheels = folder.resolve() / "debian", folder.resolve() / "wheels"
    _make_debian(root)
    _collect_wheels(wheels)
    for old in ("face", "wheels", "films"):
        shutil.rmtree(root / old, ignore_errors=True)
    shutil.copytree(wheels, root / "wheels")
    (root / "films").mkdir()
    found = [str(path) for pattern in OPENGL for path in root.rglob(pattern)]
    assert not found, f"Debian has OpenGL: {found}"
    _inside(root, "python3", "-m", "venv", "/face")
    _inside(root, "/face/bin/pip", "install", "--quiet", "--no-index", "--find-links", "/wheels", WANTED)
    _inside(root, "/face/bin/fapengine", "say", "Hello.", "-o", "/films/hello.mp4")
    frames, size = _video(root / "films" / "hello.mp4")
    findings = json.loads(_inside(root, "/face/bin/fapengine", "doctor", "--json"))
    print(f"bare Debian: hello.mp4 has {frames} frames of {size}; doctor: {_renderer(findings)}")
    assert frames > 10
    assert "fapengine-native" in _renderer(findings)


def _make_debian(root: Path) -> None:
    if not (root / "usr/bin/python3").exists():
        packages = "--include=python3,python3-venv,ca-certificates"
        subprocess.run(["debootstrap", "--variant=minbase", packages, SUITE, root], check=True, capture_output=True)


def _collect_wheels(wheels: Path) -> None:
    """Build ours, and fetch those of others that are not there."""
    wheels.mkdir(parents=True, exist_ok=True)
    for old in wheels.glob("fapengine*.whl"):
        old.unlink()
    pip = [sys.executable, "-m", "pip"]
    subprocess.run([*pip, "wheel", "--quiet", "--no-deps", "--wheel-dir", wheels, *SOURCES], check=True)
    for_debian = ["--python-version", PYTHON, "--only-binary", ":all:", "--find-links", wheels]
    subprocess.run([*pip, "download", "--quiet", *for_debian, "--dest", wheels, WANTED], check=True)


def _inside(root: Path, *command: str) -> str:
    """Run a command in Debian, and return what it writes."""
    program = ["unshare", "--map-root-user", "chroot", str(root), "/usr/bin/env", "-i"]
    program += ["PATH=/usr/bin:/bin", "HOME=/root", "LC_ALL=C.UTF-8"]
    done = subprocess.run([*program, *command], capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stdout}{done.stderr}"
    return done.stdout


def _video(path: Path) -> tuple[int, str]:
    """Number of frames, and their size."""
    import av

    with av.open(str(path)) as film:
        shown = [(frame.width, frame.height) for frame in film.decode(video=0)]
    return len(shown), "{} x {}".format(*shown[0])


def _renderer(findings: list[dict[str, str]]) -> str:
    return next(row["found"] for row in findings if row["part"] == "renderer")


if __name__ == "__main__":
    check_bare_debian(Path(sys.argv[1]))
