"""``<fap-face>`` with static files only: it says phones and follows sound, without a server, under a strict policy."""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from fapengine.files.profiles import load_profile
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.browser.bundlers import opened
from tests.browser.conftest import Page
from tests.browser.live_sound import make_site
from tests.unit.recognition.speech import BABY, Spoken, spoken_by_espeak

PATIENT_S = 60.0
"""Delay of the face after the sound: the recognizer has heard all before, however busy the machine."""
COUNTED = """
window.alive = { workers: 0, contexts: 0 };
window.Worker = class extends Worker {
  constructor(address) { super(address); alive.workers += 1; }
  terminate() { super.terminate(); alive.workers -= 1; }
};
window.AudioContext = class extends AudioContext {
  constructor(...options) { super(...options); alive.contexts += 1; }
  close() { alive.contexts -= 1; return super.close(); }
};
window.why = (promise) => promise.then(() => "nothing", ({ message }) => message);
"""
SPOKEN = {"Mama": "m ɑ m ə", "met": "m ɛ t", "Bob.": "b ɑ b"}
MAMA = [Phone(label, at_s, at_s + 0.15) for label, at_s in zip("mɑmɑ", (0.2, 0.35, 0.5, 0.65), strict=True)]


@pytest.fixture(scope="module")
def sentence() -> Spoken:
    return spoken_by_espeak("en-us", BABY)


@pytest.fixture(scope="module")
def site(sentence: Spoken, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("static")
    make_site(folder, {"baby": sentence})
    with opened(folder) as url:
        yield url


@pytest.fixture
def static(page: Page, site: str) -> Page:
    page.go(site)
    page.until("window.isReady")
    return page


def test_phones_are_said_as_they_are_planned(static: Page) -> None:
    assert not {"planner.bin", "recognizer.bin", "live.js"} & set(static.run("fetched()"))
    given = json.dumps([{"label": one.label, "start": one.start_s, "end": one.end_s} for one in MAMA])
    static.run(f"window.at = 0, face.say({given}, {{ clock: () => at }})")
    static.until("face.source.clock")
    style = Style.speech_only()
    planned = plan(PhoneTrack.from_phones(MAMA), load_profile("grid_s1_en"), rng=np.random.default_rng(0), style=style)
    shown = []
    for number in range(0, len(planned.track.values), 3):
        static.run(f"window.at = {number} / 30")
        static.until(f"face.source.position === {number} / 30")
        shown.append(static.run("[...face.faps]"))
    assert np.array_equal(shown, planned.track.values[::3])
    static.run("window.at = 2")
    static.until("told.some(([type]) => type === 'finished')")
    told = [[kind, detail and detail["label"]] for kind, detail in static.run("told")]
    assert told == [["started", None], *(["phone", one.label] for one in MAMA), ["finished", None]]
    assert "recognizer.bin" not in static.run("fetched()")
    assert "expected { label" in static.run(
        "face.say([{ label: 'm', start: 1, end: 1 }]).catch(({ message }) => message)"
    )


def test_a_text_is_said_and_its_language_is_fetched_for_it(static: Page) -> None:
    static.run("window.at = 0, face.say([{ label: 'm', start: 5, end: 9 }], { clock: () => at })")
    assert not {"letters.js", "words-en.bin"} & set(static.run("fetched()"))
    said = static.run("face.say('Mama met Bob.', { clock: () => at })")
    assert [word["text"] for word in said["words"]] == ["Mama", "met", "Bob."]
    assert "words-en.bin" in static.run("fetched()")
    static.run("window.at = 2")
    static.until("told.some(([type]) => type === 'finished')")
    told = [(detail["label"], detail["word"]) for kind, detail in static.run("told") if kind == "phone"]
    assert told == [(label, word) for word in ("Mama", "met", "Bob.") for label in SPOKEN[word].split()]
    said = static.run("face.say([{ text: 'Mama', start: 1 }], { pronounce: () => 'm a' })")
    assert said == {"words": [{"text": "Mama", "start": 1, "end": pytest.approx(1.32)}], "unread": []}


def test_it_follows_sound_as_it_is_planned(static: Page, sentence: Spoken) -> None:
    """What comes of it in real time, on a machine with nothing else to do, is measured by live_sound.py."""
    static.run(f"""(async () => {{
        window.context = new AudioContext({{ sampleRate: 44100 }});
        const buffer = await context.decodeAudioData(await (await fetch("baby.wav")).arrayBuffer());
        const source = new AudioBufferSourceNode(context, {{ buffer }});
        window.heard = await face.hear(source, {{ delay: {PATIENT_S} }});
        window.limit = () => context.currentTime - face.source.begun - {PATIENT_S};
        source.start(context.currentTime + 0.3);
        source.onended = () => (window.wholeAt = context.currentTime - face.source.begun + 1);
    }})()""")
    static.until("window.wholeAt && face.source.heard > wholeAt")
    assert static.run("[heard.delayTime.value, heard.context === context]") == [PATIENT_S, True]
    assert static.run("face.source.clock() <= limit()")
    static.run("context.suspend()")
    static.sleep(0.3)
    assert static.run("face.source.clock() <= limit()")  # it stands still with the sound
    phones = [
        Phone(one["label"], one["start"], one["end"], one["stress"], loudness_db=one["loudness"])
        for one in static.run("face.source.planner.phones")
    ]
    assert any(phone.loudness_db for phone in phones)
    assert sum(one.label in ("p", "b", "m") for one in phones) >= 6
    style = Style.speech_only()
    planned = plan(
        PhoneTrack.from_phones(phones), load_profile("grid_s1_en"), rng=np.random.default_rng(0), style=style
    )
    static.run("face.source.clock = () => window.at")
    shown = []
    for number in range(0, len(planned.track.values), 5):
        static.run(f"window.at = {number} / 30")
        static.until(f"face.source.position === {number} / 30")
        shown.append(static.run("[...face.faps]"))
    assert np.array_equal(shown, planned.track.values[::5])
    assert [detail["label"] for kind, detail in static.run("told") if kind == "phone"] == [one.label for one in phones]
    assert {"planner.bin", "recognizer.bin", "worker.js", "tap-worklet.js"} <= set(static.run("fetched()"))
    assert static.run("told.filter(([type]) => type === 'error')") == []


def test_it_follows_a_stream_and_stops_where_the_element_is_taken_away(static: Page) -> None:
    static.run(COUNTED)
    static.run("""navigator.mediaDevices.getUserMedia({ audio: true })
        .then((stream) => face.hear(window.stream = stream, { delay: 2 }))""")
    static.until("told.filter(([type]) => type === 'phone').length > 5")
    static.run("""window.source = face.source;
        window.end = () => face.cancel();
        face.addEventListener("phone", end)""")  # some phone is said then
    static.until("told.some(([type]) => type === 'cancelled')")
    static.run("face.removeEventListener('phone', end), told.length = 0")
    static.until("told.some(([type]) => type === 'phone')")  # and goes on
    assert static.run("alive") == {"workers": 1, "contexts": 1}
    static.run("face.remove()")
    assert static.run("[source.run, source.clock, source.isSpeaking]") == [None, None, False]
    assert static.run("alive") == {"workers": 0, "contexts": 0}
    assert static.run("why(face.hear(stream))") == "fap-face: not in a document"
    static.run("stream.getTracks().forEach((track) => track.stop())")


DEVICES = """
window.opened = [];
window.isThere = true;
const given = navigator.mediaDevices.getUserMedia.bind(navigator.mediaDevices);
navigator.mediaDevices.getUserMedia = async (wanted) => {
  if (!isThere) throw new DOMException("none", "NotFoundError");
  const stream = await given(wanted);
  opened.push(stream.getAudioTracks()[0]);
  return stream;
};
window.unplug = (track) => { track.stop(); track.dispatchEvent(new Event("ended")); };
window.change = () => navigator.mediaDevices.dispatchEvent(new Event("devicechange"));
"""


def test_it_goes_on_with_another_microphone_where_one_was_unplugged(static: Page) -> None:
    static.run(COUNTED)
    static.run(f"{{{DEVICES}}}")
    static.run("face.hear({ audio: true }).then(() => 0)")
    static.until("told.some(([type]) => type === 'phone')")
    static.run("told.length = 0, unplug(opened[0])")  # another is there
    static.until("told.some(([type]) => type === 'regained') && told.some(([type]) => type === 'phone')")
    static.run("told.length = 0, isThere = false, unplug(opened[1])")
    static.until("told.at(-1)[0] === 'finished'")
    assert static.run("told.filter(([type]) => type === 'lost').length") == 1
    static.until("face.faps.every((value) => value === 0)")
    static.run("change()")  # a loudspeaker comes
    static.run("told.length = 0, isThere = true, change(), change()")
    static.until("told.some(([type]) => type === 'phone')")
    assert static.run("told.filter(([type]) => type === 'regained').length") == 1
    static.until("opened.length === 4")
    assert static.run("opened.filter(({ readyState }) => readyState === 'live').length") == 1
    assert static.run("alive") == {"workers": 1, "contexts": 1}
    static.run("face.remove(), change()")
    assert static.run("opened.map(({ readyState }) => readyState)") == ["ended"] * 4
    assert static.run("alive") == {"workers": 0, "contexts": 0}
    assert static.run("told.filter(([type]) => type === 'error')") == []


def test_it_goes_on_where_a_microphone_was_unplugged_before_it_was_heard(static: Page) -> None:
    static.run(f"{{{DEVICES}}}")
    static.run("""{
        const open = navigator.mediaDevices.getUserMedia;
        navigator.mediaDevices.getUserMedia = async (wanted) => {
          const stream = await open(wanted);
          if (opened.length < 3) stream.getAudioTracks()[0].stop();
          return stream;
        };
        face.hear({ audio: true }).then(() => 0);
    }""")
    static.until("told.some(([type]) => type === 'phone')")
    kinds = static.run("told.map(([type]) => type).filter((type) => ['lost', 'regained'].includes(type))")
    assert kinds == ["lost", "regained", "lost", "regained"]
    assert static.run("opened.map(({ readyState }) => readyState)") == ["ended", "ended", "live"]
    static.run("face.remove()")


def test_a_page_is_told_that_its_own_stream_has_ended(static: Page) -> None:
    static.run(f"{{{DEVICES}}}")
    static.run("navigator.mediaDevices.getUserMedia({ audio: true }).then((stream) => face.hear(stream)).then(() => 0)")
    static.until("told.some(([type]) => type === 'phone')")
    static.run("unplug(opened[0])")
    static.until("told.at(-1)[0] === 'finished'")
    static.run("change()")
    assert static.run("told.filter(([type]) => ['lost', 'regained'].includes(type)).map(([type]) => type)") == ["lost"]
    assert static.run("opened.length") == 1
    static.run("face.remove()")


def test_what_does_not_begin_leaves_nothing(static: Page) -> None:
    static.run(COUNTED)
    static.run("face.cancel()")  # before anything was begun
    phone = "{ label: 'm', start: 0, end: 9 }"
    assert static.run(f"(async () => {{ const said = face.say([{phone}]); face.cancel(); await said; }})()") is None
    assert static.run("face.source.clock") is None
    assert "a MediaStream, an AudioNode, or" in static.run("why(face.hear('sound'))")
    assert "without sound" in static.run("why(face.hear(new MediaStream()))")
    assert "delay of -1" in static.run("why(face.hear(new OscillatorNode(new AudioContext()), { delay: -1 }))")
    static.run("window.own = new AudioContext(), null")
    assert "output" in static.run("why(face.hear(own.destination))")  # it has none
    other = "why(face.hear(new OscillatorNode(own), { context: new OfflineAudioContext(1, 99, 8000) }))"
    assert "of another context" in static.run(other)
    static.run("window.over = new OscillatorNode(new AudioContext()), over.context.close()")
    assert static.run("why(face.hear(over))") == "hear: got a context that is closed"
    assert static.run("alive") == {"workers": 0, "contexts": 2}  # both are the page's
    static.run("window.stream = new MediaStreamAudioDestinationNode(own).stream")
    two = "Promise.all([why(face.hear(stream)), why(face.hear(stream))])"
    assert static.run(two) == ["hear: something else was begun meanwhile", "nothing"]
    assert static.run("alive") == {"workers": 1, "contexts": 3}
    static.run("window.tap = face.source.run.tap, null")
    static.run(f"face.say([{phone}], {{ clock: () => 7 }})")
    static.run("tap.port.onmessage({ data: { begun: 0 } })")  # as of sound that is not followed any more
    assert static.run("face.source.clock()") == 7
    assert static.run("alive") == {"workers": 0, "contexts": 2}
    static.run("face.source.addresses.worklet = new URL('absent.js', location)")
    assert static.run("why(face.hear(stream))") != "nothing"
    assert static.run("alive") == {"workers": 0, "contexts": 2}
    away = "(() => { const heard = why(face.hear(stream)); face.remove(); return heard; })()"
    gone = "fap-face: it was taken away, or begun again, meanwhile"
    assert static.run(away) == gone
    twice = """(() => {
        document.body.append(face);
        const first = why(face.hear(stream));
        face.remove();
        document.body.append(face);
        return Promise.all([first, why(face.hear(stream))]);
    })()"""  # as React's strict mode does
    assert static.run(twice) == [gone, "nothing"]
    assert static.run("alive") == {"workers": 1, "contexts": 3}
    static.run("face.remove()")
    static.complaints[:] = [one for one in static.complaints if "404" not in one]


LOOP = """(async () => {
  window.context = new AudioContext();
  const spoken = await context.decodeAudioData(await (await fetch("baby.wav")).arrayBuffer());
  const loop = new AudioBuffer({ length: spoken.length + context.sampleRate, sampleRate: context.sampleRate });
  loop.copyToChannel(spoken.getChannelData(0), 0);
  window.sound = new AudioBufferSourceNode(context, { buffer: loop, loop: true });
  sound.start();
})()"""
CALLED = """
window.call = async () => {
  const out = new MediaStreamAudioDestinationNode(context);
  sound.connect(out);
  const [here, there] = (window.pair = [new RTCPeerConnection(), new RTCPeerConnection()]);
  here.onicecandidate = ({ candidate }) => there.addIceCandidate(candidate);
  there.onicecandidate = ({ candidate }) => here.addIceCandidate(candidate);
  const track = new Promise((done) => (there.ontrack = done));
  here.addTrack(out.stream.getAudioTracks()[0], out.stream);
  await here.setLocalDescription();
  await there.setRemoteDescription(here.localDescription);
  await there.setLocalDescription();
  await here.setRemoteDescription(there.localDescription);
  await face.hear((await track).streams[0], { context });
};
window.hangUp = () => pair.forEach((end) => end.close());
"""
PHONE = "told.some(([type]) => type === 'phone')"


def test_it_follows_a_remote_track_and_another_after_it(static: Page) -> None:
    """Chromium gives no sound of a remote track that no element plays."""
    static.run(LOOP)
    static.run(CALLED + "0")
    static.run("call()")
    static.until(PHONE)
    static.run("hangUp()")
    static.run("call().then(() => (told.length = 0))")
    static.until(PHONE)
    static.run("hangUp(), face.remove(), context.close()")


def test_it_goes_on_in_a_tab_that_is_not_seen(static: Page) -> None:
    static.run(LOOP)
    static.run("face.hear(sound).then(() => 0)")
    static.until(PHONE)
    other = static.call("Target.createTarget", url="about:blank")["targetId"]
    static.until("document.visibilityState === 'hidden'")
    static.run("told.length = 0, window.seen = face.picture.count")
    static.until(PHONE)  # events do not wait for pictures
    assert static.run("face.picture.count - seen") <= 1
    static.call("Target.closeTarget", targetId=other)
    static.call("Page.bringToFront")
    static.until("document.visibilityState === 'visible' && face.picture.count > seen + 2")
    assert static.run("face.source.position <= face.source.heard")
    static.run("face.remove(), context.close()")


def test_a_context_of_its_own_wakes_when_the_page_is_touched(static: Page) -> None:
    """As where browsers let no sound begin before; a context of the page's is the page's."""
    static.run(LOOP)
    static.run("window.stream = new MediaStreamAudioDestinationNode(context), sound.connect(stream), 0")
    static.run("face.hear(stream.stream).then(() => 0)")
    static.until("face.source.clock")
    static.run("window.own = face.source.run.context, own.suspend()")
    assert static.run("own.state") == "suspended"
    static.key("a")
    static.until("own.state === 'running'")
    static.run("told.length = 0")
    static.until(PHONE)
    static.run("own.suspend().then(() => face.remove())")
    static.key("a")
    static.until("own.state === 'closed'")
    static.run("context.close()")


def test_it_goes_on_when_the_loudspeaker_changes(static: Page) -> None:
    static.run(LOOP)
    static.run("face.hear(sound).then(() => 0)")
    static.until(PHONE)
    static.run("window.before = face.source.position, context.setSinkId({ type: 'none' })")
    static.run("told.length = 0")
    static.until(f"{PHONE} && face.source.position > before + 1")
    assert static.run("face.source.position <= face.source.heard + 1")
    static.run("face.remove(), context.close()")


def test_frames_of_elsewhere_need_an_element_of_their_own(static: Page) -> None:
    pushed = "(() => { try { face.push(new Int16Array(1), 16000) } catch (e) { return e.message } })()"
    assert static.run(pushed) == "fap-face: push needs the attribute server"
    static.run("window.at = 0, face.say([{ label: 'm', start: 5, end: 9 }], { clock: () => at })")
    assert "neither hears nor says" in static.run(
        "(() => { try { face.feed(new ArrayBuffer(288)) } catch (e) { return e.message } })()"
    )
