"""Trains the letters-to-phones network of ``fapengine-face/words-en`` and writes it with the words that it gets wrong.

    python -m bench.words_train CMUDICT [-o design/words-en.bin] [--steps 7000]

CMUDICT is ``cmudict.dict`` of github.com/cmusphinx/cmudict (BSD-2-Clause, Copyright (C) 1993-2015 Carnegie Mellon
University), here commit 0f8072f. It needs JAX and optax. Seeded; 7000 steps take 20 minutes on a busy
machine with two cores.

Theory of operation
-------------------
1. Letters (a to z and the apostrophe) are vectors. Layers of convolutions over :data:`REACH` letters to both sides add
   to them; after :data:`LETTER_LAYERS` of them each letter becomes :data:`PLACES` places, so that a letter may have two
   phones. The last matrix scores the phones of each place, and no phone.
2. The loss is CTC (Graves and others 2006, doi:10.1145/1143844.1143891): nobody says which letter has which phone.
   The best label of each place is read; repeated labels count once.
3. Weights are stored as int8 with a scale for each row. A twentieth of the words is left out of the training, and
   measured. Every word of the dictionary that the network gets wrong is stored with its phones, so the whole dictionary
   is exact; and those without a vowel letter, because others of that kind are spelled.

The words are sorted; each begins with the number of letters that it shares with the one before (as a byte), then come
its other letters and a zero. Phones of all words follow in the same order, a byte each, each word with a zero after it.
"""

import argparse
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.live_tables import packed
from fapengine.speech.alphabets.convert import from_arpabet

Array = NDArray[Any]
LETTERS = "'abcdefghijklmnopqrstuvwxyz"
CHANNELS, REACH, LETTER_LAYERS, LAYERS, PLACES = 72, 2, 3, 5, 2
LONGEST = 20
"""Letters of the longest word that is learned."""
BUCKETS = (6, 8, 11, LONGEST)
"""Words of up to so many letters are learned together, so that little is filled up."""
BATCH = 96
RATE = 3e-3
LEFT_OUT = 20
"""One word of so many is left out of the training."""
VOWELS = frozenset("aeiouy")
LIPS = ("pbm", "fv")
"""Phones that close the lips, or bring the lip to the teeth."""


def dictionary(path: Path) -> dict[str, tuple[str, ...]]:
    """First pronunciation of each word of letters, in IPA."""
    words: dict[str, tuple[str, ...]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        word, *labels = line.partition("#")[0].split()
        if re.fullmatch("[a-z'][a-z']*[a-z][a-z']*|[a-z]", word):
            words[word] = tuple(ipa(label) for label in labels)
    return words


def ipa(label: str) -> str:
    """IPA of an ARPAbet label; unstressed IH is ɪ."""
    found = from_arpabet("IH1" if label == "IH0" else label)
    assert found is not None, f"{label}: got no IPA"
    return found


def coded(word: str) -> list[int]:
    """Numbers of letters; 0 fills up."""
    return [LETTERS.index(letter) + 1 for letter in word]


def first_weights(rng: np.random.Generator, phones: int) -> dict[str, Array]:
    """Draw weights: matrices as (inputs, outputs)."""

    def matrix(inputs: int, outputs: int) -> Array:
        return (rng.standard_normal((inputs, outputs)) * np.sqrt(1.5 / inputs)).astype(np.float32)

    wide = (2 * REACH + 1) * CHANNELS
    weights = {"letters": (0.3 * rng.standard_normal((len(LETTERS) + 1, CHANNELS))).astype(np.float32)}
    weights["places"] = matrix(CHANNELS, PLACES * CHANNELS)
    weights["head"], weights["head.bias"] = matrix(CHANNELS, phones + 1), np.zeros(phones + 1, np.float32)
    for layer in range(LAYERS):
        weights[f"mix{layer}"], weights[f"mix{layer}.bias"] = matrix(wide, CHANNELS), np.zeros(CHANNELS, np.float32)
    return weights


def scores(weights: Mapping[str, Any], letters: Any, xp: Any = np) -> Any:
    """Score phones, (N, PLACES * T, phones + 1), of words' letters, (N, T); 0 is no phone. ``xp`` is NumPy or JAX's."""
    mask = (letters > 0)[..., None]
    x = xp.where(mask, weights["letters"][letters], 0)
    for layer in range(LAYERS):
        if layer == LETTER_LAYERS:
            x = (x @ weights["places"]).reshape(len(x), -1, CHANNELS)
            mask = xp.repeat(mask, PLACES, axis=1)
        normed = xp.where(mask, x / xp.sqrt((x * x).mean(-1, keepdims=True) + 1e-5), 0)
        padded = xp.pad(normed, ((0, 0), (REACH, REACH), (0, 0)))
        near = xp.concatenate([padded[:, step : step + x.shape[1]] for step in range(2 * REACH + 1)], axis=2)
        x = x + xp.maximum(near @ weights[f"mix{layer}"] + weights[f"mix{layer}.bias"], 0)
        x = xp.where(mask, x, 0)
    return x @ weights["head"] + weights["head.bias"]


def said(weights: Mapping[str, Array], labels: Sequence[str], words: Sequence[str]) -> list[tuple[str, ...]]:
    """Phones of words as the network says them, with the arithmetic of the page (float64)."""
    exact = {name: array.astype(np.float64) for name, array in weights.items()}
    found: dict[str, tuple[str, ...]] = {}
    for length in sorted({len(word) for word in words}):
        same = [word for word in words if len(word) == length]
        for first in range(0, len(same), 512):
            some = same[first : first + 512]
            best = scores(exact, np.array([coded(word) for word in some])).argmax(-1)
            for word, row in zip(some, best, strict=True):
                kept = [int(now) for before, now in zip([0, *row], row, strict=False) if now and now != before]
                found[word] = tuple(labels[number - 1] for number in kept)
    return [found[word] for word in words]


def rounded(weights: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Weights as int8 with a scale for each output, as the file has them, and as they are used."""
    arrays: dict[str, Array] = {}
    used: dict[str, Array] = {}
    for name, array in weights.items():
        if array.ndim == 1:
            arrays[name] = used[name] = array
            continue
        scale = (np.abs(array).max(axis=0) / 127).astype(np.float32)
        arrays[f"{name}.matrix"] = np.rint(array / scale).astype(np.int8).T
        arrays[f"{name}.scale"] = scale
        used[name] = arrays[f"{name}.matrix"].T.astype(np.float64) * scale
    return arrays, used


def front_coded(words: Sequence[str]) -> bytes:
    """Sorted words, each with the number of letters that it shares with the one before."""
    written, before = bytearray(), ""
    for word in words:
        count = next((at for at, (one, other) in enumerate(zip(before, word, strict=False)) if one != other), None)
        shared = min(len(before), len(word)) if count is None else count
        written += bytes([shared]) + word[shared:].encode() + b"\0"
        before = word
    return bytes(written)


def batches(words: Sequence[str], rng: np.random.Generator) -> Iterator[tuple[list[str], int]]:
    """Words of similar length, at random, for ever; and the length to fill them up to."""
    buckets = [
        [word for word in words if low < len(word) <= high]
        for low, high in zip((0, *BUCKETS), BUCKETS, strict=False)
    ]  # fmt: skip
    while True:
        drawn = []
        for bucket, length in zip(buckets, BUCKETS, strict=True):
            order = rng.permutation(len(bucket))
            drawn += [(order[at : at + BATCH], bucket, length) for at in range(0, len(bucket) - BATCH + 1, BATCH)]
        for number in rng.permutation(len(drawn)):
            order, bucket, length = drawn[number]
            yield [bucket[at] for at in order], length


def train(
    words: Mapping[str, tuple[str, ...]], learned: Sequence[str], labels: list[str], steps: int
) -> dict[str, Array]:
    """Learn weights."""
    import jax
    import jax.numpy as jnp
    import optax

    rng = np.random.default_rng(0)
    weights: Any = first_weights(rng, len(labels))
    print(f"{sum(array.size for array in weights.values())} weights, {len(learned)} words", flush=True)
    optimizer = optax.chain(
        optax.clip_by_global_norm(1.0), optax.scale_by_adam(),
        optax.scale_by_learning_rate(optax.warmup_cosine_decay_schedule(0.0, RATE, 50, steps, 1e-5)),
    )  # fmt: skip
    state = optimizer.init(weights)

    def loss(weights: Any, letters: Any, phones: Any) -> Any:
        empty = jnp.repeat((letters == 0).astype(jnp.float32), PLACES, axis=1)
        return optax.ctc_loss(scores(weights, letters, jnp), empty, phones, (phones == 0).astype(jnp.float32)).mean()

    @jax.jit
    def step(weights: Any, state: Any, letters: Any, phones: Any) -> Any:
        value, slope = jax.value_and_grad(loss)(weights, letters, phones)
        change, state = optimizer.update(slope, state)
        return optax.apply_updates(weights, change), state, value

    number_of = {label: number for number, label in enumerate(labels, 1)}
    fits = [word for word in learned if len(word) <= LONGEST and len(words[word]) <= PLACES * len(word)]
    drawn, values = batches(fits, rng), []
    for number in range(1, steps + 1):
        some, length = next(drawn)
        letters, phones = np.zeros((BATCH, length), np.int32), np.zeros((BATCH, PLACES * length), np.int32)
        for row, word in enumerate(some):
            letters[row, : len(word)] = coded(word)
            phones[row, : len(words[word])] = [number_of[label] for label in words[word]]
        weights, state, value = step(weights, state, letters, phones)
        values.append(float(value))
        if number % 200 == 0:
            print(number, round(float(np.mean(values[-200:])), 3), flush=True)
    return {name: np.asarray(array) for name, array in weights.items()}


def distance(one: Sequence[str], other: Sequence[str]) -> int:
    """Number of phones to change, lose or gain."""
    row = list(range(len(other) + 1))
    for number, label in enumerate(one, 1):
        before, row[0] = row[0], number
        for at, known in enumerate(other, 1):
            before, row[at] = row[at], min(row[at] + 1, row[at - 1] + 1, before + (label != known))
    return row[-1]


def on_lips(phones: Sequence[str]) -> list[str]:
    """Those that lips show: which of :data:`LIPS`."""
    return [kind for label in phones for kind in LIPS if label in kind]


def measure(words: Mapping[str, tuple[str, ...]], left_out: Sequence[str], found: Sequence[tuple[str, ...]]) -> str:
    """Shares of what is wrong in words."""
    pairs = [(words[word], phones) for word, phones in zip(left_out, found, strict=True)]
    share = {
        "phones": sum(distance(one, other) for one, other in pairs) / sum(len(one) for one, _ in pairs),
        "p b m f v": sum(distance(on_lips(one), on_lips(other)) for one, other in pairs)
        / sum(len(on_lips(one)) for one, _ in pairs),
        "words": sum(one != other for one, other in pairs) / len(pairs),
    }
    return ", ".join(f"{name} wrong {100 * value:.2f} %" for name, value in share.items())


def main() -> None:
    parser = argparse.ArgumentParser(description="Trains words-en.")
    parser.add_argument("dictionary", type=Path, metavar="CMUDICT")
    parser.add_argument("-o", "--output", type=Path, default=Path("design/words-en.bin"))
    parser.add_argument("--steps", type=int, default=7000)
    given = parser.parse_args()
    words = dictionary(given.dictionary)
    labels = sorted({label for phones in words.values() for label in phones})
    order = sorted(words)
    np.random.default_rng(1).shuffle(order)
    left_out, learned = order[: len(order) // LEFT_OUT], order[len(order) // LEFT_OUT :]
    arrays, used = rounded(train(words, learned, labels, given.steps))
    print(f"{len(left_out)} words left out: {measure(words, left_out, said(used, labels, left_out))}", flush=True)
    every = sorted(words)
    found = zip(every, said(used, labels, every), strict=True)
    stored = [word for word, phones in found if phones != words[word] or not VOWELS & set(word)]
    print(f"{len(stored)} of {len(every)} words are stored")
    number_of = {label: number for number, label in enumerate(labels, 1)}
    phones = b"".join(bytes(number_of[label] for label in words[word]) + b"\0" for word in stored)
    arrays["words"] = np.frombuffer(front_coded(stored), np.int8)
    arrays["phones"] = np.frombuffer(phones, np.int8)
    shape = {"channels": CHANNELS, "reach": REACH, "letterLayers": LETTER_LAYERS, "layers": LAYERS, "places": PLACES}
    given.output.write_bytes(packed({"labels": labels, "alphabet": LETTERS} | shape, arrays))
    print(json.dumps({name: array.nbytes for name, array in arrays.items() if array.nbytes > 9000}))


if __name__ == "__main__":
    main()
