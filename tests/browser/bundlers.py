"""The packed npm package in projects of others: React, Vue and Svelte with types, built by Vite; Node without a DOM."""

import contextlib
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.browser.chromium import Browser
from tests.processes import free_port, start

PAGE = """<!doctype html><html lang="en"><title>A shop</title><link rel="icon" href="data:," />
<div id="root"></div><script type="module" src="./main.{kind}"></script></html>"""
REACT = """import { StrictMode, useEffect, useRef } from "react";
import { createRoot } from "react-dom/client";
import "fapengine-face/react";
import type { FapFace } from "fapengine-face";

function Shop() {
  const face = useRef<FapFace>(null);
  useEffect(() => {
    face.current!.addEventListener("error", ({ detail }) => (document.title = detail.slice(0, 200)));
  }, []);
  return <fap-face ref={face} camera="front" transparent={true} style={{ width: "20rem" }} />;
}
createRoot(document.getElementById("root")!).render(<StrictMode><Shop /></StrictMode>);
"""
VUE = """import { createApp } from "vue";
import Shop from "./Shop.vue";

createApp(Shop).mount("#root");
"""
SHOP = """<script setup lang="ts">
import "fapengine-face/vue";

const heard = (label: string) => label.length;
</script>
<template>
  <fap-face camera="front" style="width: 20rem" edges="soft" @phone="({ detail }) => heard(detail.label)" />
  <!-- @vue-expect-error there are no such edges -->
  <fap-face hidden edges="round" />
  <!-- @vue-expect-error a label is text -->
  <fap-face hidden @phone="({ detail }) => detail.label.toFixed()" />
</template>
"""
SVELTE = """import { mount } from "svelte";
import Shop from "./Shop.svelte";

mount(Shop, { target: document.getElementById("root")! });
"""
SVELTE_SHOP = """<script lang="ts">
  import "fapengine-face/svelte";
  import type { SvelteHTMLElements } from "svelte/elements";

  const heard = (label: string) => label.length;
  // @ts-expect-error: there are no such edges
  export const round: SvelteHTMLElements["fap-face"] = { edges: "round" };
  // @ts-expect-error: a label is text
  export const counted: SvelteHTMLElements["fap-face"] = { onphone: ({ detail }) => detail.label.toFixed() };
</script>
<fap-face camera="front" style="width: 20rem" edges="soft" onphone={({ detail }) => heard(detail.label)}></fap-face>
"""
CONFIGURATIONS = {
    "react": 'import react from "@vitejs/plugin-react";\nexport default { base: "./", plugins: [react()] };\n',
    "vue": 'import vue from "@vitejs/plugin-vue";\nconst isCustomElement = (tag) => tag === "fap-face";\n'
    'export default { base: "./", plugins: [vue({ template: { compilerOptions: { isCustomElement } } })] };\n',
    "svelte": 'import { svelte } from "@sveltejs/vite-plugin-svelte";\n'
    'export default { base: "./", plugins: [svelte()] };\n',
}
CHECKS = {
    "react": ("typescript/bin/tsc",),
    "vue": ("vue-tsc/bin/vue-tsc.js", "--noEmit"),
    "svelte": ("svelte-check/bin/svelte-check", "--tsconfig", "./tsconfig.json", "--fail-on-warnings"),
}
"""What checks the types of each."""
TYPED = {
    "compilerOptions": {
        "strict": True, "noEmit": True, "jsx": "react-jsx", "module": "esnext", "moduleResolution": "bundler",
        "target": "es2022", "lib": ["es2022", "dom"], "types": [],
    },
    "include": ["main.*", "Shop.*"],
}  # fmt: skip
FILES = {
    "react": {"index.html": PAGE.format(kind="tsx"), "main.tsx": REACT, "tsconfig.json": json.dumps(TYPED)},
    "vue": {"index.html": PAGE.format(kind="ts"), "main.ts": VUE, "Shop.vue": SHOP, "tsconfig.json": json.dumps(TYPED)},
    "svelte": {
        "index.html": PAGE.format(kind="ts"),
        "main.ts": SVELTE,
        "Shop.svelte": SVELTE_SHOP,
        "tsconfig.json": json.dumps(TYPED),
    },
}
HEARS = """document.querySelector("fap-face").hear(new OscillatorNode(new AudioContext()))
    .then((heard) => heard.constructor.name)"""
"""Its worker, worklet and tables are where the built site has them."""
SEEN = "document.querySelector('fap-face')?.picture?.count > 0"


def project(modules: Path, package: Path, name: str) -> Path:
    """Make a project beside the installed packages, with ours in it; returns its folder."""
    folder = modules.parent / "projects" / name
    own = folder / "node_modules"
    # A copy, as npm makes it: through a link, TypeScript looks for React beside the package's real folder.
    shutil.copytree(package, own / "fapengine-face", dirs_exist_ok=True)
    for file, text in {**FILES[name], "vite.config.js": CONFIGURATIONS[name]}.items():
        (folder / file).write_text(text)
    (folder / "package.json").write_text(json.dumps({"name": name, "private": True, "type": "module"}))
    return folder


def built(modules: Path, package: Path, name: str) -> Path:
    """Build a project; returns the folder of its site."""
    folder = project(modules, package, name)
    program, *options = CHECKS[name]
    subprocess.run(["node", str(modules / program), *options], cwd=folder, check=True, timeout=300)
    vite = modules / "vite" / "bin" / "vite.js"
    subprocess.run(["node", str(vite), "build", "--logLevel", "warn"], cwd=folder, check=True, timeout=300)
    return folder / "dist"


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[str]:
    """Serve a folder; its address."""
    port = free_port()
    command = [sys.executable, "-u", "-m", "http.server", str(port), "--bind", "127.0.0.1", "--directory", str(folder)]
    with start(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        assert process.stdout.readline()  # it listens
        try:
            yield f"http://127.0.0.1:{port}/"
        finally:
            process.terminate()


async def check_bundlers(modules: Path, package: Path) -> None:
    """Each built site shows a face, which follows sound."""
    for name in FILES:
        with opened(built(modules, package, name)) as url:
            async with Browser((400, 400)) as browser:
                await browser.open(url)
                await browser.until(SEEN, 180)
                picture = await browser.picture()
                assert await browser.run(HEARS) == "DelayNode"
                assert await browser.run("document.title") == "A shop"
        levels = picture[100:250, 100:250].astype(int).std(axis=(0, 1)).max()
        assert levels > 20, f"{name}: got a picture of one colour ({levels:.1f}), expected a face"
        print(f"{name}, Vite: the face is seen, and hears")


def check_node(package: Path) -> None:
    """A program without a DOM, such as one that renders pages on a server, may import the package."""
    code = (
        f"import({json.dumps((package / 'index.js').resolve().as_uri())}).then((all) => console.log(Object.keys(all)))"
    )
    told = subprocess.run(["node", "-e", code], capture_output=True, text=True, check=False, timeout=300)
    assert "FapFace" in told.stdout, told.stderr
