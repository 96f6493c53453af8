"""Our head in the programs that load it: it speaks there, its lips open on ɑ and meet on m, and a picture shows both.

TalkingHead, three.js and three-vrm run in Chromium, Godot 3 and Blender on their own (what Blender reads is compared in
``scenes.py``). Each moves the vertices by its own code. In the browser the height of the opening between the inner lips
at their middle is measured, beyond that of the head at rest.
"""

import asyncio
import base64
import functools
import io
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bench.retarget import fractions_of
from fapengine.app.performance import Performance, speak
from fapengine.app.scene_files import export_head
from fapengine.files.gltf.writing import Writer
from fapengine.files.heads.load import load_head
from fapengine.files.motion import as_visemes
from fapengine.mesh.face_mesh import Material
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.moods import MOODS
from fapengine.retarget.rig_weights import OCULUS_SPELLINGS
from fapengine.retarget.skeleton import BODY, FACE
from fapengine.retarget.visemes import OCULUS_NAMES, VRM1_NAMES, approximate_presets, approximate_visemes
from tests.browser.chromium import Browser
from tests.oracles.scenes import check_with_validator, served
from tests.processes import start

Array = NDArray[np.float64]
HEAD, TEXT = "woman", "My mama bought a bomb."
LANGUAGES = {
    "en-us": (
        "My mama bought a bomb.",
        "Peter put a big pumpkin above the barn.",
        "Bob's baby might prefer the blue map.",
    ),
    "de": (
        "Meine Mama backt braunes Brot.",
        "Am Bahnhof parkt ein blauer Bus.",
        "Paul probiert die Pommes mit dem Papa.",
    ),
    "es": ("Mi mamá compra pan para Pepe.", "El bombero bebe bien por la mañana.", "Pablo busca un mapa de Perú."),
}
"""Three texts in each of three languages, by the voice that says them."""
SETS = ("arkit", "oculus", "mpeg4", "vrm")
OPEN_MM, CLOSED_MM = 5.0, 0.5
"""Least opening on ɑ, and largest on m, in every program."""
MAX_STEP = {"arkit": 0.35, "oculus": 0.35, "vrm": 0.35, "mpeg4": 1.0}
"""Largest change of a weight in 1/60 s. FAP 1 shows two visemes at a time, so that a third one begins at once."""
ANGLE_DEG = 11.3
"""Direction of a target 0.2 m aside and below at 1 m."""
GODOT = ("xvfb-run", "-a", "-s", "-screen 0 640x640x24", "godot3", "--audio-driver", "Dummy", "--resolution", "480x480")
PAGES = Path(__file__).resolve().parent / "pages"
SIZE = (480, 620)
"""Of a picture, px."""


def lip_vertices() -> tuple[int, int]:
    """Vertices of the inner lips' middle, above and below, in the part ``Face`` of the exported head."""
    mesh = load_head(HEAD)
    skin = mesh.triangles[np.isin(mesh.material[mesh.triangles[:, 0]], (Material.SKIN, Material.LIP))]
    used = np.unique(skin)
    above, below = (int(np.searchsorted(used, mesh.feature_points[point])) for point in ("2.2", "2.3"))
    return above, below


@functools.cache
def said(text: str = TEXT, voice: str = "en-us") -> Performance:
    """Say a text at 60 Hz, once."""
    return speak(text, voice=voice, rate_hz=60.0)


def write_page(folder: Path, name: str, imports: dict[str, str]) -> None:
    """Write a page with one of the modules of ``pages``; ``imports`` are its libraries' addresses."""
    code = (PAGES / f"{name}.mjs").read_text()
    (folder / f"{name}.html").write_text(
        "<!doctype html><meta charset=utf-8><style>body { margin: 0; height: 100vh }</style>"
        f"<script>window.LIPS = {json.dumps(lip_vertices())}</script>"
        f'<script type="importmap">{json.dumps({"imports": imports})}</script><script type="module">{code}</script>'
    )


def save_pair(folder: Path, program: str, opened: Image.Image, closed: Image.Image) -> None:
    """Write two pictures side by side, the open mouth first; they differ."""
    folder.mkdir(parents=True, exist_ok=True)
    both = Image.new("RGB", (opened.width + closed.width, opened.height))
    both.paste(opened, (0, 0))
    both.paste(closed, (opened.width, 0))
    both.save(folder / f"{program}.webp", quality=80)
    assert np.abs(np.asarray(opened, int) - np.asarray(closed, int)).max() > 40, (
        f"{program}: both pictures are the same"
    )


class Page:
    """A head in a program that runs in the browser. Stateful."""

    def __init__(self, browser: Browser) -> None:
        self.run = browser.run

    async def openings(self, names: list[str], rows: Array) -> Array:
        """(T,) mm beyond rest, for weights (T, N) of shapes."""
        return np.array(
            await self.run(f"avatar.openings({json.dumps(names)}, {json.dumps(np.round(rows, 6).tolist())})")
        )

    async def picture(self, names: list[str], row: Array) -> Image.Image:
        """What the program draws for weights (N,) of shapes."""
        address = await self.run(f"avatar.draw({json.dumps(dict(zip(names, row.tolist(), strict=True)))})")
        with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as drawn:
            shown = Image.new("RGB", drawn.size, "white")
            shown.paste(drawn, mask=drawn.getchannel("A") if drawn.mode == "RGBA" else None)
            return shown


@asynccontextmanager
async def loaded(url: str, name: str, avatar: str) -> AsyncIterator[Page]:
    """Open a page, and load an avatar in it."""
    async with Browser(SIZE) as browser:
        await browser.open(f"{url}/{name}")
        await browser.until("window.ready", 120.0)
        await browser.run(f"load('/{avatar}')")
        yield Page(browser)


def weights_of(performance: Performance, key: str) -> tuple[list[str], Array]:
    """Names of a set's shapes in our files, and (T, N) weights."""
    values, rate_hz = performance.track.filled_values().astype(np.float64), performance.track.rate_hz
    match key:
        case "arkit":
            return list(ARKIT_NAMES), approximate_arkit(values)
        case "oculus":
            return shape_names(), approximate_visemes(values, rate_hz)
        case "vrm":
            return list(VRM1_NAMES), approximate_presets(values, rate_hz)
    return shape_names(), fractions_of(as_visemes(performance.track))


def shape_names() -> list[str]:
    """Names in our files of MPEG-4's visemes, which are Oculus' number for number."""
    return [f"viseme_{OCULUS_SPELLINGS[name.lower()]}" for name in OCULUS_NAMES]


def closures(performance: Performance, openings_mm: Array) -> tuple[int, int]:
    """How many runs of p b m are closed somewhere, and how many there are."""
    runs: list[list[float]] = []
    for phone in performance.phones.phones:
        if phone.label in ("p", "b", "m"):
            if runs and phone.start_s <= runs[-1][1] + 1e-6:
                runs[-1][1] = phone.end_s
            else:
                runs.append([phone.start_s, phone.end_s])
    frames = [
        slice(int(start * performance.track.rate_hz), int(end * performance.track.rate_hz) + 1) for start, end in runs
    ]
    return sum(bool(openings_mm[each].min() < CLOSED_MM) for each in frames), len(frames)


def judge(program: str, performance: Performance, openings_mm: Array) -> tuple[int, int]:
    """Print what was measured; fail if no vowel opens the mouth or a closure is lost. Frames of both pictures."""
    kept, wanted = closures(performance, openings_mm)
    print(f"{program}: lips {openings_mm.max():.1f} mm open at most, {kept} of {wanted} closures")
    assert openings_mm.max() > OPEN_MM
    assert kept == wanted
    closing = next(phone for phone in performance.phones.phones if phone.label == "m")
    closed = slice(int(closing.start_s * 60), int(closing.end_s * 60) + 1)
    return int(openings_mm.argmax()), closed.start + int(openings_mm[closed].argmin())


def check_talking_head(folder: Path) -> None:
    """Let TalkingHead say our visemes by its own lip sync (their sound is silence), and show our weights."""
    export_head(HEAD, folder / "mixamo.glb", "mixamo")
    package = "node_modules/@met4citizen/talkinghead"
    own = (folder / package / "node_modules/three").exists()
    three = f"/{package}/node_modules/three" if own else "/node_modules/three"
    imports = {"talkinghead": f"/{package}/modules/talkinghead.mjs"} | three_at(three)
    write_page(folder, "talkinghead", imports)
    asyncio.run(_talk(folder))


async def _talk(folder: Path) -> None:
    spelled = [(OCULUS_SPELLINGS[name.lower()], start, end) for name, start, end in said().visemes("oculus")]
    visemes = {
        "visemes": [name for name, _, _ in spelled], "vtimes": [1000 * start for _, start, _ in spelled],
        "vdurations": [1000 * (end - start) for _, start, end in spelled],
    }  # fmt: skip
    names, rows = weights_of(said(), "oculus")
    with served(folder) as url:
        async with loaded(url, "talkinghead.html", "mixamo.glb") as shown:
            spoken = np.array(await shown.run(f"speak({json.dumps(visemes)}, {int(30 * said().duration_s) + 30})"))
            openings = await shown.openings(names, rows)
            joints = (await shown.run("avatar.facts()"))["joints"]
            opened, closed = judge("TalkingHead, our weights", said(), openings)
            pictures = [await shown.picture(names, rows[frame]) for frame in (opened, closed)]
    on_p = spoken[spoken[:, 1].argmax(), 0]
    print(f"TalkingHead, its own lip sync: lips {spoken[:, 0].max():.1f} mm open at most, {on_p:.1f} on PP")
    print(f"TalkingHead: {joints} joints")
    save_pair(folder / "pictures", "talkinghead", *pictures)
    assert spoken[:, 0].max() > OPEN_MM
    assert on_p < 0.3 * spoken[:, 0].max()


def three_at(folder: str) -> dict[str, str]:
    """Addresses of three.js in a folder of the page's server."""
    return {"three": f"{folder}/build/three.module.js", "three/addons/": f"{folder}/examples/jsm/"}


def check_three(folder: Path) -> None:
    """Let three.js show our weights on a GLB, and three-vrm on a VRM, whose bones, expressions and gaze it reads."""
    export_head(HEAD, folder / "head.glb")
    export_head(HEAD, folder / "head.vrm")
    vrm = {"@pixiv/three-vrm": "/node_modules/@pixiv/three-vrm/lib/three-vrm.module.js"}
    write_page(folder, "three", three_at("/node_modules/three") | vrm)
    asyncio.run(_three(folder))


def check_closures(folder: Path) -> None:
    """Let three.js and three-vrm move the lips by each set of weights: all closures of all texts are kept."""
    asyncio.run(_closures(folder))


async def _closures(folder: Path) -> None:
    with served(folder) as url:
        for key in SETS:
            kept = wanted = 0
            step = 0.0
            async with loaded(url, "three.html", "head.vrm" if key == "vrm" else "head.glb") as shown:
                for voice, texts in LANGUAGES.items():
                    for text in texts:
                        names, rows = weights_of(said(text, voice), key)
                        met, all_of_it = closures(said(text, voice), await shown.openings(names, rows))
                        kept, wanted = kept + met, wanted + all_of_it
                        step = max(step, float(np.abs(np.diff(rows[:, mouth_of(names)], axis=0)).max()))
            program = "three-vrm" if key == "vrm" else "three.js"
            print(f"{program}, {key}: {kept} of {wanted} closures, largest step of a weight {step:.2f} in 1/60 s")
            assert kept == wanted
            assert step <= MAX_STEP[key]


def mouth_of(names: list[str]) -> list[int]:
    """Columns of shapes that move the mouth: not eyes, lids, brows, nose or cheeks, nor moods."""
    others = ("eye", "brow", "nose", "cheek", "blink", "look", *MOODS, "relaxed", "neutral")
    return [column for column, name in enumerate(names) if not name.startswith(others)]


async def _three(folder: Path) -> None:
    with served(folder) as url:
        for program, avatar, key in (("three.js", "head.glb", "arkit"), ("three-vrm", "head.vrm", "vrm")):
            names, rows = weights_of(said(), key)
            async with loaded(url, "three.html", avatar) as shown:
                opened, closed = judge(program, said(), await shown.openings(names, rows))
                pictures = [await shown.picture(names, rows[frame]) for frame in (opened, closed)]
                if key == "vrm":
                    await _judge_vrm(shown)
            save_pair(folder / "pictures", program, *pictures)


async def _judge_vrm(shown: Page) -> None:
    facts = await shown.run("avatar.facts()")
    missing = {*VRM1_NAMES, *ARKIT_NAMES} - set(facts["expressions"])
    left, down = await shown.run("avatar.look(0.2, -0.2, 1.0)")
    print(f"three-vrm: {len(facts['bones'])} bones, {len(facts['expressions'])} expressions")
    print(f"three-vrm: eyes turn {left:.1f} degrees to the left, {down:.1f} down")
    assert not missing, missing
    assert len(facts["bones"]) == len(BODY) * 2 - 4 + len(FACE)
    assert "ICT" in facts["meta"]["thirdPartyLicenses"]
    assert abs(left - ANGLE_DEG) < 1.5
    assert abs(down - ANGLE_DEG) < 1.5


def check_godot(folder: Path) -> None:
    """Let Godot 3 import the head and draw it with our weights; the file has no sparse accessors.

    Godot 3.2.3 takes the number of all vertices for that of the sparse ones, so that most shapes move nothing. A window
    needs Xvfb.
    """
    if not (shutil.which("godot3") and shutil.which("xvfb-run")):
        print("godot3 or xvfb-run: absent (apt-get install godot3 xvfb), NOT TRIED")
        return
    place = folder / "godot"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    with patch.object(Writer, "sparse", lambda writer, values: writer.accessor(np.float32(values), bounds=True)):
        export_head(HEAD, place / "head.glb", "mixamo")
    (place / "project.godot").write_text("config_version=4\n")
    shutil.copy(PAGES / "show.gd", place)
    wanted = write_poses(place)
    _import(place)
    done = subprocess.run([*GODOT, "--path", str(place), "-s", "show.gd"], capture_output=True, text=True, timeout=300)
    told = [line for line in done.stdout.splitlines() if line.startswith(("joints", "jawOpen"))]
    assert len(told) == 3, done.stdout + done.stderr
    shown = [float(line.split()[1]) for line in told[1:]]
    print(f"Godot 3: {told[0]}; jawOpen {shown[0]:.2f} and {shown[1]:.2f}")
    judge_pictures(folder, "godot", [place / f"{name}.png" for name in wanted])
    assert np.allclose(shown, list(wanted.values()), atol=1e-4)


def check_blender(folder: Path) -> None:
    """Let Blender draw the head with our weights."""
    if not shutil.which("blender"):
        print("blender: absent (apt-get install blender python3-numpy), NOT TRIED")
        return
    place = folder / "blender"
    place.mkdir(exist_ok=True)
    export_head(HEAD, place / "head.glb", "mixamo")
    wanted = write_poses(place)
    script = ["-P", str(PAGES / "show_blender.py"), "--", str(place / "head.glb"), str(place / "poses.json")]
    subprocess.run(["blender", "-b", "--factory-startup", *script], check=True, capture_output=True, timeout=600)
    judge_pictures(folder, "blender", [place / f"blender-{name}.png" for name in wanted])


def write_poses(place: Path) -> dict[str, float]:
    """Write ``poses.json``, the mouth at its widest and on an m; returns their weights of ``jawOpen``."""
    names, rows = weights_of(said(), "arkit")
    jaw, close = rows[:, names.index("jawOpen")], rows[:, names.index("mouthClose")]
    frames = {"open": int((jaw - close).argmax()), "closed": closure_frame(said(), close)}
    poses = [
        {"name": name, "weights": {names[column]: float(rows[frame, column]) for column in mouth_of(names)}}
        for name, frame in frames.items()
    ]
    (place / "poses.json").write_text(json.dumps(poses))
    return {name: float(jaw[frame]) for name, frame in frames.items()}


def judge_pictures(folder: Path, program: str, paths: list[Path]) -> None:
    """Fail if two pictures, an open and a closed mouth, do not differ mostly at the mouth."""
    opened, closed = (Image.open(path).convert("RGB") for path in paths)
    save_pair(folder / "pictures", program, opened, closed)
    apart = np.abs(np.asarray(opened, int) - np.asarray(closed, int)).max(axis=2) > 40
    print(f"{program}: {apart.sum()} pixels differ between an open and a closed mouth")
    height, width = apart.shape
    mouth = apart[int(0.45 * height) : int(0.75 * height), int(0.35 * width) : int(0.65 * width)]
    assert mouth.sum() > 200
    assert mouth.sum() > 0.8 * apart.sum()


def closure_frame(performance: Performance, close: Array) -> int:
    """Frame of the second m at which the weight of ``mouthClose``, (T,), is largest."""
    phone = [phone for phone in performance.phones.phones if phone.label == "m"][1]
    first, last = int(phone.start_s * 60), int(phone.end_s * 60) + 1
    return first + int(close[first:last].argmax())


def _import(place: Path) -> None:
    """Import the project's files by Godot's editor, which does not end by itself."""
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    with start([*GODOT, "--editor", "--quit", "--path", str(place)], **silent) as editor:
        stop_s = time.monotonic() + 300
        try:
            while not list((place / ".import").glob("*.md5")):
                assert editor.poll() is None, "Godot's editor ended without an import"
                assert time.monotonic() < stop_s, "Godot's editor does not import"
                time.sleep(0.5)
        finally:
            os.killpg(editor.pid, signal.SIGKILL)  # xvfb-run, its X server and the editor


def check_programs(root: Path) -> None:
    """Let every program show our head; pictures lie in ``programs/pictures``."""
    folder = root / "programs"
    folder.mkdir(parents=True, exist_ok=True)
    link = folder / "node_modules"
    if not link.exists():
        link.symlink_to((root / "node_modules").resolve())
    check_talking_head(folder)
    check_three(folder)
    check_closures(folder)
    check_godot(folder)
    check_blender(folder)
    check_with_validator(
        [(folder / name).resolve() for name in ("mixamo.glb", "head.glb", "head.vrm")], root / "node_modules"
    )
