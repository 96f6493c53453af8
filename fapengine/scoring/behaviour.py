"""What needs no truth: how a head moves, how eyes blink, and whether lips grow with loudness."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.scoring.contacts import runs
from fapengine.scoring.likeness import correlation
from fapengine.scoring.mouth import Mouth
from fapengine.scoring.timing import GRID_HZ, grid

Array = NDArray[np.float64]

BLINK_SHUT, MAX_BLINK_S = 0.5, 0.6
"""An eye is shut from half its opening on; longer than that it sleeps (blinks last 0.1 to 0.4 s; Schiffman, "Sensation
and Perception", 2001, cited from memory)."""
WINDOW_S, HOP_S, MIN_WINDOWS = 1.0, 0.5, 6
"""Windows in which loudness and motion are compared, and how few of them say nothing."""
LEVEL_FLOOR_DB = -50.0
"""Sound further below its loudest moment is a pause."""


@dataclass(frozen=True, slots=True)
class Behaviour:
    """Head and eyes of one recording."""

    head_deg: tuple[float, float, float]
    """Standard deviations of pitch, yaw and roll."""
    head_deg_s: float
    """Mean speed of its turning."""
    blinks: int
    """Times that both eyes shut, and opened again within 0.6 s."""
    blinks_per_minute: float
    blink_ms: float | None
    """Mean time for which eyes are more than half shut; None without a blink."""


@dataclass(frozen=True, slots=True)
class Intensity:
    """Lips and loudness."""

    slcc: float | None
    """Speech-lip intensity correlation; None for a recording too short or without change."""
    windows: int
    """Windows it rests on."""
    opening_r: float | None
    """Correlation of the level in dB with the opening, moment by moment, pauses left out."""


def behaviour_of(mouth: Mouth) -> Behaviour:
    """Look at head and eyes."""
    length_s = mouth.end_s - float(mouth.times_s[0])
    blinks = [span for span in runs(mouth.shut.min(axis=1) > BLINK_SHUT, mouth.times_s) if _is_blink(span, mouth)]
    frame_s = length_s / (len(mouth.times_s) - 1)
    turned = np.linalg.norm(np.diff(mouth.head_rad, axis=0), axis=1).sum()
    pitch, yaw, roll = np.rad2deg(mouth.head_rad.std(axis=0)).tolist()
    return Behaviour(
        head_deg=(pitch, yaw, roll),
        head_deg_s=float(np.rad2deg(turned) / length_s),
        blinks=len(blinks),
        blinks_per_minute=60 * len(blinks) / length_s,
        blink_ms=float(1000 * np.mean([end - start + frame_s for start, end in blinks])) if blinks else None,
    )


def _is_blink(span: tuple[float, float], mouth: Mouth) -> bool:
    return span[1] - span[0] <= MAX_BLINK_S and span[0] > mouth.times_s[0] and span[1] < mouth.end_s


def intensity_of(mouth: Mouth, power: Array) -> Intensity:
    """Compare lips and loudness.

    Parameters
    ----------
    mouth : Mouth
    power : (N,) float64
        Mean square of the sound in each 10 ms, of any scale.

    Notes
    -----
    SLCC (Chae-Yeon et al., arXiv:2503.20308) is Pearson's r, over the clips of a corpus, of the sound's root mean
    square and the lips' (root mean square over frames of the mean motion of the lip points). Here windows of one second
    of one recording stand for the clips.
    """
    times_s = grid(min(mouth.end_s, (len(power) - 1) / GRID_HZ))
    seen, power = mouth.at(times_s), power[: len(times_s)]
    motion = np.linalg.norm(np.diff(seen.lips_mm, axis=0, prepend=seen.lips_mm[:1]), axis=-1).mean(axis=1)
    width, hop = int(WINDOW_S * GRID_HZ), int(HOP_S * GRID_HZ)
    starts = range(0, len(times_s) - width + 1, hop)
    loud = np.array([np.sqrt(power[start : start + width].mean()) for start in starts])
    lips = np.array([np.sqrt((motion[start : start + width] ** 2).mean()) for start in starts])
    enough = len(starts) >= MIN_WINDOWS
    peak = power.max() if len(power) else 0.0
    level = 10 * np.log10(np.maximum(power, 1e-12 * max(peak, 1e-30)) / max(peak, 1e-30))
    spoken = level > LEVEL_FLOOR_DB
    return Intensity(
        slcc=correlation(loud / max(loud.max(), 1e-30), lips) if enough else None,
        windows=len(starts),
        opening_r=correlation(level[spoken], seen.opening_mm[spoken]),
    )
