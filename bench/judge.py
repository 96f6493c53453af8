"""A judge that reads lips: a small network that hears nothing, trained on captured motion, names the words it sees.

Theory of operation
-------------------
Input are x and y of 18 points, frame by frame: both contours of the lips, and two points of the jaw. **Depth does not
count**: one camera saw the speaker, and nobody measured how far lips come forward; nor does the tongue.

A residual network of dilated convolutions, about 1.3 s wide, gives each frame's phone posteriors. Training varies size,
posture and noise of the motion, so that the judge goes by the shape of a movement rather than by its millimetres.
Viterbi decoding finds the likeliest sentence in the corpus' own grammar: the words that the training sentences have at
each place, in their commonest pronunciation, with the phones' mean durations. No times are given to it.

It is no part of the product. Chance is seeded; weights are kept in the user's cache, under a name that is the hash of
what they were learned from and of this file.
"""

import hashlib
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fapengine.speech.phone_track import SILENCE, PhoneTrack

Array = np.ndarray
Weights = dict[str, Any]

CHANNELS, BLOCKS, FIRST, WIDTH = 96, (1, 2, 4, 8, 1), 5, 3
"""Channels; dilation of each residual block; frames of the first convolution and of the others."""
EPOCHS, BATCH, RATE, DECAY, DROPOUT, SMOOTHING = 40, 16, 2e-3, 0.02, 0.2, 0.05
GAIN, POINT_GAIN, SHIFT, NOISE = 0.2, 0.1, 0.25, 0.08
"""Training's variation: of a sentence's size, of each coordinate's, of its constant posture, of each frame; the last
two in standard deviations of the coordinate."""
POSTERIOR_POWER, PRIOR_POWER = 0.6, 0.6
"""Neighbouring frames are no independent witnesses, so posteriors count less; priors of phones are divided out in
part."""
PAUSE_LOG = -1.0
"""Log weight of a pause between two words."""


@dataclass(frozen=True)
class Word:
    """One word of a sentence, in small letters, with its time."""

    text: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Example:
    """A sentence to learn from."""

    motion: Array
    """(T, 36) mm: x and y of the points."""
    phones: PhoneTrack
    words: tuple[Word, ...]


@dataclass(frozen=True)
class Grammar:
    """States of the decoder: phones of words in their places, and pauses between them."""

    labels: tuple[str, ...]
    phone: Array
    """(N,) which label a state shows."""
    place: Array
    """(N,) place of its word in the sentence; -1 in a pause."""
    words: tuple[str, ...]
    """(N,) its word."""
    before: Array
    """(N, P) states from which it can be entered, padded with itself."""
    cost: Array
    """(N, P) log probability of each; -inf where it is padding."""
    first: Array
    last: Array
    prior: Array
    """(labels,) log probability of each label in a frame."""


@dataclass(frozen=True)
class Judge:
    """A trained judge of lips: network weights, scaling of its input, grammar; :meth:`read` reads words with it."""

    mean: Array
    spread: Array
    weights: Weights
    grammar: Grammar
    rate_hz: float

    def posteriors(self, motions: Sequence[Array]) -> list[Array]:
        """Log probability of each label in each frame: (T, labels) for each motion (T, 36) in mm."""
        padded, _ = _padded([(motion - self.mean) / self.spread for motion in motions])
        found = np.concatenate([_posteriors(self.weights, padded[at : at + 64]) for at in range(0, len(padded), 64)])
        return [rows[: len(motion)] for rows, motion in zip(found, motions, strict=True)]

    def read(self, motions: Sequence[Array]) -> list[list[str]]:
        """Words of each motion (T, 36), mm."""
        return [decode(self.grammar, rows) for rows in self.posteriors(motions)]


def learn_judge(examples: Sequence[Example], rate_hz: float, *, seed: int = 0, epochs: int = EPOCHS) -> Judge:
    """Train a judge on captured sentences, or take it from the cache.

    Parameters
    ----------
    examples : sequence of Example
        Every one needs words.
    rate_hz : float
        Frames a second, of every motion to be judged as well.
    """
    if find_spec("jax") is None or find_spec("optax") is None:
        raise SystemExit("error: the judge needs JAX and optax, which are not there: pip install --group judge")
    grammar = make_grammar(examples, rate_hz)
    together = np.concatenate([example.motion for example in examples])
    mean, spread = together.mean(axis=0), together.std(axis=0) + 1e-3
    motions = [((example.motion - mean) / spread).astype(np.float32) for example in examples]
    frames = [frame_labels(example, grammar.labels, rate_hz) for example in examples]
    path = _cache_path(motions, frames, seed, epochs)
    if path.is_file():
        with np.load(path) as kept:
            return Judge(mean, spread, dict(kept), grammar, rate_hz)
    weights = _train(motions, frames, len(grammar.labels), seed, epochs)
    path.parent.mkdir(parents=True, exist_ok=True)
    half = path.with_suffix(f".{os.getpid()}")
    with half.open("wb") as file:
        np.savez(file, **weights)
    half.replace(path)
    return Judge(mean, spread, weights, grammar, rate_hz)


def frame_labels(example: Example, labels: Sequence[str], rate_hz: float) -> Array:
    """(T,) which label sounds in each frame."""
    number = {label: index for index, label in enumerate(labels)}
    found = np.full(len(example.motion), number[SILENCE])
    times = np.arange(len(found)) / rate_hz
    for phone in example.phones.phones:
        if not phone.is_silence:
            found[(times >= phone.start_s) & (times < phone.end_s)] = number[phone.label]
    return found


def _cache_path(motions: list[Array], frames: list[Array], seed: int, epochs: int) -> Path:
    digest = hashlib.sha256(Path(__file__).read_bytes())
    digest.update(f"{seed} {epochs}".encode())
    for motion, labels in zip(motions, frames, strict=True):
        digest.update(np.ascontiguousarray(motion).tobytes() + labels.tobytes())
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "fapengine" / f"judge-{digest.hexdigest()[:24]}.npz"


# ---------------------------------------------------------------- grammar and decoding


def make_grammar(examples: Sequence[Example], rate_hz: float) -> Grammar:
    """Collect words by place, their commonest pronunciations, and durations."""
    said: dict[str, Counter[tuple[str, ...]]] = defaultdict(Counter)
    frames: dict[str, list[float]] = defaultdict(list)
    places: list[dict[str, None]] = []
    ends: set[int] = set()
    for example in examples:
        spoken = [phone for phone in example.phones.phones if not phone.is_silence]
        for phone in example.phones.phones:
            frames[SILENCE if phone.is_silence else phone.label].append((phone.end_s - phone.start_s) * rate_hz)
        ends.add(len(example.words) - 1)
        for place, word in enumerate(example.words):
            inside = tuple(p.label for p in spoken if word.start_s <= (p.start_s + p.end_s) / 2 <= word.end_s)
            if inside:
                said[word.text][inside] += 1
            while len(places) <= place:
                places.append({})
            places[place][word.text] = None
    labels = tuple(sorted(frames))
    counts = np.array([sum(frames[label]) for label in labels])
    build = _Builder(labels, {label: max(1.2, float(np.mean(frames[label]))) for label in labels})
    lead = build.add(SILENCE, -1, "")
    first, last, exits = [lead], [], [lead]
    for place, words in enumerate(places):
        entries, leaves = [], []
        for word in sorted(words):
            if not said[word]:
                continue
            states = [build.add(label, place, word) for label in said[word].most_common(1)[0][0]]
            for one, other in pairwise(states):
                build.join(one, other)
            entries.append(states[0])
            leaves.append(states[-1])
        for entry in entries:
            for leave in exits:
                build.join(leave, entry)
        first += entries if place == 0 else []
        pause = build.add(SILENCE, -1, "")
        for leave in leaves:
            build.join(leave, pause, PAUSE_LOG if place + 1 < len(places) else 0.0)
        exits = [*leaves, pause]
        last += exits if place in ends else []
    return build.grammar(first, last, np.log((counts + 1) / (counts + 1).sum()))


class _Builder:
    """Collects states and transitions. Stateful."""

    def __init__(self, labels: tuple[str, ...], frames: dict[str, float]) -> None:
        self.labels, self.frames = labels, frames
        self.states: list[tuple[int, int, str]] = []
        self.entered: list[list[tuple[int, float]]] = []

    def add(self, label: str, place: int, word: str) -> int:
        self.states.append((self.labels.index(label), place, word))
        self.entered.append([(len(self.states) - 1, float(np.log(1 - 1 / self.frames[label])))])
        return len(self.states) - 1

    def join(self, one: int, other: int, weight: float = 0.0) -> None:
        stay = self.frames[self.labels[self.states[one][0]]]
        self.entered[other].append((one, float(np.log(1 / stay)) + weight))

    def grammar(self, first: list[int], last: list[int], prior: Array) -> Grammar:
        size = max(map(len, self.entered))
        before = np.repeat(np.arange(len(self.states))[:, None], size, axis=1)
        cost = np.full(before.shape, -np.inf)
        for state, ways in enumerate(self.entered):
            for column, (other, weight) in enumerate(ways):
                before[state, column], cost[state, column] = other, weight
        phone, place, words = zip(*self.states, strict=True)
        return Grammar(
            self.labels, np.array(phone), np.array(place), words, before, cost, np.array(first), np.array(last), prior
        )


def decode(grammar: Grammar, posteriors: Array) -> list[str]:
    """Find the likeliest sentence for (T, labels) log posteriors."""
    shown = POSTERIOR_POWER * (posteriors - PRIOR_POWER * grammar.prior)[:, grammar.phone]
    score = np.full(len(grammar.phone), -np.inf)
    score[grammar.first] = shown[0, grammar.first]
    rows = np.arange(len(score))
    came = np.zeros((len(shown), len(score)), dtype=np.intp)
    for time in range(1, len(shown)):
        ways = score[grammar.before] + grammar.cost
        best = ways.argmax(axis=1)
        came[time] = grammar.before[rows, best]
        score = ways[rows, best] + shown[time]
    state = grammar.last[score[grammar.last].argmax()]
    words: dict[int, str] = {}
    for time in range(len(shown) - 1, -1, -1):
        if grammar.place[state] >= 0:
            words[int(grammar.place[state])] = grammar.words[state]
        state = came[time, state]
    return [words[place] for place in sorted(words)]


# ---------------------------------------------------------------- the network


def _padded(motions: Sequence[Array]) -> tuple[Array, Array]:
    """(B, T, D) with the last frame repeated, and (B, T) which frames are real."""
    length = max(map(len, motions))
    rows = [np.pad(motion, ((0, length - len(motion)), (0, 0)), mode="edge") for motion in motions]
    real = np.arange(length) < np.array([len(motion) for motion in motions])[:, None]
    return np.stack(rows).astype(np.float32), real


def _convolve(x: Any, kernel: Any, dilation: int = 1) -> Any:
    import jax

    return jax.lax.conv_general_dilated(
        x, kernel, (1,), "SAME", rhs_dilation=(dilation,), dimension_numbers=("NWC", "WIO", "NWC")
    )


def _network(weights: Weights, x: Any, key: Any = None) -> Any:
    """(B, T, labels) logits of (B, T, D) standardised motion; with a key, channels are dropped."""
    import jax
    import jax.numpy as jnp

    speed = jnp.pad(x[:, 2:] - x[:, :-2], ((0, 0), (1, 1), (0, 0)))
    state = _convolve(jnp.concatenate([x, speed], axis=-1), weights["in"]) + weights["in bias"]
    for index, dilation in enumerate(BLOCKS):
        heard = jax.nn.relu(state)
        if key is not None:
            key, mine = jax.random.split(key)
            kept = jax.random.bernoulli(mine, 1 - DROPOUT, (heard.shape[0], 1, heard.shape[2]))
            heard = heard * kept / (1 - DROPOUT)
        inner = jax.nn.relu(_convolve(heard, weights[f"wide {index}"], dilation) + weights[f"wide bias {index}"])
        state = state + _convolve(inner, weights[f"next {index}"]) + weights[f"next bias {index}"]
    return _convolve(jax.nn.relu(state), weights["out"]) + weights["out bias"]


def _posteriors(weights: Weights, x: Array) -> Array:
    import jax

    return np.asarray(jax.jit(lambda w, m: jax.nn.log_softmax(_network(w, m)))(weights, x))


def _first_weights(key: Any, inputs: int, labels: int) -> Weights:
    import jax
    import jax.numpy as jnp

    shapes = {"in": (FIRST, 2 * inputs, CHANNELS), "out": (1, CHANNELS, labels)}
    for index in range(len(BLOCKS)):
        shapes[f"wide {index}"] = shapes[f"next {index}"] = (WIDTH, CHANNELS, CHANNELS)
    small = {"out": 0.3, **{f"next {index}": 0.2 for index in range(len(BLOCKS))}}
    weights = {}
    for mine, (name, shape) in zip(jax.random.split(key, len(shapes)), shapes.items(), strict=True):
        size = np.sqrt(2 / (shape[0] * shape[1])) * small.get(name, 1.0)
        weights[name] = size * jax.random.normal(mine, shape)
        kind, *number = name.split(" ")
        weights[" ".join([kind, "bias", *number])] = jnp.zeros(shape[-1])
    return weights


def _vary(x: Any, key: Any) -> Any:
    import jax

    size, each, shift, noise = jax.random.split(key, 4)
    count, coordinates = x.shape[0], x.shape[2]
    x = x * (1 + GAIN * jax.random.normal(size, (count, 1, 1)))
    x = x * (1 + POINT_GAIN * jax.random.normal(each, (count, 1, coordinates)))
    x = x + SHIFT * jax.random.normal(shift, (count, 1, coordinates))
    return x + NOISE * jax.random.normal(noise, x.shape)


def _train(motions: list[Array], frames: list[Array], labels: int, seed: int, epochs: int) -> Weights:
    import jax
    import jax.numpy as jnp
    import optax

    x, real = _padded(motions)
    y = np.stack([np.pad(row, (0, x.shape[1] - len(row))) for row in frames])
    batches = max(1, len(x) // BATCH)
    schedule = optax.warmup_cosine_decay_schedule(0.0, RATE, min(100, epochs * batches // 4), epochs * batches)
    optimizer = optax.adamw(schedule, weight_decay=DECAY)

    def loss(weights: Weights, x: Any, y: Any, real: Any, key: Any) -> Any:
        one, other = jax.random.split(key)
        wanted = optax.smooth_labels(jax.nn.one_hot(y, labels), SMOOTHING)
        each = optax.softmax_cross_entropy(_network(weights, _vary(x, one), other), wanted)
        return (each * real).sum() / real.sum()

    @jax.jit
    def step(weights: Weights, state: Any, x: Any, y: Any, real: Any, key: Any) -> tuple[Weights, Any, Any]:
        value, slope = jax.value_and_grad(loss)(weights, x, y, real, key)
        change, state = optimizer.update(slope, state, weights)
        return optax.apply_updates(weights, change), state, value

    key, order = jax.random.PRNGKey(seed), np.random.default_rng(seed)
    key, mine = jax.random.split(key)
    weights = _first_weights(mine, x.shape[-1], labels)
    state = optimizer.init(weights)
    for epoch in range(epochs):
        losses = []
        shuffled = order.permutation(len(x))
        for at in range(batches):
            rows = shuffled[at * BATCH : (at + 1) * BATCH]
            key, mine = jax.random.split(key)
            weights, state, value = step(weights, state, x[rows], y[rows], jnp.asarray(real[rows]), mine)
            losses.append(value)
        if (epoch + 1) % 10 == 0 and sys.stderr.isatty():
            print(f"judge: epoch {epoch + 1} of {epochs}, loss {np.mean(losses):.3f}", file=sys.stderr)
    return {name: np.asarray(value) for name, value in weights.items()}
