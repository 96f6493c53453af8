"""Does planned motion live as captured motion does? Sizes, speeds, spectra, variation and undershoot of both.

    python -m bench.alive [--train data/speech_train.npz] [--test B.npz] [--liveliness 0] [--words] [--json]

Held-out sentences are planned from their phones and compared while they are spoken. Ratios are planned over captured.
The AUC says how well a small network that sees one second, nine numbers a frame, tells the two apart; 0.5 is chance.
Sentences whose phone times are wrong (:func:`design.fit_profile.is_mistimed`) are left out of training. A mean is
smaller and smoother than what it is the mean of, so errors in mm alone reward what these figures show. ``--words``
adds the share of words that the judge misreads (it needs JAX): natural variation may not cost too many.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from bench.fidelity import Clip, Corpus, Learned, Method, add_files, learn, ours, read_files
from bench.measures import COMPARED, seen, train_judge
from design.fit_profile import is_mistimed

Array = np.ndarray
BANDS_HZ = ((0.5, 4.0), (4.0, 8.0), (8.0, 12.5))
SPECTRUM = 128
CLASSES = {"open": ("aɪ", "æ", "ɛ", "eɪ", "ʌ", "aʊ"), "close": ("i", "ɪ"), "round": ("u", "ɔ", "oʊ")}
LEAST_TOKENS = 3
"""Of three phones in a row, or of a word, whose variation counts."""
WINDOW, STEP = 25, 3
"""Frames that the network sees, and from one window to the next."""
UNITS, PASSES, BATCH, RATE = 48, 30, 64, 2e-3
SEEDS, WORD_SEEDS = 4, 12
"""Of the variation: their means are the AUC, and the share of misread words."""


def channels(points: Array, names: Sequence[str]) -> dict[str, Array]:
    """(T,) mm each, of (T, P, 3) points."""

    def at(name: str, axis: int) -> Array:
        return points[:, list(names).index(name), axis]

    return {
        "opening": at("2.2", 1) - at("2.3", 1),
        "width": at("8.3", 0) - at("8.4", 0),
        "jaw": at("2.1", 1),
        "upper lip": at("2.2", 1),
        "corners' height": (at("8.3", 1) + at("8.4", 1)) / 2,
        "corners, left - right": at("8.3", 1) - at("8.4", 1),
        "upper lip, left - right": at("2.6", 1) - at("2.7", 1),
        "lower lip, left - right": at("2.8", 1) - at("2.9", 1),
        "jaw, to the side": at("2.1", 0),
    }


def moves(tracks: Sequence[Array], rate_hz: float) -> Array:
    """(6,): standard deviation of values, speeds and accelerations, and power in each of :data:`BANDS_HZ`."""
    orders = [np.concatenate([np.diff(track, order) * rate_hz**order for track in tracks]).std() for order in range(3)]
    hertz = np.fft.rfftfreq(SPECTRUM, 1 / rate_hz)
    spectra = [np.abs(np.fft.rfft((one - one.mean()) * np.hanning(len(one)), SPECTRUM)) ** 2 for one in tracks]
    power = np.sum(spectra, axis=0)
    return np.array([*orders, *(power[(hertz >= low) & (hertz < high)].sum() for low, high in BANDS_HZ)])


def spread(groups: dict[object, list[Array]]) -> float:
    """Standard deviation within groups of equal shapes, of groups that have enough."""
    within = [np.stack(group) - np.mean(group, axis=0) for group in groups.values() if len(group) >= LEAST_TOKENS]
    return float(np.sqrt(np.mean(np.concatenate([one.ravel() for one in within]) ** 2))) if within else float("nan")


def variation(clips: Sequence[Clip], tracks: Sequence[Array], rate_hz: float) -> dict[str, float]:
    """mm: a phone's middle over contexts and in the same three phones, a word's course over sentences."""
    phones, threes, words = defaultdict(list), defaultdict(list), defaultdict(list)
    for clip, track in zip(clips, tracks, strict=True):
        times = np.arange(len(track)) / rate_hz
        labels = ["_", *(phone.label for phone in clip.phones.phones), "_"]
        for index, phone in enumerate(clip.phones.phones):
            if not phone.is_silence:
                middle = np.interp((phone.start_s + phone.end_s) / 2, times, track)
                phones[phone.label].append(middle)
                threes[tuple(labels[index : index + 3])].append(middle)
        for word in clip.words:
            words[word.text].append(np.interp(np.linspace(word.start_s, word.end_s, 9), times, track))
    return {"phone": spread(phones), "same three phones": spread(threes), "same word": spread(words)}


def undershoot(clips: Sequence[Clip], openings: Sequence[Array], rate_hz: float) -> dict[str, float]:
    """Millimetres of a vowel's greatest opening per doubling of its duration, between the same neighbours, by class."""
    found: dict[tuple[str, ...], list[tuple[float, float]]] = defaultdict(list)
    for clip, opening in zip(clips, openings, strict=True):
        said = clip.phones.phones
        for before, phone, after in zip(said, said[1:], said[2:], strict=False):
            shown = opening[int(phone.start_s * rate_hz) : int(np.ceil(phone.end_s * rate_hz)) + 1]
            if len(shown):
                found[before.label, phone.label, after.label].append((np.log2(phone.duration_s), shown.max()))
    slopes = {}
    for name, vowels in CLASSES.items():
        rows = [np.array(v) - np.mean(v, axis=0) for k, v in found.items() if k[1] in vowels and len(v) >= LEAST_TOKENS]
        length, peak = np.concatenate(rows).T if rows else np.full((2, 1), np.nan)
        slopes[name] = float(length @ peak / (length @ length))
    return slopes


def windows(tracks: Sequence[Array]) -> Array:
    """(N, F): a second of values and changes of the channels, (T, C) each, without the sentence's posture."""
    seen = []
    for track in tracks:
        still = track - track.mean(axis=0)
        both = np.hstack([still, 2 * np.diff(still, axis=0, prepend=still[:1])])
        seen += [both[start : start + WINDOW].ravel() for start in range(0, len(both) - WINDOW + 1, STEP)]
    return np.array(seen)


def told_apart(training: tuple[Array, Array], tested: tuple[Array, Array]) -> float:
    """AUC of a network with one layer that tells the second kind of windows from the first; 0.5 is chance."""
    rng = np.random.default_rng(0)
    inputs, goals = np.concatenate(training), np.repeat([-1.0, 1.0], [len(kind) for kind in training])
    scale = inputs.std(axis=0) + 1e-9
    inputs = inputs / scale
    weights = [rng.normal(0, inputs.shape[1] ** -0.5, (inputs.shape[1], UNITS)), rng.normal(0, UNITS**-0.5, UNITS)]
    means, squares = [np.zeros_like(one) for one in weights], [np.zeros_like(one) for one in weights]
    step = 0
    for _ in range(PASSES):
        for rows in np.array_split(rng.permutation(len(inputs)), max(len(inputs) // BATCH, 1)):
            step += 1
            units = np.tanh(inputs[rows] @ weights[0])
            error = np.tanh(units @ weights[1]) - goals[rows]
            back = np.outer(error, weights[1]) * (1 - units**2)
            for index, slope in enumerate((inputs[rows].T @ back / len(rows), units.T @ error / len(rows))):
                means[index] += 0.1 * (slope - means[index])
                squares[index] += 0.01 * (slope**2 - squares[index])
                weights[index] -= RATE * means[index] / (np.sqrt(squares[index] / (1 - 0.99**step)) + 1e-8)
    captured, other = (np.tanh(kind / scale @ weights[0]) @ weights[1] for kind in tested)
    return float(np.mean(other[:, None] > captured[None, :]))


def misread(training: Sequence[Clip], tested: Corpus, learned: Learned, moves: Sequence[Method]) -> float:
    """Share of the words of held-out sentences that the judge misreads, over several methods."""
    judge, names = train_judge(training, tested.rate_hz), learned.profile.space.points
    right = []
    for move in moves:
        shown = [move(one, learned.profile, np.arange(len(one.points)) / tested.rate_hz) for one in tested.clips]
        read = judge.read([seen(points, names) for points in shown])
        right += [
            words[n : n + 1] == [word.text]
            for one, words in zip(tested.clips, read, strict=True)
            for n, word in enumerate(one.words)
        ]
    return round(1.0 - float(np.mean(right)), 4)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_files(parser)
    parser.add_argument("--liveliness", type=int, choices=(0, 1), default=1, help="0 measures the mean alone")
    parser.add_argument("--words", action="store_true", help="words that are misread, too")
    parser.add_argument("--json", action="store_true", help="print every figure as JSON")
    options = parser.parse_args(arguments)
    training, tested = read_files(options, words=True)
    rate_hz = tested.rate_hz
    others = [ours("context", variation=seed) for seed in (range(WORD_SEEDS) if options.liveliness else (None,))]
    learned = learn(training, rate_hz)
    names = learned.profile.space.points

    def shown(clip: Clip, method: Callable[..., Array]) -> dict[str, Array]:
        return channels(method(clip, learned.profile, np.arange(len(clip.points)) / rate_hz), names)

    def both(clips: Sequence[Clip]) -> list[list[dict[str, Array]]]:
        return [[shown(clip, method) for clip in clips] for method in (COMPARED["captured"], others[0])]

    heard = both(training)
    right = [not is_mistimed(one["opening"], other["opening"]) for one, other in zip(*heard, strict=True)]
    if not all(right):
        training = [clip for clip, kept in zip(training, right, strict=True) if kept]
        learned = learn(training, rate_hz)
        heard = both(training)
    held_out = both(tested.clips)
    spoken = [clip.spoken for clip in tested.clips]
    ratios = {}
    for name in held_out[0][0]:
        one, other = (
            moves([track[name][at] for track, at in zip(kind, spoken, strict=True)], rate_hz) for kind in held_out
        )
        ratios[name] = (other / one).round(3).tolist()
    opening, width = ([[track[name] for track in kind] for kind in held_out] for name in ("opening", "width"))
    figures = {
        "left_out_of_training": right.count(False),
        "ratios": ratios,
        "variation_mm": {
            kind: {"opening": variation(tested.clips, a, rate_hz), "width": variation(tested.clips, b, rate_hz)}
            for kind, a, b in zip(("captured", "planned"), opening, width, strict=True)
        },
        "undershoot_mm": {
            kind: undershoot(tested.clips, a, rate_hz) for kind, a in zip(("captured", "planned"), opening, strict=True)
        },
    }

    def seen_of(method: Callable[..., Array]) -> list[Array]:
        """Windows of the training's and of the held-out sentences."""
        return [
            windows([np.stack([*shown(clip, method).values()], 1)[clip.spoken] for clip in clips])
            for clips in (training, tested.clips)
        ]

    real = seen_of(COMPARED["captured"])
    half = [kind[::2] for kind in real], [kind[1::2] for kind in real]
    apart = [told_apart((real[0], made[0]), (real[1], made[1])) for made in map(seen_of, others[:SEEDS])]
    figures["auc"] = float(np.mean(apart))
    figures["auc_of_captured_against_captured"] = told_apart((half[0][0], half[1][0]), (half[0][1], half[1][1]))
    if options.words:
        figures["misread"] = misread(training, tested, learned, others)
    if options.json:
        print(json.dumps(figures, indent=1))
        return 0
    print(f"{len(tested.clips)} sentences; {figures['left_out_of_training']} of the training's have wrong times")
    print(f"{'planned / captured':24} {'sd':>6} {'speed':>6} {'accel':>6}", *(f"{a:g}-{b:g} Hz" for a, b in BANDS_HZ))
    for name, row in ratios.items():
        print(f"{name:24}", *(f"{value:6.2f}" for value in row))
    for name in ("variation_mm", "undershoot_mm", "auc", "auc_of_captured_against_captured", "misread"):
        if name in figures:
            print(f"{name}: {figures[name]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
