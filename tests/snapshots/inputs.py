"""Small inputs of every kind: some spelled here, the others made of them by the program itself."""

import csv
import json
import wave
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import fapengine
from tests.snapshots import trackers
from tests.snapshots.run import run
from tests.unit.speech.samples import SAMPLES

TESTS = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]

PHONES = (
    ("_", 80), ("b", 70), ("ɹ", 60), ("aɪ", 140), ("t", 70), ("m", 80), ("ʌ", 90), ("n", 70), ("f", 90), ("iː", 130),
    ("l", 60), ("p", 80), ("uː", 120), ("_", 60),
)  # fmt: skip
"""Label and length in ms: 1.2 s with closed lips, teeth on the lip, and wide and round vowels."""
SENTENCE = "Bright moon, feel pool."
UNITS_MM = {"MNS": 22.2, "MW": 51.1, "IRISD": 11.2, "ENS": 48.1, "ES": 62.8}
AXES = {"left": (0, 1.0), "right": (0, -1.0), "up": (1, 1.0), "down": (1, -1.0), "forward": (2, 1.0), "back": (2, -1.0)}
TIMES = 3
"""How often a take of the session says all of it."""
MADE = (
    "animate talk.pho -o talk.fap --without all",
    "animate talk.pho -o moving.fap --expression joy:0.6 --seed 4",
    f'say "{SENTENCE}" -o voice.fap --without all',
    "encode talk.fap -o talk.fba",
    "encode talk.fap -o marked.fba --intra-every 6 --start-codes",
    "encode talk.fap --audio voice.wav -o faps.mp4",
    "convert talk.fap -o arkit.csv",
    "convert talk.fap --shapes oculus -o oculus.csv",
    "convert talk.fap --shapes vrm0 -o vrm0.csv",
    "convert talk.fap --shapes vrm1 -o vrm1.csv",
    "animate talk.pho -o rhubarb.json --shapes rhubarb",
    "render talk.fap -o small.mp4 --size 48x48 --audio voice.wav --fps 10",
    "head export default -o head.glb",
    "reduce take.csv -o via.npz --back take.c3d",
    "reduce take.csv -o via.npz --back take.trc",
    "reduce take.csv -o via.npz --back take.npz",
)
"""Commands that make the other inputs, one of the other."""


def write_texts(folder: Path) -> None:
    """Write those that are spelled here into a folder."""
    for name, text in _texts().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def make_inputs(folder: Path) -> None:
    """Write all inputs into a folder."""
    write_texts(folder)
    for path in sorted((TESTS / "fuzz" / "corpus").iterdir()):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "gltf_transform.glb").write_bytes((TESTS / "vectors" / "gltf" / "gltf_transform.glb").read_bytes())
    levels = np.arange(12 * 16 * 3) * 37 % 256
    Image.fromarray(levels.astype(np.uint8).reshape(12, 16, 3)).save(folder / "wall.png")
    for command in MADE[:1]:
        _made(command, folder)
    values = fapengine.load(folder / "talk.fap").values
    _write_markers(folder, values)
    face = _moved(values)
    (folder / "landmarks.json").write_text(trackers.landmarks_json(face))
    (folder / "openface.csv").write_text(trackers.openface_csv(face))
    (folder / "azure.json").write_text(trackers.azure_json())
    (folder / "vmc.osc").write_text(trackers.vmc_osc(values))
    for command in MADE[1:]:
        _made(command, folder)
    _write_stereo(folder / "voice.wav", folder / "two.wav")


def _made(command: str, folder: Path) -> None:
    ran = run(command, folder)
    if ran.code:
        raise AssertionError(f"fapengine {command}: exit code {ran.code}: {ran.err}")


def _texts() -> dict[str, str]:
    texts = {f"timings/{name.replace(' ', '-')}.txt": text for name, text in SAMPLES.items()}
    texts["talk.pho"] = "".join(f"{label} {length_ms}\n" for label, length_ms in PHONES)
    texts["other.pho"] = "_ 50\nm 100\nɑː 200\nb 100\nɑː 150\n_ 50\n"
    texts["odd.lab"] = "0 2000000 m\n2000000 3000000 §§\n3000000 4000000 §§\n4000000 6000000 ay\n"
    texts["arpabet.lab"] = "0 1000000 sh\n1000000 2000000 iy\n2000000 3000000 bcl\n3000000 4000000 pho\n"
    texts["words.align"] = "0 10000 mama\n10000 20000 sil\n20000 30000 papa\n"
    texts["talk.txt"] = f"{SENTENCE}\n"
    texts["empty.fap"] = ""
    texts["broken.fba"] = "no stream"
    texts["corpus.csv"] = "id,text,timings,seed\none,Bright moon.,,1\ntwo,,talk.pho,2\nthree,,other.pho,3\n"
    texts["rows.jsonl"] = "".join(
        json.dumps(row) + "\n"
        for row in ({"id": "a", "timings": "talk.pho"}, {"id": "b/c", "timings": "other.pho", "fps": 25})
    )
    texts["films.csv"] = "id,timings,size,fps\none,other.pho,48x48,8\n"
    texts["bad.csv"] = "id,timings\none,talk.pho\ntwo,missing.pho\n"
    texts["plan.epf"] = "FBM 1 FFR 0 ISI 1 FMT 0 3 3 3 3 3 3 3 3 3 FBM 1 FFR 25 ISI 0"
    texts["marks.txt"] = "[laughs] Oh really? 🤔 Yes.\n"
    texts["speech.ssml"] = '<speak>Hello <break time="200ms"/> <prosody rate="slow">moon</prosody> &amp; pool</speak>'
    texts["map.toml"] = '[shapes]\nsmile = "mouthSmileLeft"\nopen = { 3 = 900.0, 5 = -300.0 }\nrest = "unused"\n'
    texts["S01/session.toml"] = (
        'subject = "S01"\nlanguage = "en-GB"\nunits = "mm"\nup = "+y"\nlicence = "CC0-1.0"\n'
        'head = ["9.1", "9.2", "11.1"]\n'
    )
    texts["quad.obj"] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n"
    texts["quad.ply"] = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    return texts


def _points() -> list[tuple[int, str, int, float]]:
    """FAP number, point, axis and mm for a unit, of the FAPs that move a point along an axis."""
    with (TESTS / "vectors" / "fap_table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = []
    for row in rows:
        axis, sign = AXES.get(row["positive"], (0, 0.0))
        if sign and row["unit"] in UNITS_MM:
            found.append((int(row["number"]), row["point"], axis, sign * UNITS_MM[row["unit"]] / 1024))
    return found


def _moved(values: NDArray[np.int32]) -> dict[str, Array]:
    """(T, 3) mm of each feature point: at rest on our own head, and moved along an axis by its FAPs."""
    head = fapengine.load_head("default")
    names = [name for name in sorted(head.feature_points) if name[0] in "23489" or name.startswith("11.")]
    moved = {name: np.tile(np.asarray(head.point_mm(name), np.float64), (len(values), 1)) for name in names}
    for number, point, axis, unit_mm in _points():
        if point in moved:
            moved[point][:, axis] += values[:, number - 1] * unit_mm
    return moved


def _table(moved: dict[str, Array], rate_hz: float) -> str:
    header = ["frame", "time_s", *(f"{name}_{axis}" for name in moved for axis in "xyz")]
    lines = [",".join(header)]
    for frame in range(len(next(iter(moved.values())))):
        cells = [f"{value:.3f}" for track in moved.values() for value in track[frame]]
        lines.append(",".join([str(frame), f"{frame / rate_hz:.5f}", *cells]))
    return "\n".join(lines) + "\n"


def _write_markers(folder: Path, values: NDArray[np.int32]) -> None:
    """Write a take, and a session of four: the same phones in another order and of another size."""
    (folder / "take.csv").write_text(_table(_moved(values), 30.0))
    for number in range(4):
        order = np.tile(np.roll(np.arange(len(values)), 7 * number), TIMES)
        moved = _moved(values * (10 + number) // 10)
        points = {
            name: track[order] + _trembling(len(order), place) for place, (name, track) in enumerate(moved.items())
        }
        (folder / "S01" / f"take{number}.csv").write_text(_table(points, 30.0))
        phones = "".join(f"{label} {length_ms}\n" for label, length_ms in _rolled(7 * number, len(values)) * TIMES)
        (folder / "S01" / f"take{number}.pho").write_text(phones)


def _trembling(frames: int, place: int) -> Array:
    """(T, 3) mm: what makes every marker's motion its own, as in a recording."""
    turns = np.arange(frames)[:, None] * (0.07 + 0.013 * place) + [0.0, 1.0 + place, 2.0 * place]
    return np.asarray(0.25 * np.sin(turns))


def _rolled(frames: int, count: int) -> list[tuple[str, int]]:
    """Phones from some frame before the end on, then the others: as ``np.roll`` orders the frames."""
    cut_ms = (count - frames) * 1000 // 30
    first, second, at_ms = [], [], 0
    for label, length_ms in PHONES:
        (second if at_ms + length_ms / 2 < cut_ms else first).append((label, length_ms))
        at_ms += length_ms
    return [*first, *second]


def _write_stereo(mono: Path, stereo: Path) -> None:
    with wave.open(str(mono)) as file:
        rate_hz, data = file.getframerate(), np.frombuffer(file.readframes(file.getnframes()), "<i2")
    with wave.open(str(stereo), "wb") as out:
        out.setparams((2, 2, rate_hz, 0, "NONE", ""))
        out.writeframes(np.stack([data, data[::-1] // 3], axis=1).astype("<i2").tobytes())
