"""ExifTool reads the mark that says that images and films are synthetic: python -m tests.oracles.marks."""

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from fapengine.files.moving import FORMATS, write_moving
from fapengine.files.pictures import save_png
from fapengine.files.provenance import SYNTHETIC

FRAMES = list(np.random.default_rng(1).integers(0, 255, (3, 64, 64, 3), np.uint8))


def check_with_exiftool() -> None:
    """Write every kind of image and film, and fail on one whose mark ExifTool reads otherwise or warns of."""
    if not shutil.which("exiftool"):
        print("exiftool: is not installed")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for suffix in FORMATS:
            write_moving(folder / f"film{suffix}", FRAMES, rate_hz=10.0)
        write_moving(folder / "one.webp", FRAMES[:1], rate_hz=10.0)
        save_png(folder / "face.png", FRAMES[0])
        told = subprocess.run(["exiftool", "-j", name], capture_output=True, check=True, timeout=300).stdout
    rows = {Path(row["SourceFile"]).name: row for row in json.loads(told)}
    assert len(rows) == len(FORMATS) + 2, rows
    for file, row in rows.items():
        assert row.get("DigitalSourceType", row.get("Digitalsourcetype")) == SYNTHETIC, file
        assert not {"Warning", "Error"} & row.keys(), row
    print(f"exiftool: reads the mark in {', '.join(sorted(rows))}")


if __name__ == "__main__":
    check_with_exiftool()
