"""Blinks, nods with raised brows and head motion of a talking face, counted as one counts them in people.

    python -m bench.life [--seeds 8] [--json]

A fable is spoken by espeak-ng and planned with everything that lives; the same face is also
left silent for ten minutes. Published figures stand beside ours in docs/trajectories.md.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import fapengine
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.gestures import ONSET_PAUSE_S, PAUSE_S
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style

Array = NDArray[np.float64]

TEXT = (
    "One morning the wind boasted to the sun that nobody on earth was as strong as he. The sun only smiled, and pointed"
    " to a man who was walking along the road below. Whoever takes his coat away, she said, shall be called the"
    " stronger one of us. So the wind blew with all his might, but the colder it grew, the more tightly the man held"
    " his coat, and at last the wind was out of breath. Then the sun came out from behind her cloud, and shone on him"
    " gently. After a while he opened one button, and then another; and when he reached the top of the hill, he took"
    " the coat off. Since that day the wind has been a little more careful, when he talks about himself."
)
"""Aesop's fable in our own words."""
RATE_HZ = 100.0
NEAR_S = 0.25
ONSET_S, END_S = 0.8, 0.4
"""Times over which the head is watched when speech begins, and when it ends before the next begins."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Figures of one seed."""

    blinks_per_min: float
    blinks_near_pauses: float
    near_pauses_by_chance: float
    nods_per_min: float
    nods_per_phrase: float
    stresses_per_nod: float
    head_deg: float
    onset_deg: float
    usual_deg: float
    end_deg: float
    usual_short_deg: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    phones = fapengine.speak(TEXT).phones
    counts = [count(phones, seed) for seed in range(options.seeds)]
    found = {name: [getattr(one, name) for one in counts] for name in Counts.__slots__}
    silence = PhoneTrack.from_phones([Phone("_", 0.0, 600.0)])
    silent = [len(blinks(lived(silence, seed))) / 10 for seed in range(3)]
    figures = {**found, "silent_blinks_per_min": silent}
    if options.json:
        print(json.dumps({name: float(np.mean(values)) for name, values in figures.items()}, indent=2))
        return
    print(f"{phones.duration_s:.1f} s, {len(phrases(phones))} phrases, {options.seeds} seeds: mean (least to greatest)")
    for name, values in figures.items():
        print(f"{name:24} {np.mean(values):6.2f} ({min(values):.2f} to {max(values):.2f})")


def count(phones: PhoneTrack, seed: int) -> Counts:
    alive = lived(phones, seed)
    spans = phrases(phones)
    spoken_s = spans[-1][1] - spans[0][0]
    at = [begin / RATE_HZ for begin in blinks(alive) if spans[0][0] <= begin / RATE_HZ <= spans[-1][1]]
    pauses = [(one[1], other[0]) for one, other in pairwise(spans)]
    near = [any(start - NEAR_S <= t <= stop + NEAR_S for start, stop in pauses) for t in at]
    brows = (alive - lived(phones, seed, "emphasis"))[:, fap.column(33)]
    nods = int((np.diff((brows > 8).astype(int)) == 1).sum())
    turns = alive[:, [fap.column(number) for number in (48, 49, 50)]] * AU_RAD
    onsets = [
        begin for before, (begin, _) in zip([(-9.0, -9.0), *spans], spans, strict=False) if begin - before[1] >= 0.4
    ]
    ends = [one[1] for one, other in pairwise([*spans, (1e9, 1e9)]) if other[0] - one[1] >= ONSET_PAUSE_S]
    within = np.arange(spans[0][0] + 1.0, spans[-1][1] - 1.5, 0.37)
    usual = [t for t in within.tolist() if all(abs(t - x) > 1.0 for x in (*onsets, *ends))]
    return Counts(
        blinks_per_min=60 * len(at) / spoken_s,
        blinks_near_pauses=float(np.mean(near)),
        near_pauses_by_chance=sum(stop - start + 2 * NEAR_S for start, stop in pauses) / spoken_s,
        nods_per_min=60 * nods / spoken_s,
        nods_per_phrase=nods / len(spans),
        stresses_per_nod=sum(phone.stress > 0 for phone in phones.phones) / max(nods, 1),
        head_deg=float(np.degrees(np.sqrt(turns.var(axis=0).sum()))),
        onset_deg=mean_moved_deg(turns, [t - 0.3 for t in onsets], ONSET_S),
        usual_deg=mean_moved_deg(turns, usual, ONSET_S),
        end_deg=mean_moved_deg(turns, ends, END_S),
        usual_short_deg=mean_moved_deg(turns, usual, END_S),
    )


def phrases(phones: PhoneTrack) -> list[tuple[float, float]]:
    spans: list[tuple[float, float]] = []
    for phone in phones.phones:
        if not phone.is_silence:
            joins = spans and phone.start_s - spans[-1][1] < PAUSE_S
            spans[-1:] = [(spans[-1][0], phone.end_s)] if joins else [*spans[-1:], (phone.start_s, phone.end_s)]
    return spans


def blinks(faps: NDArray[np.generic]) -> list[int]:
    """Frames at which lids begin to fall."""
    shut = np.asarray(faps, dtype=float)[:, fap.column(19)] > 480
    return np.flatnonzero(np.diff(shut.astype(int)) == 1).tolist()


def lived(phones: PhoneTrack, seed: int, *without: str) -> Array:
    """(T, 68) FAPU of a face that lives, but for some generators."""
    track = plan(
        phones,
        fapengine.load_profile("grid_s1_en"),
        rng=np.random.default_rng(seed),
        rate_hz=RATE_HZ,
        style=Style().without(without),
    ).track
    return track.values.astype(np.float64)


def mean_moved_deg(turns: Array, from_s: Sequence[float], over_s: float) -> float:
    """Mean angle, degrees, by which the head turns within ``over_s`` from each of these times on."""
    steps = [posture(turns, t + over_s) - posture(turns, t) for t in from_s]
    return float(np.degrees(np.mean(np.linalg.norm(steps, axis=1))))


def posture(turns: Array, at_s: float) -> Array:
    """Mean turn of a fifth of a second, without nods' middle: (3,) rad."""
    first = max(round((at_s - 0.1) * RATE_HZ), 0)
    mean: Array = turns[first : first + round(0.2 * RATE_HZ)].mean(axis=0)
    return mean


if __name__ == "__main__":
    main()
