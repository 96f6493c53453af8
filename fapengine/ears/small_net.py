"""The network of the small ear: what it is made of, its weights, and how it hears sound as it comes.

Theory of operation
-------------------
Frames of 10 ms (:mod:`.mel`) come in pairs, so the network steps 50 times a second. A first layer looks at three pairs;
eight layers follow, each of which adds to its input what two small matrices make of it at three moments
(:data:`OFFSETS`), a convolution with gaps (van den Oord et al. 2016, "WaveNet"; residual layers: He et al. 2016,
doi:10.1109/CVPR.2016.90). The input of each is brought to unit power first (Zhang and Sennrich 2019, "Root mean square
layer normalization"). The last layer gives a score for each label and each of the two frames. Together they look
:data:`AHEAD` steps ahead and a second and more back. ``bench/ear_train.py`` learned the weights.

It is run two steps at a time, whatever comes, so that rounding does not depend on how the sound is cut.
"""

import io
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.ears.mel import BANDS, WIDTH
from fapengine.errors import DataError

PAIR = 2 * WIDTH
"""Numbers of a step."""
FRONT = (-1, 0, 1)
"""Steps that the first layer looks at."""
OFFSETS = ((-1, 0, 1), (-2, 0, 1), (-4, 0, 1), (-8, -4, 0), (-2, -1, 0), (-16, -8, 0), (-4, -2, 0), (-2, -1, 0))
"""Steps that each further layer looks at."""
AHEAD = FRONT[-1] + sum(max(steps) for steps in OFFSETS)
"""Steps behind a step that its scores need."""
STEPS = 2
"""Steps that are run at a time."""
WEIGHTS = Path(__file__).with_name("small_ear.npz")

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """What was learned."""

    labels: tuple[str, ...]
    """Label of each class: IPA, and silence first."""
    front: tuple[Floats, Floats]
    """Matrix and offset of the first layer."""
    mix: tuple[tuple[Floats, Floats], ...]
    """Matrix and offset of each further layer, over the steps that it looks at."""
    out: tuple[tuple[Floats, Floats], ...]
    """Matrix and offset of what each further layer adds."""
    head: tuple[Floats, Floats]
    """Matrix and offset of the scores of two frames."""
    first_mean: Floats
    """Bands of average speech, (40,)."""
    shares: Floats
    """Share of each label in what was learned from, (C,)."""
    pairs: Floats
    """Counts of a label behind another, (C, C)."""
    other: Floats
    """Logarithm of how much likelier a label is where PocketSphinx hears another, (heard, C) (:mod:`.joint_ear`)."""
    about: dict[str, Any]
    """Origin of the weights."""


def read_weights(data: bytes) -> Weights:
    """Read weights.

    Parameters
    ----------
    data : bytes
        What ``bench/ear_train.py`` wrote.

    Raises
    ------
    DataError
        If it is anything else.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        about = json.loads(str(arrays.pop("about")))
        labels = tuple(str(label) for label in about["labels"])
    except Exception as error:  # zipfile, zlib, NumPy and json raise a dozen kinds that share no base
        raise DataError(f"ear: its weights cannot be read ({error})") from error
    classes = len(labels)
    channels = len(arrays["front.bias"]) if arrays.get("front.bias", np.zeros(())).ndim == 1 else 0

    def take(name: str, *shape: int) -> Floats:
        array = arrays.get(name)
        if array is None or array.shape != shape or array.dtype.kind not in "fu":
            got = "nothing" if array is None else f"{array.dtype} {array.shape}"
            raise DataError(f"ear: its weights are damaged: got {got} for {name}, expected numbers {shape}")
        floats: Floats = array.astype(np.float32)
        if not np.isfinite(floats).all():
            raise DataError(f"ear: its weights are damaged: {name} is not finite")
        return floats

    def layer(name: str, inputs: int, outputs: int) -> tuple[Floats, Floats]:
        return np.ascontiguousarray(take(f"{name}.weight", outputs, inputs).T), take(f"{name}.bias", outputs)

    return Weights(
        labels,
        layer("front", PAIR * len(FRONT), channels),
        tuple(layer(f"mix.{n}", channels * len(steps), channels) for n, steps in enumerate(OFFSETS)),
        tuple(layer(f"out.{n}", channels, channels) for n in range(len(OFFSETS))),
        layer("head", channels, 2 * classes),
        take("first_mean", BANDS),
        take("shares", classes),
        take("pairs", classes, classes),
        take("other", classes, classes),
        about,
    )


@cache
def shipped() -> Weights:
    """Read the weights of the package. Raises ``DataError`` if its file is missing or damaged."""
    try:
        data = WEIGHTS.read_bytes()
    except OSError as error:
        raise DataError(f"ear: its weights cannot be read ({error.strerror})", where=str(WEIGHTS)) from error
    return read_weights(data)


def _normed(x: Floats) -> Floats:
    found: Floats = x / np.sqrt((x * x).mean(axis=-1, keepdims=True) + np.float32(1e-5))
    return found


class _Layer:
    """The last steps that a layer needs. Stateful."""

    def __init__(self, steps: tuple[int, ...], width: int) -> None:
        self._rows = [np.arange(STEPS) + step - min(steps) for step in steps]
        self._kept = np.zeros((max(*steps, 0) - min(steps) + STEPS, width), np.float32)

    def push(self, x: Floats) -> Floats:
        """Add steps, (STEPS, width); return what lies beside those that are due, (STEPS, width * n)."""
        self._kept[:-STEPS] = self._kept[STEPS:]
        self._kept[-STEPS:] = x
        return np.concatenate([self._kept[rows] for rows in self._rows], axis=1)


class SmallNet:
    """The network as sound comes. Stateful.

    Parameters
    ----------
    weights : Weights
    """

    def __init__(self, weights: Weights) -> None:
        self._weights = weights
        channels = len(weights.front[1])
        self._front = _Layer(FRONT, PAIR)
        self._layers = [_Layer(steps, channels) for steps in OFFSETS]
        self._late = [_Layer((-max(steps),), channels) if max(steps) else None for steps in OFFSETS]
        self._now = -FRONT[-1]
        """Number of the first step that the first layer gives next."""

    def push(self, seen: Floats) -> Floats:
        """Hear :data:`STEPS` steps, (2 * STEPS, 41); return scores of so many frames :data:`AHEAD` steps before.

        Scores of frames before the first mean nothing.
        """
        w = self._weights
        x = np.maximum(self._front.push(seen.reshape(STEPS, PAIR)) @ w.front[0] + w.front[1], np.float32(0.0))
        first = self._now
        self._now += STEPS
        if first < 0:
            x[:-first] = 0.0
        for layer, late, steps, mix, out in zip(self._layers, self._late, OFFSETS, w.mix, w.out, strict=True):
            near = layer.push(_normed(x))
            if late is not None:
                x = late.push(x)
                first -= max(steps)
            x = x + (np.maximum(near @ mix[0] + mix[1], np.float32(0.0)) @ out[0] + out[1])
            if first < 0:
                x[:-first] = 0.0
        scores: Floats = (_normed(x) @ w.head[0] + w.head[1]).reshape(2 * STEPS, -1)
        return scores
