"""The package's demo of a face beside a VRM avatar, in Chromium with three.js and three-vrm: both speak.

    python -m tests.browser.demo_pages FOLDER [PICTURES]

FOLDER has ``node_modules`` with three and @pixiv/three-vrm, as ``make oracles`` installs them; the avatar is our own
head as a VRM. PICTURES, a folder, takes a picture of each demo page, as on a desk and on a telephone.
"""

import asyncio
import sys
import tempfile
from pathlib import Path

import numpy as np

from design import face_package
from fapengine.app.scene_files import export_head
from fapengine.files.pictures import save_png
from tests.browser.bundlers import opened
from tests.browser.chromium import Browser

WINDOWS = {"desk": (1280, 860), "telephone": (390, 844)}
DRAWN = "document.getElementById('face')?.picture?.count > 0"
SPOKEN = "document.getElementById('face').source.position > 0.35"
LIPS = """(() => {
    const { left, top, width, height } = document.getElementById("avatar").getBoundingClientRect();
    return [left, top, width, height].map(Math.round);
})()"""
SAY = "(document.getElementById('aloud').checked = false), document.querySelector('#text button').click()"


async def check_demo(modules: Path, pictures: Path | None = None) -> None:
    """Both pages say words without a complaint; lips of the avatar move."""
    with tempfile.TemporaryDirectory() as name:
        site = Path(name)
        package = site / "node_modules" / "fapengine-face"
        face_package.build(package)
        for other in ("three", "@pixiv"):
            (site / "node_modules" / other).symlink_to((modules / other).resolve())
        export_head("woman", package / "demo" / "woman.vrm")
        with opened(site) as url:
            for window, size in WINDOWS.items():
                for page in ("index.html", "vrm.html?avatar=woman.vrm"):
                    await _spoken(f"{url}node_modules/fapengine-face/demo/{page}", size, window, pictures)
    print("the demo's pages: words are said, and an avatar's lips move")


async def _spoken(url: str, size: tuple[int, int], window: str, pictures: Path | None) -> None:
    async with Browser(size) as browser:
        await browser.open(url)
        await browser.until(DRAWN, 180)
        assert await browser.run("document.documentElement.scrollWidth <= innerWidth"), f"{url}: too wide"
        if "vrm" in url:
            await browser.until("window.isReady")
            assert await browser.run("document.getElementById('status').textContent") == ""
            left, top, width, height = await browser.run(LIPS)
            below = slice(top + height // 2, top + height), slice(left, left + width)
            before = (await browser.picture())[below].astype(int)
        await browser.run(SAY)
        await browser.until(SPOKEN)
        picture = await browser.picture()
        if "vrm" in url:
            moved = (np.abs(picture[below].astype(int) - before).max(axis=-1) > 30).mean()
            assert moved > 0.002, f"{url}: {moved:.4f} of the lower half has changed"
        if pictures:
            save_png(pictures / f"{url.split('/')[-1].split('.')[0]}-{window}.png", picture)
        assert browser.complaints == [], browser.complaints


if __name__ == "__main__":
    pictures_folder = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    asyncio.run(check_demo(Path(sys.argv[1]) / "node_modules", pictures_folder))
