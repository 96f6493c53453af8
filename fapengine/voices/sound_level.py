"""How loud and how bright a sound is, moment by moment: what tells a closure from a vowel."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError

STEP_S = 0.001
"""Resolution of all answers."""
WINDOW_S = 0.004
"""Time over which loudness is taken; a period of a man's voice is 10 ms, but it is never silent for 4 of them."""
QUIET = 0.03
"""Level below which a closure is silent, as a share of the RMS of the whole sound."""
PAUSE = 0.1
"""Level below which a stretch is a pause; breath and room may be in it."""
BRIGHT_HZ = (900.0, 4000.0)
"""Band that a mouth lets out and a nose or a tongue does not: the second and third formants of vowels."""
BRIGHT_SHARE = 0.3
"""A vowel has begun where this share of the way from the darkest to the brightest is done."""
_BRIGHT_WINDOW_S = 0.01


class SoundLevel:
    """A sound that is asked where it is quiet, and where it gets bright; it never changes.

    Parameters
    ----------
    samples : (N,) number
        Mono, any scale.
    rate_hz : int
        Samples a second.

    Raises
    ------
    UsageError
        If the samples are no row of finite numbers or the rate is not positive.
    """

    def __init__(self, samples: ArrayLike, rate_hz: int) -> None:
        self._samples = frozen(samples, "samples", ("N",), np.float64)
        if rate_hz <= 0:
            raise UsageError(f"rate_hz: got {rate_hz}, expected a positive number")
        self._rate_hz = rate_hz

    @property
    def duration_s(self) -> float:
        """Length of the sound."""
        return len(self._samples) / self._rate_hz

    @cached_property
    def _energy(self) -> NDArray[np.float64]:
        """(N + 1,): sum of squares up to each sample."""
        return np.concatenate([[0.0], np.cumsum(np.square(self._samples))])

    @cached_property
    def _whole(self) -> float:
        """RMS of the whole sound; 1 for a silent one, so that all of it is quiet."""
        return float(np.sqrt(self._energy[-1] / max(len(self._samples), 1))) or 1.0

    def level(self, start_s: ArrayLike, end_s: ArrayLike) -> NDArray[np.float64]:
        """(...): RMS between two times, (...) each, as a share of that of the whole sound."""
        last = len(self._samples)
        first = np.clip(np.rint(np.asarray(start_s) * self._rate_hz).astype(int), 0, last)
        behind = np.clip(np.rint(np.asarray(end_s) * self._rate_hz).astype(int), 0, last)
        mean = (self._energy[behind] - self._energy[first]) / np.maximum(behind - first, 1)
        level: NDArray[np.float64] = np.sqrt(np.maximum(mean, 0.0)) / self._whole
        return level

    def quiet_until(self, at_s: float, earliest_s: float, *, slack_s: float = 0.01) -> float:
        """Where the quiet begins that ends at a time, give or take ``slack_s``; that time itself if none does."""
        times = at_s - STEP_S * np.arange(int(max(at_s - earliest_s, 0.0) / STEP_S) + 1)
        quiet = self.level(times - WINDOW_S / 2, times + WINDOW_S / 2) <= QUIET
        last = int(np.argmax(quiet))
        if not quiet[last] or times[last] < at_s - slack_s:
            return at_s
        loud = np.flatnonzero(~quiet[last:])
        return float(times[last + loud[0] - 1] if len(loud) else times[-1])

    def stays_quiet(self, start_s: float, end_s: float) -> bool:
        """Whether no moment between two times is louder than a closure."""
        times = np.arange(start_s, end_s, STEP_S)
        return bool((self.level(times, times + STEP_S) <= QUIET).all())

    def longest_quiet(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Start and end of the longest stretch that is quiet as a pause is; twice ``start_s`` if there is none."""
        edges = np.append(np.arange(start_s, end_s, STEP_S), end_s)
        quiet = np.concatenate([[False], self.level(edges[:-1], edges[1:]) <= PAUSE, [False]])
        turns = np.flatnonzero(quiet[1:] != quiet[:-1])
        if not len(turns):
            return start_s, start_s
        longest = int(np.argmax(turns[1::2] - turns[::2]))
        return float(edges[turns[2 * longest]]), float(edges[turns[2 * longest + 1]])

    def brightens(self, start_s: float, end_s: float) -> float | None:
        """Where the sound gets bright between two times, as it does where a vowel begins behind a nasal; None if not.

        Brightness is the energy between 0.9 and 4 kHz; the place is where its root first passes :data:`BRIGHT_SHARE` of
        the way from its 5th to its 90th percentile; nowhere, if it does not double or is as low as in a closure.
        """
        margin = round(_BRIGHT_WINDOW_S * self._rate_hz)
        first, last = round(start_s * self._rate_hz), round(end_s * self._rate_hz)
        piece = self._samples[max(first - margin, 0) : last + margin]
        if last - first < margin:
            return None
        spectrum = np.fft.rfft(piece * np.hanning(len(piece)) ** 0.1)
        hertz = np.fft.rfftfreq(len(piece), 1.0 / self._rate_hz)
        band = np.fft.irfft(np.where((hertz >= BRIGHT_HZ[0]) & (hertz <= BRIGHT_HZ[1]), spectrum, 0.0), len(piece))
        power = np.convolve(np.square(band), np.hanning(margin) / np.hanning(margin).sum(), mode="same")
        root = np.sqrt(power[first - max(first - margin, 0) :][: last - first])
        dark, bright = np.percentile(root, (5, 90))
        if bright < max(2.0 * dark, QUIET * self._whole):
            return None
        return float(start_s + int(np.argmax(root > dark + BRIGHT_SHARE * (bright - dark))) / self._rate_hz)
