"""A face in Chromium follows sound for a long time, in real time, without a server: its memory does not grow.

    python -m tests.browser.live_memory [--minutes 30]

A sentence and a pause are played again and again to ``hear`` of a ``<fap-face>`` that draws itself with all its
gestures; every five minutes the sound is begun anew, as after a reconnect. Once a minute, after a collection of
garbage: the heaps of JavaScript of the page and of its worker, and the memory of all processes of the browser. The last
third is compared with the third before it, so that what is filled once does not count.
"""

import argparse
import asyncio
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.browser import consumption
from tests.browser.bundlers import opened
from tests.browser.chromium import Browser
from tests.browser.live_sound import make_site
from tests.unit.recognition.speech import BABY, spoken_by_espeak

PREPARE = """(async () => {
  window.phones = 0;
  face.addEventListener("phone", () => (phones += 1));
  window.context = new AudioContext();
  const spoken = await context.decodeAudioData(await (await fetch("baby.wav")).arrayBuffer());
  window.loop = new AudioBuffer({ length: spoken.length + context.sampleRate, sampleRate: context.sampleRate });
  loop.copyToChannel(spoken.getChannelData(0), 0);
})()"""
BEGIN = """(async () => {
  window.source?.stop();
  window.source = new AudioBufferSourceNode(context, { buffer: loop, loop: true });
  (await face.hear(source)).connect(context.destination);
  source.start();
})()"""
STATE = "(told.length = 0, { phones, heard: face.source.heard, pictures: face.picture.count })"
ANEW = 5
"""Minutes from one beginning to the next."""
HEAP_GROWTH, MEMORY_GROWTH = 0.5e6, 20e6
"""Bytes by which a heap, and all processes together, may be larger in the last third than in the one before."""
Row = tuple[float, float, float]


async def heap(browser: Browser, session: str | None) -> float:
    """Bytes of JavaScript that are in use after a collection."""
    await browser.call("HeapProfiler.collectGarbage", session)
    return float((await browser.call("Runtime.getHeapUsage", session))["usedSize"])


async def measured(browser: Browser) -> Row:
    """Heap of the page, heap of its worker, memory of all processes: bytes."""
    workers = [session for session, kind in browser.workers.items() if kind == "worker"]
    assert len(workers) == 1, f"{len(workers)} workers are there, expected one"
    return await heap(browser, None), await heap(browser, workers[0]), consumption.memory(browser.pid)


async def follow(browser: Browser, minutes: int) -> list[Row]:
    """Let it follow the sound; what :func:`measured` found after each minute."""
    rows, pictures = [], 0
    for minute in range(minutes):
        if minute % ANEW == 0:
            await browser.run(BEGIN)
        await asyncio.sleep(60)
        state = await browser.run(STATE)
        assert state["pictures"] > pictures, f"the face stands still: {state}"
        assert state["heard"], f"the recognizer hears nothing: {state}"
        pictures = state["pictures"]
        rows.append(await measured(browser))
        shown = ", ".join(f"{size / 1e6:.2f}" for size in rows[-1])
        print(f"{minute + 1} min: {shown} MB; {state['phones']} phones, {state['pictures']} pictures", flush=True)
    assert state["phones"] > 10 * minutes, f"it follows too little: {state}; the machine is too busy"
    return rows


def growths(rows: list[Row]) -> Row:
    """By how many bytes the least of the last third is above the least of the third before: garbage varies."""
    third = len(rows) // 3
    before, last = np.array(rows)[-2 * third :].reshape(2, third, 3).min(axis=1)
    page, worker, memory = last - before
    return page, worker, memory


async def main(minutes: int) -> int:
    with tempfile.TemporaryDirectory() as folder:
        make_site(Path(folder), {"baby": spoken_by_espeak("en-us", BABY)})
        page = Path(folder) / "index.html"
        page.write_text(page.read_text().replace("<fap-face still>", "<fap-face>"))
        with opened(Path(folder)) as url:
            async with Browser((160, 160)) as browser:
                await browser.call("Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=False, flatten=True)
                await browser.open(url)
                await browser.until("window.isReady")
                await browser.run(PREPARE)
                rows = await follow(browser, minutes)
                assert browser.complaints == [], browser.complaints
    grown = growths(rows)
    print(
        "Growth of the last third: page {:+.3f}, worker {:+.3f}, all processes {:+.1f} MB".format(
            *(g / 1e6 for g in grown)
        )
    )
    return int(max(grown[:2]) > HEAP_GROWTH or grown[2] > MEMORY_GROWTH)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, default=30, help="at least 3")
    sys.exit(asyncio.run(main(max(parser.parse_args().minutes, 3))))
