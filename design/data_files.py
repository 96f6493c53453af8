"""Recorded data that design scripts and benchmarks read, and the tables that they write into the package."""

import argparse
import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import DIGESTS

FOLDER = Path("data")
"""Folder of recorded data in a checkout; not part of the repository."""
HOW = {
    "speech_train.npz": "python -m design.make_speech_data makes it from public sources; python -m design.speech_sample"
    " makes the like of it in any clone, with figures of its own",
    "dense_face.npz": "python -m design.make_speech_data --help says what it holds and whose face it was",
    "markers.csv": "python -m design.make_speech_data --help says what it holds",
}


def need(path: Path) -> Path:
    """Return a path that exists, or end the program with one line that says how to get the file."""
    if not path.is_file():
        raise SystemExit(f"error: {path} is not there: {HOW.get(path.name, HOW['speech_train.npz'])}")
    return path


def asked_path(doc: str | None, default: Path, *files: str) -> Path:
    """Read a script's one argument, a file or a folder that must hold ``files``."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", default=default, help=f"default: {default}")
    path: Path = parser.parse_args().data
    for name in files:
        need(path / name)
    return path if files else need(path)


def save_table(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a table and its digest as :func:`fapengine._arrays.read_table` reads them.

    The bytes depend on the arrays alone: nothing is compressed, and every member has the same date.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for key, values in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.ascontiguousarray(values), version=(1, 0))
            entry = zipfile.ZipInfo(f"{key}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = 3  # the same on every system
            archive.writestr(entry, member.getvalue())
    path.write_bytes(buffer.getvalue())
    sums = path.with_name(DIGESTS)
    digests = dict(line.split()[::-1] for line in sums.read_text("ascii").splitlines()) if sums.exists() else {}
    digests[path.name] = hashlib.sha256(buffer.getvalue()).hexdigest()
    sums.write_text("".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items())), "ascii")
    print(f"{path.name}: {len(buffer.getvalue()) / 1000:.0f} kB")
