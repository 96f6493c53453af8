"""The page and the npm package before other judges: axe-core, Firefox, TypeScript; :mod:`tests.oracles` is for files.

python -m tests.browser.oracles
"""

import asyncio
import subprocess
import sys
import tempfile
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from pathlib import Path

from design import face_package
from tests.browser import live_sound
from tests.browser.bundlers import check_bundlers, opened
from tests.browser.chromium import Browser
from tests.browser.conftest import SIZE, Server
from tests.browser.demo_pages import check_demo
from tests.browser.firefox import Firefox, find_firefox
from tests.browser.test_face_package import PAGE, open_site, packed
from tests.unit.recognition.speech import BABY, spoken_by_espeak

TRIES, FIREFOXES = 5, 3
ROOT = Path(__file__).resolve().parents[2]
ORACLES = ROOT / "out" / "oracles" / "node_modules"
AXE = ORACLES / "axe-core" / "axe.min.js"
TYPESCRIPT = ORACLES / "typescript" / "bin" / "tsc"
CONNECTED = "document.body.dataset.connection === 'connected' && page.session.jitterBuffer.frames.length > 3"
STATES = {
    "just opened": "0",
    "all of it": "document.querySelectorAll('details').forEach((one) => (one.open = true))",
    "speaking, two wait": """(async () => {
        page.hasChosenSilence = true;
        for (const text of ["The first one speaks.", "The second one waits.", "The third one, too."])
            page.session.say(text);
        while (!document.querySelector("#queue li") || !document.querySelector("#said .now"))
            await new Promise((done) => setTimeout(done, 50));
    })()""",
    "paused": "page.session.pause(true)",
    "a FAP held": """(() => {
        const slider = document.getElementById("fap-3");
        slider.value = 500;
        slider.dispatchEvent(new Event("input"));
    })()""",
    "something wrong": "page.told('It went wrong.', true)",
    "the server away": "page.connection('waiting')",
    "a notice": "page.notice('This browser has no WebGL2.')",
}
"""What is done one after the other, by the name of what is seen then."""
WINDOWS = {"a desk": SIZE, "a telephone": (390, 740), "on its side": (844, 390), "400 %": (360, 225)}
CONSUMER = """
import { FapFace, Session, parseFap } from "fapengine-face";
import { elevenLabsWords, Live, planAll, Profile } from "fapengine-face/live";
import { English } from "fapengine-face/words-en";
import { ARKIT_NAMES, ArkitFollower, applyARKit, turns } from "fapengine-face/arkit";

const face: FapFace = document.querySelector("fap-face")!;
face.addEventListener("phone", ({ detail }) => console.log(detail.label.length, detail.position_s));
const sent: Promise<boolean> = face.say("Hello.", { voice: "en-gb", rate: 180 });
const heard: Promise<AudioNode> = face.hear(new MediaStream(), { delay: 0.3 });
const phones = [{ label: "m", start: 0, end: 0.1 }];
face.say(phones, { clock: () => 0 });
face.say("Guten Tag", { pronounce: async (word) => word.split("") }).then((said) => said?.unread.length);
face.say(elevenLabsWords([{}]), { add: true }).then((said) => said?.words[0].end.toFixed());
English.make().then((english) => english.pronounce(["hello"])[0]?.join(" "));
Live.make({ jaw: 1.2 }).then((live) => (live.onweights = (weights, faps) => console.log(heard, weights[0] + faps[0])));
const opened: number = planAll(new Profile(new ArrayBuffer(0)), phones, { rate: 60 }).faps[0][3];
face.push(new Int16Array(160), 16000);
face.words([["Hi", 0.1, 0.4]], { last: false });
applyARKit({ morphTargetDictionary: { jawOpen: 0 }, morphTargetInfluences: [0] }, face.faps);
const yaw: number = turns(face.faps).head.yaw + new ArkitFollower().follow(parseFap("").frames[0])[0];
new Session({ server: "http://127.0.0.1:8110/" }).express("joy", 0.5);
// @ts-expect-error: there is no such expression
face.express("hunger");
// @ts-expect-error: a phone has an end
face.say([{ label: "m", start: 0 }]);
console.log(sent, yaw, opened, ARKIT_NAMES[0]);
"""


async def axe(server: Server) -> None:
    """No state of the page breaks a rule of WCAG 2.1 AA that axe-core knows."""
    rules = "axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'] })"
    shown = "`${id}: ${nodes[0].html} ${nodes[0].failureSummary}`"
    broken = f"{rules}.then(({{ violations }}) => violations.map(({{ id, nodes }}) => {shown}))"
    async with Browser(SIZE) as browser:
        for window, (width, height) in WINDOWS.items():
            await browser.open(f"{server.url}?session={window.replace(' ', '-').replace('%', '')}")
            await browser.until(CONNECTED, 60)
            await browser.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            still = {"name": "prefers-reduced-motion", "value": "reduce"}  # what fades has less contrast meanwhile
            await browser.call("Emulation.setEmulatedMedia", features=[still])
            await browser.run(AXE.read_text() + ";0")
            for state, code in STATES.items():
                await browser.run(code)
                assert (found := await browser.run(broken)) == [], f"{window}, {state}: {found}"
    print(f"axe-core: {len(WINDOWS)} windows, {len(STATES)} states each, no violation")


async def firefox_page(server: Server) -> None:
    """Our own page speaks in Firefox, shows what it says, and complains of nothing."""
    async with Firefox() as browser:
        await browser.open(f"{server.url}?session=fritz")
        await browser.until(CONNECTED)
        await browser.run("page.hasChosenSilence = true, page.say('Many people like to hum.')")
        await browser.until("document.getElementById('said').textContent === 'Many people like to hum.'")
        await browser.until("document.querySelector('#said .now')?.textContent === 'people'")
        await browser.until("Math.max(...page.picture.faps) > 50 && page.picture.count > 3")
        picture = await browser.run(
            "page.picture.view ? `drawn, ${page.picture.count} pictures` : page.picture.trouble"
        )
        assert browser.complaints == [], browser.complaints
        print(f"Firefox, the page: {picture}")


async def firefox_package(server: Server) -> None:
    """The packed tarball talks in Firefox, and survives a restart of the server."""
    async with Firefox() as browser:
        await browser.open(server.site)
        await browser.until("window.show")
        await browser.run(f"show({{ server: '{server.url}', session: 'franz' }})")
        connected = "told.some(([type, detail]) => type === 'connection' && detail === 'connected')"
        await browser.until(connected)
        labels: list[str] = []
        for _ in range(TRIES):  # a phone is told with a picture, and a busy machine draws few
            await browser.run("(told.length = 0), (face.muted = true), face.say('Mama, mama.')")
            await browser.until("told.some(([type]) => type === 'finished')")
            labels = await browser.run("told.filter(([type]) => type === 'phone').map(([, { label }]) => label)")
            if "m" in labels:
                break
        assert "m" in labels, labels
        assert browser.complaints == [], browser.complaints
        server.kill()
        await browser.until("told.at(-1)[1] === 'waiting'")
        server.start()
        await browser.run("(told.length = 0)")
        await browser.until(connected)
        await browser.run("face.say('Hello again.')")
        await browser.until("told.some(([type]) => type === 'started')")
        print(f"Firefox, the package: {len(labels)} phones told, and it speaks again after a restart")


async def firefox_call(server: Server) -> None:
    """The call page shows the face in Firefox on this machine, and again after a restart of the server."""
    seen = "document.getElementById('state').textContent === 'You see the face.'"
    async with Firefox() as browser:
        await browser.open(f"{server.url}call.html?session=frieda")
        await browser.until("document.body?.dataset.watching === 'false'")
        await browser.run("document.getElementById('call').click()")
        await browser.until(f"{seen} && document.getElementById('face').videoWidth === 256", 180)
        server.kill()
        await browser.until(f"!({seen})")
        server.start()
        await browser.until(seen, 180)
        print("Firefox, a call: the face is seen, and again after a restart")


async def demo(_: Server) -> None:
    """The demo's pages speak, one of them beside a VRM avatar."""
    await check_demo(ORACLES)


async def firefox_live(_: Server) -> None:
    """It follows sound in Firefox without a server."""
    await live_sound.follow(Firefox())


DEVICES = """(() => {
  window.isThere = true;
  window.sounds = [];
  navigator.mediaDevices.getUserMedia = async () => {
    if (!isThere) throw new DOMException("none", "NotFoundError");
    const sound = new Audio("baby.wav");
    sounds.push(sound);
    await sound.play();
    return sound.mozCaptureStream();
  };
})()"""
"""Microphones that are unplugged after a sentence: Firefox gives a track no event that a page made."""
AT_REST = """(() => {
  const last = (kind) => told.findLastIndex(([type]) => type === kind);
  return last("lost") > last("regained") && last("finished") > last("started");
})()"""
"""The last device is lost and its speech is over, in whatever order."""


async def firefox_devices(_: Server) -> None:
    """A face in Firefox goes on with the next microphone, and comes to rest where there is none.

    Firefox itself may stand still when tracks end (``firefox.PREFERENCES``), so another one is tried then.
    """
    for left in reversed(range(FIREFOXES)):
        try:
            await _lose_devices()
        except AssertionError as error:
            print(f"Firefox, microphones: {error}")
            if not left:
                raise
        else:
            print("Firefox, without a server: it goes on with another microphone")
            return


async def _lose_devices() -> None:
    regained = "told.filter(([type]) => type === 'regained').length"
    with tempfile.TemporaryDirectory() as folder:
        live_sound.make_site(Path(folder), {"baby": spoken_by_espeak("en-us", BABY)})
        with opened(Path(folder)) as url:
            async with Firefox() as browser:
                await browser.open(url)
                await browser.until("window.isReady")
                await browser.run(DEVICES)
                await browser.run("face.hear({ audio: true }).then(() => 0)")
                await browser.until(f"{regained} > 1")
                await browser.run("isThere = false")
                await browser.until(f"{AT_REST} && face.faps.every((value) => value === 0)")
                await browser.run("told.length = 0, isThere = true")
                await browser.run("navigator.mediaDevices.dispatchEvent(new Event('devicechange'))")
                await browser.until(f"{regained} === 1 && told.some(([type]) => type === 'phone')")
                assert browser.complaints == [], browser.complaints


def typescript(folder: Path) -> None:
    """What TypeScript is told of the package holds together, and refuses what is wrong."""
    (folder / "node_modules").mkdir()
    (folder / "node_modules" / "fapengine-face").symlink_to(folder / "package")
    (folder / "consumer.ts").write_text(CONSUMER)
    options = ("--noEmit", "--strict", "--module", "nodenext", "--target", "es2022", "--lib", "es2022,dom,dom.iterable")
    subprocess.run(["node", str(TYPESCRIPT), *options, "consumer.ts"], cwd=folder, check=True)
    print("TypeScript: the types hold together")


async def main() -> int:
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        server = Server(folder)
        stack.callback(server.kill)
        face_package.build(folder / "built")
        packed(folder)
        (folder / "index.html").write_text(PAGE)
        stack.enter_context(open_site(server, folder))
        judges: dict[str, Callable[[Server], Awaitable[None]]] = {"axe-core": axe, "the demo": demo}
        if find_firefox():
            judges |= {"Firefox": firefox_page, "Firefox, package": firefox_package, "Firefox, a call": firefox_call}
            judges |= {"Firefox, without a server": firefox_live, "Firefox, microphones": firefox_devices}
        else:
            print("Nothing was tried in Firefox: it, or Xvfb, is absent; Debian has them as firefox-esr and xvfb")
        failed = 0
        for what, judge in judges.items():
            try:
                await judge(server)
            except AssertionError as error:
                failed += 1
                print(f"{what}: {error}")
        try:
            await check_bundlers(ORACLES, folder / "package")
        except (AssertionError, subprocess.CalledProcessError) as error:
            failed += 1
            print(f"bundlers: {error}")
        try:
            typescript(folder)
        except subprocess.CalledProcessError:
            failed += 1
        return failed


if __name__ == "__main__":
    sys.exit(asyncio.run(main()))
