"""The wheel of fapengine-native for 64-bit ARM, run by QEMU: it draws an image and codes a stream as x86-64 does.

python -m tests.oracles.aarch64 FOLDER, with Debian's debootstrap and qemu-user-static. Debian's packages for ARM are
only unpacked.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import fapengine
from fapengine.files.heads.load import load_head
from fapengine.render.drawing import RenderOptions
from fapengine.render.native import _backdrop, _Native
from fapengine.render.packing import frame_uniforms, pack
from tests.native.images import ALIKE, faps_of

SUITE, PYTHON, TARGET = "bookworm", "3.11", "aarch64-linux-gnu.2.28"
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_27_aarch64", "manylinux2014_aarch64")
PROGRAM = """
import platform
from pathlib import Path
import numpy as np
import fapengine_native
from fapengine import load, save
from fapengine.codec.kernels import loops
assert loops.__name__ == "fapengine_native.codec"
with np.load("frame.npz") as frame:
    parts = {name: frame[name] for name in fapengine_native.PARTS if name in frame}
    face = fapengine_native.Face(frame["vertices"], frame["displacements"], frame["normal_deltas"], parts)
    face.canvas((512, 512), frame["background"])
    face.skin(frame["skin"])
    image = face.draw(frame["values"], at_vertices=bool(frame["at_vertices"]))
place = Path(platform.machine())
place.mkdir(exist_ok=True)
np.save(place / "image.npy", image)
save(load("speech.fap"), place / "speech.fba")
save(load(place / "speech.fba"), place / "speech.csv")
print(platform.machine(), fapengine_native.select())
"""


def check_aarch64(folder: Path) -> None:
    """Draw and code on both machines, and compare."""
    emulator = shutil.which("qemu-aarch64-static")
    if not (emulator and shutil.which("debootstrap")):
        print("aarch64: debootstrap or qemu-user-static is absent, NOT TRIED")
        return
    folder = folder.resolve() / "aarch64"
    work = folder / "work"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    _write_inputs(work)
    subprocess.run([sys.executable, "-c", PROGRAM], cwd=work, check=True)
    root, modules = _debian(folder), _modules(folder)
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": f"{modules}:{Path.cwd()}", "PYTHONHOME": str(root / "usr")}
    command = [emulator, "-L", str(root), str(root / "usr/bin/python3.11"), "-c", PROGRAM]
    subprocess.run(command, cwd=work, env={**environment, "PYTHONDONTWRITEBYTECODE": "1"}, check=True)
    mine, its = (np.load(work / machine / "image.npy").astype(int) for machine in ("x86_64", "aarch64"))
    off = np.abs(mine - its).max(axis=2)
    print(f"image: {100 * (off == 0).mean():.3f} % of the pixels are equal, the others differ by {off.max()} at most")
    assert off.max() <= ALIKE
    for name in ("speech.fba", "speech.csv"):
        assert (work / "x86_64" / name).read_bytes() == (work / "aarch64" / name).read_bytes(), name
    print(f"stream: {(work / 'aarch64/speech.fba').stat().st_size} bytes, equal; decoded, equal")


def _write_inputs(work: Path) -> None:
    """A speech, and a frame as the library reads it."""
    (work / "speech.pho").write_text("p 100\na 300\nm 100\ni 200\n_ 300\n" * 10)
    fapengine.animate(work / "speech.pho").save(work / "speech.fap")
    head, drawing = load_head("default"), RenderOptions()
    packed, background = pack(head), _backdrop(drawing)
    native = _Native(packed, drawing)
    assert packed.skin is not None
    assert background is not None
    np.savez(
        work / "frame.npz", vertices=packed.vertices, displacements=packed.displacements,
        normal_deltas=packed.normal_deltas, skin=packed.skin_at(native._level), at_vertices=native._at_vertices,
        background=background, values=native.values(frame_uniforms(head, faps_of("open"))), **packed.parts,
    )  # fmt: skip
    native.close()


def _debian(folder: Path) -> Path:
    """Debian's Python for ARM, unpacked."""
    root, packages = folder / "debian", folder / "packages"
    if not (root / "usr/bin/python3.11").exists():
        options = ["--download-only", "--arch=arm64", "--variant=minbase", "--include=python3"]
        subprocess.run(["debootstrap", *options, SUITE, packages], check=True, capture_output=True)
        for package in sorted((packages / "var/cache/apt/archives").glob("*.deb")):
            subprocess.run(["dpkg", "-x", package, root], check=True)
    return root


def _modules(folder: Path) -> Path:
    """NumPy for ARM, and the wheel that Zig compiles here."""
    wheels, modules = folder / "wheels", folder / "modules"
    for old in (wheels, modules):
        shutil.rmtree(old, ignore_errors=True)
    pip = [sys.executable, "-m", "pip"]
    environment = {**os.environ, "FAPENGINE_NATIVE_TARGET": TARGET}
    wheel = [*pip, "wheel", "--quiet", "--no-deps", "--wheel-dir", wheels, "./native"]
    subprocess.run(wheel, env=environment, check=True)
    for_arm = ["--python-version", PYTHON, "--only-binary", ":all:", *(f"--platform={name}" for name in PLATFORMS)]
    subprocess.run([*pip, "download", "--quiet", "--no-deps", *for_arm, "--dest", wheels, "numpy"], check=True)
    for each in wheels.glob("*.whl"):
        shutil.unpack_archive(each, modules, "zip")
    return modules


if __name__ == "__main__":
    check_aarch64(Path(sys.argv[1]))
