"""The network of the small recognizer: its input (mel bands), layers and weights, run on a stream.

Theory of operation
-------------------
A frame is 25 ms of audio around the middle of its 10 ms: natural logarithms of the energies of 40 triangular bands,
evenly spaced in mel (Davis and Mermelstein 1980, doi:10.1109/TASSP.1980.1163420). Voices and microphones differ by a
spectrum that hardly changes, so the mean of the loud frames so far is subtracted. It begins as the mean of average
speech (also learned), as loud as the loudest frame so far, and forgets frames older than about 1 s of loud audio. So
loudness does not count, and the first word is recognized as well as the tenth.

Frames come in pairs, so the network steps 50 times a second. A first layer sees three pairs; eight layers follow, each
of which adds to its input a function of it at three moments (:data:`OFFSETS`) through two small matrices, a dilated
convolution (van den Oord et al. 2016, "WaveNet"; residual layers: He et al. 2016, doi:10.1109/CVPR.2016.90). The input
of each is normalised to unit power (Zhang and Sennrich 2019, "Root mean square layer normalization"). The last layer
gives a score for each label and each of the two frames. Together they look :data:`AHEAD` steps ahead and a second and
more back. ``bench/recognizer_train.py`` learned the weights.

It always runs one step at a time, so that rounding does not depend on how the audio is cut.
"""

import io
import json
from collections import deque
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, any_error_as
from fapengine.recognition.loudness import HOP
from fapengine.recognition.protocol import RATE_HZ

BANDS = 40
WIDTH = BANDS + 1
"""Numbers of a frame: the bands, and its loudness below the loudest."""
WINDOW = 400
"""Samples of a frame, 25 ms."""
BEFORE = (WINDOW - HOP) // 2
"""Samples of a frame before its own 10 ms, and after them."""
_FFT = 512
_EDGES_HZ = (60.0, 7600.0)
FLOOR = 1e-7
"""Energy of a band that is added to each: that of the smallest steps of 16 bits, and a little."""
QUIETEST = -9.5
"""Least loudness, natural logarithm, of what counts as loudest: about -50 dB below full scale."""
FALL = 0.0023
"""Fall of the loudest within a frame: 1 dB in a second."""
LOUD = 4.6
"""Distance to the loudest, 20 dB, within which frames count for the mean."""
FIRST_COUNT, MAX_COUNT = 50.0, 100.0
"""Frames that the first mean counts for, and loud frames after which old ones are forgotten. The shipped weights were
learned with 300; with fewer, speech is recognized sooner after music, and not worse otherwise."""
SCALE, LIMIT = 0.5, 4.0


def _filters() -> NDArray[np.float32]:
    mel = 2595.0 * np.log10(1.0 + np.array(_EDGES_HZ) / 700.0)
    edges_hz = 700.0 * (10.0 ** (np.linspace(mel[0], mel[1], BANDS + 2) / 2595.0) - 1.0)
    bins_hz = np.arange(_FFT // 2 + 1) * RATE_HZ / _FFT
    rise = (bins_hz[:, None] - edges_hz[:-2]) / (edges_hz[1:-1] - edges_hz[:-2])
    fall = (edges_hz[2:] - bins_hz[:, None]) / (edges_hz[2:] - edges_hz[1:-1])
    return np.maximum(np.minimum(rise, fall), 0.0).astype(np.float32)


_FILTERS = _filters()
_WINDOW = np.hanning(WINDOW + 1)[:WINDOW]


def log_mel(frames: NDArray[np.int16]) -> NDArray[np.float32]:
    """Logarithms of the bands' energies.

    Parameters
    ----------
    frames : (T, 400) int16
        Samples around each frame.

    Returns
    -------
    (T, 40) float32

    Examples
    --------
    >>> [round(float(value), 1) for value in log_mel(np.zeros((2, WINDOW), np.int16))[0, :3]]
    [-16.1, -16.1, -16.1]
    """
    spectrum = np.fft.rfft(frames * (_WINDOW / 2**15), n=_FFT, axis=1)
    power = (spectrum.real**2 + spectrum.imag**2).astype(np.float32)
    logarithms: NDArray[np.float32] = np.log(power @ _FILTERS + np.float32(FLOOR))
    return logarithms


@dataclass(slots=True, eq=False)
class RunningMean:
    """Subtracts the running mean, from one stream or from several at once. Stateful."""

    first_mean: NDArray[np.float32]
    """Bands of average speech, relative to the loudest frame, (40,)."""
    _peak: NDArray[np.float32] = field(default_factory=lambda: np.full(1, QUIETEST, np.float32))
    _sum: NDArray[np.float32] = field(default_factory=lambda: np.zeros(BANDS, np.float32))
    _count: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))

    def push(self, frame: NDArray[np.float32]) -> NDArray[np.float32]:
        """Turn a frame, (..., 40) float32, into (..., 41) float32."""
        level = np.log(np.add.reduce(np.exp(frame), axis=-1, keepdims=True) / BANDS)
        self._peak = np.maximum(np.maximum(self._peak - FALL, level), QUIETEST)
        loud = (level > self._peak - LOUD).astype(np.float32)
        keep = 1.0 - loud / MAX_COUNT * (self._count >= MAX_COUNT)
        self._sum = self._sum * keep + loud * frame
        self._count = self._count * keep + loud
        mean = ((self.first_mean + self._peak) * FIRST_COUNT + self._sum) / (FIRST_COUNT + self._count)
        seen: NDArray[np.float32] = np.concatenate([frame - mean, level - self._peak + LOUD], axis=-1)
        seen *= SCALE
        return np.minimum(np.maximum(seen, -LIMIT, out=seen), LIMIT, out=seen)


PAIR = 2 * WIDTH
"""Numbers of a step."""
FRONT = (-1, 0, 1)
"""Steps that the first layer looks at."""
OFFSETS = ((-1, 0, 1), (-2, 0, 1), (-4, 0, 1), (-8, -4, 0), (-2, -1, 0), (-16, -8, 0), (-4, -2, 0), (-2, -1, 0))
"""Steps that each further layer looks at."""
AHEAD = FRONT[-1] + sum(max(steps) for steps in OFFSETS)
"""Steps after a step that its scores need."""
STEPS = 1
"""Steps that are run at a time."""
WEIGHTS = Path(__file__).with_name("small_recognizer.npz")

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """The learned weights."""

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
    """Fraction of each label in the training data, (C,)."""
    pairs: Floats
    """Counts of a label after another, (C, C)."""
    other: Floats
    """Log likelihood ratio of a label where PocketSphinx finds another, (found, C), for
    :class:`.small_recognizer.JointRecognizer`."""
    about: dict[str, Any]
    """Origin of the weights."""


def read_weights(data: bytes) -> Weights:
    """Read weights.

    Parameters
    ----------
    data : bytes
        What ``bench/recognizer_train.py`` wrote.
    """
    with any_error_as(DataError, "recognizer: its weights cannot be read"):
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        about = json.loads(str(arrays.pop("about")))
        labels = tuple(str(label) for label in about["labels"])
    classes = len(labels)
    channels = len(arrays["front.bias"]) if arrays.get("front.bias", np.zeros(())).ndim == 1 else 0

    def take(name: str, *shape: int) -> Floats:
        array = arrays.get(name)
        if array is None or array.shape != shape or array.dtype.kind not in "fu":
            got = "nothing" if array is None else f"{array.dtype} {array.shape}"
            raise DataError(f"recognizer: its weights are damaged: got {got} for {name}, expected numbers {shape}")
        floats: Floats = array.astype(np.float32)
        if not np.isfinite(floats).all():
            raise DataError(f"recognizer: its weights are damaged: {name} is not finite")
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
        raise DataError(f"recognizer: its weights cannot be read ({error.strerror})", where=str(WEIGHTS)) from error
    return read_weights(data)


def _normed(x: Floats) -> Floats:
    power = np.add.reduce(x * x) / np.float32(len(x))  # rounds as x.mean() does, in a third of its time
    normed: Floats = x / np.sqrt(power + np.float32(1e-5))
    return normed


class _Layer:
    """The last inputs of a layer. Stateful."""

    def __init__(self, steps: tuple[int, ...], width: int) -> None:
        length = max(*steps, 0) - min(steps) + 1
        self._kept = deque([np.zeros(width, np.float32)] * length, length)
        self._places = [step - min(steps) for step in steps]

    def push(self, x: Floats) -> Floats:
        """Add a step, (width,); return the inputs of the one that is due, (n * width,)."""
        kept = self._kept
        kept.append(x)
        return np.concatenate([kept[place] for place in self._places])


class SmallNet:
    """The network on a stream. Stateful."""

    def __init__(self, weights: Weights) -> None:
        self._weights = weights
        channels = len(weights.front[1])
        self._front = _Layer(FRONT, PAIR)
        self._layers = [_Layer(steps, channels) for steps in OFFSETS]
        self._late = [deque([np.zeros(channels, np.float32)] * (max(steps) + 1), max(steps) + 1) for steps in OFFSETS]
        """What each layer adds to: its last inputs, the one that is due first."""
        self._now = -FRONT[-1]
        """Number of the step that the first layer gives next."""

    def push(self, seen: Floats) -> Floats:
        """Process a step, (2, 41); return the scores of the two frames :data:`AHEAD` steps before, (2, C).

        Scores of frames before the first mean nothing.
        """
        w = self._weights
        x = _added(self._front.push(seen.reshape(PAIR)), w.front)
        np.maximum(x, 0.0, out=x)
        now = self._now
        self._now += 1
        if now < 0:
            x[:] = 0.0
        for layer, late, steps, mix, out in zip(self._layers, self._late, OFFSETS, w.mix, w.out, strict=True):
            late.append(x)
            near = _added(layer.push(_normed(x)), mix)
            x = _added(np.maximum(near, 0.0, out=near), out)
            x += late[0]
            now -= max(steps)
            if now < 0:
                x[:] = 0.0
        return _added(_normed(x), w.head).reshape(2, -1)


def _added(x: Floats, matrix: tuple[Floats, Floats]) -> Floats:
    found: Floats = x @ matrix[0]
    found += matrix[1]
    return found
