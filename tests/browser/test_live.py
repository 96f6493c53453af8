"""``fapengine-face/live`` in Node: the same FAPs and phones as Python, value for value."""

import ast
import hashlib
import json
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import resample_poly

from design import face_package, live_tables
from fapengine.files.profiles import load_profile
from fapengine.files.sound import load_sound
from fapengine.mpeg4 import fap
from fapengine.profiles import Profile
from fapengine.recognition import small_net
from fapengine.recognition.process import answers
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.small_recognizer import BLOCK, SmallRecognizer
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.batch import BatchPlanner
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.faps import Overlay
from fapengine.trajectory.gestures import CHANNELS, Channel, GestureGenerator, gesture_faps, start_levels, varied_faps
from fapengine.trajectory.planner import plan
from fapengine.trajectory.ramps import Ramp, sample_ramps
from fapengine.trajectory.style import Style
from fapengine.wire.shapes import ArkitFollower
from tests.unit.recognition.speech import BABY, POPPIES, no_speech, spoken_by_espeak, whispered
from tests.unit.retarget.living_speech import living

ROOT = Path(__file__).resolve().parents[2]
RUNNER = Path(__file__).with_name("live_runner.mjs")
PORTED = {
    "recognition/loudness.py": "voicing.js", "recognition/protocol.py": "recognizer.js",
    "recognition/small_net.py": "mel.js and small-net.js",
    "recognition/small_recognizer.py": "recognizer.js and search.js", "speech/prosody.py": "prosody.js",
    "trajectory/batch.py": "planner.js", "trajectory/closures.py": "closures.js", "trajectory/context.py": "keys.js",
    "trajectory/faps.py": "planner.js", "trajectory/gestures.py": "gestures.js",
    "trajectory/variation.py": "gestures.js",
    "trajectory/hermite.py": "path.js", "trajectory/phonetics.py": "keys.js",
    "trajectory/planner.py": "planner.js", "trajectory/ramps.py": "ramp.js",
    "trajectory/stream.py": "planner.js", "trajectory/style.py": "planner.js",
    "trajectory/targets.py": "keys.js", "voices/pronounce.py": "words.js",
    "voices/spoken_form.py": "../words-en/spoken.js", "speech/formats/services.py": "timings.js",
}  # fmt: skip
"""Modules of Python that ``fapengine-face/live`` has in JavaScript, and the file there."""
SAME_AS = Path(__file__).with_name("ported.json")
"""Digests of these modules, without comments and docstrings, when the JavaScript was last the same."""
STRANGE = ("ʧ", "ʏ", "ɔɪ", "oː", "pf", "ɛ̃", "t͡s", "ç", "xyz%", "ɝ", "hʔ", "aʊə", "ˈm", "…", "g")
NAMES_OF_LETTERS = ("B", "q,", "“Z”", "m", "h", "are", "constructor")
pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="needs Node")


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The live part of the npm package, with its numbers."""
    folder = tmp_path_factory.mktemp("package")
    for name in ("live", "words-en"):
        shutil.copytree(ROOT / "fapengine-face" / name, folder / name)
    shutil.copy(ROOT / "fapengine-face" / "package.json", folder)
    shutil.copy(ROOT / "fapengine-face" / "arkit.js", folder)
    face_package.write_arkit(folder)
    live_tables.write(folder)
    return folder


@pytest.fixture(scope="module")
def profile() -> Profile:
    return load_profile("grid_s1_en")


def node(package: Path, script: Path, given: object) -> Any:
    """Run a script of this folder with a JSON value; returns what it writes."""
    before, after = package / "given.json", package / "found.json"
    before.write_text(json.dumps(given, ensure_ascii=False))
    ran = subprocess.run(
        ["node", str(script), str(package), str(before), str(after)],
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    return json.loads(after.read_text())


def spoken(
    rng: np.random.Generator, known: list[str], count: int, start_s: float = 0.0, *, longest_s: float = 1.5
) -> list[Phone]:
    """Random phones of any alphabet, with pauses, words that are names of letters, and loudness."""
    found = []
    for _ in range(count):
        labels = known if rng.random() < 0.7 else STRANGE if rng.random() < 0.5 else list(ipa.SOUNDS)
        if rng.random() < 0.15:
            start_s += float(rng.choice([0.003, 0.05, 0.15, 0.4, 1.0]))
        end_s = start_s + float(rng.choice([0.001, 0.02, 0.04, 0.06, 0.08, 0.12, 0.2, 0.5, longest_s])) * float(
            rng.uniform(0.8, 1.2)
        )
        word = str(rng.choice(NAMES_OF_LETTERS)) if rng.random() < 0.2 else ""
        loudness_db = float(rng.uniform(-12, 8)) if rng.random() < 0.2 else 0.0
        stress = int(rng.choice([0, 0, 0, 1, 2]))
        found.append(Phone(str(rng.choice(labels)), start_s, end_s, stress, word, loudness_db=loudness_db))
        start_s = end_s
    return found


def as_json(phone: Phone) -> dict[str, Any]:
    named = {"label": phone.label, "start": phone.start_s, "end": phone.end_s}
    return named | {"stress": phone.stress, "word": phone.word, "loudness": phone.loudness_db}


def events_of(
    rng: np.random.Generator, known: list[str], end_s: float
) -> list[tuple[float, list[Phone] | tuple[float, float]]]:
    """Phones as they come: early, late, again, revised, overlapped, removed; and times at which speech is cancelled."""
    events: list[tuple[float, list[Phone] | tuple[float, float]]] = []
    for phone in spoken(rng, known, round(10 * end_s), 0.3):
        at_s = max(phone.start_s - float(rng.uniform(-0.15, 0.4)), 0.0)
        events.append((at_s, [phone]))
        if rng.random() < 0.1:
            label = SILENCE if rng.random() < 0.3 else "m"
            events.append((at_s + 0.02, [Phone(label, phone.start_s + 0.01, phone.end_s + 0.02)]))
        if rng.random() < 0.1:  # again, and a little later
            moved_s = float(rng.choice([0.0, 0.0, 0.0004, 0.01]))
            events.append((at_s + 0.05, [Phone(phone.label, phone.start_s + moved_s, phone.end_s + moved_s)]))
        if rng.random() < 0.1:  # heard while it grows
            label, from_s = str(rng.choice(["m", "f", "w", "ɑ"])), max(phone.start_s - 0.1, 0.0)
            lengths_s = [0.03 * step for step in range(1, 8)]
            events += [(from_s + one_s, [Phone(label, phone.start_s, phone.start_s + one_s)]) for one_s in lengths_s]
    if rng.random() < 0.05:  # more than is planned ahead
        events.append((0.1, spoken(rng, known, 200, end_s)))
    cancels = [(float(rng.uniform(0, end_s)), float(rng.choice([0.1, 0.2, 0.5]))) for _ in range(rng.integers(0, 3))]
    events += [(float(rng.uniform(0, end_s)), cancel) for cancel in cancels]
    return sorted(events, key=lambda event: event[0])


def style_of(rng: np.random.Generator) -> tuple[dict[str, float], Style]:
    """A random style, as both languages take it."""
    if rng.random() < 0.5:
        return {}, Style.speech_only()
    sizes = {name: float(rng.uniform(0.2, 2)) for name in ("articulation", "jaw", "lips")}
    loudness = float(rng.uniform(-10, 20))
    return sizes | {"loudness": loudness}, Style(**sizes, loudness_db=loudness).without(["all"])


def stream_of(rng: np.random.Generator, profile: Profile, end_s: float) -> tuple[dict[str, Any], np.ndarray, list[int]]:
    """A random stream as the runner takes it, its FAPs, (T, 68), and its counts of phones."""
    rate_hz, horizon_s = float(rng.choice([25, 30, 60])), float(rng.choice([0.0, 0.0, 0.1]))
    options, style = style_of(rng)
    faces = expression_faps(profile)
    expression = faces @ (rng.uniform(0, 1, faces.shape[1]) * (rng.random(faces.shape[1]) < 0.2))
    levels = np.zeros((CHANNELS, 1))
    levels[[Channel.BLINK, Channel.NOD, Channel.PITCH], 0] = rng.uniform(0, [1, 1, 0.05]) * (rng.random(3) < 0.5)
    gestures = gesture_faps(levels, np.zeros((2, 1, 1)), np.zeros(1))
    overlay = Overlay(expression[:, None], gestures, np.ones(1), np.ones(1))
    planner = BatchPlanner(profile, style, horizon_s=horizon_s)
    session = planner.open()
    events = events_of(rng, list(profile.phones), end_s)
    waiting, rows = list(events), []
    for number in range(int(end_s * rate_hz)):
        while waiting and waiting[0][0] <= number / rate_hz:
            _, told = waiting.pop(0)
            if isinstance(told, list):
                planner.feed(session, told)
            else:
                planner.cancel(session, told[0], fade_s=told[1])
        rows.append(planner.frames(number / rate_hz, overlay)[0].copy())
    told_events = [
        {"at": at_s, "phones": [*map(as_json, told)]}
        if isinstance(told, list)
        else {"at": at_s, "cancel": told[0], "fade": told[1]}
        for at_s, told in events
    ]
    given = {"events": told_events, "frames": len(rows), "rate": rate_hz, "options": options | {"horizon": horizon_s}}
    given |= {"expression": expression.tolist(), "gestures": gestures[:, 0].tolist()}
    counts = planner.counts(session)
    return given, np.array(rows), [counts.late, counts.dropped, counts.revised, counts.cancelled, counts.unknown]


def check_plans(package: Path, profile: Profile, seed: int, streams: int, tracks: int, *, end_s: float) -> int:
    """Plan random streams and finished lists in both languages; every value is the same. The number of values."""
    rng = np.random.default_rng(seed)
    made = [stream_of(rng, profile, end_s) for _ in range(streams)]
    lists, plans = [], []
    for _ in range(tracks):
        phones = spoken(rng, list(profile.phones), round(8 * end_s))
        options, style = style_of(rng)
        rate_hz = float(rng.choice([25, 30, 60]))
        lists.append({"phones": [*map(as_json, phones)], "options": options | {"rate": rate_hz}})
        plans.append(plan(PhoneTrack.from_phones(phones), profile, rng=rng, rate_hz=rate_hz, style=style))
    found = node(package, RUNNER, {"streams": [given for given, _, _ in made], "tracks": lists})
    frames = compared = 0
    for number, (one, (_, expected, counts)) in enumerate(zip(found["streams"], made, strict=True)):
        values = np.array(one["faps"])
        where = np.flatnonzero((values != expected).any(axis=1))
        assert not len(where), (
            f"stream {number}: {len(where)} of {len(expected)} frames differ, the first is {where[0]}"
        )
        assert list(one["counts"].values()) == counts
        frames += np.count_nonzero(expected.any(axis=1))
        compared += expected.size
    for number, (one, planned) in enumerate(zip(found["tracks"], plans, strict=True)):
        assert np.array_equal(one["faps"], planned.track.values), f"track {number}"
        assert sorted(set(one["unknown"])) == sorted(planned.unknown)
        compared += planned.track.values.size
    assert frames > 15 * end_s * streams  # faces that move
    assert {name for _, _, counts in made for name, count in zip("ldrcu", counts, strict=True) if count} == set("ldrcu")
    return compared


def test_plans_are_pythons(package: Path, profile: Profile) -> None:
    check_plans(package, profile, seed=1, streams=60, tracks=30, end_s=1.8)


def digest(module: str) -> str:
    """Digest of a module's code; comments, docstrings and blank lines do not count."""
    text = (ROOT / "fapengine" / module).read_text(encoding="utf-8")
    texts = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    code = [line.partition("  #")[0].strip() for number, line in enumerate(text.splitlines(), 1) if number not in texts]
    return hashlib.sha256("\n".join(line for line in code if line and line[0] != "#").encode()).hexdigest()[:16]


def test_who_changes_a_ported_module_is_asked_for_the_javascript() -> None:
    known = json.loads(SAME_AS.read_text())
    changed = [f"{name}: see {script}" for name, script in PORTED.items() if known.get(name) != digest(name)]
    assert not changed, (
        f"Python's side has changed ({'; '.join(changed)}): port it to fapengine-face/live, run this file's tests,"
        " then write the digests with python -m tests.browser.test_live"
    )
    assert set(known) == set(PORTED)


def as_shipped() -> small_net.Weights:
    """The recognizer's weights as the package has them, in 8 bits."""
    weights, (_, arrays) = small_net.shipped(), live_tables.recognizer_tables()

    def layer(name: str) -> tuple[np.ndarray, np.ndarray]:
        matrix = arrays[f"{name}.matrix"] * arrays[f"{name}.scale"][:, None]
        return np.ascontiguousarray(matrix.T.astype(np.float32)), arrays[f"{name}.bias"]

    count = len(small_net.OFFSETS)
    mix, out = (tuple(layer(f"{name}{number}") for number in range(count)) for name in ("mix", "out"))
    return replace(weights, front=layer("front"), head=layer("head"), mix=mix, out=out)


WRONG = """
import { readFile, writeFile } from "node:fs/promises";
const [folder, , output] = process.argv.slice(2);
const { Live, Planner, Recognizer, planAll } = await import(`${folder}/live/index.js`);
const live = await Live.make({ seed: 5 });
const weights = await readFile(`${folder}/assets/recognizer.bin`);
const table = weights.buffer.slice(weights.byteOffset, weights.byteOffset + weights.byteLength);
const [m, faps, said] = [{ label: "m", start: 1.2, end: 1.3 }, new Float32Array(68), []];
await live.push(new Float32Array(160), 16000);
for (const wrong of [
  () => live.say(5), () => live.say([null]), () => live.say([["m", 1.2, 1.3]]), () => live.say([m], { clock: 5 }),
  () => live.say([{ ...m, start: "1.2" }]), () => live.say([{ ...m, loudness: NaN }]),
  () => live.say([{ ...m, stress: 3 }]), () => live.express("happy"),
  () => live.express("joy", NaN), () => live.push(new Int16Array(160), 16000),
  () => live.push(new Float32Array(160), 0),
  () => live.push(new Float32Array(160), 8000), () => live.push(new Float32Array(160), 16000, { delay: NaN }),
  () => live.hear({}), () => new Planner(live.profile).frame(NaN), () => new Planner(live.profile).cancel(NaN),
  () => planAll(live.profile, [m], { rate: 0 }), () => new Recognizer(table, { steps: 0 }),
  () => new Recognizer(table).push(new Float32Array(160)),
]) {
  try {
    await wrong();
    said.push("nothing");
  } catch (error) {
    said.push(error.message);
  }
}
live.cancel(); // nothing is said, nothing happens
let now = 0;
live.say([m], { clock: () => Math.min(now, 1.5) }); // a sound that ends before its face
const frames = (until) => {
  for (; now < until; now += 1 / 30) live.sample(now, faps);
  return live.gestures.random[1].drawn; // numbers drawn for the head
};
const drawn = [frames(0.1), frames(3), frames(13)];
const nods = ["a", "ˈa", "a"].map((label) => {
  const begun = now;
  live.say([{ label, start: 1, end: 1.2 }], { clock: () => now - begun });
  frames(begun + 3);
  return live.gestures.random[4].drawn;
});
await writeFile(output, JSON.stringify({ said, drawn, nods }));
live.close();
"""
REASONS = (
    "say: got Number", "phone: got null", 'phone: got ["m",1.2,1.3]', "say: got the clock 5", '"start":"1.2"',
    "loudness", "a stress of 0, 1 or 2",
    "express: got happy, expected joy", "got level NaN", "push: got Int16Array, expected a Float32Array",
    "a rate of 0", "push: got 8000 Hz after 16000 Hz", "a delay of NaN", "hear: got no AudioWorklet", "frame: got NaN",
    "cancel: got NaN", "rate: got 0", "steps: got 0", "push: got Float32Array, expected an Int16Array",
)  # fmt: skip


def test_who_uses_it_wrongly_is_told_what_is_wrong(package: Path) -> None:
    (script := package / "wrong.mjs").write_text(WRONG)
    found = node(package, script, None)
    for told, reason in zip(found["said"], REASONS, strict=True):
        assert reason in told
    assert found["nods"] == [0, 1, 1]
    before, after, later = found["drawn"]
    assert before < after == later  # the head moved when it spoke, and rests while its clock stands still


def check_phones(package: Path, sounds: list[np.ndarray], *, is_plain: bool = False) -> int:
    """Recognize sounds in both languages; the same phones and partial ones after each piece, of any length."""
    pieces = [320, 1, 999, 640, 4000]
    given = [{"samples": samples.tolist(), "pieces": pieces} for samples in sounds]
    found = node(package, RUNNER, {"sounds": given, "isPlain": is_plain})["heard"]
    count = 0
    for number, (samples, one) in enumerate(zip(sounds, found, strict=True)):
        recognizer, phones, partials, at = SmallRecognizer(weights=as_shipped()), [], [], 0
        while at < len(samples):
            length = pieces[len(partials) % len(pieces)]
            phones += recognizer.push(samples[at : at + length])
            partials.append(recognizer.partial)
            at += length
        phones += recognizer.end()
        spelled = [
            [(one["label"], one["start"], one["end"]) for one in each] for each in (one["phones"], *one["partials"])
        ]
        expected = [[(one.label, one.start_s, one.end_s) for one in each] for each in (phones, *partials)]
        assert spelled[0] == expected[0], f"sound {number}"
        assert spelled[1:] == expected[1:], f"sound {number}"
        count += sum(not phone.is_silence for phone in phones)
    return count


@pytest.mark.parametrize("is_plain", [False, True], ids=["by WebAssembly", "in plain JavaScript"])
def test_phones_are_pythons(is_plain: bool, package: Path) -> None:
    sentences = [spoken_by_espeak(voice, BABY).samples for voice in ("en-us", "fr")]
    noises = [no_speech()[name] for name in ("silence", "pink noise that swells")]
    others = [*noises, whispered(spoken_by_espeak("en-us", POPPIES).samples)]
    assert check_phones(package, [*sentences, *others], is_plain=is_plain) > 40


def check_prosody(package: Path, sounds: list[np.ndarray]) -> tuple[int, int]:
    """Loudness and stress of what is heard in both languages, of final and partial phones after each block of 20 ms.

    The number of phones that are louder or quieter than usual, and of stressed ones.
    """
    given = [{"samples": samples.tolist(), "pieces": [BLOCK]} for samples in sounds]
    found = node(package, RUNNER, {"sounds": given})["heard"]
    loud = stressed = 0
    for number, (samples, one) in enumerate(zip(sounds, found, strict=True)):
        head = {"stream": number, "rate_hz": RATE_HZ, "skips": 0, "is_reduced": False}
        blocks = [samples[at : at + BLOCK].astype("<i2").tobytes() for at in range(0, len(samples), BLOCK)]
        messages = [*((head, block) for block in blocks), (head | {"rate_hz": 0}, b"")]
        _, *told = answers(messages, SmallRecognizer(weights=as_shipped()))
        final = [phone for answer in told for phone in answer["phones"]]
        for given_phones, phones in zip(
            (one["phones"], *one["partials"]), (final, *(a["partial"] for a in told[:-1])), strict=True
        ):
            spelled = [(one["label"], one["start"], one.get("stress", 0)) for one in given_phones]
            assert spelled == [(one["label"], one["start_s"], one["stress"]) for one in phones], f"sound {number}"
            louder = np.array([one.get("loudness", 0.0) for one in given_phones])
            assert np.abs(louder - [one["loudness_db"] for one in phones]).max(initial=0) < 1e-6, f"sound {number}"
            loud += np.count_nonzero(louder)
            stressed += sum(stress for _, _, stress in spelled)
    return loud, stressed


def emphasized(speech: np.ndarray, gains: list[float]) -> np.ndarray:
    """Speech again and again, a gain each, with a louder syllable in each second."""
    gain = np.repeat(gains, len(speech))
    gain[np.arange(len(gain)) % RATE_HZ < 0.25 * RATE_HZ] *= 2
    return (gain * np.tile(speech, len(gains))).astype(np.int16)


def test_loudness_and_stress_of_what_is_heard_are_pythons(package: Path) -> None:
    speech = spoken_by_espeak("en-us", BABY).samples
    loud, stressed = check_prosody(package, [emphasized(speech, [0.2, 0.02, 0.5])])
    assert loud > 200
    assert stressed > 10


def test_values_glide_as_pythons(package: Path) -> None:
    rng = np.random.default_rng(3)
    given, expected = [], []
    times_s = np.sort(rng.uniform(0, 5, 60))
    for _ in range(20):
        made = [
            Ramp(
                float(rng.uniform(0, 4)),
                0,
                float(rng.uniform(0, 2)),
                float(rng.uniform(0.05, 2)),
                bool(rng.random() < 0.5),
            )
            for _ in range(6)
        ]
        events = [{"goal": r.goal, "at": r.at_s, "over": r.over_s, "takesOver": r.takes_over} for r in made]
        given.append({"events": events, "times": times_s.tolist()})
        expected.append(sample_ramps(np.zeros(1), made, times_s)[0])
    found = node(package, RUNNER, {"ramps": given})["glided"]
    assert np.abs(np.array(found) - expected).max() < 1e-9


def test_a_long_speech_is_said_as_it_is_planned(package: Path, profile: Profile) -> None:
    """It has more phones than the planner plans ahead, and long ones."""
    rng = np.random.default_rng(6)
    phones = [one for one in spoken(rng, list(profile.phones), 320, longest_s=1.5) if one.duration_s > 0.03]
    track = plan(PhoneTrack.from_phones(phones), profile, rng=rng, rate_hz=10.0, style=Style.speech_only()).track
    times_s = (np.arange(len(track.values)) / 10).tolist()
    given = {"phones": [*map(as_json, phones[::-1])], "times": times_s}
    (found,) = node(package, RUNNER, {"said": [given]})["said"]
    assert times_s[-1] > 25
    assert np.array_equal(found, track.values)
    seen_s = [*times_s[:10], *times_s[200:]]  # no picture in between, as in a tab that is not seen
    (found,) = node(package, RUNNER, {"said": [given | {"times": seen_s}]})["said"]
    assert np.array_equal(found[20:], track.values[210:])
    assert np.array(found)[20:].any(axis=1).mean() > 0.5


class CounterGenerator:
    """Random numbers of ``random.js``, by the methods of NumPy's generators. Stateful."""

    def __init__(self, seed: int, stream: int = 0) -> None:
        self._seed, self._drawn = seed, 0
        self._key = self._mixed(self._mixed(seed) + (stream + 1) * 0x9E3779B9)

    @staticmethod
    def _mixed(value: int) -> int:
        for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
            value &= 0xFFFFFFFF
            value = (value ^ (value >> shift)) * factor
        value &= 0xFFFFFFFF
        return value ^ (value >> 16)

    def spawn(self, count: int) -> list["CounterGenerator"]:
        return [CounterGenerator(self._seed, stream) for stream in range(count)]

    def uniform(self, low: float = 0.0, high: float = 1.0, size: int | None = None) -> Any:
        if size is not None:
            return np.array([self.uniform(low, high) for _ in range(size)])
        self._drawn += 1
        return low + (high - low) * ((self._mixed(self._key + self._drawn * 0x9E3779B9) + 0.5) / 2**32)

    def exponential(self, scale: float) -> float:
        return float(-scale * np.log(self.uniform()))

    def normal(self, *, scale: tuple[float, ...]) -> np.ndarray:
        return np.array(
            [one * np.sqrt(-2 * np.log(self.uniform())) * np.cos(2 * np.pi * self.uniform()) for one in scale]
        )

    def choice(self, sides: tuple[float, float]) -> float:
        return sides[self.uniform() >= 0.5]


LATE = 7
"""Seed of a face whose phones become known in any order, some too late."""


def test_gestures_are_pythons(package: Path, profile: Profile) -> None:
    rng = np.random.default_rng(4)
    times_s = np.arange(0.0, 30.0, 1 / 25)
    given, expected, nods = [], [], 0
    for seed in (0, 1, 2**32 - 1, LATE):
        phones = [*spoken(rng, list(profile.phones), 60, 1.5), *spoken(rng, list(profile.phones), 40, 20.0)]
        ahead_s = rng.uniform(-0.1, 2.0, len(phones)) if seed == LATE else np.full(len(phones), 30.0)
        known_s = np.array([phone.start_s for phone in phones]) - ahead_s
        generator = GestureGenerator(CounterGenerator(seed), Style())  # type: ignore[arg-type]  # has its methods
        made = generator.begin()
        for before_s, now_s in pairwise([-np.inf, *times_s.tolist()]):
            new = np.flatnonzero((known_s > before_s) & (known_s <= now_s))
            generator.hear(((phones[number].start_s, phones[number]) for number in new), now_s)
            made += generator.draw(now_s)
        levels = sample_ramps(start_levels(Style()), made, times_s)
        nods += sum(ramp.channel == Channel.NOD and ramp.goal > 0 for ramp in made)
        at = levels, generator.waves[..., None], times_s
        expected.append((gesture_faps(*at) + varied_faps(*at)).T)
        known = [as_json(phone) | {"known": at_s} for phone, at_s in zip(phones, known_s.tolist(), strict=True)]
        given.append({"seed": seed, "phones": known, "times": times_s.tolist()})
    found = np.array(node(package, RUNNER, {"faces": given})["drawn"])
    differs = np.abs(found - expected) > 1e-5
    assert not differs[:-1].any()
    assert not differs[-1][:, [fap.column(number) for number in range(31, 37)]].any()  # brows go with nods
    assert nods > 20
    assert np.abs(found[0] - found[1]).max() > 100
    assert (found[..., fap.column(19)] > 900).any(axis=1).all()  # they blink


def test_a_face_that_hears_nods_and_opens_wide_for_loud_speech(package: Path) -> None:
    speech = spoken_by_espeak("en-us", BABY).samples
    sounds = [emphasized(speech, [0.1, gain]) for gain in (0.1, 0.5)]
    followed = [{"samples": sound.tolist(), "rate": RATE_HZ, "still": False} for sound in sounds]
    found = node(package, RUNNER, {"followed": followed})["followed"]
    even, loud = (-np.array(one["frames"])[len(speech) // 160 :, 1:].sum(axis=1) for one in found)
    assert np.percentile(loud, 90) > 1.2 * np.percentile(even, 90)  # 1.40 times
    assert all(one["nods"] for one in found)


def test_a_face_without_a_page_follows_sound(package: Path) -> None:
    speech = spoken_by_espeak("en-us", BABY)
    pause = np.zeros(RATE_HZ, np.int16)
    given = {"samples": [*speech.samples.tolist(), *pause.tolist()], "rate": RATE_HZ}
    samples = resample_poly(given["samples"], 441, 160).clip(-32768, 32767)
    other = {"samples": samples.astype(int).tolist(), "rate": 44_100}
    followed = {"followed": [given, given | {"cancelAt": 1}, other]}
    found, stopped, again = node(package, RUNNER, followed)["followed"]
    kinds = [kind for kind, _, _ in found["told"]]
    assert (kinds[0], kinds[-1], kinds.count("started")) == ("started", "finished", 1)
    labels = [label for kind, label, _ in found["told"] if kind == "phone"]
    assert sum(label in ("b", "m", "p") for label in labels) >= 6
    assert [label for kind, label, _ in again["told"] if kind == "phone"] == labels  # also of another rate
    openings = -np.array(found["frames"])[:, 1:].sum(axis=1)
    assert openings.max() > 200
    assert openings[-1] == 0
    assert found["joy"] > 100
    assert found["weights"] == [len(ARKIT_NAMES), 68]
    told = [(kind, at_s) for kind, _, at_s in stopped["told"]]
    (cancelled_s,) = (at_s for kind, at_s in told if kind == "cancelled")
    after = [at_s for kind, at_s in told if kind == "phone" and at_s > cancelled_s]
    assert min(after) > cancelled_s + 0.2  # what had sounded before is not said, what comes after it is
    assert len(after) > 5


SHAPES = """
import { readFile, writeFile } from "node:fs/promises";
import { pathToFileURL } from "node:url";
const [folder, input, output] = process.argv.slice(2);
const { ArkitFollower } = await import(pathToFileURL(`${folder}/arkit.js`));
const follower = new ArkitFollower();
let rows = 0;
for (const solver of [follower.upper, follower.spoken]) {
  const { moved } = solver;
  solver.moved = (shape, step) => ((rows += step !== 0), moved.call(solver, shape, step));
}
const weights = JSON.parse(await readFile(input, "utf8")).map((faps) => [...follower.follow(faps)]);
await writeFile(output, JSON.stringify({ rows, weights }));
"""


def test_shapes_of_arkit_take_little_work(package: Path, tmp_path: Path) -> None:
    """Rows of the solvers' matrices that are added up in a frame; coordinate descent alone adds 2,000."""
    (script := tmp_path / "shapes.mjs").write_text(SHAPES)
    faps = living(mood="joy")[:200]
    found = node(package, script, faps.tolist())
    follower = ArkitFollower()
    expected = np.array([follower.follow(row) for row in faps])
    assert np.abs(found["weights"] - expected).max() < 2e-3
    assert 10 < found["rows"] / len(faps) < 300


KERNELS = """
import { writeFile } from "node:fs/promises";
const [folder, , output] = process.argv.slice(2);
const { matrixOf, multiply } = await import(`${folder}/live/small-net.js`);
const { newKernel } = await import(`${folder}/live/kernel.js`);
const [kernel, worst] = [newKernel(), []];
for (const [outputs, inputs] of [[1, 1], [16, 3], [82, 160], [160, 480]]) {
  const values = (count) => Float32Array.from({ length: count }, (_, index) => Math.cos(index * 1.7));
  const arrays = { "m.matrix": values(outputs * inputs), "m.scale": values(outputs), "m.bias": values(outputs) };
  const matrix = matrixOf(arrays, "m");
  const [one, other] = [new Float32Array(3 * outputs), new Float32Array(3 * outputs)];
  multiply(matrix, values(3 * inputs), one, 3);
  kernel.run(kernel.place(matrix), values(3 * inputs), other, 3);
  const size = Math.max(...one.map(Math.abs));
  worst.push(Math.max(...one.map((value, index) => Math.abs(value - other[index]))) / size);
}
await writeFile(output, JSON.stringify(worst));
"""


def test_matrices_by_webassembly_are_those_of_javascript(package: Path) -> None:
    (script := package / "kernels.mjs").write_text(KERNELS)
    assert max(node(package, script, None)) < 1e-6


@pytest.mark.nightly
@pytest.mark.shared
def test_phones_of_twenty_recordings_are_pythons(package: Path, shared: Path) -> None:
    files = sorted((shared / "data" / "speech_sound").glob("*.flac"))[:10]
    filmed = [load_sound(path, rate_hz=RATE_HZ)[0] for path in files]
    spoken_by = [(voice, text) for voice in ("en-us", "en-gb", "de", "fr", "it") for text in (BABY, POPPIES)]
    assert check_phones(package, [*filmed, *(spoken_by_espeak(*one).samples for one in spoken_by)]) > 400


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2, 6))
def test_many_plans_are_pythons(seed: int, package: Path, profile: Profile) -> None:
    compared = check_plans(package, profile, seed, streams=100, tracks=50, end_s=6.0)
    print(f"seed {seed}: {compared} values of 100 streams and 50 lists are the same")
    assert compared > 1_200_000


if __name__ == "__main__":
    SAME_AS.write_text(json.dumps({name: digest(name) for name in PORTED}, indent=2) + "\n")
