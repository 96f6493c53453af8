# ruff: noqa: F811  # package is a fixture
"""Words in Node without a voice: phones of English by ``words-en``, times as Python's, and what services report."""

import json
import re
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import groupby, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from num2words import num2words

from bench import words_stress, words_train
from design import live_tables
from fapengine.host.words import TimedWord, WordQueue
from fapengine.recognition.sphinx import MODEL_PHONES, ipa_of
from fapengine.speech import ipa
from fapengine.speech.formats.services import parse_azure, parse_cartesia, parse_elevenlabs
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.speech.prosody import is_vowel
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.pronounce import USUAL_S, Pronouncer, kinds, stretched
from tests.browser.test_live import node, package, pytestmark  # noqa: F401  # the package without its head
from tests.unit.speech.samples import SAMPLES
from tests.unit.voices.test_spoken_form import CASES

RUNNER = """
import { readFile, writeFile } from "node:fs/promises";
const [folder, input, output] = process.argv.slice(2);
const of = (name) => import(`${folder}/${name}.js`);
const { phonesOf, kinds, stretched } = await of("live/words");
const { English } = await of("words-en/index");
const { spokenForms } = await of("words-en/spoken");
const given = JSON.parse(await readFile(input, "utf8"));
const [english, numbers, timings] = [await English.make(), await of("words-en/numbers"), await of("live/timings")];
const made = {
  read: (word) => english.letters.read(word).map((number) => english.letters.labels[number - 1]),
  look: (word) => english.letters.say(word),
  pronounce: (texts) => english.pronounce(texts),
  stress: ([word, phones]) => english.letters.stress.place(word, phones),
  kinds, spokenForms, stretched: (parts) => stretched(...parts),
  number: ([kind, number]) => numbers[kind](number),
  timings: ([name, events]) => timings[name](events),
  phonesOf: ([words, spoken]) =>
    phonesOf(words, spoken ? { pronounce: (texts) => texts.map((text) => spoken[text]) } : english),
  live: async (steps) => {
    const { Live } = await of("live/index");
    const [live, found] = [await Live.make({ still: true }), []];
    for (const { said, cancel, clock, ...options } of steps) {
      try {
        const saying = live.say(said, { ...options, ...(clock === undefined ? {} : { clock: () => clock }) });
        if (cancel) live.cancel();
        found.push({ said: await saying, coming: live.coming, clock: live.clock?.() });
      } catch ({ message }) {
        found.push(message);
      }
    }
    live.close();
    return found;
  },
};
const found = {};
for (const [name, all] of Object.entries(given)) found[name] = await Promise.all(all.map((one) => made[name](one)));
await writeFile(output, JSON.stringify(found));
"""
MY, MAMA, OH = ["m", "aɪ"], ["m", "ɑ", "m", "ə"], ["oʊ"]


def run(package: Path, **given: Sequence[object]) -> Any:
    """Values of the runner's functions for each of some arguments."""
    (script := package / "words.mjs").write_text(RUNNER)
    return node(package, script, given)


class MadeUpVoice:
    """A voice of made-up words, each phone as long as is usual."""

    def __init__(self, spoken: dict[str, list[str]]) -> None:
        self._spoken = spoken

    def speak(self, text: str) -> Any:
        now_s, phones = 0.0, []
        for label in (label for word in text.split() for label in self._spoken[word]):
            length_s = sum(USUAL_S[kind] for kind in kinds(label))
            phones.append(Phone(label, now_s, now_s + length_s))
            now_s += length_s
        return SimpleNamespace(phones=PhoneTrack.from_phones(phones, tolerance_s=1e-9))


def test_phones_are_timed_as_pythons(package: Path) -> None:
    rng = np.random.default_rng(7)
    labels = [*ipa.SOUNDS, "aɪ", "tʃ", "ɔːɹ", "t͡s", "ˈɑː", "xyz%"]
    spoken = {f"word{number}": list(rng.choice(labels, rng.integers(1, 6))) for number in range(80)}
    lists, expected = [], []
    for _ in range(12):
        now_s, words = float(rng.uniform(0, 2)), []
        for _ in range(rng.integers(1, 40)):
            now_s += float(rng.choice([0.0, 0.0, 0.0, 0.3]))
            end_s = now_s + float(rng.uniform(0.03, 0.7))
            words.append((str(rng.choice(list(spoken))), now_s, end_s))
            now_s = end_s
        said = Pronouncer(MadeUpVoice(spoken)).words(words)  # type: ignore[arg-type]  # it speaks
        expected.append([phone for phone in said if not phone.is_silence])
        lists.append([[{"text": text, "start": start, "end": end} for text, start, end in words], spoken])
    found = run(package, phonesOf=lists, kinds=labels, stretched=[[[0.1, 0.1], [True, False], 0.4]])
    for one, phones in zip(found["phonesOf"], expected, strict=True):
        assert [(each["label"], each["word"]) for each in one["phones"]] == [(each.label, each.word) for each in phones]
        for key, times_s in (("start", [p.start_s for p in phones]), ("end", [p.end_s for p in phones])):
            assert np.allclose([each[key] for each in one["phones"]], times_s, rtol=0, atol=1e-9)
        assert one["unread"] == []
    assert found["kinds"] == [list(kinds(label)) for label in labels]
    assert np.allclose(found["stretched"][0], stretched([0.1, 0.1], [True, False], 0.4), rtol=0, atol=1e-12)


def test_words_without_an_end_last_as_pythons(package: Path) -> None:
    words = [("my", 0.2, None), ("mama", 0.3, 0.6), ("mama", 0.5, None), ("oh", 2.0, None), ("oh", 2.01, 2.3)]
    timed: list[tuple[str, float, float]] = []
    WordQueue().add([TimedWord(*word) for word in words], lambda these: timed.extend(these) or [], 0.0)
    given = [{"text": text, "start": start_s} | ({"end": end_s} if end_s else {}) for text, start_s, end_s in words]
    (found,) = run(package, phonesOf=[[given, {"my": MY, "mama": MAMA, "oh": OH}]])["phonesOf"]
    assert [(word["text"], word["start"], word["end"]) for word in found["words"]] == timed
    assert len(timed) == 4


def test_the_network_reads_as_pythons(package: Path) -> None:
    rng = np.random.default_rng(2)
    words = ["".join(rng.choice(list(words_train.LETTERS), rng.integers(1, 24))) for _ in range(60)]
    about, arrays = words_stress.unpacked(live_tables.WORDS.read_bytes())
    weights = {name.removesuffix(".matrix"): arrays[name] for name in arrays if name.endswith(".matrix")}
    used = {name: matrix.T * arrays[f"{name}.scale"].astype(float) for name, matrix in weights.items()}
    used |= {name: array for name, array in arrays.items() if name.endswith(".bias")}
    expected = words_train.said(used, about["labels"], words)
    assert [tuple(one) for one in run(package, read=words)["read"]] == expected


def test_words_are_stressed_as_pythons(package: Path) -> None:
    rng = np.random.default_rng(5)
    about, arrays = words_stress.unpacked(live_tables.WORDS.read_bytes())
    names = arrays["accents"].tobytes().decode().split("\n")
    weights = dict(zip(names, arrays["accentWeights"].tolist(), strict=True))
    words = [
        (str(rng.choice(TEXT.split())).lower().strip("."), list(rng.choice(about["labels"], 8))) for _ in range(80)
    ]
    expected = []
    for word, phones in words:
        vowels = [number for number, label in enumerate(phones) if kinds(label)[0].endswith("vowel")]
        expected.append(words_stress.found_in(word, phones, vowels, weights))
    assert run(package, stress=words)["stress"] == expected


def test_a_text_is_stressed_as_by_espeak(package: Path) -> None:
    (found,) = run(package, pronounce=[TEXT.split()])["pronounce"]
    spoken = [phone for phone in EspeakVoice("en-us").speak(TEXT).phones.phones if not phone.is_silence]
    words = [list(phones) for _, phones in groupby(spoken, key=lambda phone: phone.word)]
    theirs = [[phone.stress == 1 for phone in word if is_vowel(phone)] for word in words]
    ours = [[label[0] == "ˈ" for label in word if is_vowel(Phone(label, 0, 1))] for word in found]
    pairs = zip(words, ours, theirs, strict=True)
    different = [
        word[0].word for word, *both in pairs if np.flatnonzero(both[0]).tolist() != np.flatnonzero(both[1]).tolist()
    ]
    assert different == ["makes", "beside"]  # which espeak leaves without stress
    assert sum(map(any, ours)) > 50


@pytest.mark.skipif(find_spec("pocketsphinx") is None, reason="needs PocketSphinx's dictionary")
def test_words_of_the_dictionary_are_said_as_it_has_them(package: Path) -> None:
    """PocketSphinx has another edition of CMUdict, without stress."""
    import pocketsphinx

    path = Path(pocketsphinx.__file__).parent / "model" / "en-us" / "cmudict-en-us.dict"
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if re.match("[a-z']+ ", line)]
    chosen = np.random.default_rng(1).choice(len(lines), 500, replace=False)
    known = {lines[number][0]: [ipa_of(name) for name in lines[number][1:]] for number in chosen}
    assert set(MODEL_PHONES)
    same = {"ə": "ʌ", "ɚ": "ɝ"}
    found = [[same.get(label, label) for label in one] for one in run(package, look=list(known))["look"]]
    wrong = sum(map(words_train.distance, found, known.values()))
    assert wrong < 0.02 * sum(map(len, known.values()))


TEXT = """
The birch canoe slid on the smooth planks. Glue the sheet to the dark blue background. It is easy to tell the depth of
a well. These days a chicken leg is a rare dish. Rice is often served in round bowls. The juice of lemons makes fine
punch. The box was thrown beside the parked truck. The hogs were fed chopped corn and garbage. Four hours of steady work
faced us. A large size in stockings is hard to sell. My mama and papa bought five maps from a famous Bavarian company.
""".strip()
ALIKE = {
    "ɐ": "ə", "ʌ": "ə", "ɪ": "i", "ᵻ": "i", "ɚ": "ə", "ɝ": "ə", "ɜ": "ə", "ɹ": "", "ɔ": "ɑ", "o": "ɑ", "ɾ": "t",
    "d": "t", "j": "i",
}  # fmt: skip
"""Letters that the two transcriptions choose between."""


def seen(labels: Sequence[str]) -> list[str]:
    """Phones as letters that both transcriptions use."""
    plain = (ALIKE.get(letter, letter) for label in labels for letter in ipa.letters(label))
    letters = [letter for letter in plain if letter]
    return [letter for before, letter in pairwise(["", *letters]) if letter != before]


def test_it_reads_a_text_as_espeak_does(package: Path) -> None:
    (found,) = run(package, phonesOf=[[TEXT]])["phonesOf"]
    ours = [phone["label"] for phone in found["phones"]]
    theirs = [phone.label for phone in EspeakVoice("en-us").speak(TEXT).phones.phones if not phone.is_silence]
    share = 1 - words_train.distance(seen(ours), seen(theirs)) / len(seen(theirs))
    assert share > 0.97
    assert words_train.on_lips(ours) == words_train.on_lips(theirs)
    ends = [word["end"] for word in found["words"]]
    assert found["unread"] == []
    assert ends == sorted(ends)


def test_prices_units_and_abbreviations_are_said_as_pythons(package: Path) -> None:
    cases = {text: said for code, text, said in CASES if code.startswith("en")}
    assert len(cases) > 6
    forms = run(package, spokenForms=[text.split() for text in cases])["spokenForms"]
    for text, found in zip(cases, forms, strict=True):
        assert len(found) == len(text.split())
        plain = [re.sub(r"[-\s]+|\.(?= |$)", " ", said).split() for said in (" ".join(found), cases[text])]
        assert plain[0] == plain[1]


def test_numbers_are_said_as_pythons(package: Path) -> None:
    rng = np.random.default_rng(3)
    numbers = [*range(35), 100, 101, 1000, 1001, 1100, *(int(10 ** rng.uniform(2, 14)) for _ in range(80))]
    years = [1100, 1905, 1987, 1999, 2000, 2005, 2026, 1066]
    given = [(kind, number) for kind in ("cardinal", "ordinal") for number in numbers] + [("year", y) for y in years]
    found = run(package, number=[list(one) for one in given])["number"]
    expected = [re.sub("[-,]", " ", num2words(number, to=kind)) for kind, number in given]
    assert found == [" ".join(said.split()) for said in expected]


SAYINGS = {
    "The FBI told U.S. banks": "ð i|ɛ f b i aɪ|t oʊ l d|j u ɛ s|b æ ŋ k s",
    "I read it": "aɪ|ɹ i d|ɪ t",
    "He has read it": "h i|h ə z|ɹ ɛ d|ɪ t",
    "It's 3:30 - 21st of May": "ɪ t s|θ ɹ i θ ɝ d i||t w ɛ n t i f ɝ s t|ə v|m eɪ",
    "café 东京 me@b.com": "k ə f eɪ||m i ə t b i d ɑ t k ɑ m",
    "The nth xkcd: -5, 2x. 1,2": "ð i|ɛ n θ|ɛ k s k eɪ s i d i|m aɪ n ə s f aɪ v|t u ɛ k s|w ʌ n t u",
    "What is it made of": "w ʌ t|ɪ z|ɪ t|m eɪ d|ʌ v",
    "3:00 pm 3:05 AM 7am 3:00": "θ ɹ i|p i ɛ m|θ ɹ i oʊ f aɪ v|eɪ ɛ m|s ɛ v ə n eɪ ɛ m|θ ɹ i ə k l ɑ k",
    "the '90s 1½ ½": "ð ə|n aɪ n t i z|w ʌ n ə n d ə h æ f|w ʌ n h æ f",
    "A Q&A": "ə|k j u ə n d eɪ",
}


def test_it_reads_letters_numbers_weak_forms_and_words_of_two_readings(package: Path) -> None:
    found = run(package, pronounce=[text.split() for text in SAYINGS])["pronounce"]
    said = ["|".join(" ".join(word or []) for word in one) for one in found]
    assert [one.replace("ˈ", "") for one in said] == list(SAYINGS.values())


def test_verbs_are_stressed_in_another_place_than_nouns(package: Path) -> None:
    found = run(package, pronounce=[["To", "record", "the", "record"], ["It", "is", "with", "you"]])["pronounce"]
    assert [" ".join(word) for word in found[0]] == ["t ə", "ɹ ɪ k ˈɔ ɹ d", "ð ə", "ɹ ˈɛ k ɚ d"]
    assert "ˈ" not in "".join(map("".join, found[1]))


def test_a_word_without_an_end_is_read_in_part(package: Path) -> None:
    words = ["1" * 100_000, "a@" * 50_000, "$1" * 30_000, "-" * 100_000]
    (found,) = run(package, pronounce=[words])["pronounce"]
    assert [0 < len(phones) < 3000 for phones in found[:3]] == [True] * 3
    assert found[3] is None


def test_what_services_report_is_pythons(package: Path) -> None:
    def values(name: str) -> list[Any]:
        try:
            found = json.loads(SAMPLES[name])
        except ValueError:
            found = [json.loads(line) for line in SAMPLES[name].splitlines()]
        return found if isinstance(found, list) else [found]

    as_the_sdk = [{"audioOffset": one["audio_offset"], "visemeId": one["viseme_id"]} for one in values("azure")]
    elevenlabs = [["elevenLabsWords", values(name)] for name in ("elevenlabs", "elevenlabs stream")]
    cartesia = [["cartesiaTimings", values(name)] for name in ("cartesia", "cartesia words", "cartesia stream")]
    livekit = [{"text": "my ", "startTime": 0.1, "endTime": 0.3}, {"text": " oh", "start_time": 0.3}, {"text": "."}]
    azure, *spelled, words = run(
        package, timings=[["azurePhones", as_the_sdk], *elevenlabs, *cartesia, ["liveKitWords", livekit]]
    )["timings"]
    tracks = [parse_elevenlabs(SAMPLES[name].encode()) for name in ("elevenlabs", "elevenlabs stream")]
    tracks += [parse_cartesia(SAMPLES[name].encode()) for name in ("cartesia", "cartesia words", "cartesia stream")]
    for one, track in zip([azure, *spelled], [parse_azure(SAMPLES["azure"].encode()), *tracks], strict=True):
        expected = [phone for phone in track.phones if not phone.is_silence]
        assert [each.get("label") or each["text"] for each in one] == [phone.label for phone in expected]
        assert [each.get("word", "") for each in one] == [phone.word if not track.spelled else "" for phone in expected]
        times_s = [(phone.start_s, phone.end_s) for phone in expected]
        assert np.allclose([(each["start"], each["end"]) for each in one], times_s, rtol=0, atol=1e-9)
    assert words == [{"text": "my", "start": 0.1, "end": 0.3}, {"text": "oh", "start": 0.3}]


def test_a_face_says_words(package: Path) -> None:
    more = {"said": [{"text": "mama", "start": 2}], "add": True}
    steps = [
        {"said": "My mama 东京", "clock": 5}, more, {"said": "oh"}, {"said": "oh", "cancel": True},
        {"said": [{"text": "oh", "start": 2}, {"text": "my", "start": 1}]}, {"said": [{"text": "a", "start": -1}]},
        {"said": "oh", "pronounce": "oʊ"}, {"said": 5}, {"said": [{"text": "oh", "start": 1, "end": None}]},
    ]  # fmt: skip
    (found,) = run(package, live=[steps])["live"]
    first, added, other, cancelled, in_order, *reasons, endless = found
    assert [(phone["label"], phone["word"]) for phone in first["coming"]] == [
        *((label, "My") for label in MY), *((label, "mama") for label in MAMA)
    ]  # fmt: skip
    assert first["said"]["unread"] == ["东京"]
    assert (first["clock"], added["clock"]) == (5, 5)
    assert [phone["label"] for phone in added["coming"]] == MY + MAMA + MAMA
    assert [phone["label"] for phone in other["coming"]] == OH
    assert (cancelled["said"], cancelled["coming"]) == (None, [])
    assert [phone["label"] for phone in in_order["coming"]] == MY + OH
    assert "expected a word { text, start, end }" in reasons[0]
    assert reasons[1].startswith("say: got the pronounce oʊ")
    assert reasons[2].startswith("say: got Number")
    assert [phone["label"] for phone in endless["coming"]] == OH


def test_a_text_that_is_added_follows_what_is_said(package: Path) -> None:
    steps = [{"said": "My mama.", "clock": 0}, {"said": "Oh my", "add": True}, {"said": "mama", "add": True}]
    late = [{"said": "oh", "clock": 9}, {"said": "my", "add": True}]
    found, after = run(package, live=[steps, late])["live"]
    words = [word for step in found for word in step["said"]["words"]]
    assert [word["text"] for word in words] == ["My", "mama.", "Oh", "my", "mama"]
    assert [later["start"] - word["end"] for word, later in pairwise(words)] == pytest.approx([0, 0.35, 0, 0])
    assert [phone["label"] for phone in found[-1]["coming"]] == MY + MAMA + OH + MY + MAMA
    starts = [phone["start"] for phone in found[-1]["coming"]]
    assert starts == sorted(starts)
    assert after[1]["said"]["words"][0]["start"] == 9  # what is over is not said
