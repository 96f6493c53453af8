"""The npm package ``fapengine-face``: its modules, types, head, shaders and numbers, ready for ``npm pack``.

python -m design.face_package [FOLDER]    # by default out/fapengine-face; make npm packs it, too
"""

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fapengine
from design import live_tables
from fapengine.files.heads.load import load_head
from fapengine.mpeg4 import fap
from fapengine.retarget import arkit, moods
from fapengine.retarget.blend import ALL_MOODS, ARKIT_NAMES, BlendMap, weights_mm
from fapengine.server.web.page_files import head_binary, setup

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "fapengine-face"
FOLDER = ROOT / "out" / "fapengine-face"
DIGITS = 7


def build(folder: Path) -> None:
    """Write the package's folder anew."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(SOURCE, folder)
    for name in ("LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, folder)
    about = json.loads((folder / "package.json").read_text())
    about["version"] = version()
    (folder / "package.json").write_text(json.dumps(about, indent=2) + "\n")
    assets = folder / "assets"
    assets.mkdir()
    (assets / "setup.json").write_text(json.dumps(setup(voices={}), ensure_ascii=False))
    (assets / "head.bin").write_bytes(head_binary(load_head("default")))
    write_arkit(folder)
    live_tables.write(folder)


def write_arkit(folder: Path) -> None:
    """Write the numbers of ``arkit.js``."""
    head = "// Made by python -m design.face_package from fapengine/retarget.\n"
    (folder / "arkit-table.js").write_text(f"{head}export const ARKIT = {json.dumps(arkit_table())};\n")


def version() -> str:
    """Give the distribution's version as npm spells it: 1.2.3, or 1.2.3-dev.4."""
    parts = re.match(r"(\d+)\.(\d+)(?:\.(\d+))?(?:\.dev(\d+))?", fapengine.__version__)
    if parts is None:
        return "0.0.0"
    number = ".".join(part or "0" for part in parts.groups()[:3])
    return f"{number}-dev.{parts[4]}" if parts[4] else number


def arkit_table() -> dict[str, object]:
    """Gather what ``arkit.js`` needs of :mod:`fapengine.retarget`."""
    rows, one_way = moods._rows(ALL_MOODS)
    lengths = weights_mm()
    return {
        "names": ARKIT_NAMES,
        "spoken": _map(arkit.speech_map(), helpers=arkit.HELPERS.tolist()),
        "upper": _map(moods.mood_map(ALL_MOODS), helpers=[]),
        "jaw": arkit.JAW,
        "close": arkit.CLOSE,
        "opposites": arkit._OPPOSITES,
        "openings": _short(arkit._shape_openings_mm()),
        "openers": arkit._OPENERS,
        "inner": [[number, lengths[fap.column(number)]] for number in arkit.INNER_PAIRS[0]],
        "outer": [[number, lengths[fap.column(number)]] for number in arkit.OUTER_PAIRS[0]],
        "shut": arkit.SHUT_MM,
        "parted": arkit.PARTED_MM,
        "swing": arkit.SWING,
        "faint": moods.FAINT,
        "moodFaps": _short(rows),
        "oneWay": one_way,
        "moodShapes": _short(arkit._mood_weights()),
        "blinkStep": moods.BLINK_STEP,
        "openAgain": moods.OPEN_AGAIN,
        "maxBlinkFrames": moods.MAX_BLINK_FRAMES,
    }


def _map(shapes: BlendMap, helpers: list[int]) -> dict[str, object]:
    return {
        "names": shapes.names,
        "limit": shapes.limit,
        "goals": _short(shapes._goals),
        "gram": _short(shapes._gram),
        "lengths": _short(shapes._lengths),
        "reluctance": _short(shapes._reluctance),
        "plain": moods.PLAIN,
        "helpers": helpers,
    }


def _short(values: NDArray[np.float64]) -> object:
    """Nested lists of numbers with so many digits."""
    if values.ndim > 1:
        return [_short(row) for row in values]
    return [int(value) if value == int(value) else float(f"{value:.{DIGITS}g}") for value in values]


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    build(target)
    print(target)
