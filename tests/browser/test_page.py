"""The page as somebody sees and uses it, in a real browser."""

import base64
import io
import wave
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from fapengine.files.profiles import load_profile
from fapengine.files.report.parts import new_figure, picture, table, to_svg, verdict
from fapengine.files.report.parts import page as report_page
from fapengine.mpeg4 import fap
from fapengine.recognition.protocol import RATE_HZ
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.browser.conftest import OWN_TURNS, Page
from tests.unit.recognition.speech import BABY, spoken

NEWEST = "page.session.jitterBuffer.frames.at(-1).faps"
REST = f"{NEWEST}.every((value) => value === 0)"
PLAN_HZ = 240.0
KEEP_FRAMES = """
    window.kept = { frames: [], texts: [] };
    const push = page.session.jitterBuffer.push.bind(page.session.jitterBuffer);
    page.session.jitterBuffer.push = (frame, arrival) => { kept.frames.push(frame); push(frame, arrival); };
    const message = page.session.message.bind(page.session);
    page.session.message = (said) => { kept.texts.push(said); message(said); };
"""
HOLD = """(() => {
    page.session.jitterBuffer.sample = (now, faps) => { faps.set(%s); return { faps, time: now }; };
    page.session.fadeOut.at = () => 1;
    return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
})()"""
"""Show one row of FAPs from now on."""


def say(page: Page, text: str) -> None:
    """Type a sentence and press Enter, with the sound off."""
    page.run("page.hasChosenSilence = true; document.getElementById('text').value = ''")
    page.run("document.getElementById('text').focus()")
    page.call("Input.insertText", text=text)
    page.key("Enter")


def stage(picture: np.ndarray, page: Page) -> np.ndarray:
    """The part of a picture that shows the face."""
    box = page.run(
        "(({ left, top, width, height }) => [left, top, width, height])(page.picture.canvas.getBoundingClientRect())"
    )
    left, top, width, height = (round(value) for value in box)
    whole = picture[top : top + height, left : left + width].astype(int)
    return whole[int(0.16 * height) : int(0.84 * height)]  # without what is written over it


def slide(page: Page, slider: str, value: float) -> None:
    page.run(
        f"(() => {{ const input = document.getElementById('{slider}'); input.value = {value};"
        " input.dispatchEvent(new Event('input')); })()"
    )


def test_the_page_loads_and_shows_a_face(page: Page) -> None:
    page.open("anna")
    page.until("document.getElementById('fps').textContent !== '–'")
    page.until("document.getElementById('latency').textContent.endsWith('ms')")
    assert page.run("document.getElementById('session').textContent") == "anna"
    picture = stage(page.picture(), page)
    middle = picture[picture.shape[0] // 2, picture.shape[1] // 2]
    assert middle[0] > 140 > picture[5, 5].max()  # skin in the middle, a dark wall in the corner
    assert middle[0] > middle[2] + 20
    assert page.run("document.querySelectorAll('#expressions input').length") == 9
    assert page.run("document.querySelectorAll('.fap').length") == 66
    every_field_is_named = (
        "[...document.querySelectorAll('input, button')].every((one) => one.labels?.length || one.textContent)"
    )
    assert page.run(every_field_is_named)


def test_the_face_moves_while_it_speaks_and_rests_before_and_after(page: Page) -> None:
    page.open("berta")
    page.until(REST)
    page.run(KEEP_FRAMES)
    page.run("page.picture.budget.add = () => false")  # a busy machine would draw fewer pixels
    page.until("!page.picture.resized")
    before = [stage(page.picture(), page) for _ in range(2)]
    say(page, "Many people like to sing along with the radio, and many more like to hum while they walk home.")
    page.until(f"page.picture.faps[{fap.column(3)}] > 50")
    page.run("kept.words = [...document.querySelectorAll('.word')].map((one) => one.textContent)")
    speaking = [stage(page.picture(), page) for _ in range(5)]
    page.until("kept.texts.some((text) => text.kind === 'finished')")
    page.until(REST)
    page.sleep(0.3)
    after = stage(page.picture(), page)
    assert np.abs(before[0] - before[1]).max() <= 2
    assert np.abs(before[0] - after).max() <= 2
    moves = [(np.abs(after - before).max(axis=-1) > 20).sum() > 100 for before, after in pairwise(speaking)]
    assert sum(moves) >= 3  # a busy machine may show one picture twice
    phones = [label for text in page.run("kept.texts") if text["type"] == "phones" for label, *_ in text["phones"]]
    assert "ŋ" in phones
    words = page.run("kept.words")
    assert words[:6] == ["Many", "people", "like", "to", "sing", "along"]  # espeak-ng takes "with the" for one
    frames = np.array(
        [
            [frame["number"], frame["time"]]
            for frame in page.run("kept.frames.map(({ number, time }) => ({ number, time }))")
        ]
    )
    assert len(frames) > 100
    assert (np.diff(frames, axis=0) > 0).all()


def test_lips_are_closed_on_m_and_open_on_a(page: Page) -> None:
    """The page is sent what the planner says, and draws it: whichever frames a busy machine had time for."""
    page.open("clara", OWN_TURNS)
    assert "[native code]" in page.run("String(requestAnimationFrame)")
    page.run(KEEP_FRAMES)
    say(page, "Mama, mama.")
    page.until("kept.texts.some((text) => text.kind === 'finished')")
    texts, frames = page.run("[kept.texts, kept.frames.map(({ time, faps }) => [time, [...faps]])]")
    zero_s = next(text["time_s"] - text["position_s"] for text in texts if text["type"] == "position")
    phones = [Phone(*phone[:3]) for text in texts if text["type"] == "phones" for phone in text["phones"]]
    profile, style, unused = load_profile("grid_s1_en"), Style.speech_only(), np.random.default_rng(1)
    planned = plan(PhoneTrack.from_phones(phones), profile, rng=unused, rate_hz=PLAN_HZ, style=style).track.values

    def faps_at(time_s: float) -> np.ndarray:
        index = min(int(time_s * PLAN_HZ), len(planned) - 2)  # a frame may come in the last 4 ms of the plan
        share = time_s * PLAN_HZ - index
        return planned[index] * (1 - share) + planned[index + 1] * share

    starts_s = phones[1].start_s  # before, it gets ready in less time than the plan has
    during = [(time_s - zero_s, faps) for time_s, faps in frames if starts_s <= time_s - zero_s < phones[-1].end_s]
    assert during
    assert max(np.abs(faps_at(time_s) - faps).max() for time_s, faps in during) <= 4  # 1.7, of rounding
    page.run("page.steering.fly(page.steering.presets.findIndex(([name]) => name === 'mouth'))")
    page.until("page.steering.flight === null")

    def middles(label: str) -> list[np.ndarray]:
        """Colours down the middle of the lips, in the middle of every such phone."""
        found = []
        for phone in phones:
            if phone.label != label:
                continue
            page.run(HOLD % faps_at((phone.start_s + phone.end_s) / 2).round().tolist())
            picture = stage(page.picture(), page)
            height, width, _ = picture.shape
            found.append(picture[int(0.2 * height) : int(0.7 * height), width // 2 - 3 : width // 2 + 3].mean(axis=1))
        return found

    closed, opened = middles("m"), middles("ɑː")
    assert (len(closed), len(opened)) == (4, 2)
    for column in closed:  # but for the line where the lips meet all is skin and lips, which are red
        assert (column[:, 0] - column[:, 2] < 42).sum() <= 6  # 3; of open lips 98
    other = [int((np.abs(column - closed[0]).max(axis=1) > 25).sum()) for column in (*closed, *opened)]
    assert max(other[:4]) <= 15
    assert min(other[4:]) >= 40  # where lips were there are teeth, tongue and the cavity


def test_a_slider_moves_the_face_and_lets_it_go(page: Page) -> None:
    page.open("dora")
    page.until(REST)
    rest = stage(page.picture(), page)
    page.run("[...document.querySelectorAll('.faps details')].forEach((details) => (details.open = true))")
    jaw, lip = fap.column(3), fap.column(5)
    slide(page, "fap-3", 900)  # lips follow the jaw, and are released with it
    page.until(f"{NEWEST}[{lip}] === -990 && {NEWEST}[{jaw}] === 900")
    page.run("document.querySelector('.fap.held .let-go').click()")
    page.until(REST)
    page.run("document.getElementById('lips-follow').click()")
    slide(page, "fap-3", 900)
    slide(page, "fap-5", -600)
    page.until(f"{NEWEST}[{lip}] === -600 && {NEWEST}[{jaw}] === 900")
    page.sleep(0.3)
    moved = stage(page.picture(), page)
    assert (np.abs(moved - rest).max(axis=-1) > 30).sum() > 300
    assert page.run("document.querySelectorAll('.fap.held').length") == 2
    page.run("document.querySelector('.fap.held .let-go').click()")
    page.until(f"{NEWEST}[{jaw}] === 0 && {NEWEST}[{lip}] === -600")
    page.run("document.getElementById('release').click()")
    page.until(REST)
    page.until("document.querySelectorAll('.fap.held').length === 0 && document.getElementById('release').disabled")


def test_the_head_is_turned_by_hand_by_keys_and_for_whoever_watches(page: Page) -> None:
    page.open("dina")
    page.until(REST)
    rest = stage(page.picture(), page)
    pitch, yaw, roll = (fap.column(number) for number in (48, 49, 50))
    slide(page, "head-yaw", 30)
    slide(page, "head-pitch", -10)
    slide(page, "head-roll", 15)
    turned = "page.session.jitterBuffer.frames.at(-1).faps"
    page.until(" && ".join(
        f"Math.abs({turned}[{column}] - {angle_deg} * Math.PI / 180 * 1e5) < 2"
        for column, angle_deg in ((yaw, 30), (pitch, -10), (roll, 15))
    ))  # fmt: skip
    page.sleep(0.3)
    assert (np.abs(stage(page.picture(), page) - rest).max(axis=-1) > 30).sum() > 3000
    assert page.run("document.querySelectorAll('#head output')[0].textContent") == "30°"
    page.run("document.getElementById('head-yaw').focus()")
    page.key("ArrowRight")
    page.until(f"Math.abs({turned}[{yaw}] - 31 * Math.PI / 180 * 1e5) < 2")
    page.run("document.activeElement.blur(); page.session.link.send('head', { yaw: -0.2, pitch: 0, roll: 0 })")
    page.until("document.getElementById('head-yaw').value === '-11'")  # as another page would have it
    page.run("document.getElementById('straight').click()")
    page.until(REST)
    assert page.run("document.getElementById('head-yaw').value") == "0"


def test_an_expression_shows_and_sliders_follow_the_face(page: Page) -> None:
    page.open("emma")
    page.until(REST)
    page.run("document.querySelector('.faps details').open = true")
    slide(page, "expression-joy", 1)
    page.until(f"{NEWEST}[{fap.column(59)}] > 100")
    page.until("Number(document.getElementById('fap-12').value) > 50")
    page.run("document.getElementById('neutral').click()")
    page.until(REST)
    page.until("document.getElementById('fap-12').value === '0'")


def test_a_page_that_is_loaded_anew_knows_a_pause_and_neutral_means_all(page: Page) -> None:
    page.open("elsa")
    page.run(KEEP_FRAMES)
    smile = f"{NEWEST}[{fap.column(59)}]"
    slide(page, "expression-joy", 1)
    page.until(f"{smile} > 100")
    say(page, "Many people like to sing along with the radio.")
    page.until("kept.texts.some((text) => text.kind === 'started')")
    page.run("page.session.pause(true)")
    page.open("elsa")
    page.run(KEEP_FRAMES)
    assert "Paused" in page.run("document.getElementById('told').textContent")
    page.run("document.getElementById('neutral').click()")
    page.until(f"{smile} < 5")
    page.run("document.getElementById('face').focus()")
    page.key(" ")
    page.until("kept.texts.some((text) => text.kind === 'finished')")
    page.until(REST)


def test_faps_are_found_by_name_and_number(page: Page) -> None:
    page.open("fee")

    def found(text: str) -> list[str]:
        page.run(
            "(() => { const box = document.getElementById('search');"
            f" box.value = {text!r}; box.dispatchEvent(new Event('input')); }})()"
        )
        return page.run(
            "[...document.querySelectorAll('.fap')]"
            ".filter((one) => !one.hidden && one.closest('details').open && !one.closest('details').hidden)"
            ".map((one) => one.querySelector('.number').textContent)"
        )

    assert found("eyebrow raise l") == ["31", "33", "35"]
    assert found("48") == ["48"]
    assert found("") == []


def test_a_voice_can_be_chosen(page: Page) -> None:
    page.open("vera")
    page.run("page.sent = []; page.session.link.send = (...what) => { page.sent.push(what); return true; }")
    assert page.run("document.getElementById('voice').options.length") > 100
    for code in ("", "de"):
        page.run(f"page.hasChosenSilence = true; document.getElementById('voice').value = '{code}'; page.say('Hallo')")
    assert page.run("page.sent.filter(([type]) => type === 'say').map(([, fields]) => fields)") == [
        {"text": "Hallo"},
        {"text": "Hallo", "voice": "de"},
    ]


def test_the_keyboard_is_enough(page: Page) -> None:
    page.open("greta")
    page.run("document.getElementById('face').focus(); page.hasChosenSilence = true")
    yaw = page.run("page.steering.camera.yaw")
    page.key("ArrowRight")
    assert page.run("page.steering.camera.yaw") > yaw
    page.key("3")
    page.until("page.steering.flight === null && page.steering.camera.yaw === page.steering.presets[2][1].yaw")
    assert page.run("document.querySelector('.views [aria-pressed=true]').textContent") == page.run(
        "document.querySelector('.views').children[2].textContent"
    )
    page.run(KEEP_FRAMES)
    page.run("document.querySelector('.views').children[0].focus(); page.blinks = 0")
    page.run(
        "const { send } = page.session.link; page.session.link.send = function (type, fields) {"
        " page.blinks += type === 'blink'; return send.call(this, type, fields); }"
    )
    page.key("2")
    page.until("page.steering.flight === null && page.steering.camera.yaw === page.steering.presets[1][1].yaw")
    page.key("B")  # Caps Lock
    assert page.run("page.blinks") == 1
    page.key(" ")  # on a button
    assert not page.run("page.session.paused")
    page.run("document.getElementById('expression-joy').focus()")
    page.key("b")
    assert page.run("page.blinks") == 2
    page.key(" ")  # on a slider
    assert not page.run("page.session.paused")
    page.run("document.getElementById('letters').click()")
    page.key("b")
    assert page.run("page.blinks") == 2
    page.run("document.getElementById('letters').click()")
    page.key("/")
    assert page.run("document.activeElement.id") == "text"
    page.key("b")
    assert page.run("page.blinks") == 2
    page.call("Input.insertText", text="This sentence is long, and nobody will hear the end of it.")
    page.key("Enter")
    page.until("kept.texts.some((text) => text.kind === 'started')")
    page.key("Escape")
    page.until("kept.texts.some((text) => text.kind === 'cancelled')")
    page.until(REST)


def test_a_drag_turns_the_head_and_the_wheel_comes_nearer(page: Page) -> None:
    page.open("hilde")
    before = page.run("page.steering.camera")
    for kind, x, buttons in (("mousePressed", 200, 1), ("mouseMoved", 260, 1), ("mouseReleased", 260, 0)):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=200, button="left", buttons=buttons, clickCount=1)
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=200, y=200, deltaX=0, deltaY=-120)
    page.until(f"page.steering.camera.distance < {before['distance']}")
    assert page.run("page.steering.camera.yaw") == pytest.approx(before["yaw"] - 60 * 0.35)


def test_with_sound_the_face_follows_the_loudspeaker(page: Page) -> None:
    page.open("ida")
    page.run(KEEP_FRAMES + "page.hasChosenSilence = false")
    assert page.run("page.setSound(true).then(() => page.session.sound.on)")
    page.run("document.getElementById('text').value = 'One, two, three, four, five, six, seven, eight, nine, ten.'")
    page.run("document.getElementById('say').click()")
    page.until("page.session.sound.playing.size && [...page.session.sound.playing.values()][0].source")
    page.until("page.session.utterances.current !== null")
    # Where the sound is, against where the face is that is on the screen now.
    page.run("""window.apart = () => {
        const [[number, { starts }]] = page.session.sound.playing;
        const { time } = page.session.jitterBuffer.sample(performance.now() / 1000);
        const shown = time + page.session.utterances.said.get(number).offset;
        return Math.abs(page.session.sound.heard() - starts - shown);
    }""")
    page.until("page.session.sound.heard() > 0.5 && apart() < 0.12")
    page.run("document.getElementById('face').focus()")
    page.key(" ")
    page.until("page.session.sound.context.state === 'suspended'")
    page.until(f"Math.abs({NEWEST}[{fap.column(3)}]) < 5 && page.session.sound.playing.size === 1")
    page.key(" ")
    page.until("page.session.sound.context.state === 'running' && apart() < 0.12")
    page.key("Escape")
    page.until("page.session.sound.playing.size === 0")
    page.run("page.setSound(false)")


def with_sound(page: Page, session: str) -> None:
    page.open(session)
    page.run(KEEP_FRAMES + "page.hasChosenSilence = false")
    assert page.run("page.setSound(true).then(() => page.session.sound.on)")
    page.run("document.getElementById('face').focus()")


def test_what_is_said_before_and_during_a_pause_is_heard_after_it(page: Page) -> None:
    with_sound(page, "ina")
    page.run("""
        const decode = page.session.sound.context.decodeAudioData.bind(page.session.sound.context);
        page.session.sound.context.decodeAudioData = async (data) => {
            while (!window.late) await new Promise((done) => setTimeout(done, 20));
            return decode(data);
        };
        page.session.link.send("say", { text: "One, two, three, four." });""")
    page.until("page.session.sound.playing.size === 1")
    page.key(" ")  # before it is decoded
    page.until("page.session.sound.context.state === 'suspended'")
    page.run("page.session.link.send('say', { text: 'Five, six.' })")
    page.until("page.session.sound.playing.size === 2")
    page.run("window.late = true")
    page.sleep(0.3)
    assert page.run("page.session.sound.playing.size") == 2
    page.key(" ")
    page.until(
        "kept.texts.filter((text) => text.kind === 'finished').length === 2 && page.session.sound.playing.size === 0"
    )
    page.run("page.setSound(false)")


def test_sound_that_is_switched_in_a_pause_stands_still_with_the_face(page: Page) -> None:
    with_sound(page, "isa")
    page.run("page.session.link.send('say', { text: 'One, two, three, four, five, six, seven, eight.' })")
    page.until(
        "[...page.session.sound.playing.values()].some(({ source }) => source) && page.session.sound.heard() > 0.3"
    )
    page.key(" ")
    page.until("page.session.sound.context.state === 'suspended'")
    page.key("m")
    page.until("page.session.sound.playing.size === 0")
    assert page.run("document.getElementById('sound').textContent") == "Sound off"
    page.key("m")
    page.until("document.getElementById('sound').textContent === 'Sound on'")
    page.until("page.session.sound.context.state === 'suspended'")  # still paused
    page.key("m")
    page.until("document.getElementById('sound').textContent === 'Sound off'")
    page.key(" ")
    page.until("kept.texts.some((text) => text.kind === 'finished')")
    assert page.run("page.session.sound.context.state") == "suspended"
    assert not page.run("page.session.sound.on")


def test_sound_that_is_switched_off_in_mid_sentence_stays_off(page: Page) -> None:
    with_sound(page, "ivo")
    page.run("page.session.link.send('say', { text: 'One, two, three, four, five, six, seven, eight.' })")
    page.until("[...page.session.sound.playing.values()].some(({ source }) => source)")
    page.key("m")
    page.until("page.session.sound.context.state === 'suspended'")
    page.key(" ")
    page.key(" ")
    page.sleep(0.2)
    assert page.run("page.session.sound.context.state") == "suspended"
    assert page.run("page.session.sound.playing.size") == 0
    page.run("page.setSound(true)")  # what comes next is heard: nothing waits for an end that never comes
    page.run("page.session.link.send('cancel'); page.session.link.send('say', { text: 'Nine.' })")
    page.until("[...page.session.sound.playing.values()].some(({ source }) => source)")
    page.run("page.setSound(false)")


def test_a_server_that_fell_silent_takes_its_sound_along(page: Page) -> None:
    with_sound(page, "iris")
    page.run("page.session.link.send('say', { text: 'One, two, three, four, five, six, seven, eight.' })")
    page.until("[...page.session.sound.playing.values()].some(({ source }) => source)")
    page.run("page.session.link.heard = -10_000; page.session.link.ping()")
    assert page.run("page.session.sound.playing.size") == 0
    page.until("document.body.dataset.connection === 'connected'")
    page.run("page.session.link.send('cancel'); page.setSound(false)")


def test_where_the_server_plays_the_sound_the_page_does_not(page: Page) -> None:
    page.open("ilse")
    hello = (
        "page.session.message({ type: 'hello', session: 'ilse', rate_hz: 60, profile: 'p', voice: true, sound: %r,"
        " paused: false })"
    )
    page.run(hello % "server")
    assert page.run("document.getElementById('sound').disabled")
    assert page.run("document.getElementById('sound').textContent") == "At server"
    page.run("page.hasChosenSilence = false")
    page.run("document.getElementById('text').value = 'Hello.'")
    page.run("document.getElementById('say').click()")
    page.key("m")
    # It speaks, and waits for no sound of ours.
    page.until(f"{NEWEST}[{fap.column(3)}] > 50")
    assert not page.run("page.session.sound.on")
    page.run(hello % "page")
    assert not page.run("document.getElementById('sound').disabled")


def test_what_is_said_has_the_rate_that_was_chosen_and_comes_back_by_arrow_keys(page: Page) -> None:
    page.open("rita")
    page.run("sessionStorage.removeItem('history'); location.reload()")
    page.until("window.page?.session.jitterBuffer.frames.length > 3 && page.history.texts.length === 0")
    page.run("page.sent = []; page.session.link.send = (...what) => { page.sent.push(what); return true; }")
    say(page, "First.")
    slide(page, "rate", 250)
    say(page, "Second.")
    said = "page.sent.filter(([type]) => type === 'say').map(([, fields]) => fields)"
    assert page.run(said) == [{"text": "First."}, {"text": "Second.", "rate": 250}]
    seen = []
    for key in ("ArrowUp", "ArrowUp", "ArrowUp", "ArrowDown", "ArrowDown"):
        page.key(key)
        seen.append(page.run("document.getElementById('text').value"))
    assert seen == ["First.", "First.", "First.", "Second.", "Second."]  # the last one still stands in the box
    page.run("document.getElementById('text').value = 'x'.repeat(3500)")
    page.key("Enter")
    assert "3500 characters; at most 2000 are allowed" in page.run("document.getElementById('told').textContent")
    assert len(page.run(said)) == 2


def test_another_face_a_film_and_a_clear_ground(page: Page) -> None:
    page.open("willa")
    page.until(REST)
    page.run("window.first = page.picture.view.head; 0")
    before = stage(page.picture(), page)
    page.run("(() => { const who = document.getElementById('who'); who.value = 'child';"
             " who.dispatchEvent(new Event('change')); })()")  # fmt: skip
    page.until("document.getElementById('told').textContent === '' && page.picture.view.head !== window.first")
    page.sleep(0.3)
    assert (np.abs(stage(page.picture(), page) - before).max(axis=-1) > 30).sum() > 3000
    assert page.run("page.picture.view.gl.getError()") == 0
    page.run("page.recorder.start(); page.say('Hello.')")
    page.until("page.session.isSpeaking")
    page.sleep(1.5)  # a busy machine draws few pictures
    kind, size = page.run("page.recorder.stop().then((film) => [film.type, film.size])")
    assert kind.startswith("video/")
    assert size > 3000
    page.run("page.setSound(false)")
    page.open("willa", "&transparent&camera=mouth")
    green = {"r": 0, "g": 255, "b": 0, "a": 1}
    page.call("Emulation.setDefaultBackgroundColorOverride", color=green)
    page.run("page.steering.fly('front', { atOnce: true })")
    page.sleep(0.3)
    picture = page.picture()
    page.call("Emulation.setDefaultBackgroundColorOverride")
    assert picture[5, 5].tolist() == picture[-5, 5].tolist() == [0, 255, 0]  # nothing is written over it, either
    middle = picture[picture.shape[0] // 2, picture.shape[1] // 2]
    assert middle[0] > middle[2] + 20
    page.run("page.session.play(false)")


def test_a_recording_moves_the_face(page: Page) -> None:
    page.open("mike")
    page.until("!document.getElementById('file').hidden")
    page.run(KEEP_FRAMES)
    buffer = io.BytesIO()
    sound = np.repeat(spoken("rms", BABY).samples, 2)  # at another rate, and in two channels
    with wave.open(buffer, "wb") as file:
        file.setparams((2, 2, 2 * RATE_HZ, 0, "NONE", ""))
        file.writeframes(np.stack([sound, sound], axis=1).astype("<i2").tobytes())
    data = base64.b64encode(buffer.getvalue()).decode()
    page.run(f"const bytes = Uint8Array.from(atob('{data}'), (one) => one.charCodeAt(0));"
             "page.sayFile(new File([bytes], 'baby.wav'))")  # fmt: skip
    page.until("kept.texts.some((text) => text.kind === 'finished')")
    labels = [label for text in page.run("kept.texts") if text["type"] == "phones" for label, *_ in text["phones"]]
    assert sum(label in ("p", "b", "m") for label in labels) >= 4
    page.run("page.sayFile(new File(['no sound'], 'letter.txt'))")
    page.until("document.getElementById('told').textContent.startsWith('letter.txt: got no sound')")


def test_manner_is_told_to_every_page(page: Page) -> None:
    page.open("manu")
    assert page.run("document.getElementById('manner-idle').checked") is False  # as this server was started
    page.run("page.session.send('manner', { setting: 'jaw', value: 0.2 })")  # as another page or OSC would
    page.run("page.session.send('manner', { setting: 'gaze', value: 1 })")
    shown = "[document.getElementById('manner-jaw').value, document.getElementById('manner-gaze').checked]"
    page.until(f"{shown}.join() === '0.2,true'")
    page.open("manu")
    assert page.run(shown) == ["0.2", True]


def test_the_caption_is_what_is_being_said_and_the_queue_what_waits(page: Page) -> None:
    page.open("cara")
    page.run(KEEP_FRAMES)
    for text in ("The first one, now.", "And the second one.", "Third one.", "Fourth.", "Fifth."):
        page.run(f"page.session.say({text!r})")
        page.until(f"kept.texts.some((said) => said.type === 'sound' && said.text === {text!r})")
    said, queue = (
        "document.getElementById('said').textContent",
        "document.getElementById('queue').innerText.split('\\n')",
    )
    waiting = "And the second one.|Third one.|Fourth.|and 1 more"
    page.until(f"{said} === 'The first one, now.' && {queue}.join('|') === '{waiting}'")
    page.until("document.querySelector('#said .now')?.textContent === 'first'")
    page.until(f"{said} === 'And the second one.' && {queue}.join('|') === 'Third one.|Fourth.|Fifth.'")
    page.key("Escape")
    page.until(f"{queue}.join('') === ''")


def test_at_rest_every_second_turn_is_drawn_and_what_does_not_change_is_not(page: Page) -> None:
    page.open("irma")
    page.until(REST)
    count = """(moves) => {
        const { picture } = page;
        cancelAnimationFrame(picture.asked);
        const sample = picture.sample;
        let number = 0;
        picture.sample = (now, faps) => (faps.fill(moves ? ++number : 0), { time: now });
        const before = picture.count;
        for (let turn = 1; turn <= 120; ++turn) {
            cancelAnimationFrame(picture.asked);
            picture.turn(picture.lastTurn + 1000 / 60);
        }
        picture.sample = sample;
        return picture.count - before;
    }"""
    page.run("page.picture.movedAt = -Infinity")
    assert page.run(f"({count})(true)") in range(58, 63)
    assert page.run(f"({count})(false)") <= 1
    page.run("page.picture.isBusy = () => true")
    assert page.run(f"({count})(true)") in range(118, 121)


def test_a_hidden_page_is_sent_nothing_and_nothing_piles_up(page: Page) -> None:
    page.open("hida")
    page.run(KEEP_FRAMES)
    page.run("""Object.defineProperty(document, "hidden", { configurable: true, get: () => Boolean(window.isHidden) });
        window.hide = (wanted) => {
            window.isHidden = wanted;
            document.dispatchEvent(new Event("visibilitychange"));
        };
        hide(true);""")
    page.sleep(0.5)
    seen = page.run("kept.frames.length")
    page.sleep(0.5)
    assert page.run("kept.frames.length") == seen
    page.run("page.session.link.heard = -10_000; page.session.link.ping(); hide(false)")
    assert page.run("document.body.dataset.connection") == "connected"  # silence was wanted
    page.until(f"kept.frames.length > {seen + 3}")
    nodes = {}
    for when in ("before", "after"):
        page.call("HeapProfiler.collectGarbage")
        metrics = page.call("Memory.getDOMCounters")
        nodes[when] = metrics["nodes"]
        page.run("for (let turn = 0; turn < 300; ++turn) page.count(page.rate.since + 501)")
    assert page.call("Memory.getDOMCounters")["nodes"] <= nodes["before"] + 20  # without the collector's help
    assert nodes["after"] <= nodes["before"] + 20


def test_no_button_lies_over_the_face_at_400_percent(page: Page) -> None:
    page.open("hella")
    page.call("Emulation.setDeviceMetricsOverride", width=320, height=200, deviceScaleFactor=1, mobile=True)
    page.sleep(0.2)
    face, views = (
        page.run(f"(({{ top, bottom }}) => [top, bottom])(document.getElementById('{name}').getBoundingClientRect())")
        for name in ("face", "views")
    )
    page.call("Emulation.clearDeviceMetricsOverride")
    assert face[0] + 100 <= face[1] <= views[0] < views[1] <= 200


@pytest.mark.parametrize(("width", "height", "landscape"), [(360, 225, False), (844, 390, True)])
def test_a_short_window_shows_all_that_can_be_used(page: Page, width: int, height: int, landscape: bool) -> None:
    page.open("jette")
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=True)
    page.sleep(0.2)
    at = "document.elementFromPoint({x}, {y})?.closest('.stage') === null"
    if landscape:  # beside the face, at first sight
        top, bottom = page.run(
            "(({ top, bottom }) => [top, bottom])(document.getElementById('say').getBoundingClientRect())"
        )
        assert 0 <= top < bottom <= height
    page.run("scrollTo(0, document.documentElement.scrollHeight)")
    reached = [page.run(at.format(x=0.75 * width, y=share * height)) for share in (0.2, 0.5, 0.8)]
    page.run("document.getElementById('text').scrollIntoView({ block: 'center' })")
    box = "document.getElementById('text').getBoundingClientRect()"
    reached.append(page.run(f"(({{ x, y }}) => document.elementFromPoint(x + 9, y + 9).id)({box}) === 'text'"))
    wide = page.run("document.documentElement.scrollWidth")
    page.call("Emulation.clearDeviceMetricsOverride")
    assert reached == [True] * 4
    assert wide <= width


def test_a_report_fits_a_telephone_and_begins_with_its_verdict(page: Page, tmp_path: Path) -> None:
    figure, (axes,) = new_figure(10.0, 2.0)
    axes.plot([0, 1], [0, 1])
    wide = tuple(f"a column of some words {n}" for n in range(12))
    parts = ["<h1>x</h1>", verdict("good", "It speaks."), "<h2>A</h2>", table(wide, [wide]), "<h2>B</h2>"]
    path = tmp_path / "report.html"
    path.write_bytes(report_page("x", [*parts, picture(to_svg(figure), "A line."), f"<code>{'x' * 300}</code>"]))
    page.call("Emulation.setDeviceMetricsOverride", width=390, height=740, deviceScaleFactor=1, mobile=True)
    page.go(path.as_uri())
    page.until("document.title === 'x'")
    wide_px, scrolls = page.run(
        "[document.documentElement.scrollWidth, document.querySelector('.scroll').scrollWidth > 390]"
    )
    first = page.run("document.querySelector('h1').nextElementSibling.textContent")
    page.call("Emulation.clearDeviceMetricsOverride")
    assert (wide_px, scrolls, first) == (390, True, "Good. It speaks.")


def test_sliders_are_there_in_forced_colours(page: Page) -> None:
    page.open("fiona")
    page.call("Emulation.setEmulatedMedia", features=[{"name": "forced-colors", "value": "active"}])
    before = page.run("getComputedStyle(document.getElementById('expression-joy')).appearance")
    left, top, right, bottom = page.run(
        "(({ left, top, right, bottom }) => [left, top, right, bottom].map(Math.round))"
        "(document.getElementById('expression-joy').getBoundingClientRect())"
    )
    slider = page.picture()[top:bottom, left:right].astype(int).mean(axis=2)
    page.call("Emulation.setEmulatedMedia", features=[])
    assert before == "auto"
    assert np.ptp(slider[:, 2:-2], axis=0).min() > 60  # its track is seen from end to end


def test_the_face_fills_the_screen_and_comes_back(page: Page) -> None:
    page.open("frida")
    page.run("document.getElementById('full').click()")
    page.until("document.fullscreenElement?.id === 'stage'")
    page.run("document.getElementById('full').click()")
    page.until("document.fullscreenElement === null")


def test_everything_to_be_pressed_is_24_pixels_high_and_wide(page: Page) -> None:
    page.open("zita")
    small = page.run("""(() => {
        for (const details of document.querySelectorAll("details")) details.open = true;
        const sizes = [...document.querySelectorAll("button, input, select, summary")]
            .map((one) => (one.type === "checkbox" ? one.closest("label") : one))
            .filter((one) => one.checkVisibility({ visibilityProperty: true }) && !one.matches(".unseen"))
            .map((one) => [one.id || one.textContent, one.getBoundingClientRect()]);
        if (sizes.length < 90) throw new Error(`only ${sizes.length} controls`);
        return sizes.filter(([, { width, height }]) => Math.min(width, height) < 24).map(([name]) => name);
    })()""")
    assert small == []


@pytest.mark.parametrize("width", [320, 390, 768])
def test_the_page_fits_a_narrow_screen(page: Page, width: int) -> None:
    page.open("jana")
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=740, deviceScaleFactor=2, mobile=True)
    page.sleep(0.2)
    wide, canvas = page.run(
        "[document.documentElement.scrollWidth, page.picture.view.canvas.getBoundingClientRect().height]"
    )
    page.call("Emulation.clearDeviceMetricsOverride")
    assert wide <= width
    assert canvas > 270


def test_a_server_that_is_killed_or_ends_is_looked_for_and_found_again(page: Page) -> None:
    page.open("karla")
    page.run(KEEP_FRAMES)
    assert page.run("page.setSound(true)") is None
    say(page, "Ah, ah, ah, this mouth is wide open when the server goes away.")
    jaw = fap.column(3)
    page.until(f"{NEWEST}[{jaw}] > 150")
    assert page.run("page.session.sound.playing.size") == 1
    page.server.kill()
    page.until("document.body.dataset.connection === 'waiting'")
    assert page.run("page.session.sound.playing.size") == 0
    page.run("page.setSound(false)")
    page.until("page.picture.faps.every((value) => value === 0)")  # the mouth does not stay open
    page.server.start("--token", "a secret")
    page.until("!document.getElementById('notice').hidden")
    assert "token" in page.run("document.getElementById('notice').textContent")
    page.go(f"{page.server.url}?session=karla")
    page.until("!window.page && !document.getElementById('notice').hidden")
    assert "token" in page.run("document.getElementById('notice').textContent")
    page.open("karla", "&token=a%20secret")
    assert page.run("document.getElementById('notice').hidden")
    page.open("karla")  # the token is remembered
    assert page.server.end() == 0
    page.until("document.body.dataset.connection === 'waiting'")
    page.server.start()
    page.until("document.body.dataset.connection === 'connected' && page.session.fadeOut.value === 1")
    say(page, "Hello again.")
    page.until(f"{NEWEST}[{jaw}] > 100")
    page.run("sessionStorage.clear()")
    # What a browser says of a server that is away, and 426 where a page that asks for the reason finds it back.
    excused = ("ERR_CONNECTION_REFUSED", "403", "426", "ERR_CONNECTION_RESET")
    page.complaints[:] = [one for one in page.complaints if not any(reason in one for reason in excused)]


def test_what_the_server_refuses_is_told(page: Page) -> None:
    page.open("mia")
    say(page, "...")
    page.until("document.getElementById('told').classList.contains('wrong')")
    assert "contains nothing to speak" in page.run("document.getElementById('told').textContent")


def test_the_documented_viewer_works(page: Page) -> None:
    page.open("nora")
    text = (Path(__file__).resolve().parents[2] / "docs" / "page.md").read_text()
    code = text.split("```javascript\n")[1].split("```")[0].replace("127.0.0.1:8110", f"127.0.0.1:{page.server.port}")
    page.run(f"window.seen = []; console.log = (said) => seen.push(said); {{ {code}; window.socket = socket; }}")
    page.until("seen.some((said) => said.type === 'event' && said.kind === 'started')")
    assert page.run("seen[0].type") == "hello"
    page.run("socket.close()")


def test_a_lost_graphics_context_comes_back_with_the_face(page: Page) -> None:
    page.open("olga", "&edges=fine")
    page.until(REST)
    before = stage(page.picture(), page)
    page.run("window.lose = page.picture.view.gl.getExtension('WEBGL_lose_context'); lose.loseContext()")
    page.until("page.picture.view.gl.isContextLost()")
    page.run("lose.restoreContext()")
    page.until("!page.picture.view.gl.isContextLost()")
    page.sleep(0.3)
    assert np.abs(stage(page.picture(), page) - before).max() <= 2
    assert page.run("page.picture.view.gl.getError()") == 0
    page.complaints[:] = [one for one in page.complaints if "context" not in one.lower()]


def test_every_phone_is_told_however_few_pictures_are_drawn(page: Page) -> None:
    page.open("olga")
    page.run(KEEP_FRAMES)
    page.run("window.told = []; page.session.addEventListener('phone', ({ detail }) => told.push(detail.label))")
    say(page, "Mama, mama, mama, mama.")
    page.until("told.length > 2")
    page.run("(() => { const end = performance.now() + 600; while (performance.now() < end); })()")
    page.until(REST)  # the server's newest frame: the page shows it later
    texts = page.run("kept.texts")
    said = [label for text in texts if text["type"] == "phones" for label, *_ in text["phones"]]
    assert said.count("m") == 8
    page.until("told.filter((label) => label === 'm').length === 8")


def test_without_webgl_the_page_speaks_all_the_same_and_the_address_keeps_quiet(page: Page) -> None:
    no_webgl = "HTMLCanvasElement.prototype.getContext = () => null"
    script = page.call("Page.addScriptToEvaluateOnNewDocument", source=no_webgl)["identifier"]
    page.go(f"{page.server.url}?session=nomi")
    page.until("window.page && document.body.dataset.connection === 'connected'")
    page.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)  # or the next page has none either
    said = page.run("document.getElementById('notice').textContent")
    assert "WebGL2" in said
    assert said.endswith("The face speaks all the same, unseen.")
    say(page, "Hello there.")
    page.until("document.querySelectorAll('.phone').length > 4")  # it is followed, unseen
    page.until("document.getElementById('fps').textContent === 'no picture'")
    assert page.run("location.search") == "?session=nomi"
    # Not even before the program has come, or where it does not run.
    page.run("document.body.appendChild(document.getElementById('speak').cloneNode(true)).submit()")
    assert page.run("location.search") == "?session=nomi"


@pytest.mark.nightly  # a microphone runs in real time: beside a dozen busy programs words are lost
def test_the_microphone_moves_the_lips_and_lets_them_rest(page: Page) -> None:
    page.open("mike")
    page.until("!document.getElementById('microphone').hidden")
    page.run(KEEP_FRAMES)
    page.run("document.getElementById('microphone').click()")
    page.until("document.getElementById('microphone').getAttribute('aria-pressed') === 'true'")
    page.until("kept.texts.filter((text) => text.kind === 'finished').length >= 1")  # the sentence was once over
    page.until(f"kept.frames.some((frame) => frame.faps[{fap.column(3)}] > 50)")
    closing = "kept.texts.flatMap((text) => text.phones ?? []).filter(([label]) => 'pbm'.includes(label)).length"
    page.until(f"{closing} >= 4")  # of the eight of its sentence
    page.run("document.getElementById('microphone').click()")
    page.until("document.getElementById('microphone').getAttribute('aria-pressed') === 'false'")
    page.until(REST)
    assert not any(text["type"] == "error" for text in page.run("kept.texts"))


def test_a_microphone_that_is_not_allowed_is_told(page: Page) -> None:
    page.open("mike")
    page.until("!document.getElementById('microphone').hidden")
    page.run("""navigator.mediaDevices.getUserMedia = () =>
        Promise.reject(new DOMException("Permission denied", "NotAllowedError"))""")
    page.run("document.getElementById('microphone').click()")
    page.until("document.getElementById('told').textContent === 'The microphone was not allowed.'")
    assert page.run("document.getElementById('microphone').getAttribute('aria-pressed')") == "false"
