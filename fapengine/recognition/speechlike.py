"""Speech in the output of a phone loop: the loop finds phones in music, too.

Theory of operation
-------------------
The model's own noise estimate removes steady noise. What is left is speech and tones. The pitch
of a voice is never still: within 50 ms it moves by half a percent and more, where that of an instrument's note stays.
So a moment is music if, within :data:`REACH_S`, most frames that have a pitch keep it (:data:`STEADY_FRAMES`,
:data:`STEADY_SHARE`). Singing with vibrato is speech, and so is a whisper, which has no pitch.

There is no speech without vowels: what has none of :data:`VOWEL_FRAMES` around it is noise. So are phones that last
longer than any speaker holds them (:data:`MAX_PHONE_S`), and what is hardly there (:data:`QUIET_DB`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.recognition.loudness import FRAME_HZ, SILENT_DB
from fapengine.recognition.sphinx import MODEL_PHONES, VOWELS, Frames

REACH_S = 1.0
"""Time on both sides of a moment that decides about it."""
GLIDE_FRAMES = 5
"""Frames of 10 ms over which a glide is measured."""
STILL = 0.004
"""Largest change of pitch, natural logarithm, that counts as none."""
STEADY_FRAMES = 8
"""Least number of steady frames that make a moment music."""
STEADY_SHARE = 0.5
"""Least fraction of them among the frames that have a pitch: plucked notes had .56 and more."""
VOWEL_FRAMES = 4
"""Least number of frames in vowels around a moment of speech."""
VOICED_FRAMES = 5
"""Least number of frames that have a pitch around a moment of speech that is not whispered."""
MAX_PHONE_S = {True: 1.5, False: 0.6}
"""Longest vowel, and longest consonant."""
QUIET_DB = -62.0
"""Loudness, dB below full scale, under which nothing is speech: the noise of a microphone that is switched on."""


def steady(pitch_hz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,): frames whose pitch is that of :data:`GLIDE_FRAMES` before.

    Examples
    --------
    >>> int(steady(np.full(20, 200.0)).sum()), int(steady(200.0 * 1.002 ** np.arange(20)).sum())
    (15, 0)
    """
    still = np.zeros(len(pitch_hz), dtype=bool)
    before, now = pitch_hz[:-GLIDE_FRAMES], pitch_hz[GLIDE_FRAMES:]
    voiced = (before > 0) & (now > 0)
    change = np.full(len(voiced), np.inf)
    change[voiced] = np.abs(np.log(now[voiced] / before[voiced]))
    still[GLIDE_FRAMES:] = change < STILL
    return still


def spoken_frames(
    segments: Sequence[Frames], pitch_hz: NDArray[np.float64], loudness_db: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(T,): frames of a hypothesis that are speech.

    Parameters
    ----------
    segments : sequence of Frames
        Phones of the loop.
    pitch_hz, loudness_db : (T,)
        Of the same frames.
    """
    count = len(pitch_hz)
    vowels, sounds = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for name, start, end in segments:
        if name not in MODEL_PHONES or end - start > MAX_PHONE_S[name in VOWELS] * FRAME_HZ:
            continue
        if loudness_db[start:end].max(initial=SILENT_DB) < QUIET_DB:
            continue
        sounds[start:end] = True
        vowels[start:end] = name in VOWELS
    music = musical_frames(pitch_hz)
    return sounds & ~music & (_around(vowels & ~music) >= VOWEL_FRAMES)


def voiced_frames(pitch_hz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,): frames near which there is a voice, music too: :data:`VOICED_FRAMES` and more have a pitch."""
    return _around(pitch_hz > 0) >= VOICED_FRAMES


def musical_frames(pitch_hz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,): frames near which most that have a pitch keep it.

    Examples
    --------
    >>> int(musical_frames(np.full(50, 200.0)).sum()), int(musical_frames(200.0 * 1.002 ** np.arange(50)).sum())
    (50, 0)
    """
    voiced = _around(pitch_hz > 0)
    still = _around(steady(pitch_hz))
    return (still >= STEADY_FRAMES) & (still >= STEADY_SHARE * voiced)


def _around(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(T,): how many frames are marked within :data:`REACH_S`."""
    total = np.concatenate([[0], np.cumsum(marked)])
    at = np.arange(len(marked))
    first = np.maximum(at - round(REACH_S * FRAME_HZ), 0)
    last = np.minimum(at + round(REACH_S * FRAME_HZ) + 1, len(marked))
    counted: NDArray[np.int64] = total[last] - total[first]
    return counted
