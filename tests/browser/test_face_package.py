"""The npm package, packed and imported by a page of another site."""

import base64
import contextlib
import gzip
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design import face_package
from fapengine.codec.fapfile import format_fap
from fapengine.files.sound import save_wav
from fapengine.host.hearing import DELAY_S
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.server.web.messages import pack_frame
from fapengine.wire.shapes import ArkitFollower
from tests.browser.bundlers import check_node
from tests.browser.conftest import Page, Server
from tests.processes import start
from tests.unit.retarget.living_speech import living

PAGE = """<!doctype html><html lang="en"><title>Somebody's page</title><link rel="icon" href="data:," />
<script type="importmap">
  {"imports": {"fapengine-face": "/package/index.js", "fapengine-face/arkit": "/package/arkit.js"}}
</script>
<script type="module">
  import * as all from "fapengine-face";
  import * as arkit from "fapengine-face/arkit";
  Object.assign(window, { all, arkit });
  window.told = [];
  window.show = async (attributes) => {
    document.querySelector("fap-face")?.remove();
    const face = (window.face = document.createElement("fap-face"));
    face.style.width = "320px";
    for (const type of ["started", "phone", "finished", "connection", "error"])
      face.addEventListener(type, ({ detail }) => told.push([type, detail]));
    for (const [name, value] of Object.entries(attributes)) face.setAttribute(name, value);
    document.body.append(face);
    await face.ready;
    face.picture.budget.add = () => false;
  };
</script></html>"""


STRICT = """<!doctype html><html lang="en"><title>Strict</title><link rel="icon" href="/none.svg" />
<meta http-equiv="Content-Security-Policy" content="default-src 'self'; require-trusted-types-for 'script'" />
<script type="module" src="package/index.js"></script><fap-face></fap-face></html>"""


def packed(folder: Path) -> None:
    """Put what lies in ``built`` into ``package``, as npm packs it; as it is, where npm is not."""
    if npm := shutil.which("npm"):
        command = [npm, "pack", "--silent", "--pack-destination", str(folder)]
        subprocess.run(command, cwd=folder / "built", check=True, capture_output=True, timeout=300)
        (tarball,) = folder.glob("*.tgz")
        subprocess.run(["tar", "-xzf", str(tarball), "-C", str(folder)], check=True, timeout=300)
    else:
        shutil.copytree(folder / "built", folder / "package")


@contextlib.contextmanager
def open_site(server: Server, folder: Path) -> Iterator[None]:
    """Somebody else's site, whose pages may show the server's faces."""
    port = server.site.rpartition(":")[2]
    command = [sys.executable, "-u", "-m", "http.server", port, "--bind", "127.0.0.1", "--directory", str(folder)]
    with start(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        assert process.stdout.readline()  # it listens
        try:
            yield
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def site(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Another site's files: the package and a page."""
    folder = tmp_path_factory.mktemp("site")
    face_package.build(folder / "built")
    packed(folder)
    assert "USC Institute for Creative Technologies" in (folder / "built" / "NOTICE").read_text()
    (folder / "index.html").write_text(PAGE)
    with open_site(server, folder):
        yield folder


@pytest.fixture
def shop(page: Page, site: Path) -> Page:
    page.go(page.server.site)
    page.until("window.show")
    return page


def gzipped_mb(paths: list[Path]) -> float:
    return sum(len(gzip.compress(path.read_bytes(), 9)) for path in paths) / 1e6


def test_the_sizes_that_the_guide_states_are_those_of_the_package(site: Path) -> None:
    guide = (Path(face_package.ROOT) / "docs" / "how-to" / "web.md").read_text()
    pattern = r"\(([\d.]+) MB, mostly a head\).*`hear` loads ([\d.]+) MB \(gzip\), `say` ([\d.]+) MB, words ([\d.]+) MB"
    stated = re.search(pattern, guide, re.DOTALL)
    assert stated
    package = site / "package"
    modules, assets = [*package.glob("live/*.js")], package / "assets"
    hears = gzipped_mb([*modules, assets / "planner.bin", assets / "recognizer.bin"])
    says = hears - gzipped_mb([assets / "recognizer.bin"])
    words = gzipped_mb([*package.glob("words-en/*.js"), assets / "words-en.bin"])
    assert [float(size) for size in stated.groups()[1:]] == pytest.approx([hears, says, words], abs=0.05)
    for tarball in site.glob("*.tgz"):  # where npm is
        assert float(stated[1]) == pytest.approx(tarball.stat().st_size / 1e6, abs=0.1)


def show(page: Page, **attributes: str) -> None:
    page.run(f"show({json.dumps(attributes)})")


def test_it_talks_in_anybodys_page_and_survives_a_restart_of_the_server(shop: Page) -> None:
    show(shop, server=shop.server.url, session="paula", camera="mouth")
    connected = "told.some(([type, detail]) => type === 'connection' && detail === 'connected')"
    shop.until(f"{connected} && face.source.jitterBuffer.frames.length > 3")
    shop.run("face.muted = true; face.say('Mama, mama.')")
    shop.until("told.some(([type]) => type === 'finished')")
    kinds = shop.run("told.map(([type]) => type)")
    assert kinds.index("started") < kinds.index("finished")
    labels = shop.run("told.filter(([type]) => type === 'phone').map(([, { label }]) => label)")
    assert "m" in labels
    assert shop.run("face.picture.count") > 3
    shop.server.kill()
    shop.until("told.at(-1)[1] === 'waiting'")
    shop.server.start()
    shop.run("told.length = 0")
    shop.until(connected)
    shop.run("face.say('Hello again.')")
    shop.until("told.some(([type]) => type === 'started')")
    shop.run("face.cancel(); face.remove()")
    excused = ("ERR_CONNECTION_REFUSED", "ERR_CONNECTION_RESET", "ERR_EMPTY_RESPONSE")
    shop.complaints[:] = [one for one in shop.complaints if not any(reason in one for reason in excused)]


def test_pictures_that_take_long_do_not_hold_the_sound_up(shop: Page) -> None:
    show(shop, server=shop.server.url, session="pia")
    shop.until("face.source.jitterBuffer.frames.length > 3 && face.source.clock.known")
    shop.run("""const draw = face.picture.view.draw.bind(face.picture.view);
        face.picture.view.draw = (...what) => {
            const until = performance.now() + 300;
            draw(...what);
            while (performance.now() < until);
        };""")
    shop.run("face.say('One, two, three, four, five, six, seven, eight, nine, ten.')")
    shop.until("[...face.source.sound.playing.values()].some(({ source }) => source)")
    heard = "[performance.now() / 1000, face.source.sound.heard(), face.picture.count]"
    before = shop.run(heard)
    shop.until(f"face.picture.count >= {before[2]} + 5")
    after = shop.run(heard)
    passed_s, heard_s = after[0] - before[0], after[1] - before[1]
    assert passed_s > 1.2  # so slow it was
    assert heard_s == pytest.approx(passed_s, rel=0.15)
    shop.run("face.remove()")


def test_a_site_that_the_server_does_not_name_is_refused(shop: Page) -> None:
    shop.go(shop.server.site.replace("127.0.0.1", "localhost"))
    shop.until("window.show")
    assert shop.run(f"show({{ server: '{shop.server.url}' }}).then(() => 'shown', () => 'refused')") == "refused"
    assert shop.run("told.length") == 1
    for _ in range(200):  # the browser says, when it likes, that the other site allows neither file
        if sum("CORS" in said for said in shop.complaints) == 2:
            break
        shop.sleep(0.05)
    shop.complaints.clear()


def test_a_file_is_played_with_its_sound_and_without_a_server(shop: Page, site: Path) -> None:
    values = np.zeros((31, 68), np.int32)
    values[:, fap.column(3)] = 20 * np.arange(31)
    (site / "talk.fap").write_text(format_fap(FapTrack.from_values(values, rate_hz=25.0)))
    save_wav(site / "talk.wav", np.zeros(24_000, np.int16), 16_000)
    show(shop, src="talk.fap", audio="talk.wav", transparent="")
    shop.until("face.source.audio.readyState > 2")
    assert shop.run("[...face.faps].every((value) => value === 0)")
    shop.run("""window.apart = [];
        face.addEventListener("picture", () => face.source.isSpeaking &&
            apart.push(face.faps[2] / 500 - face.source.audio.currentTime));
        face.play()""")
    shop.until("told.some(([type]) => type === 'finished')")
    assert np.abs(shop.run("apart")).max() < 0.1  # the mouth is where the sound is: 500 FAPU a second
    assert shop.run("face.faps[2]") == 600
    read = "(text) => { try { return all.parseFap(text).frames.length; } catch (error) { return error.message; } }"
    good = format_fap(FapTrack.from_values(values, rate_hz=25.0))
    frames = [good, good[: good.rindex(" ")], "MThd", "2.1 x 25 0\n"]
    told = [shop.run(f"({read})({json.dumps(text)})") for text in frames]
    assert told[0] == 31
    for part, text in zip(("frame 30", "2.1 name rate", "no frame"), told[1:], strict=True):
        assert part in text


def test_a_page_plays_what_it_pushes_when_the_server_moves_the_face() -> None:
    source = (face_package.SOURCE / "session.js").read_text(encoding="utf-8")
    assert f"EAR_DELAY_S = {DELAY_S};" in source


def test_frames_of_a_data_channel_are_shown(shop: Page) -> None:
    show(shop)
    row = np.zeros(68, np.int32)
    row[fap.column(3)] = 321
    frames = [base64.b64encode(pack_frame(number, number / 60, row)).decode() for number in range(40)]
    shop.run(f"""const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
        const frames = {json.dumps(frames)}.map(bytes);
        window.channel = new EventTarget();
        face.listen(channel);
        let number = 0;
        window.feeding = setInterval(() => {{
            const frame = frames[number++];
            if (!frame) clearInterval(feeding);
            else if (number % 2) face.feed(frame); // a view
            else channel.dispatchEvent(new MessageEvent("message", {{ data: frame.buffer }}));
        }}, 16);""")
    shop.until("Math.abs(face.faps[2] - 321) < 1")
    assert not shop.run("face.feed(new ArrayBuffer(8))")
    reason = shop.run("(() => { try { face.words([]); } catch ({ message }) { return message; } })()")
    assert reason.startswith("fap-face: words needs the attribute server")


def test_liveliness_without_a_server_is_an_attribute(shop: Page) -> None:
    def shown(attributes: dict[str, str]) -> Any:
        result = "({ liveliness }) => liveliness, ({ message }) => message"
        return shop.run(f"show({json.dumps(attributes)}).then(() => face.local('say')).then({result})")

    assert shown({"liveliness": "0.3"}) == 0.3
    assert shown({}) == 1
    assert shown({"liveliness": "2"}) == "liveliness: must be 0 to 1, got 2"


def test_arkit_s_shapes_are_python_s(shop: Page) -> None:
    faps = living(mood="joy")[:200]
    follower = ArkitFollower()
    expected = np.array([follower.follow(row) for row in faps])
    found = np.array(
        shop.run(f"""(() => {{
        const follower = new arkit.ArkitFollower();
        return {json.dumps(faps.tolist())}.map((faps) => [...follower.follow(faps)]);
    }})()""")
    )
    assert shop.run("arkit.ARKIT_NAMES") == list(ARKIT_NAMES)
    assert expected.max(axis=0).max() > 0.3
    assert np.abs(found - expected).max() < 2e-3
    shown = shop.run(f"""(() => {{
        const mesh = {{ morphTargetDictionary: {{ jawOpen: 1, other: 0 }}, morphTargetInfluences: [0.5, 0] }};
        const set = {{}};
        const getExpression = (name) => name === "jawOpen";
        const manager = {{ getExpression, setValue: (name, value) => (set[name] = value) }};
        for (const target of [mesh, manager]) arkit.applyARKit(target, {json.dumps(faps[60].tolist())});
        return [mesh.morphTargetInfluences, set];
    }})()""")
    assert shown[0] == [0.5, shown[1]["jawOpen"]]
    assert list(shown[1]) == ["jawOpen"]


def test_it_is_shown_under_a_strict_policy_with_trusted_types(page: Page, site: Path) -> None:
    (site / "strict.html").write_text(STRICT)
    (site / "none.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    page.go(f"{page.server.site}/strict.html")
    page.until("document.querySelector('fap-face')?.picture?.count > 0")
    face = "document.querySelector('fap-face')"
    width, height = page.run(f"[{face}.clientWidth, {face}.clientHeight]")
    assert width == height > 200
    assert page.run(f"getComputedStyle({face}.shadowRoot.querySelector('canvas')).position") == "absolute"


def test_other_assets_may_be_named(shop: Page, site: Path) -> None:
    shutil.copy(site / "package" / "assets" / "setup.json", site / "elsewhere.json")
    (site / "package" / "assets" / "setup.json").rename(site / "moved.json")
    try:
        show(shop, setup="elsewhere.json", head="package/assets/head.bin")
    finally:
        (site / "moved.json").rename(site / "package" / "assets" / "setup.json")
    shop.until("face.picture.count > 0")


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node")
def test_it_may_be_imported_without_a_dom(site: Path) -> None:
    check_node(site / "package")


PIXELS = """async (face) => {
    const { view } = face.picture, still = new OffscreenCanvas(64, 64);
    const side = 64 + (many.indexOf(face) % 2) * 16;
    view.resize(side, side, face.getAttribute("edges") === "fine");
    view.draw(new Float32Array(68), face.picture.steering.camera);
    still.getContext("2d").drawImage(view.canvas, 0, 0, 64, 64);
    return [...still.getContext("2d").getImageData(0, 0, 64, 64).data];
}"""


@pytest.mark.parametrize(
    ("edges", "count"), [("soft", 18), ("fine", 8), pytest.param("soft", 50, marks=pytest.mark.nightly)]
)
def test_many_faces_share_a_context_and_look_the_same(shop: Page, edges: str, count: int) -> None:
    """Browsers keep 16 contexts. One that is lost comes back, and the element tells both."""
    shop.run(f"""(async () => {{
        window.many = Array.from({{ length: {count} }}, (_, number) => {{
            const face = document.createElement("fap-face");
            face.style.width = number % 2 ? "80px" : "64px";
            face.setAttribute("edges", "{edges}");
            document.body.append(face);
            return face;
        }});
        await Promise.all(many.map((face) => face.ready));
    }})()""")
    shop.until("many.every((face) => face.picture.count > 0)")
    shop.run("many.forEach((face) => cancelAnimationFrame(face.picture.asked))")  # only what the test draws
    assert shop.run("many.map((face) => face.picture.trouble).filter(Boolean)") == []
    assert not any(shop.run("many.map((face) => face.picture.view.gl.isContextLost())"))
    assert shop.run("new Set(many.map((face) => face.picture.view.gl)).size") < 16
    first, last, other = (
        np.array(shop.run(f"({PIXELS})(many[{n}])")).reshape(64, 64, 4) for n in (0, count - 2, count - 1)
    )
    assert first[..., :3].std() > 20
    assert np.array_equal(first, last)
    assert np.abs(first - other).mean() < 12  # drawn with other pixels
    shop.run("many[0].remove(), many.at(-2).remove()")  # one with a context of its own, one without
    again = np.array(shop.run(f"({PIXELS})(many[{count - 1}])")).reshape(64, 64, 4)
    assert np.array_equal(again, other)
    shop.run("""(() => {
        window.told = [];
        for (const [number, face] of [many[1], many.at(-1)].entries())
            for (const type of ["contextlost", "contextrestored"])
                face.addEventListener(type, () => told.push(number + type));
    })()""")
    for number, face in enumerate(("many[1]", "many.at(-1)")):  # with a context of its own, and without
        shop.run(f"window.lose = {face}.picture.view.gl.getExtension('WEBGL_lose_context')")
        shop.run("lose.loseContext()")
        shop.until(f"told.includes('{number}contextlost')")
        assert shop.run(f"{face}.picture.draw()") is False
        shop.run("lose.restoreContext()")
        shop.until(f"told.includes('{number}contextrestored')")
        assert not shop.run(f"{face}.picture.view.gl.isContextLost()")
    back = np.array(shop.run(f"({PIXELS})(many[{count - 1}])")).reshape(64, 64, 4)
    assert np.array_equal(back, other)
    shop.run("many.forEach((face) => face.remove())")
    shop.complaints[:] = [one for one in shop.complaints if "CONTEXT_LOST" not in one]
