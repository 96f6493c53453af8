"""Lips that follow sound in a browser, with static files only, against the offline plan of the phones that were spoken.

    python -m tests.browser.live_sound

The ten sentences of ``bench/recognizers.py`` in each of flite's four voices, under ``default-src 'self'`` with trusted
types. Where in a block of 20 ms a sound begins decides what the recognizer takes for what: each begins in another
quarter. First a browser renders them as fast as it can, through its own worklet and worker, and the answers move a face
on a made clock, 10 ms after their sound: the figures are the same on a busy machine. Then some are played in real time
to ``hear`` of a ``<fap-face>`` that draws itself; that needs a machine with nothing else to do, and the age of a sound
when its answer comes says whether it was one.

Figures: correlation of the opening of the lips that are shown with that of the plan, mean and worst; p b m met as in
``bench/recognizer_delays.py``; share of a core that the recognizer's worker takes, by processor time.
"""

import asyncio
import json
import tempfile
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from bench.recognizer_delays import OPEN_MM, OPEN_S, SHUT_MM, SHUT_S
from bench.recognizers import SENTENCES
from design import face_package
from fapengine.files.sound import save_wav
from fapengine.recognition.protocol import RATE_HZ
from tests.browser.bundlers import opened
from tests.browser.chromium import Browser as Chromium
from tests.browser.consumption import worker_seconds
from tests.browser.firefox import Firefox, find_firefox
from tests.unit.recognition.speech import FAPU_MM, VOICES, Spoken, closures, opening_mm, spoken

DELAYS_S = (0.2, 0.25, 0.3)
DELAY_S = 0.25
RATES_HZ = (44_100, 48_000)
ANSWER_S = 0.01
BEGIN_S, QUARTER_S = 0.2, 0.005
"""When the first sentence begins, and how much later in a block each next one."""
EVERY = 5
"""One of so many sentences is played in real time."""
LEAST_R = 0.87
"""At 0.25 s on the made clock; less would be a fault of the browser's side, for the phones are those of Python."""
POLICY = "default-src 'self'; require-trusted-types-for 'script'"
PAGE = f"""<!doctype html><html lang="en"><title>Hear</title><link rel="icon" href="package/icon.svg" />
<meta http-equiv="Content-Security-Policy" content="{POLICY}" />
<script type="module" src="package/index.js"></script><script type="module" src="hear.js"></script>
<fap-face still></fap-face></html>"""
SCRIPT = f"""
const ANSWER_S = {ANSWER_S};
"""
SCRIPT += """
const face = (window.face = document.querySelector("fap-face"));
window.told = [];
for (const type of ["started", "phone", "finished", "cancelled", "lost", "regained", "error"])
  face.addEventListener(type, ({ detail }) => told.push([type, detail]));
await face.ready;
window.fetched = () => performance.getEntriesByType("resource").map(({ name }) => name.split("/").at(-1));
window.before = fetched();
const until = async (condition, state) => {
  for (const limit = performance.now() + 90000; !condition(); ) {
    if (performance.now() > limit) throw new Error(`it never became so: ${condition}; ${JSON.stringify(state())}`);
    await new Promise((done) => setTimeout(done, 20));
  }
};
const decoded = async (name, context) => context.decodeAudioData(await (await fetch(name)).arrayBuffer());

// Frames of [position, FAP 4, FAP 5] for each delay, of a sound that begins at a time and is rendered without waiting.
window.follow = async (name, sampleRate, begin, delays) => {
  const { Live } = await import("./package/live/index.js");
  const buffer = await decoded(name, new OfflineAudioContext(1, 1, sampleRate));
  const end = begin + buffer.duration + 1;
  const context = new OfflineAudioContext(1, Math.ceil(end * sampleRate), sampleRate);
  const source = new AudioBufferSourceNode(context, { buffer });
  const [answers, hearing] = [[], await Live.make({ still: true })];
  hearing.take = (answer) => answers.push(answer);
  await hearing.hear(source, { context });
  source.start(begin);
  await new Promise((done) => setTimeout(done, 500)); // the worklet is told where to send before it has rendered all
  await context.startRendering();
  await until(() => answers.at(-1)?.heard > end - 0.1, () => [name, hearing.begun, answers.at(-1)?.heard, end]);
  hearing.close();
  const faps = new Float32Array(68);
  const followed = async (delay) => {
    const live = await Live.make({ still: true });
    const [waiting, frames] = [[...answers], []];
    let now = 0;
    live.clock = () => now - delay;
    for (let number = 0; (now = number / 100) < end; ++number) {
      while (waiting[0]?.heard + hearing.begun + ANSWER_S < now + 0.001) live.take(waiting.shift());
      live.sample(now, faps);
      frames.push([live.position - begin + hearing.begun, faps[3], faps[4]]);
    }
    return frames;
  };
  return JSON.stringify(await Promise.all(delays.map(followed)));
};

let context, source, buffer;
window.hear = async (name, sampleRate, delay) => {
  await context?.close();
  told.length = 0;
  context = new AudioContext({ sampleRate });
  buffer = await decoded(name, context);
  source = new AudioBufferSourceNode(context, { buffer });
  const heard = await face.hear(source, { delay });
  heard.connect(context.destination);
};
// Begins so long after the begin of a block of 20 ms.
window.play = async (later) => {
  const live = face.source;
  const state = () => [context.state, context.currentTime, live.position, live.heard, live.begun, face.picture.count];
  await until(() => live.begun !== undefined && live.heard, state);
  const [since, frames, ages, end] = [live.heard, [], [], new AbortController()];
  live.take = (answer) => {
    ages.push(context.currentTime - live.begun - answer.heard);
    live.constructor.prototype.take.call(live, answer);
  };
  face.addEventListener("picture", () => frames.push([live.position, face.faps[3], face.faps[4]]), end);
  const shift = Math.ceil((context.currentTime - live.begun + 0.2) / 0.02) * 0.02 + later;
  source.start(live.begun + shift);
  await until(() => live.position > shift + buffer.duration + 0.2, state);
  end.abort();
  const shown = frames.map(([position, ...faps]) => [position - shift, ...faps]);
  return JSON.stringify({ frames: shown, ages, heard: live.heard - since });
};
window.isReady = true;
"""


def make_site(folder: Path, sentences: dict[str, Spoken], rate_hz: int = 44_100) -> None:
    """Write the package, the page and sounds into a folder."""
    face_package.build(folder / "package")
    (folder / "package" / "icon.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    (folder / "index.html").write_text(PAGE)
    (folder / "hear.js").write_text(SCRIPT)
    for name, speech in sentences.items():
        sound = resample_poly(speech.samples.astype(float), rate_hz // 100, RATE_HZ // 100)
        save_wav(folder / f"{name}.wav", np.clip(sound, -32768, 32767).astype(np.int16), rate_hz)


def judged(frames: list[list[float]], speech: Spoken) -> tuple[float, int, int]:
    """Correlation with the plan, p b m met, and how many there are."""
    position_s, upper, lower = np.array(frames).T
    lips_mm = -(upper + lower) * FAPU_MM
    rate_hz, length_s = 60.0, len(speech.samples) / RATE_HZ
    plan_mm = opening_mm(speech.phones, length_s, rate_hz)
    inside = (position_s >= 0) & (position_s < length_s)
    expected = np.interp(position_s[inside], np.arange(len(plan_mm)) / rate_hz, plan_mm)
    middles = closures(speech.phones)

    def around(at_s: float, reach_s: float) -> np.ndarray:
        return lips_mm[np.abs(position_s - at_s) <= reach_s]

    met = sum(
        around(at_s, SHUT_S).min(initial=99.0) < SHUT_MM and around(at_s, OPEN_S).max(initial=0.0) > OPEN_MM
        for at_s in middles
    )
    return float(np.corrcoef(lips_mm[inside], expected)[0, 1]), int(met), len(middles)


def all_sentences() -> dict[str, Spoken]:
    """Speak each sentence in each voice; their names and sounds."""
    return {f"{n}-{voice}": spoken(voice, text) for n, text in enumerate(SENTENCES) for voice in VOICES}


def later_s(number: int) -> float:
    """Time after the begin of a block at which a sentence begins."""
    return (number + number // len(VOICES)) % 4 * QUARTER_S


async def on_a_made_clock(browser: Chromium | Firefox, sentences: dict[str, Spoken], rate_hz: int) -> float:
    """Let a browser hear all sentences, however long it takes; print the figures, return the mean r at 0.25 s."""
    rows = []
    for number, (name, speech) in enumerate(sentences.items()):
        begin_s = BEGIN_S + later_s(number)
        found = json.loads(str(await browser.run(f"follow('{name}.wav', {rate_hz}, {begin_s}, {list(DELAYS_S)})")))
        rows.append([judged(frames, speech) for frames in found])
    for delay_s, these in zip(DELAYS_S, zip(*rows, strict=True), strict=True):
        print(f"{rate_hz} Hz, {delay_s:.2f} s: {figures(list(these))}", flush=True)
    usual = [row[DELAYS_S.index(DELAY_S)] for row in rows]
    print(f"{rate_hz} Hz, {DELAY_S} s, those of them that are played: {figures(usual[::EVERY])}", flush=True)
    return float(np.mean([r for r, *_ in usual]))


async def in_real_time(browser: Chromium | Firefox, sentences: dict[str, Spoken], rate_hz: int) -> None:
    """Play some sentences 0.25 s before the face follows, and print the figures."""
    rows, ages_s, worked_s, heard_s, frames = [], [], 0.0, 0.0, 0
    for number, (name, speech) in list(enumerate(sentences.items()))[::EVERY]:
        await browser.run(f"hear('{name}.wav', {rate_hz}, {DELAY_S})")
        before_s = worker_seconds(browser.pid)
        found = json.loads(str(await browser.run(f"play({later_s(number)})")))
        worked_s += worker_seconds(browser.pid) - before_s
        rows.append(judged(found["frames"], speech))
        ages_s += found["ages"]
        heard_s += found["heard"]
        frames += len(found["frames"])
    middle, late = (1000 * float(np.percentile(ages_s, share)) for share in (50, 95))
    share = f"worker {100 * worked_s / heard_s:.1f} % of a core, {frames / heard_s:.0f} pictures per second"
    age = f"answers {middle:.0f} ms after the sound, 95 % within {late:.0f}"
    print(f"{rate_hz} Hz, {DELAY_S} s, in real time: {figures(rows)}, {share}, {age}", flush=True)


async def follow(browser: Chromium | Firefox) -> None:
    """Let a browser follow, at two rates, and print the figures.

    Raises
    ------
    AssertionError
        If the lips follow less well on the made clock, or the page complains.
    """
    with tempfile.TemporaryDirectory() as folder:
        make_site(Path(folder), sentences := all_sentences())
        with opened(Path(folder)) as url:
            async with browser:
                await browser.open(url)
                await browser.until("window.isReady")
                for rate_hz in RATES_HZ:
                    r = await on_a_made_clock(browser, sentences, rate_hz)
                    assert r > LEAST_R, f"{rate_hz} Hz: r {r:.3f}, expected {LEAST_R}"
                    await in_real_time(browser, sentences, rate_hz)
                assert browser.complaints == [], browser.complaints


def figures(rows: list[tuple[float, int, int]]) -> str:
    """Write what :func:`judged` found."""
    r, met, count = (np.array(column) for column in zip(*rows, strict=True))
    return f"r {r.mean():.3f}, worst {r.min():.3f}, p b m {met.sum()}/{count.sum()}"


async def main() -> None:
    print("Chromium")
    await follow(Chromium((400, 400)))
    if find_firefox():
        print("Firefox")
        await follow(Firefox())


if __name__ == "__main__":
    asyncio.run(main())
