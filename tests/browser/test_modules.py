"""The page's arithmetic, run by the browser itself, against Python's."""

import base64
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fapengine.codec.fapfile import format_fap
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import bone_transforms, channel_weights, with_rest
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack, limits
from fapengine.render.camera import PRESETS
from fapengine.render.drawing import RenderOptions
from fapengine.render.packing import frame_uniforms
from fapengine.render.renderer import FaceRenderer
from fapengine.server.web.page_files import PAGE_CAMERAS
from fapengine.trajectory.high_level import expand
from tests.browser.conftest import Page

# sRGB steps of 255, mean over the picture: two compilers' rounding, and edges that fall on either side of a pixel.
MEAN_STEPS = 0.8  # half of it the painting, whose level the page chooses for every pixel


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


@pytest.fixture
def modules(page: Page) -> Page:
    """A page that all tests here share: they change nothing of it."""
    if page.run("location.search") != "?session=modules":
        page.open("modules")
    return page


def plausible(count: int) -> np.ndarray:
    """(count, 68): random frames that a face can do."""
    rng = np.random.default_rng(5)
    reach = np.array([0, 0] + [min(row.intra_limit, 500) * (60 if row.unit == "AU" else 1) for row in fap.FAPS])
    frames = np.round(rng.uniform(-1, 1, (count, 68)) * reach)
    return frames * rng.choice([0, 1], (count, 68), p=[0.3, 0.7])


def calculated(page: Page, module: str, code: str, **given: object) -> Any:
    """Run code in the page; ``m`` is the module, ``given`` what is passed in."""
    return page.run(
        f"import('/face/{module}').then((m) => {{ const given = {json.dumps(given)}; return (() => {{ {code} }})(); }})"
    )


def test_channels_bones_pupil_and_lids_are_python_s(modules: Page, head: FaceMesh) -> None:
    frames = plausible(25)
    found = calculated(
        modules,
        "deform.js",
        """const { head } = page.picture.view;
        return given.frames.map((faps) => [
            [...m.channelWeights(head, faps)], [...m.boneMatrices(head, faps)],
            m.irisAndPupil(head, faps), m.lidMargins(head, faps)]);""",
        frames=frames.tolist(),
    )
    expected = frame_uniforms(head, frames)
    assert np.array([row[0] for row in found]) == pytest.approx(expected.channels, rel=1e-5, abs=1e-5)
    bones = np.array([row[1] for row in found]).reshape(-1, 5, 4, 4)
    assert bones == pytest.approx(expected.bones, rel=1e-5, abs=1e-5)
    assert np.array([row[2] for row in found]) == pytest.approx(expected.iris, rel=1e-5)
    assert np.array([row[3] for row in found]) == pytest.approx(expected.lids, rel=1e-5, abs=1e-5)
    # Not by way of the packing: the reference itself.
    assert np.array(found[3][0])[: len(head.basis.channels)] == pytest.approx(
        channel_weights(head.basis, frames[3]), rel=1e-5, abs=1e-4
    )
    assert bones[3].swapaxes(-1, -2) == pytest.approx(bone_transforms(head, frames[3]), rel=1e-5, abs=1e-4)


def test_the_expression_at_rest_is_python_s(modules: Page) -> None:
    frames = plausible(12)
    frames[0, 18:22] = 963, 963, 176, 176  # a smile blinks
    found = calculated(
        modules,
        "deform.js",
        "return given.frames.map((faps) => [...m.withRest(faps, page.setup, 0.8)]);",
        frames=frames.tolist(),
    )
    assert np.array(found) == pytest.approx(with_rest(frames, 0.8), abs=1e-9)
    assert found != pytest.approx(frames, abs=1.0)


def test_the_share_of_the_expression_at_rest_is_from_0_to_1(modules: Page) -> None:
    given = [None, "", "soft", "NaN", "-3", "0", "0.25", 0.25, "7", "Infinity"]
    found = calculated(modules, "deform.js", "return given.texts.map(m.restShare);", texts=given)
    assert found == [1, 1, 1, 1, 0, 0, 0.25, 0.25, 1, 1]


def test_channels_are_mixed_as_python_mixes_them(modules: Page) -> None:
    rng = np.random.default_rng(2)
    spans = [(3, -np.inf, np.inf), (19, 0.0, 1100.0), (19, 0.0, -600.0), (47, 0.0, np.inf)]
    mix = rng.normal(size=(6, len(spans))).astype(np.float32)
    basis = DeformationBasis(
        channels=tuple(Channel(*span) for span in spans), offsets=[0, 0], entry_channels=np.zeros(0, int),
        entry_mm=np.zeros((0, 3)), mix=mix,
    )  # fmt: skip
    frames = plausible(12)
    found = calculated(
        modules,
        "deform.js",
        """const head = { channels: { array: Float64Array.from(given.channels, Number) },
            mix: { array: Float32Array.from(given.mix) } };
        return given.frames.map((faps) => [...m.channelWeights(head, faps)]);""",
        channels=[str(value).replace("inf", "Infinity") for span in spans for value in span],
        mix=mix.ravel().tolist(),
        frames=frames.tolist(),
    )
    assert np.array(found)[:, :6] == pytest.approx(channel_weights(basis, frames), rel=1e-5, abs=1e-4)
    assert not np.array(found)[:, 6:].any()


@pytest.mark.parametrize("name", PAGE_CAMERAS)
def test_cameras_see_as_python_s_do_but_upright(modules: Page, name: str) -> None:
    camera = PRESETS[name]
    given = {"name": name, "aspects": [1.0, 1.6]}
    code = """const camera = page.setup.cameras[given.name];
        return [m.cameraPosition(camera), ...given.aspects.map((aspect) => [...m.clipFromWorld(camera, aspect)])];"""
    position, *clips = calculated(modules, "camera.js", code, **given)
    assert position == pytest.approx(camera.position_mm.tolist())
    for aspect, clip in zip(given["aspects"], clips, strict=True):
        matrix = np.array(clip).reshape(4, 4).T
        upright = np.diag([1.0, -1.0, 1.0, 1.0]) @ camera.clip_from_world(aspect)
        assert matrix == pytest.approx(upright, rel=1e-5, abs=1e-4)


def test_a_high_picture_keeps_the_width_of_a_square_one(modules: Page) -> None:
    code = "return [1, 0.5].map((aspect) => [...m.clipFromWorld(page.setup.cameras.front, aspect)]);"
    square, high = (np.array(clip).reshape(4, 4).T for clip in calculated(modules, "camera.js", code))
    assert high[0] == pytest.approx(square[0])
    assert high[1] == pytest.approx(square[1] / 2)


def pictured(page: Page, faps: np.ndarray, camera: str, size: int, edges: str) -> np.ndarray:
    """(size, size, 4) int: what the page draws with nothing behind the face."""
    code = """const { size } = given;
        const view = new m.FaceView(document.createElement("canvas"), page.picture.view.head, page.setup, null);
        view.resize(size, size, given.edges === "fine");
        view.draw(given.faps, page.setup.cameras[given.camera]);
        const pixels = new Uint8Array(size * size * 4);
        view.gl.readPixels(0, 0, size, size, view.gl.RGBA, view.gl.UNSIGNED_BYTE, pixels);
        const error = view.gl.getError();
        let text = "";
        for (const value of pixels) text += String.fromCharCode(value);
        return [error, btoa(text)];"""
    given = {"faps": faps.tolist(), "camera": camera, "size": size, "edges": edges}
    error, encoded = calculated(page, "face.js", code, **given)
    assert error == 0
    return np.frombuffer(base64.b64decode(encoded), np.uint8).reshape(size, size, 4)[::-1].astype(int)


@pytest.mark.parametrize("name", ["front", "three-quarter"])
def test_the_picture_is_the_desktop_s(modules: Page, head: FaceMesh, name: str) -> None:
    faps = np.zeros(68)
    faps[[fap.column(number) for number in (3, 5, 10, 11, 19, 31, 49)]] = 400, -300, -250, -250, 300, 200, 10_000
    found = pictured(modules, faps, name, 256, "soft")
    drawing = RenderOptions(
        size=(256, 256), camera=PRESETS[name], background="transparent", samples=0, shading="pixels"
    )  # as the page does
    with FaceRenderer(head, drawing) as renderer:
        expected = renderer.draw(faps).astype(int)
    assert (expected[..., 3] > 0).mean() > 0.3
    difference = np.abs(found - expected)
    assert difference.mean() < MEAN_STEPS
    assert (difference.max(axis=-1) > 24).mean() < 0.004  # of the outline alone
    flipped = np.abs(found[:, ::-1] - expected)
    assert flipped.mean() > 10 * difference.mean()  # the measure would see another picture


def test_fine_edges_are_nearer_to_a_picture_of_more_pixels(modules: Page) -> None:
    fine, soft = (pictured(modules, np.zeros(68), "front", 256, edges) for edges in ("fine", "soft"))
    # Four samples a pixel: an outline has a quarter, a half, three quarters of the face's colour.
    off = np.abs(fine[..., 3, None] - [0, 64, 128, 191, 255]).min(axis=-1)
    assert (off > 1).mean() < 0.001  # single hairs, which are blended, cross the outline in few places
    apart = np.abs(fine - soft)
    assert apart.mean() < 4.0
    assert 0.002 < (apart.max(axis=-1) > 24).mean() < 0.1  # on edges, and there alone
    many = pictured(modules, np.zeros(68), "front", 1024, "fine").reshape(256, 4, 256, 4, 4).mean(axis=(1, 3))
    edges = apart.max(axis=-1) > 8
    off = {name: np.abs(found - many)[edges].mean() for name, found in (("fine", fine), ("soft", soft))}
    assert off["fine"] < 0.6 * off["soft"]


def test_the_server_s_clock_is_the_fastest_ping_s(modules: Page) -> None:
    code = """const clock = new m.ServerClock();
        const before = [clock.known, clock.at(5)];
        clock.add(10, 1010.4, 10.6);  // 0.6 s on its way, one way slower than the other
        clock.add(11, 1011.01, 11.02);
        clock.add(12, 1012.9, 13);
        const found = clock.at(20);
        for (let n = 0; n < 16; ++n) clock.add(30 + n, 1040.1 + n, 30.2 + n);
        return [...before, found, clock.at(20)];"""
    known, unknown, best, later = calculated(modules, "time.js", code)
    assert (known, unknown) == (False, 5)
    assert best == pytest.approx(1020.0)
    assert later == pytest.approx(1030.0)  # old pings are forgotten: clocks drift


def test_uneven_frames_are_shown_evenly(modules: Page) -> None:
    rng = np.random.default_rng(3)
    times = 1000 + np.arange(600) / 60
    arrivals = np.maximum.accumulate(times - 990 + 0.005 + rng.exponential(0.006, 600))
    kept = rng.random(600) > 0.02
    kept[0] = kept[-1] = True
    code = """const buffer = new m.JitterBuffer(60);
        const shown = [buffer.sample(0)];
        let next = 0;
        for (let now = given.arrivals[0]; now < given.arrivals.at(-1) + 0.2; now += 1 / 144) {
            while (next < given.times.length && given.arrivals[next] <= now) {
                const faps = new Int32Array(68).fill(Math.round(1e4 * (given.times[next] - 1000)));
                buffer.push({ number: given.numbers[next], time: given.times[next], faps }, given.arrivals[next]);
                ++next;
            }
            const { faps, time } = buffer.sample(now);
            shown.push([now, time, faps[0], faps[67]]);
        }
        return [shown, buffer.lost];"""
    given = {"times": times[kept], "arrivals": arrivals[kept], "numbers": np.flatnonzero(kept)}
    (before, *shown), lost = calculated(
        modules, "time.js", code, **{key: value.tolist() for key, value in given.items()}
    )
    now, time_s, first, last = np.array(shown).T
    assert before is None
    assert lost == (~kept).sum()
    assert (np.diff(time_s) >= 0).all()
    assert np.allclose(first, 1e4 * (time_s - 1000), atol=2.0)  # between frames, not the nearest
    assert (first == last).all()
    settled = slice(300, 1300)
    steps = np.diff(time_s[settled])
    assert np.mean(np.abs(steps - 1 / 144) < 1 / 500) > 0.9  # time passes evenly
    arrived = times[np.searchsorted(arrivals, now[settled], side="right") - 1]
    assert np.mean(np.abs(np.diff(arrived) - 1 / 144) < 1 / 500) < 0.1  # as the newest frame would not
    lag = now[settled] - (time_s[settled] - 990)
    assert 0.005 < lag.mean() < 0.045
    assert time_s[-1] == times[-1]  # it ends with the newest


def test_time_on_the_screen_does_not_jump_when_the_network_gets_better(modules: Page) -> None:
    times = np.arange(360) / 60
    held_up = np.where((times < 2) & (np.arange(360) % 10 == 0), 0.08, 0.0)
    arrivals = np.maximum.accumulate(times + 5 + held_up)
    code = """const buffer = new m.JitterBuffer(60);
        const shown = [];
        let next = 0;
        for (let now = 5.1; now < 10.9; now += 1 / 60) {
            while (given.arrivals[next] <= now) {
                const frame = { number: next, time: given.times[next], faps: new Int32Array(68) };
                buffer.push(frame, given.arrivals[next++]);
            }
            shown.push(buffer.sample(now).time);
        }
        return shown;"""
    shown = np.array(calculated(modules, "time.js", code, times=times.tolist(), arrivals=arrivals.tolist()))
    steps, lag = np.diff(shown), 0.1 + np.arange(len(shown)) / 60 - shown
    assert (steps >= 0).all()
    assert steps[30:].max() < 0.03  # a jump would be of 0.08
    assert lag[-1] < lag[100] - 0.03  # it has learnt that it need not wait


def test_a_new_server_or_a_long_sleep_begins_anew(modules: Page) -> None:
    code = """const buffer = new m.JitterBuffer(60);
        const frame = (number, time) => ({ number, time, faps: new Int32Array(68) });
        buffer.push(frame(100, 50), 1);
        buffer.push(frame(101, 50.1), 1.1);
        buffer.push(frame(3, 2), 1.2);
        const restarted = [buffer.frames.length, buffer.lost, buffer.sample(1.3).time];
        buffer.push(frame(900, 30), 1.4);
        return [...restarted, buffer.frames.length];"""
    assert calculated(modules, "time.js", code) == [1, 0, 2, 1]


def test_a_silent_server_s_face_comes_to_rest_and_back(modules: Page) -> None:
    code = """const fadeOut = new m.FadeOut();
        const silence = (now) => (now < 1 ? 0 : now < 2 ? now - 1 : 0);
        return Array.from({ length: 180 }, (_, n) => fadeOut.at(n / 60, silence(n / 60)));"""
    value = np.array(calculated(modules, "time.js", code))
    at_s = np.arange(180) / 60
    assert value[0] == 0
    assert (value[(at_s > 0.3) & (at_s < 1.29)] == 1).all()
    assert (value[(at_s > 1.6) & (at_s < 2)] == 0).all()
    assert (value[at_s > 2.3] == 1).all()
    assert np.abs(np.diff(value)).max() < 0.15  # never a jump


def test_pixels_are_given_up_for_the_rate_and_come_back_slowly(modules: Page) -> None:
    code = """const budget = new m.PixelBudget();
        const pass = (interval, count) => {
            for (let n = 0; n < count; ++n) budget.add(interval);
            return budget.scale;
        };
        return [pass(1 / 60, 600), pass(1 / 2, 1), pass(1 / 30, 15), pass(1 / 30, 30), pass(1 / 30, 1000),
            pass(1 / 60, 3000), pass(1 / 60, 40000)];"""
    steady, hiccup, short, slow, slowest, soon, later = calculated(modules, "time.js", code)
    assert (steady, hiccup, short) == (1, 1, 1)
    assert slow == pytest.approx(0.64)
    assert slowest == pytest.approx(0.4)
    assert soon < later == 1


def test_two_pictures_a_second_are_answered_at_once(modules: Page) -> None:
    code = """const budget = new m.PixelBudget(given.card);
        return Array.from({ length: 4 }, () => (budget.add(0.4), [budget.fine, budget.scale]));"""
    assert calculated(modules, "time.js", code, card=False) == [[False, 0.5], [False, 0.4], [False, 0.4], [False, 0.4]]
    assert calculated(modules, "time.js", code, card=True)[0] == [False, 0.5]


def test_words_of_a_text_are_found_in_it_with_all_between(modules: Page) -> None:
    code = """const word = (word, count) => Array.from({ length: count }, () => ({ label: "a", word }));
        const phones = [...word(null, 1), ...word("Well", 3), ...word("well", 2), ...word("xx", 1), ...word("I", 1)];
        return [m.captionPieces({ text: "Well, well -- 2 I!", phones }), m.captionPieces({ text: "", phones })]
            .map((pieces) => pieces.map(({ text, first, last }) => [text, first, last]));"""
    assert calculated(modules, "utterances.js", code) == [
        [["Well", 1, 3], [", ", -1, -1], ["well", 4, 5], [" -- 2 ", -1, -1], ["I", 7, 7], ["!", -1, -1]],
        [["Well", 1, 3], [" ", -1, -1], ["well", 4, 5], [" ", -1, -1], ["xx", 6, 6], [" ", -1, -1], ["I", 7, 7]],
    ]


def test_phones_of_two_utterances_are_told_though_both_ended_between_two_pictures(modules: Page) -> None:
    code = """const told = [], one = Object.create(m.Session.prototype);
        const utterances = one.utterances = new Utterances();
        one.tell = (type, { utterance, label }) => told.push([type, utterance, label ?? ""]);
        const say = (number, time, labels) => {
            utterances.phones(number, 0, labels.map((label, place) => [label, place / 10, (place + 1) / 10, null]));
            utterances.position(number, 0, time);
        };
        say(1, 10, ["m", "a"]);
        one.follow(10.01);
        say(2, 11, ["p", "a"]);
        utterances.over(1);
        utterances.over(2);
        one.follow(15);
        return told;"""
    code = f"return import('/face/utterances.js').then(({{ Utterances }}) => {{ {code} }});"
    assert calculated(modules, "session.js", code) == [
        ["begin", 1, ""], ["phone", 1, "m"], ["phone", 1, "a"], ["begin", 2, ""], ["phone", 2, "p"], ["phone", 2, "a"],
    ]  # fmt: skip


EDGES_AND_SCALE = """const budget = new m.PixelBudget(true);
    const seen = [];
    // A screen shows a picture at its next turn, however soon it was drawn.
    const pass = (count, cost) => {
        for (let n = 0; n < count; ++n) {
            const drawn = cost(budget.fine, budget.scale) / given.turn;
            budget.add(Math.max(1, Math.ceil(drawn)) * given.turn);
            const now = `${budget.fine ? "fine" : "soft"} ${budget.scale.toFixed(2)}`;
            if (now !== seen.at(-1)) seen.push(now);
        }
    };
"""


def test_a_card_that_holds_soft_edges_but_not_fine_ones_keeps_to_soft_ones(modules: Page) -> None:
    code = EDGES_AND_SCALE + "pass(30_000, (fine) => (fine ? 0.02 : 0.01)); return seen;"
    assert calculated(modules, "time.js", code, turn=1 / 60) == ["fine 1.00", "soft 1.00"]


def test_a_card_that_is_too_slow_gives_up_pixels_and_finds_its_rate(modules: Page) -> None:
    code = EDGES_AND_SCALE + "pass(400, (fine, scale) => (fine ? 0.035 : 0.033 * scale ** 2)); return seen;"
    assert calculated(modules, "time.js", code, turn=1 / 60) == ["fine 1.00", "soft 1.00", "soft 0.80", "soft 0.64"]
    code = EDGES_AND_SCALE + "pass(400, (fine, scale) => 0.08 * scale ** 2); return seen;"
    assert calculated(modules, "time.js", code, turn=1 / 60)[-1] == "soft 0.41"


def test_pixels_that_help_a_little_from_the_first_picture_on_are_not_taken_back(modules: Page) -> None:
    code = EDGES_AND_SCALE + "pass(400, (fine, scale) => 0.06 + 0.02 * scale ** 2); return seen;"
    assert calculated(modules, "time.js", code, turn=1e-4)[-1] == "soft 0.40"


def test_on_a_slow_screen_nothing_is_given_up_for_nothing(modules: Page) -> None:
    code = EDGES_AND_SCALE + "pass(5000, () => 0.002); return seen;"
    seen = calculated(modules, "time.js", code, turn=1 / 30)
    assert seen == ["fine 1.00", "soft 1.00", "soft 0.80", "soft 0.64", "fine 1.00"]


def test_damaged_files_and_frames_are_told(modules: Page) -> None:
    code = """const told = [];
        for (const bytes of [new Uint8Array(4), new Uint8Array(64)]) {
            try { m.parseHead(bytes.buffer); } catch (error) { told.push(error.message); }
        }
        return told;"""
    assert calculated(modules, "head.js", code) == [
        f"head.bin: got {count} bytes that do not begin with FAPHEAD1" for count in (4, 64)
    ]
    code = "return [new ArrayBuffer(100), new ArrayBuffer(288)].map((buffer) => m.parseFrame(buffer));"
    assert calculated(modules, "wire.js", code) == [None, None]


def test_visemes_and_expressions_of_a_file_are_shown_as_python_shows_them(modules: Page) -> None:
    rng = np.random.default_rng(8)
    count = 60
    values = np.rint(plausible(count)).astype(np.int32)
    mask = rng.random((count, 68)) < 0.2
    mask[:, :2] = rng.random((count, 2)) < 0.6
    visemes = np.column_stack([rng.integers(0, 15, (count, 2)), rng.integers(0, 64, count), rng.integers(0, 2, count)])
    selects, weights = rng.integers(0, 7, (2, count)), rng.integers(0, 64, (2, count))
    expressions = np.column_stack([selects[0], weights[0], selects[1], weights[1], *rng.integers(0, 2, (2, count))])
    sent = replace(
        FapTrack.from_values(values * (np.arange(68) > 1), rate_hz=25.0), mask=mask, visemes=visemes * mask[:, :1],
        expressions=expressions * mask[:, 1:2], values=values * mask * (np.arange(68) > 1),
    )  # fmt: skip
    found = calculated(
        modules, "player.js", "return m.parseFap(given.text).frames.map((faps) => [...faps]);", text=format_fap(sent)
    )
    expected = expand(sent, load_profile("grid_s1_en"))
    rounded = np.where(expected.mask, expected.values, 0)
    low, high = np.array([(0, 0), (0, 0), *map(limits, range(3, 69))]).T
    # Faces are rounded for pages, and pages do not clip. A definition multiplies the rounding by 63 over its intensity.
    assert np.abs(np.clip(found, low, high) - rounded).max() <= 2
