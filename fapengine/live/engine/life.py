"""What faces do beside speaking, for all sessions at once: expressions, gaze, blinks, and what livens them.

The stream of :mod:`fapengine.trajectory.liveliness`: the same movements with the same sizes, drawn as time goes by. All
that begins and ends is a ramp (:mod:`.ramps`); head and drifts are sums of sines that never end.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from fapengine.live.engine.commands import Express, Look, TurnHead
from fapengine.live.engine.ramps import Ramps
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import Profile
from fapengine.speech.phone_track import Phone
from fapengine.trajectory import liveliness as lively
from fapengine.trajectory.bank import Shown
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.style import Style

Array = NDArray[np.float64]

EXPRESSIONS = tuple(expression for expression in Expression if expression)


class Channel(IntEnum):
    """One ramp each, in every session; the first six are :data:`EXPRESSIONS`, at their levels."""

    JOY = 0
    SADNESS = 1
    ANGER = 2
    FEAR = 3
    DISGUST = 4
    SURPRISE = 5
    LOOK_YAW = 6
    LOOK_PITCH = 7
    GLANCE_YAW = 8
    GLANCE_PITCH = 9
    PITCH = 10
    YAW = 11
    ROLL = 12
    BLINK = 13
    NOD = 14
    JAW = 15
    LIPS = 16
    HEAD_MOTION = 17
    IDLE = 18


EASE_S = 0.3
"""Over which a changed manner takes hold."""
SWAYS = tuple(lively.HEAD_AMPLITUDE_RAD)
DRIFTS = tuple(lively.DRIFTS_FAPU)
SINES = 4
NOD_RISE_S, NOD_FALL_S = 0.18, 0.3


@dataclass(slots=True, eq=False)
class _Chance:
    """Stateful: what a session does by itself, and when next."""

    rng: np.random.Generator
    style: Style
    blink_s: float
    glance_s: float


class Life:
    """Stateful: rows as in :class:`fapengine.trajectory.bank.SessionBank`: the last moves where one closes.

    Parameters
    ----------
    profile : Profile
        Where the expressions lie.
    style : Style
        Of every session at first.
    """

    def __init__(self, profile: Profile, style: Style) -> None:
        self._style = style
        start = np.zeros(len(Channel))
        start[[Channel.JAW, Channel.LIPS]] = style.jaw_gain, style.articulation * style.lips
        self._ramps = Ramps(start)
        self._expression_faps = _expression_faps(profile)
        self._known = {expression for expression in EXPRESSIONS if expression in profile.expressions}
        self._chances: list[_Chance] = []
        self._next_s = np.zeros(0)
        self._waves = np.zeros((2, len(SWAYS) + 1 + len(DRIFTS), SINES, 0))

    def open(self, now_s: float, rng: np.random.Generator) -> None:
        """Add a row."""
        row = self._ramps.open()
        bands = [lively.HEAD_BAND_HZ] * len(SWAYS) + [lively.BREATH_HZ] + [lively.DRIFT_BAND_HZ] * len(DRIFTS)
        frequencies = np.array([rng.uniform(*band, size=SINES) for band in bands])
        phases = rng.uniform(0, 2 * np.pi, size=frequencies.shape)
        self._waves = np.concatenate([self._waves, np.stack([frequencies, phases])[..., None]], axis=-1)
        chance = _Chance(rng, self._style, now_s + 0.6 + rng.uniform(0.0, 1.2), now_s + _fixation(rng))
        self._chances.append(chance)
        self._next_s = np.append(self._next_s, min(chance.blink_s, chance.glance_s))
        for channel, on in ((Channel.HEAD_MOTION, self._style.head_motion), (Channel.IDLE, self._style.idle)):
            self._ramps.send(row, channel, now_s, float(on), lively.EDGE_S)

    def close(self, row: int) -> None:
        """Take a row away."""
        self._ramps.close(row)
        self._chances[row] = self._chances[-1]
        self._chances.pop()
        self._next_s[row], self._waves[..., row] = self._next_s[-1], self._waves[..., -1]
        self._next_s, self._waves = self._next_s[:-1], self._waves[..., :-1]

    def express(self, row: int, wish: Express, now_s: float) -> bool:
        """Let an expression come, hold and go; False if the profile does not have it."""
        if wish.expression not in self._known:
            return False
        at_s, channel = max(now_s if wish.at_s is None else wish.at_s, now_s), Channel[wish.expression.name]
        self._ramps.forget(row, channel, at_s)
        self._ramps.send(row, channel, at_s, wish.level, wish.attack_s)
        if np.isfinite(wish.hold_s):
            self._ramps.send(row, channel, at_s + wish.attack_s + wish.hold_s, 0.0, wish.release_s)
        return True

    def look(self, row: int, wish: Look, now_s: float) -> None:
        """Turn the eyes."""
        for channel, angle_rad in ((Channel.LOOK_YAW, wish.yaw_rad), (Channel.LOOK_PITCH, wish.pitch_rad)):
            self._ramps.send(row, channel, now_s, angle_rad, wish.over_s)

    def turn(self, row: int, wish: TurnHead, now_s: float) -> None:
        """Turn the head."""
        turns = ((Channel.PITCH, wish.pitch_rad), (Channel.YAW, wish.yaw_rad), (Channel.ROLL, wish.roll_rad))
        for channel, angle_rad in turns:
            self._ramps.send(row, channel, now_s, angle_rad, wish.over_s)

    def blink(self, row: int, now_s: float) -> None:
        """Close the eyes once."""
        self._pulse(row, Channel.BLINK, now_s, 1.0, lively.BLINK_CLOSE_S, lively.BLINK_SHUT_S, lively.BLINK_OPEN_S)

    def behave(self, row: int, style: Style, now_s: float) -> None:
        """Take a new style over."""
        chance = self._chances[row]
        chance.style = style
        gains = (
            (Channel.JAW, style.jaw_gain),
            (Channel.LIPS, style.articulation * style.lips),
            (Channel.HEAD_MOTION, float(style.head_motion)),
            (Channel.IDLE, float(style.idle)),
        )
        for channel, gain in gains:
            self._ramps.send(row, channel, now_s, gain, EASE_S)
        if not style.gaze:
            for channel in (Channel.GLANCE_YAW, Channel.GLANCE_PITCH):
                self._ramps.send(row, channel, now_s, 0.0, lively.SACCADE_S)

    def stress(self, row: int, phones: Iterable[tuple[float, Phone]]) -> None:
        """Nod with stressed phones: (engine time at which each begins, phone)."""
        chance = self._chances[row]
        if not chance.style.emphasis:
            return
        for start_s, phone in phones:
            strength = (1.0 if phone.stress == 1 else 0.5) * chance.rng.uniform(0.5, 1.0)
            hold_s = 0.5 * phone.duration_s
            self._pulse(row, Channel.NOD, start_s - NOD_RISE_S, strength, NOD_RISE_S, hold_s, NOD_FALL_S)

    def hush(self, row: int, now_s: float) -> None:
        """Forget nods that were to come."""
        self._ramps.forget(row, Channel.NOD, now_s)
        self._ramps.send(row, Channel.NOD, now_s, 0.0, NOD_FALL_S)

    def shown(self, now_s: float) -> Shown:
        """Everything but speech, of all rows, at a time that never goes back."""
        for row in np.flatnonzero(self._next_s <= now_s):
            self._draw(int(row), now_s)
        levels = self._ramps.values(now_s)
        expression = self._expression_faps @ levels[: len(EXPRESSIONS)]
        return Shown(expression, self._livened(levels, now_s), levels[Channel.JAW], levels[Channel.LIPS])

    def _livened(self, levels: Array, now_s: float) -> Array:
        faps = np.zeros((fap.FAP_COUNT, levels.shape[1]))
        frequencies, phases = self._waves
        waves = np.sin(2 * np.pi * frequencies * now_s + phases)
        wander = waves.sum(axis=1) / 2
        moving, idle = levels[Channel.HEAD_MOTION], levels[Channel.IDLE]
        commanded = dict(zip((48, 49, 50), levels[[Channel.PITCH, Channel.YAW, Channel.ROLL]], strict=True))
        for sway, number in zip(wander, SWAYS, strict=False):
            amplitude_rad = lively.HEAD_AMPLITUDE_RAD[number]
            faps[fap.column(number)] = (moving * amplitude_rad * sway + commanded[number]) / AU_RAD
        breath = waves[len(SWAYS), 0]
        nod = levels[Channel.NOD]
        faps[fap.column(48)] += (idle * lively.BREATH_RAD * breath + lively.NOD_RAD * nod) / AU_RAD
        for drift, numbers in zip(wander[len(SWAYS) + 1 :], DRIFTS, strict=True):
            _add(faps, numbers, idle * lively.DRIFTS_FAPU[numbers] * drift)
        _add(faps, (31, 32, 33, 34, 35, 36), lively.BROW_FAPU * nod)
        blink = np.clip(levels[Channel.BLINK], 0.0, 1.0)
        _add(faps, (19, 20), lively.UPPER_LID * blink)
        _add(faps, (21, 22), lively.LOWER_LID * blink)
        eyes = (
            ((23, 24), Channel.LOOK_YAW, Channel.GLANCE_YAW, 49),
            ((25, 26), Channel.LOOK_PITCH, Channel.GLANCE_PITCH, 48),
        )
        for numbers, look, glance, head in eyes:
            _add(
                faps,
                numbers,
                (levels[look] + levels[glance]) / AU_RAD - (faps[fap.column(head)] - commanded[head] / AU_RAD),
            )
        for numbers, per_rad in lively.LIDS_FOLLOW.items():
            _add(faps, numbers, per_rad * (1 - blink) * AU_RAD * faps[fap.column(25)])
        return faps

    def _draw(self, row: int, now_s: float) -> None:
        """Blink, or look elsewhere, and draw when next."""
        chance = self._chances[row]
        if chance.blink_s <= now_s:
            if chance.style.blinks:
                self.blink(row, now_s)
            chance.blink_s = now_s + lively.BLINK_INTERVAL_S[0] + chance.rng.exponential(lively.BLINK_INTERVAL_S[1])
        if chance.glance_s <= now_s:
            if chance.style.gaze:
                goal = chance.rng.normal(scale=(lively.GLANCE_RAD, lively.GLANCE_RAD / 2))
                for channel, angle_rad in zip((Channel.GLANCE_YAW, Channel.GLANCE_PITCH), goal, strict=True):
                    self._ramps.send(row, channel, now_s, float(angle_rad), lively.SACCADE_S)
            chance.glance_s = now_s + _fixation(chance.rng)
        self._next_s[row] = min(chance.blink_s, chance.glance_s)

    def _pulse(
        self, row: int, channel: Channel, at_s: float, height: float, rise_s: float, hold_s: float, fall_s: float
    ) -> None:
        self._ramps.send(row, channel, at_s, height, rise_s)
        self._ramps.send(row, channel, at_s + rise_s + hold_s, 0.0, fall_s)


def _add(faps: Array, numbers: Iterable[int], values: Array) -> None:
    for number in numbers:
        faps[fap.column(number)] += values


def _fixation(rng: np.random.Generator) -> float:
    shortest_s, mean_s = lively.FIXATION_S
    return float(shortest_s + rng.exponential(mean_s))


def _expression_faps(profile: Profile) -> Array:
    """(68, 6) FAPU of each full expression; what a profile lacks is 0."""
    faps = np.zeros((fap.FAP_COUNT, len(EXPRESSIONS)))
    for column, expression in enumerate(EXPRESSIONS):
        if expression in profile.expressions:
            face = profile.expressions[expression]
            moved = profile.space.to_points_mm(face.target[None])
            faps[:, column] = displacements_to_faps(moved, profile.space.points, profile.fapu)[0] + face.fap
    return faps
