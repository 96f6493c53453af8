"""Compiles the library into the wheel, with a C compiler or with Zig from the Python package index.

``CC`` is the compiler; by default cc, gcc or clang, and if none is there, Zig. ``FAPENGINE_NATIVE_TARGET`` is another
machine to compile for, such as ``aarch64-linux-gnu.2.28``, ``x86_64-macos.11.0`` or ``x86_64-windows-gnu``; only Zig
can.
``FAPENGINE_NATIVE_FLAGS`` are further flags, for example of the sanitizers.
"""

import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).parent
SOURCE = HERE / "src"
FLAGS = ["-std=gnu11", "-O3", "-Wall", "-Wextra", "-Wno-psabi", "-fPIC", "-fvisibility=hidden",
         "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fwrapv"]  # fmt: skip
"""Without contraction to fused multiply-add each build of the code draws the same bytes. Integers wrap, as in every
processor's vectors: lanes that are not chosen may overflow."""
BUILDS = {"baseline": [], "v3": ["-march=x86-64-v3"], "v4": ["-march=x86-64-v4"]}
"""Flags of each build of face.c; elsewhere than on x86-64 there is the first alone."""
ZIG_CPUS = {"v3": ["-mcpu=x86_64_v3"], "v4": ["-mcpu=x86_64_v4"]}
ENDINGS = {"windows": ".dll", "macos": ".dylib"}


def compiler(target: str) -> list[str]:
    """Return the command of the compiler. Raises RuntimeError if there is none."""
    zig = [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None
    if target:
        if zig is None:
            raise RuntimeError(f"FAPENGINE_NATIVE_TARGET={target}: requires ziglang; pip install ziglang")
        return [*zig, "-target", target]
    if named := os.environ.get("CC"):
        return shlex.split(named)
    found = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    if not found and zig is None:
        raise RuntimeError("no C compiler: got neither cc, gcc nor clang; install one, or pip install ziglang")
    return [found] if found else zig or []


def parts(target: str) -> tuple[str, str, str]:
    """Machine, system, and the oldest version of the system or of its C library, or nothing.

    >>> parts("aarch64-linux-gnu.2.28"), parts("x86_64-macos.11.0"), parts("x86_64-windows-gnu")
    (('aarch64', 'linux', '2.28'), ('x86_64', 'macos', '11.0'), ('x86_64', 'windows', ''))
    """
    machine, system, *library = target.split("-")
    return machine, system.partition(".")[0], (library[0] if library else system).partition(".")[2]


def compile_library(folder: Path, target: str = "", flags: tuple[str, ...] = ()) -> Path:
    """Compile the library into a folder; returns its path."""
    command = compiler(target)
    is_zig = "ziglang" in command
    machine, system, _ = parts(target or f"{platform.machine().lower()}-{platform.system().lower()}")
    made = folder / f"libfapengine_native{ENDINGS.get(system.replace('darwin', 'macos'), '.so')}"
    builds = list(BUILDS) if machine in ("x86_64", "amd64") else ["baseline"]
    with tempfile.TemporaryDirectory() as scratch:
        jobs, objects = [], []
        for name in (*builds, "choose", "codec"):
            its = [str(SOURCE / f"{name}.c")]
            if name in BUILDS:
                label = machine if name == "baseline" else f"x86-64-{name}"
                its = [*(ZIG_CPUS.get(name, []) if is_zig else BUILDS[name]), f"-DBUILD=face_{name}",
                       f"-DNAME={label.replace('x86_64', 'x86-64')}", str(SOURCE / "face.c")]  # fmt: skip
            objects.append(f"{scratch}/{name}.o")
            jobs.append(subprocess.Popen([*command, *FLAGS, *flags, "-c", *its, "-o", objects[-1]]))
        codes = [job.wait() for job in jobs]
        if any(codes):
            raise RuntimeError(f"{shlex.join(command)}: does not compile {SOURCE}")
        subprocess.run([*command, *flags, "-shared", "-o", str(made), *objects, "-lm"], check=True)
    return made


def tag(target: str) -> str:
    """Tag of a wheel for this machine or for the target: any Python 3, no ABI of Python, one platform."""
    if not target:
        return f"py3-none-{re.sub('[-.]', '_', sysconfig.get_platform())}"
    machine, system, version = parts(target)
    version = version.replace(".", "_")
    if system == "linux" and version:
        return f"py3-none-manylinux_{version}_{machine}"
    if system == "windows" and machine in ("x86_64", "aarch64"):
        return "py3-none-win_" + {"x86_64": "amd64", "aarch64": "arm64"}[machine]
    if system == "macos" and version:
        return f"py3-none-macosx_{version}_{machine.replace('aarch64', 'arm64')}"
    raise RuntimeError(
        f"FAPENGINE_NATIVE_TARGET={target}: expected MACHINE-linux-gnu.GLIBC, -windows-gnu or -macos.VERSION"
    )


class CompiledLibrary(BuildHookInterface):
    """Adds the library to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile it before the wheel is packed; an editable installation keeps it beside the module."""
        target = os.environ.get("FAPENGINE_NATIVE_TARGET", "")
        flags = tuple(shlex.split(os.environ.get("FAPENGINE_NATIVE_FLAGS", "")))
        folder = Path(tempfile.mkdtemp())
        self._scratch = folder
        library = compile_library(HERE / "fapengine_native" if version == "editable" else folder, target, flags)
        build_data["pure_python"], build_data["tag"] = False, tag(target)
        if version != "editable":
            build_data["force_include"][str(library)] = f"fapengine_native/{library.name}"

    def dependencies(self) -> list[str]:
        """What pip installs for the build: Zig, if it is asked for or there is no other compiler."""
        try:
            compiler(os.environ.get("FAPENGINE_NATIVE_TARGET", ""))
        except RuntimeError:
            return ["ziglang"]
        return []

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was compiled outside of the wheel."""
        shutil.rmtree(self._scratch, ignore_errors=True)
