"""Where the recorded data are that design scripts and benchmarks read, and what to do where they are not."""

import argparse
from pathlib import Path

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
