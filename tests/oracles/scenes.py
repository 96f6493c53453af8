"""GLB files in Khronos' validator, three.js' AnimationMixer and Blender: no error, and the weights that we meant."""

import asyncio
import functools
import http.server
import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fapengine.app.performance import Performance, speak
from fapengine.app.scene_files import Into, exported_head, save_scene
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from tests.browser.chromium import Browser

SENTENCE = "My baby brother bumped the big blue bowl."
HEADS = ("default", "woman", "man", "child", "older", "random:7")
AVATARS = (".glb", ".vrm")
MAX_ERROR = 1e-5
VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
(async () => {
  for (const path of process.argv.slice(1)) {
    const found = await validator.validateBytes(new Uint8Array(fs.readFileSync(path)), { maxIssues: 10000 });
    const errors = found.issues.messages.filter((message) => message.severity === 0);
    console.log(JSON.stringify([path, found.issues.numErrors, found.issues.numWarnings, errors.slice(0, 3)]));
  }
})();
"""
PLAY = """
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
window.play = async (url, times) => {
  const gltf = await new GLTFLoader().loadAsync(url);
  const mixer = new THREE.AnimationMixer(gltf.scene);
  const action = mixer.clipAction(gltf.animations.at(-1)).play();
  [action.loop, action.clampWhenFinished] = [THREE.LoopOnce, true];  // else the last time would be the first
  const shown = {};
  gltf.scene.traverse((one) => {
    if (one.morphTargetDictionary) shown[one.name] = { names: one.morphTargetDictionary, rows: [] };
  });
  const head = gltf.scene.getObjectByName('Head');
  const turns = [];
  for (const time of times) {
    mixer.setTime(time);
    gltf.scene.traverse((one) => { if (shown[one.name]) shown[one.name].rows.push([...one.morphTargetInfluences]); });
    turns.push(head ? head.quaternion.toArray() : null);
  }
  return { shown, turns };
};
window.ready = true;
"""
PAGE = f"""<!doctype html><script type="importmap">{{"imports": {{"three": "/node_modules/three/build/three.module.js",
"three/addons/": "/node_modules/three/examples/jsm/"}}}}</script><script type="module">{PLAY}</script>"""
BLENDER = """
import bpy, json, numpy, sys
numpy.bool = bool  # Debian's add-on asks for it, and Debian's NumPy has it no more
path, frames = sys.argv[-2], int(sys.argv[-1])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 30
bpy.ops.import_scene.gltf(filepath=path)
rows = []
for frame in range(frames):
    bpy.context.scene.frame_set(frame)
    keys = [one.data.shape_keys.key_blocks for one in bpy.data.objects if one.type == 'MESH' and one.data.shape_keys]
    rows.append({block.name: block.value for blocks in keys for block in blocks})
print('ROWS ' + json.dumps(rows))
"""


@functools.cache
def said() -> Performance:
    """Say the sentence at 30 Hz, once: a voice that has spoken says it a little otherwise."""
    return speak(SENTENCE, rate_hz=30.0)


def write_scenes(folder: Path, avatars: Path) -> list[Path]:
    """Write our heads, one with the sentence inside, and every avatar of a folder with it."""
    folder.mkdir(parents=True, exist_ok=True)
    track, paths = said().track, []
    for name in HEADS:
        paths.append(folder / f"{name.replace(':', '-')}.glb")
        paths[-1].write_bytes(exported_head(name))
    for keys in ("linear", "cubic"):
        paths.append(folder / f"spoken-{keys}.glb")
        save_scene(paths[-1], track, Into(folder / "default.glb", keys=keys), name="talk")
    paths.append(folder / "spoken.vrma")
    save_scene(paths[-1], track, None, name="talk")
    for avatar in sorted(path for path in avatars.glob("*") if path.suffix in AVATARS):
        paths.append(folder / f"avatar-{avatar.stem}.glb")
        print(f"{avatar.name}: {save_scene(paths[-1], track, Into(avatar), name='talk')}")
    return paths


def check_with_validator(paths: list[Path], node_modules: Path) -> None:
    """Let Khronos' gltf-validator look at files: no error in any."""
    command = ["node", "-e", VALIDATE, *map(str, paths)]
    done = subprocess.run(command, cwd=node_modules.parent, capture_output=True, text=True, check=True)
    for line in done.stdout.splitlines():
        path, errors, warnings, some = json.loads(line)
        print(f"gltf-validator: {Path(path).name}: {errors} errors, {warnings} warnings")
        assert errors == 0, some
    assert len(done.stdout.splitlines()) == len(paths)


def check_with_three(folder: Path, node_modules: Path) -> None:
    """Let three.js play the sentence on our head: the weights that we meant, at frames and between them."""
    track = said().track
    weights = approximate_arkit(track.values.astype(np.float64))
    times = np.arange(2 * len(track) - 1) / 2 / track.rate_hz
    wanted = np.stack([np.interp(times, track.times_s, column) for column in weights.T], axis=1)
    (folder / "index.html").write_text(PAGE)
    link = folder / "node_modules"
    if not link.exists():
        link.symlink_to(node_modules)
    with served(folder) as url:
        found = asyncio.run(_played(url, "spoken-linear.glb", times.tolist()))
    worst = 0.0
    for mesh in found["shown"].values():
        rows = np.array(mesh["rows"])
        for name, column in mesh["names"].items():
            if name in ARKIT_NAMES:
                worst = max(worst, float(np.abs(rows[:, column] - wanted[:, ARKIT_NAMES.index(name)]).max()))
    print(f"three.js: {len(found['shown'])} meshes, {len(times)} times; weights at most {worst:.1e} off")
    assert len(found["shown"]) >= 5
    assert worst <= MAX_ERROR
    assert np.ptp(np.array(found["turns"]), axis=0).max() > 0.005  # the head moves


async def _played(url: str, name: str, times: list[float]) -> Any:
    async with Browser((400, 300)) as browser:
        await browser.open(f"{url}/index.html")
        await browser.until("window.ready", 60.0)
        return await browser.run(f"play('/{name}', {json.dumps(times)})")


def check_with_blender(folder: Path) -> None:
    """Let Blender open the sentence on our head: its mouth opens and shuts at the frames at which it should."""
    if shutil.which("blender") is None:
        print("blender: absent (apt-get install blender), NOT TRIED")
        return
    track = said().track
    script = folder / "blender.py"
    script.write_text(BLENDER)
    command = ["blender", "-b", "--factory-startup", "-P", str(script), "--", str(folder / "spoken-linear.glb")]
    done = subprocess.run([*command, str(len(track))], capture_output=True, text=True, check=True)
    told = [line[5:] for line in done.stdout.splitlines() if line.startswith("ROWS ")]
    assert told, done.stdout + done.stderr
    rows = json.loads(told[0])
    weights = approximate_arkit(track.values.astype(np.float64))
    for name in ("jawOpen", "mouthClose"):
        shown = np.array([row[name] for row in rows])
        off = np.abs(shown - weights[:, ARKIT_NAMES.index(name)]).max()
        print(f"blender: {name} opens most at frame {shown.argmax()}; at most {off:.1e} off")
        assert shown.argmax() == weights[:, ARKIT_NAMES.index(name)].argmax()
        assert off <= MAX_ERROR


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder on a free port of this machine alone."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
