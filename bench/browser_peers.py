"""A peer of the renderer that lives in a browser: headless Chromium on the same software OpenGL.

    python -m bench.browser_peers NAME FOLDER

Speaks as ``bench/render_peers.py`` does (``ready``, then seconds for each number of frames asked for), and reads the
same ``FOLDER/mesh.npz``. ``three.js`` draws as its users do: standard material, three lights, 4x multisampling;
``three.js, bare`` without smooth edges and with the cheaper Phong material; ``three.js, morphs`` deforms by itself, one
morph target a channel, as a head with shapes is drawn there. ``our page`` is the page of ``fapengine serve`` with the
default head, deformed from FAPs. All read every picture back. three.js is fetched by npm, once, into ``out/threejs``.
"""

import asyncio
import base64
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from aiohttp import web

from bench.talking import talking_face
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import channel_weights
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.packing import normal_deltas
from fapengine.server.web.app import page_files
from tests.browser.chromium import Browser, find_chromium

NAMES = ("three.js", "three.js, bare", "three.js, morphs", "our page")
THREE = "three@0.170.0"
FOLDER = Path(__file__).resolve().parent.parent / "out" / "threejs"
FRAMES = 20


def three_js() -> bytes:
    """Fetch the library, as npm hands it out."""
    module = FOLDER / "node_modules" / "three" / "build" / "three.module.js"
    if not module.is_file():
        npm = shutil.which("npm")
        if npm is None:
            raise SystemExit("npm is not installed")
        FOLDER.mkdir(parents=True, exist_ok=True)
        command = [npm, "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(FOLDER), THREE]
        if subprocess.run(command, capture_output=True, check=False).returncode or not module.is_file():
            raise SystemExit(f"npm cannot fetch {THREE}")
    return module.read_bytes()


def morphs(head: FaceMesh, faps: np.ndarray) -> dict[str, np.ndarray]:
    """Every channel as a dense morph target, for 1000 FAPU, and how far it goes in each frame."""
    basis = head.basis
    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    targets = np.zeros((2, basis.width, len(head.vertices_mm), 3), "f4")
    targets[0, basis.entry_channels, vertex] = 1000 * basis.entry_mm
    targets[1, basis.entry_channels, vertex] = 1000 * normal_deltas(head)
    return {"targets": targets, "influences": channel_weights(basis, faps).astype("f4") / 1000}


def contents(name: str, folder: Path) -> dict[str, tuple[str, bytes]]:
    """Path to kind and bytes of what the browser may fetch."""
    head = build_head()
    faps = talking_face(100).values[:FRAMES]
    arrays: dict[str, np.ndarray] = {"faps": faps.astype("f4")}
    files: dict[str, tuple[str, bytes]] = {}
    if name == "our page":
        files |= page_files(head, {})
    else:
        with np.load(folder / "mesh.npz") as mesh:
            arrays |= {key: mesh[key] for key in ("positions", "normals", "colours", "triangles")}
        if name == "three.js, morphs":
            arrays |= morphs(head, faps)
        files["/three.module.js"] = ("text/javascript", three_js())
    for key, array in arrays.items():
        files[f"/{key}.bin"] = ("application/octet-stream", np.ascontiguousarray(array).tobytes())
    script = Path(__file__).with_name("browser_peers.js").read_bytes()
    page = b'<!doctype html><link rel="icon" href="data:,"><script type="module" src="/bench.js"></script>'
    return files | {"/bench.js": ("text/javascript", script), "/bench.html": ("text/html", page)}


async def run(name: str, folder: Path) -> None:
    app = web.Application()
    for path, (kind, body) in contents(name, folder).items():
        app.router.add_get(path, lambda _, kind=kind, body=body: _answer(kind, body))
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    port = runner.addresses[0][1]
    async with Browser((600, 600)) as browser:
        await browser.open(f"http://127.0.0.1:{port}/bench.html?{name.replace(' ', '%20')}")
        await browser.until("window.draw || window.trouble", 60)
        if trouble := await browser.run("window.trouble"):
            raise SystemExit(trouble)
        await browser.run("draw(3)")
        pixels = base64.b64decode(await browser.run("picture()"))
        np.save(folder / f"{name}.npy", np.frombuffer(pixels, "u1").reshape(512, 512, 4)[::-1, :, :3])
        print("ready", flush=True)
        while line := await asyncio.to_thread(sys.stdin.readline):
            print(await browser.run(f"draw({int(line)})"), flush=True)


async def _answer(kind: str, body: bytes) -> web.Response:
    return web.Response(body=body, content_type=kind)


if __name__ == "__main__":
    if find_chromium() is None:
        raise SystemExit("no Chromium on this machine")
    asyncio.run(run(sys.argv[1], Path(sys.argv[2])))
