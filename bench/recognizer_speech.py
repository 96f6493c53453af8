r"""Speech with known phones to train the small recognizer on, made by what Debian has.

``bench.recognizer_train`` learns from it.

    apt-get install flite festival festvox-kallpc16k festvox-kdlpc16k festvox-us-slt-hts wordnet-base ffmpeg \
        asterisk-core-sounds-{en,it,ru} asterisk-core-sounds-{en,it,ru}-g722 asterisk-moh-opsound-g722
    python -m bench.recognizer_speech FOLDER [--sentences 400]

Sentences are examples of WordNet (its licence is free), and letters, digits and names of things at random. Speakers:

- flite's four voices and three of Festival, which tell when their phones sound;
- espeak-ng with its variants of a speaker, by the project's own voice;
- the prompts of Asterisk, spoken by people (CC-BY-SA 3.0; Russian CC-BY 3.0), English, and some
  Italian and Russian. Their text is known, and the project's own aligner finds the phones;
- music on hold, which is no speech.

Each speaker is a file of NumPy: ``samples`` (N,) int16 at 16 kHz, ``frames`` (N / 160,) uint8, numbers of
:data:`LABELS`, and ``ends`` (U,), the frame after each sentence. No sentence of ``bench/recognizers.py`` is among them.
"""

import argparse
import gzip
import re
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from bench.recognizers import SENTENCES
from fapengine.files.sound import load_sound
from fapengine.recognition.loudness import HOP
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.sphinx import MODEL_NAMES, heard_as, ipa_of, words_of
from fapengine.recognition.sphinx_aligner import SphinxAligner
from fapengine.speech.alphabets.convert import from_arpabet
from fapengine.speech.formats.corpora import parse_flite
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.voices.espeak import EspeakVoice

LABELS = (SILENCE, "ə", *MODEL_NAMES)
"""Labels that the recognizer tells apart: silence, schwa, and the 39 of PocketSphinx's model."""
EITHER = len(LABELS)
"""Number of a frame that is ʌ or ə: a dictionary does not tell them apart."""
UNKNOWN = 255
"""Number of a frame of which nothing is learned."""

FLITE = ("rms", "slt", "awb", "kal16")
FESTIVAL = {"kal": "kal_diphone", "ked": "ked_diphone", "slthts": "cmu_us_slt_arctic_hts"}
ESPEAK = tuple(
    f"{language}+{variant}"
    for language, variants in (
        ("en-us", "f1 f2 f3 f4 f5 m1 m2 m3 m4 m5 m6 m7 m8 Annie Andy linda steph Alicia Michael John klatt4 Mario"),
        ("en-gb", "f2 f4 m3 m7 Lee steph2 Hugo Diogo belinda victor zac sandro"),
        ("en-gb-scotland", "f3 m2"), ("en-gb-x-rp", "f5 m1 m8 max"), ("en-gb-x-gbclan", "m4 f1"),
    )
    for variant in variants.split()
)  # fmt: skip
ASTERISK = {
    "en": ("en_US_f_Allison", "en-us"), "it": ("it_IT_m_Carlo", "it"), "ru": ("ru_RU_f_IvrvoiceRU", "ru"),
}  # fmt: skip
SOUNDS = Path("/usr/share/asterisk")
WORDNET = Path("/usr/share/wordnet")
MIN_BYTES, MAX_BYTES = 3_000, 160_000
"""Prompts of 0.4 to 20 s: 8000 bytes are a second."""

Segments = list[tuple[int, float, float]]
_NUMBER = {label: number for number, label in enumerate(LABELS)}
_NEAR = {"ɐ": "ə", "ɚ": "ɝ", "ɜ": "ɝ", "ɨ": "ɪ", "ɪ̈": "ɪ", "ʉ": "u", "ɾ": "d"}


def texts(count: int, seed: int) -> list[str]:
    """Sentences at random, none of which is one of the bench's."""
    rng = np.random.default_rng(seed)
    found = []
    for name in ("noun", "verb", "adj", "adv"):
        for line in (WORDNET / f"data.{name}").read_text("latin-1").splitlines():
            found += re.findall(r'"([A-Za-z][A-Za-z\', ]{18,70})"', line)
    names = [
        line.split()[4].replace("_", " ")
        for line in (WORDNET / "data.noun").read_text("latin-1").splitlines()
        if not line.startswith(" ") and re.fullmatch(r"[a-z_]{3,14}", line.split()[4])
    ]
    banned = {said.lower().strip(".?") for said in SENTENCES}
    chosen = []
    for _ in range(count):
        if rng.random() < 0.85:
            said = found[rng.integers(len(found))]
        else:
            pieces = []
            for _ in range(rng.integers(3, 7)):
                kind = rng.random()
                if kind < 0.3:
                    pieces.append("BCDEFGHIJKLMNOPQRSTUVWXYZ"[rng.integers(25)])
                elif kind < 0.55:
                    pieces.append(str(rng.integers(10) if rng.random() < 0.7 else rng.integers(100)))
                else:
                    pieces.append(names[rng.integers(len(names))])
            said = " ".join(pieces)
        if said.lower().strip(".?") not in banned:
            chosen.append(said.strip().capitalize() + ".")
    return chosen


def numbers(label: str) -> list[int]:
    """Numbers of the labels that a phone in IPA is heard as, one behind the other."""
    label = _NEAR.get(label, label)
    if label in _NUMBER:
        return [_NUMBER[label]]
    return [_NUMBER[ipa_of(name)] for name in heard_as(label)]


def of_phones(phones: Sequence[Phone]) -> Segments:
    """Split phones into what they are heard as."""
    found: Segments = []
    for phone in phones:
        parts = numbers(phone.label) or ([found[-1][0]] if found else [0])
        step_s = (phone.end_s - phone.start_s) / len(parts)
        found += [(n, phone.start_s + i * step_s, phone.start_s + (i + 1) * step_s) for i, n in enumerate(parts)]
    return found


def by_flite(voice: str, said: Sequence[str]) -> Iterator[tuple[np.ndarray, Segments]]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speech.wav"
        for text in said:
            command = ["flite", "-voice", voice, "-t", text, "-o", str(path), "-psdur"]
            done = subprocess.run(command, capture_output=True, check=True, timeout=60)
            yield load_sound(path, rate_hz=RATE_HZ)[0], of_phones(parse_flite(done.stdout).phones)


def by_festival(voice: str, said: Sequence[str]) -> Iterator[tuple[np.ndarray, Segments]]:
    with tempfile.TemporaryDirectory() as folder:
        lines = [f"(voice_{voice})"]
        for index, text in enumerate(said):
            lines.append(f'(set! u (utt.synth (Utterance Text "{text}")))')
            lines += [f'(utt.save.wave u "{folder}/{index}.wav")', f'(utt.save.segs u "{folder}/{index}.lab")']
        script = Path(folder) / "all.scm"
        script.write_text("\n".join(lines))
        subprocess.run(["festival", "-b", str(script)], check=True, capture_output=True)
        for index in range(len(said)):
            now_s, segments = 0.0, Segments()
            for line in (Path(folder) / f"{index}.lab").read_text().splitlines()[1:]:
                end, _, name = line.split()
                label = SILENCE if name in ("pau", "h#", "brth") else from_arpabet(name) or SILENCE
                segments.append((numbers(label)[0], now_s, float(end)))
                now_s = float(end)
            yield load_sound(Path(folder) / f"{index}.wav", rate_hz=RATE_HZ)[0], segments


def by_espeak(voice: str, said: Sequence[str], seed: int) -> Iterator[tuple[np.ndarray, Segments]]:
    rng = np.random.default_rng(seed)
    for text in said:
        speech = EspeakVoice(voice, rate_wpm=int(rng.integers(120, 190))).speak(text)
        samples = resample_poly(speech.samples.astype(float), RATE_HZ, speech.sample_rate_hz)
        yield np.clip(samples, -32768, 32767).astype(np.int16), of_phones(speech.phones.phones)


def g722(path: Path) -> np.ndarray:
    command = ["ffmpeg", "-v", "error", "-f", "g722", "-i", str(path), "-f", "s16le", "-ar", str(RATE_HZ), "-"]
    return np.frombuffer(subprocess.run(command, capture_output=True, check=True).stdout, np.int16)


def by_people(language: str) -> Iterator[tuple[np.ndarray, Segments]]:
    """Prompts whose text agrees with their sound, aligned."""
    folder, voice = ASTERISK[language]

    def pronounce(word: str) -> Sequence[Phone]:
        return EspeakVoice(voice).speak(word).phones.phones

    listed = gzip.decompress(
        Path(f"/usr/share/doc/asterisk-core-sounds-{language}/core-sounds-{language}.txt.gz").read_bytes()
    )
    prompts: list[tuple[Path, list[str]]] = []
    for line in listed.decode("utf-8", "replace").splitlines():
        name, _, text = line.partition(":")
        path = SOUNDS / "sounds" / folder / f"{name.strip()}.g722"
        words = words_of(re.sub(r"[\[(].*?[\])]", " ", text))
        if not line.startswith(";") and words and path.exists() and MIN_BYTES < path.stat().st_size < MAX_BYTES:
            prompts.append((path, words))
    aligner = SphinxAligner([word for _, words in prompts for word in words], pronounce, dictionary=language == "en")
    first = 0
    for path, words in prompts:
        samples = g722(path)
        aligned = aligner.align(samples, first, first + len(words))
        first += len(words)
        if not aligned:
            continue
        segments, now = Segments(), 0
        for phone in aligned:
            if phone.first > now:
                segments.append((0, now / 100, phone.first / 100))
            heard = phone.model.split()
            step = (phone.end - phone.first) / len(heard)
            for index, model in enumerate(heard):
                number = EITHER if model == "AH" else _NUMBER[ipa_of(model)]
                segments.append((number, (phone.first + index * step) / 100, (phone.first + (index + 1) * step) / 100))
            now = phone.end
        segments.append((0, now / 100, len(samples) / RATE_HZ))
        yield samples, segments


def music() -> Iterator[tuple[np.ndarray, Segments]]:
    for path in sorted((SOUNDS / "moh").rglob("*.g722")):
        samples = g722(path)
        for start in range(0, len(samples) - 6 * RATE_HZ, 6 * RATE_HZ):
            piece = samples[start : start + 6 * RATE_HZ]
            yield piece, [(0, 0.0, 6.0)]


def tones(count: int, seed: int) -> Iterator[tuple[np.ndarray, Segments]]:
    """Make sounds that are no speech: chords, plucked notes, drums, hum, sweeps and clicks, 6 s each."""
    rng = np.random.default_rng(seed)
    at_s = np.arange(6 * RATE_HZ) / RATE_HZ
    for _ in range(count):
        sound = np.zeros(len(at_s))
        kind = rng.integers(5)
        if kind == 0:  # a chord that swells
            for _ in range(rng.integers(1, 6)):
                pitch_hz = 55 * 2 ** (rng.integers(0, 48) / 12)
                partials = rng.integers(1, 12)
                sound += sum(
                    np.sin(2 * np.pi * n * pitch_hz * at_s) / n ** rng.uniform(0.5, 2) for n in range(1, partials + 1)
                )
            sound *= 1 + 0.5 * np.sin(2 * np.pi * rng.uniform(0.1, 3) * at_s)
        elif kind == 1:  # notes that are plucked, and a drum
            step = int(RATE_HZ * rng.uniform(0.12, 0.6))
            for start in range(0, len(at_s), step):
                rest_s = at_s[: len(at_s) - start]
                pitch_hz = 110 * 2 ** (rng.integers(0, 36) / 12)
                fall = np.exp(-rng.uniform(1, 9) * rest_s)
                slope = rng.uniform(0.7, 2)
                sound[start:] += fall * sum(np.sin(2 * np.pi * n * pitch_hz * rest_s) / n**slope for n in range(1, 9))
                if rng.random() < 0.4:
                    sound[start:] += rng.normal(0, 1, len(rest_s)) * np.exp(-rng.uniform(15, 80) * rest_s)
        elif kind == 2:  # hum of the mains, of motors
            base_hz = rng.choice([50, 60, 100, 120, rng.uniform(30, 300)])
            sound = sum(
                rng.normal(0, 1) / n * np.sin(2 * np.pi * n * base_hz * at_s) for n in range(1, rng.integers(3, 20))
            )
        elif kind == 3:  # sweeps and beeps
            ends = rng.uniform(100, 4000, 2)
            sound = np.sin(2 * np.pi * np.cumsum(np.linspace(*ends, len(at_s))) / RATE_HZ)
            sound *= np.sin(2 * np.pi * rng.uniform(0.2, 4) * at_s) > rng.uniform(-1, 0.5)
        else:  # clicks and knocks
            clicks = (rng.random(len(at_s)) < 10 ** rng.uniform(-4.5, -3)) * rng.normal(0, 1, len(at_s))
            ring = np.exp(-rng.uniform(30, 400) * at_s[:2000]) * np.sin(2 * np.pi * rng.uniform(80, 3000) * at_s[:2000])
            sound = np.convolve(clicks, ring + (at_s[:2000] == 0))[: len(at_s)]
        sound = sound + rng.normal(0, 10 ** rng.uniform(-5, -1), len(at_s)) * np.abs(sound).max()
        yield (10 ** rng.uniform(2.5, 4.3) * sound / max(np.abs(sound).max(), 1e-9)).astype(np.int16), [(0, 0.0, 6.0)]


def framed(count: int, segments: Segments) -> np.ndarray:
    """(count,) uint8: label of the middle of each frame."""
    frames = np.zeros(count, np.uint8)
    for number, start_s, end_s in segments:
        frames[max(round(start_s * 100), 0) : max(round(end_s * 100), 0)] = number
    return frames


def keep(path: Path, spoken: Iterator[tuple[np.ndarray, Segments]]) -> None:
    if path.exists():
        return
    sounds, labels, ends, total = [], [], [], 0
    for samples, segments in spoken:
        count = len(samples) // HOP
        if count < 30:
            continue
        sounds.append(samples[: count * HOP])
        labels.append(framed(count, segments))
        total += count
        ends.append(total)
    np.savez(path, samples=np.concatenate(sounds), frames=np.concatenate(labels), ends=np.array(ends))
    print(f"{path.stem}: {len(ends)} pieces, {total / 6000:.1f} minutes", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sentences", type=int, default=400, help="of each voice of flite and Festival")
    options = parser.parse_args()
    folder, count = options.folder, options.sentences
    folder.mkdir(parents=True, exist_ok=True)
    for seed, voice in enumerate(FLITE):
        keep(folder / f"flite-{voice}.npz", by_flite(voice, texts(count, 100 + seed)))
    for seed, (name, voice) in enumerate(FESTIVAL.items()):
        keep(folder / f"festival-{name}.npz", by_festival(voice, texts(count, 200 + seed)))
    keep(folder / "people-en.npz", by_people("en"))
    keep(folder / "music.npz", music())
    keep(folder / "tones.npz", tones(120, 7))
    for seed, voice in enumerate(ESPEAK):
        keep(folder / f"espeak-{voice}.npz", by_espeak(voice, texts(count // 8, 300 + seed), seed))
    for language in ("it", "ru"):
        keep(folder / f"people-{language}.npz", islice(by_people(language), 250))


if __name__ == "__main__":
    main()
