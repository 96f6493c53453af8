"""What the small ear sees of sound: the spectrum in 40 mel bands, 100 times a second, against its running mean.

Theory of operation
-------------------
A frame is 25 ms of sound around the middle of its 10 ms. Energies of triangular bands, evenly spaced in mel (Davis and
Mermelstein 1980, doi:10.1109/TASSP.1980.1163420), are taken as natural logarithms. Voices and microphones differ by a
spectrum that hardly changes, so the mean of the loud frames so far is taken away; it begins as that of average speech
(learned, too), as loud as the loudest frame so far, and forgets what is older than about 1 s of loud sound.
So loudness does not count, and the first word is heard as well as the tenth.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine.ears.loudness import HOP
from fapengine.ears.protocol import RATE_HZ

BANDS = 40
WIDTH = BANDS + 1
"""Numbers of a frame: the bands, and its loudness below the loudest."""
WINDOW = 400
"""Samples of a frame, 25 ms."""
BEFORE = (WINDOW - HOP) // 2
"""Samples of a frame before its own 10 ms, and behind them."""
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
learned with 300; with fewer, speech is heard sooner after music, and not worse otherwise."""
SCALE, LIMIT = 0.5, 4.0


def _filters() -> NDArray[np.float32]:
    mel = 2595.0 * np.log10(1.0 + np.array(_EDGES_HZ) / 700.0)
    edges_hz = 700.0 * (10.0 ** (np.linspace(mel[0], mel[1], BANDS + 2) / 2595.0) - 1.0)
    bins_hz = np.arange(_FFT // 2 + 1) * RATE_HZ / _FFT
    rise = (bins_hz[:, None] - edges_hz[:-2]) / (edges_hz[1:-1] - edges_hz[:-2])
    fall = (edges_hz[2:] - bins_hz[:, None]) / (edges_hz[2:] - edges_hz[1:-1])
    found: NDArray[np.float32] = np.maximum(np.minimum(rise, fall), 0.0).astype(np.float32)
    return found


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
    logs: NDArray[np.float32] = np.log(power @ _FILTERS + np.float32(FLOOR))
    return logs


def windows(samples: NDArray[np.int16]) -> NDArray[np.int16]:
    """Frames of a whole sound, (N,) int16: (N // 160, 400), with silence before and behind it."""
    count = len(samples) // HOP
    padded = np.zeros(count * HOP + 2 * BEFORE, np.int16)
    padded[BEFORE : BEFORE + count * HOP] = samples[: count * HOP]
    found: NDArray[np.int16] = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)[::HOP]
    return found


@dataclass(slots=True, eq=False)
class RunningMean:
    """Takes the running mean away, of one sound or of several at once. Stateful.

    Parameters
    ----------
    first_mean : (40,)
        Bands of average speech, against the loudest frame.
    shape : tuple of int
        Shape of what comes at each frame without its last axis; () for one sound.
    """

    first_mean: NDArray[np.float32]
    """Bands of average speech."""
    shape: tuple[int, ...] = ()
    """Shape of a frame without its bands."""
    _peak: NDArray[np.float32] = field(init=False)
    _sum: NDArray[np.float32] = field(init=False)
    _count: NDArray[np.float32] = field(init=False)

    def __post_init__(self) -> None:
        self._peak = np.full((*self.shape, 1), QUIETEST, np.float32)
        self._sum = np.zeros((*self.shape, BANDS), np.float32)
        self._count = np.zeros((*self.shape, 1), np.float32)

    def push(self, frame: NDArray[np.float32]) -> NDArray[np.float32]:
        """Turn a frame, (..., 40) float32, into (..., 41) float32."""
        level = np.log(np.exp(frame).mean(axis=-1, keepdims=True))
        self._peak = np.maximum(np.maximum(self._peak - np.float32(FALL), level), np.float32(QUIETEST))
        loud = (level > self._peak - np.float32(LOUD)).astype(np.float32)
        keep = np.where(self._count >= MAX_COUNT, np.float32(1.0) - loud / np.float32(MAX_COUNT), np.float32(1.0))
        self._sum = self._sum * keep + loud * frame
        self._count = self._count * keep + loud
        first = (self.first_mean + self._peak) * np.float32(FIRST_COUNT)
        mean = (first + self._sum) / (np.float32(FIRST_COUNT) + self._count)
        seen = np.concatenate([(frame - mean), level - self._peak + np.float32(LOUD)], axis=-1) * np.float32(SCALE)
        found: NDArray[np.float32] = np.clip(seen, -np.float32(LIMIT), np.float32(LIMIT))
        return found
