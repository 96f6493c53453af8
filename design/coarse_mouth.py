"""A coarse mouth 0.1 s after the sound, from the small network's layers: how well it could follow.

    python -m design.coarse_mouth [--sentences 120]

A second output sees the layers of the small network as far as each is computed at that moment (the bands at once, its
last layers 80 ms later), through random features and a ridge, and says how far the lips are open. It learns from
sentences of random words in three of flite's voices, and from sounds that are no speech; it is tried on two sentences
of the fourth voice, each voice in turn. The network itself knows all four. Time: pieces of 20 ms, half of a window of
25 ms, 10 ms for the worker. Figures: correlation of the opening with that by the true phones, mean and worst; p b m
met as in ``bench/recognizer_delays.py``; the widest opening in sounds without speech.
"""

import argparse
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.recognizer_delays import OPEN_MM, OPEN_S, SHUT_MM, SHUT_S
from fapengine.recognition.loudness import HOP
from fapengine.recognition.small_net import BEFORE, FRONT, OFFSETS, WINDOW, RunningMean, log_mel, shipped
from tests.unit.recognition.speech import BABY, POPPIES, VOICES, Spoken, closures, no_speech, opening_mm, spoken

STEP_S, DELAY_S = 0.02, 0.1
LATE_S = STEP_S + 0.0075 + 0.01 + STEP_S / 2
"""Mean age of the beginning of the newest step when what follows of it is shown."""
FEATURES, RIDGE = 2000, 30.0
WORDS = sorted(
    set(re.findall(r"\b[a-z]{2,9}\b", (Path(__file__).resolve().parents[1] / "docs/concepts.md").read_text()))
)

Array = NDArray[np.float64]


def seen(samples: NDArray[np.int16]) -> Array:
    """(T, n): what is known at each step of 20 ms: bands, and each layer of the network as far as it is computed."""
    weights, mean = shipped(), RunningMean(shipped().first_mean)
    padded = np.concatenate([np.zeros(BEFORE, np.int16), samples, np.zeros(WINDOW, np.int16)])
    count = len(samples) // (2 * HOP) * 2
    frames = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)[: count * HOP : HOP]
    bands = np.stack([mean.push(frame) for frame in log_mel(frames)]).reshape(count // 2, -1)

    def at(x: Array, step: int) -> Array:
        moved = np.zeros_like(x)
        if step > 0:
            moved[:-step] = x[step:]
        else:
            moved[-step:] = x[: len(x) + step]
        return moved

    x = np.maximum(np.hstack([at(bands, step) for step in FRONT]) @ weights.front[0] + weights.front[1], 0)
    known, ahead = [bands, at(bands, -1), at(x, -FRONT[-1])], FRONT[-1]
    for steps, mix, out in zip(OFFSETS, weights.mix, weights.out, strict=True):
        normed = x / np.sqrt((x * x).mean(axis=1, keepdims=True) + 1e-5)
        near = np.hstack([at(normed, step) for step in steps])
        x = x + np.maximum(near @ mix[0] + mix[1], 0) @ out[0] + out[1]
        if max(steps):
            ahead += max(steps)
            known.append(at(x, -ahead))
    return np.hstack([*known, at(x, -ahead)])


def wanted(speech: Spoken, count: int) -> Array:
    """(T,) mm: how far the lips are open at what each step shows."""
    rate_hz = 200.0
    opening = opening_mm(speech.phones, len(speech.samples) / 16_000, rate_hz)
    return np.interp(np.arange(count) * STEP_S + LATE_S - DELAY_S, np.arange(len(opening)) / rate_hz, opening)


def fold(voice: str, texts: list[str]) -> tuple[list[tuple[float, int, int]], float]:
    """Learn from the other voices: correlation, p b m met and asked of each sentence; widest opening without speech."""
    rng = np.random.default_rng(1)
    given, goals = [], []
    for other in VOICES:
        for text in texts if other != voice else []:
            speech = spoken(other, text)
            given.append(seen(speech.samples))
            goals.append(wanted(speech, len(given[-1])))
    for seed in range(2, 6):
        for sound in no_speech(seed=seed).values():
            given.append(seen(sound))
            goals.append(np.zeros(len(given[-1])))
    inputs, goal = np.concatenate(given), np.concatenate(goals)
    middle, spread = inputs.mean(axis=0), inputs.std(axis=0) + 1e-3
    random = rng.normal(0, 1, (inputs.shape[1], FEATURES)) / np.sqrt(inputs.shape[1])

    def lifted(x: Array) -> Array:
        normed = (x - middle) / spread
        return np.hstack([normed, np.tanh(2 * normed @ random), np.ones((len(x), 1))])

    gram, right = 0.0, 0.0
    for part in np.array_split(np.arange(len(inputs)), len(inputs) // 4000 + 1):
        x = lifted(inputs[part])
        gram, right = gram + x.T @ x, right + x.T @ goal[part]
    learned = np.linalg.solve(gram + RIDGE * np.eye(len(gram)), right)

    def shown(samples: NDArray[np.int16]) -> Array:
        return np.maximum(lifted(seen(samples)) @ learned, 0)

    rows = []
    for text in (BABY, POPPIES):
        speech = spoken(voice, text)
        mm = shown(speech.samples)
        at_s = np.arange(len(mm)) * STEP_S + LATE_S - DELAY_S
        middles = closures(speech.phones)
        met = sum(
            mm[np.abs(at_s - middle_s) <= SHUT_S].min(initial=99.0) < SHUT_MM
            and mm[np.abs(at_s - middle_s) <= OPEN_S].max(initial=0.0) > OPEN_MM
            for middle_s in middles
        )
        rows.append((float(np.corrcoef(mm, wanted(speech, len(mm)))[0, 1]), int(met), len(middles)))
    return rows, max(float(shown(sound).max()) for sound in no_speech().values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sentences", type=int, default=120, help="of each voice")
    rng = np.random.default_rng(1)
    texts = [" ".join(rng.choice(WORDS, 8)).capitalize() + "." for _ in range(parser.parse_args().sentences)]
    rows, widest = [], 0.0
    for voice in VOICES:
        found, open_mm = fold(voice, texts)
        print(f"{voice}: r {', '.join(f'{r:.3f}' for r, *_ in found)}, no speech {open_mm:.1f} mm", flush=True)
        rows += found
        widest = max(widest, open_mm)
    r, met, asked = np.array(rows).T
    print(f"r {r.mean():.3f}, worst {r.min():.3f}, p b m {met.sum():.0f}/{asked.sum():.0f}, no speech {widest:.1f} mm")


if __name__ == "__main__":
    main()
