"""A smooth synthetic talking face, by the description of the measurements: syllables, blinks, saccades, drift."""

import numpy as np

from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

JAW, LIPS, LIDS, EYES, BROWS, HEAD = (3,), range(4, 14), (19, 20), range(23, 27), range(31, 39), range(48, 51)


def talking_face(frames: int, *, seed: int = 777, rate_hz: float = 25.0) -> FapTrack:
    """Make low-passed syllables, blinks, saccades, slow head and brows; outer lips follow inner ones."""
    rng = np.random.default_rng(seed)
    fine = 200.0
    count = int(frames / rate_hz * fine) + 1
    kernel = np.exp(-0.5 * (np.arange(-20, 21) / (0.03 * fine)) ** 2)
    kernel /= kernel.sum()
    values = np.zeros((count, 68))

    def syllables(low: float, high: float) -> np.ndarray:
        out, at = np.zeros(count), 0
        while at < count:
            length = int(rng.uniform(0.07, 0.22) * fine)
            out[at : at + length] = rng.uniform(low, high)
            at += length
        return np.convolve(out, kernel, "same")

    def drift(size: float, seconds: float) -> np.ndarray:
        knots = rng.normal(0, size, int(count / fine / seconds) + 3)
        return np.interp(np.arange(count) / fine / seconds, np.arange(len(knots)), knots)

    jaw = syllables(0, 500)
    values[:, fap.column(3)] = jaw
    for number in LIPS:
        values[:, fap.column(number)] = syllables(-120, 120) - 0.15 * jaw
        values[:, fap.column(number + 47)] = 0.9 * values[:, fap.column(number)]
    blink = np.zeros(count)
    for start in np.cumsum(rng.uniform(2, 5, int(count / fine / 2) + 2)):
        first = int(start * fine)
        blink[first : first + int(0.2 * fine)] = np.hanning(int(0.2 * fine))[: max(0, count - first)]
    for number in LIDS:
        values[:, fap.column(number)] = 1024 * blink
    for numbers in ((23, 24), (25, 26)):
        at = 0
        while at < count:
            length = int(rng.uniform(0.3, 2.0) * fine)
            values[at : at + length, [fap.column(n) for n in numbers]] = rng.normal(0, 6000)
            at += length
    for number in BROWS:
        values[:, fap.column(number)] = drift(60, 1.2)
    for number in HEAD:
        values[:, fap.column(number)] = np.convolve(drift(4000, 0.8), np.ones(40) / 40, "same")
    for number in (14, 15, 16, 17, 18, 39, 40, 41, 42, 43, 44, 45, 46, 61, 62, 63, 64):
        values[:, fap.column(number)] = syllables(-40, 40)
    at_frames = (np.arange(frames) / rate_hz * fine).astype(int)
    return FapTrack.from_values(np.round(values[at_frames]).astype(np.int64), rate_hz=rate_hz)
