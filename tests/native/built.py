"""fapengine-native as the checkout has it, compiled into out/native: tests and benchmarks need no installed wheel."""

import hashlib
import importlib
import shutil
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

HERE = Path(__file__).resolve().parents[2]
SOURCE, OUT = HERE / "native", HERE / "out" / "native"


def build_hook() -> ModuleType:
    """The module that compiles the library."""
    spec = spec_from_file_location("fapengine_native_build", SOURCE / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def has_compiler() -> bool:
    try:
        build_hook().compiler("")
    except RuntimeError:
        return False
    return True


def built(flags: tuple[str, ...] = ()) -> Path:
    """Compile the package, unless that was done before; returns the folder to put on the path."""
    files = sorted(
        [*(SOURCE / "src").iterdir(), *(SOURCE / "fapengine_native").glob("*.py"), SOURCE / "hatch_build.py"]
    )
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in files) + repr(flags).encode()).hexdigest()[:16]
    folder = OUT / digest
    if not folder.is_dir():
        OUT.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=OUT) as scratch:
            package = Path(scratch) / "new" / "fapengine_native"
            shutil.copytree(SOURCE / "fapengine_native", package, ignore=shutil.ignore_patterns("lib*"))
            build_hook().compile_library(package, flags=flags)
            try:
                package.parent.rename(folder)
            except OSError:
                if not folder.is_dir():  # as it is if another process compiled it meanwhile
                    raise
    return folder


def forget() -> None:
    """Take the package out of the imported modules."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "fapengine_native"]:
        del sys.modules[name]


def imported(flags: tuple[str, ...] = ()) -> ModuleType:
    """The compiled package, found before an installed one."""
    folder = str(built(flags))
    if folder not in sys.path:
        sys.path.insert(0, folder)
        forget()
        importlib.invalidate_caches()
    return importlib.import_module("fapengine_native")
