"""docs/pictures/page.jpg: the page of ``fapengine serve`` while it speaks, as headless Chromium shows it.

python -m design.page_picture
"""

import asyncio
import contextlib
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
    const slider = document.getElementById("expression-joy");
    slider.value = 0.5;
    slider.dispatchEvent(new Event("input"));
})()"""
HOLD = """
const phone = document.getElementById("phone");
const watch = new MutationObserver(() => {
    if (!["aɪ", "ʌ", "oʊ", "ə"].includes(phone.textContent)) return;
    watch.disconnect();
    const faps = Float32Array.from(page.picture.faps);
    const shown = page.session.jitterBuffer.sample(performance.now() / 1000, new Float32Array(68));
    page.session.jitterBuffer.sample = (now, into) => { into.set(faps); return { ...shown, faps: into }; };
    page.session.fadeOut.at = () => 1;
    Object.defineProperty(page.picture, "wantsFineEdges", { get: () => true });
    page.picture.budget.scale = 1;
    page.picture.resized = true;
    window.isHeld = true;
});
watch.observe(phone, { childList: true, characterData: true, subtree: true });
"""
"""Keeps the face as it is when one of these vowels is said, with the pixels and edges that a graphics card draws."""
NO_RATES = """
    if (page.picture.view.frugal)
        for (const name of ["fps", "latency"]) document.getElementById(name).parentElement.hidden = true;
"""
"""A CPU that draws beside the browser shows rates that no reader will meet: they are left out of the picture."""


async def show() -> tuple[Image.Image, Image.Image]:
    async with Browser((1280, 837)) as browser:
        await browser.open(f"http://127.0.0.1:{PORT}/?session=anna")
        await browser.until(
            "document.body.dataset.connection === 'connected' && page.session.jitterBuffer.frames.length > 30", 90
        )
        await browser.run(
            "page.picture.budget.add = () => false; page.hasChosenSilence = true;"
            "page.steering.camera = { ...page.steering.camera, yaw: 14 }"
        )
        await browser.run("document.querySelector('.faps details').open = true;" + SMILE)
        await asyncio.sleep(1.5)
        await browser.run(HOLD)
        say = f"document.getElementById('text').value = {SENTENCE!r}; document.getElementById('say').click()"
        for _ in range(6):  # a busy machine draws too few frames to meet a vowel at once
            await browser.run(say)
            with contextlib.suppress(TimeoutError):
                await browser.until("window.isHeld", 8)
                break
        assert await browser.run("window.isHeld"), "no vowel was seen"
        await browser.run(NO_RATES)
        await asyncio.sleep(3.0)
        wide = await browser.picture()
        await browser.call(
            "Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1.5, mobile=True
        )
        await asyncio.sleep(3.0)
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
