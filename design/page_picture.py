"""docs/pictures/page.jpg: the page of ``fapengine serve`` while it speaks, as headless Chromium shows it.

python -m design.page_picture
"""

import asyncio
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from tests.browser.chromium import Browser

ROOT = Path(__file__).resolve().parent.parent
SERVER = ROOT / "tests" / "browser" / "serve_page.py"
PORT = 8119
SENTENCE = "Bright sunshine shimmers on the ocean."
SMILE = """(() => {
    const one = document.getElementById("expression-joy");
    one.value = 0.5;
    one.dispatchEvent(new Event("input"));
})()"""
HOLD = """(() => {
    const faps = Float32Array.from(page.faps);
    const shown = page.cushion.sample(performance.now() / 1000, new Float32Array(68));
    page.cushion.sample = (now, into) => { into.set(faps); return { ...shown, faps: into }; };
    page.presence.at = () => 1;
    Object.defineProperty(page, "wantsFineEdges", { get: () => true });
    page.resized = true;
})()"""
"""The face as it is now, with the edges that a graphics card draws."""


async def show() -> tuple[Image.Image, Image.Image]:
    async with Browser((1280, 837)) as browser:
        await browser.open(f"http://127.0.0.1:{PORT}/?session=anna")
        await browser.until("document.body.dataset.connection === 'connected' && page.cushion.frames.length > 30", 30)
        await browser.run(
            "page.budget.add = () => false; page.hasChosenSilence = true; page.camera = { ...page.camera, yaw: 14 }"
        )
        await browser.run("document.querySelector('.faps details').open = true;" + SMILE)
        await asyncio.sleep(1.5)
        await browser.run(
            f"document.getElementById('text').value = {SENTENCE!r}; document.getElementById('say').click()"
        )
        await browser.until("document.getElementById('phone').textContent === 'aɪ'")
        await browser.run(HOLD)
        await asyncio.sleep(1.0)
        wide = await browser.picture()
        await browser.call(
            "Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1.5, mobile=True
        )
        await asyncio.sleep(1.0)
        narrow = await browser.picture()
    return Image.fromarray(wide), Image.fromarray(narrow)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(SERVER), str(PORT), f"{folder}/head"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            server.stdout.readline()
            try:
                wide, narrow = asyncio.run(show())
            finally:
                server.terminate()
    narrow = narrow.resize((round(narrow.width * wide.height / narrow.height), wide.height), Image.Resampling.LANCZOS)
    both = Image.new("RGB", (wide.width + 24 + narrow.width, wide.height), "white")
    both.paste(wide, (0, 0))
    both.paste(narrow, (wide.width + 24, 0))
    both.save(ROOT / "docs" / "pictures" / "page.jpg", quality=82)


if __name__ == "__main__":
    main()
