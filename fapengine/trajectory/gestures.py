"""Gestures that make a face look alive: blinks, head motion, gaze, idle drifts, emphasis on stress.

Theory of operation
-------------------
Gestures are defined here once, for files and for live sessions. A :class:`GestureGenerator` draws them as ramps
(:mod:`.ramps`), in time order and each at its own time, whatever the frame rate is; :func:`gesture_faps` turns the
values of all ramps, and of the sines that never end, into FAPs. Offline :func:`gestures_of` draws all at once and
evaluates them on an array of times; live :mod:`fapengine.engine.gestures` draws them as time goes by.

- Each of :data:`fapengine.speaking.GENERATORS` has its own random generator, spawned from one. Switching one off
  changes nothing in the others, because it is drawn all the same.
- A *nod*, with raised brows, belongs to the strongest accent of a phrase (:class:`Phrases`), not to every stress. It
  begins :data:`NOD_RISE_S` before the phone, or as soon as the phone is known where that is later; a phone whose
  beginning has passed by then makes none. It is chosen and its strength drawn when it begins, so the pieces in which
  phones come do not matter, as long as they come :data:`REACH_S` before that. A nod that begins replaces the
  one before.
- *Blinks* are a process whose rate depends on what is spoken at the time: they are drawn to pauses and ends of phrases
  (Nakano and Kitazawa 2010, doi:10.1007/s00221-010-2387-z).
- The *head* moves on when speech begins after a pause, and settles when a phrase ends before one (Hadar et al. 1984,
  Human Movement Science 3).
- The eyes counter the head (vestibulo-ocular reflex), so that the gaze rests where it was; lids follow the eyes, but
  for lids that a blink has shut.
- Gestures are added to speech and expressions (:func:`add_gestures`). A lower lid that a smile has raised then yields
  to a blink, so that the lids meet and do not overlap.
- Phones that follow each other within :data:`PAUSE_S` are one *phrase*. They are added in any order; a stop's closure
  or a lost phone ends no phrase. Few accents (stressed phones) are *outstanding*: an accent is skipped for
  :data:`REACH_S` after an outstanding one, and while a stronger one of the same phrase follows within that time; but
  after twice that time there is one in any case. So a phrase of two seconds has one, its strongest; a long one has one
  every 1.2 to 3 s. Accents are judged in time order, and phones that are known :data:`REACH_S` ahead give the same ones
  as all phones.
- If an end is set, all gestures have ended by then. A file has an end; a live session has one only if it is set.
"""

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum, auto
from math import inf, log2

import numpy as np

from fapengine._arrays import Array
from fapengine.expressions import EXPRESSIONS
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD, STEPS
from fapengine.mpeg4.track import limits
from fapengine.speaking import GENERATORS
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.ramps import Ramp, pulse, sample_ramps
from fapengine.trajectory.style import Style
from fapengine.trajectory.variation import FALL_S, RISE_S, WAVES, draw_variation, variation_faps

PAUSE_S = 0.15
"""Silence between two phrases. Closures of stops are shorter, and are phones anyway."""
REACH_S = 1.6
"""Time within which accents of a phrase compete: our choice."""
SECONDARY_DB = 3.0
"""Loudness that makes up for a secondary stress: our choice."""
DB_PER_DOUBLE_LENGTH = 3.0
"""Loudness that counts as much as twice the length, because stressed vowels are longer and louder: our choice."""
USUAL_S = 0.1
KEPT_S = 5.0
"""Time for which the past is kept."""


class Phrases:
    """Phrases and accents of one face.

    Stateful.
    """

    def __init__(self) -> None:
        self._spans: list[tuple[float, float]] = []
        self._accents: list[tuple[float, float]] = []

    def learn(self, start_s: float, phone: Phone) -> None:
        """Add a phone that begins at a time."""
        if phone.is_silence:
            return
        end_s = start_s + phone.duration_s
        first = bisect_left(self._spans, start_s - PAUSE_S, key=lambda span: span[1])
        last = bisect_right(self._spans, end_s + PAUSE_S, key=lambda span: span[0])
        joined = [*self._spans[first:last], (start_s, end_s)]
        self._spans[first:last] = [(min(begin_s for begin_s, _ in joined), max(stop_s for _, stop_s in joined))]
        if phone.stress:
            insort(self._accents, (start_s, strength_db(phone)))

    def forget_from(self, now_s: float) -> None:
        """Drop what is planned from now on."""
        self._accents = self._accents[: bisect_right(self._accents, (now_s, float("inf")))]
        self._spans = self._spans[: bisect_right(self._spans, now_s, key=lambda span: span[0])]
        if self._spans:
            self._spans[-1] = self._spans[-1][0], min(self._spans[-1][1], now_s)

    def forget_before(self, now_s: float) -> None:
        """Drop what ended more than :data:`KEPT_S` ago."""
        if self._spans and self._spans[0][1] < now_s - KEPT_S:
            del self._spans[: bisect_left(self._spans, now_s - KEPT_S, key=lambda span: span[1])]
        if self._accents and self._accents[0][0] < now_s - KEPT_S:
            del self._accents[: bisect_left(self._accents, (now_s - KEPT_S, 0.0))]

    def around(self, at_s: float) -> tuple[float, float] | None:
        """Beginning and end of the last phrase that has begun by a time; None before the first."""
        index = bisect_right(self._spans, at_s, key=lambda span: span[0]) - 1
        return None if index < 0 else self._spans[index]

    def following(self, at_s: float) -> tuple[float, float] | None:
        """Beginning and end of the first phrase that begins after a time."""
        index = bisect_right(self._spans, at_s, key=lambda span: span[0])
        return None if index == len(self._spans) else self._spans[index]

    def is_outstanding(self, start_s: float, phone: Phone, last_s: float) -> bool:
        """Whether an accent is the strongest of those near it; ``last_s``: beginning of the last one that was."""
        begins_s, ends_s = self.around(start_s) or (start_s, start_s)
        if begins_s <= last_s and start_s - last_s < REACH_S:
            return False
        if start_s - max(begins_s, last_s) >= 2 * REACH_S:
            return True
        first = bisect_right(self._accents, (start_s, 1e9))
        last = bisect_right(self._accents, (min(start_s + REACH_S, ends_s), 1e9))
        return all(other_db <= strength_db(phone) for _, other_db in self._accents[first:last])


def strength_db(phone: Phone) -> float:
    """Strength of an accent: its kind, loudness and length.

    Examples
    --------
    >>> strength_db(Phone("a", 0.0, 0.2, stress=1)) > strength_db(Phone("a", 0.0, 0.1, stress=1))
    True
    """
    length_db = DB_PER_DOUBLE_LENGTH * log2(phone.duration_s / USUAL_S)
    return round((0.0 if phone.stress == 1 else -SECONDARY_DB) + phone.loudness_db + length_db, 6)


class Channel(IntEnum):
    """Ramps of a face's gestures. They come after those of its expressions: see :data:`CHANNELS`."""

    @staticmethod
    def _generate_next_value_(name: str, start: int, count: int, last_values: list[int]) -> int:
        return len(EXPRESSIONS) + count

    LOOK_YAW = auto()
    LOOK_PITCH = auto()
    GLANCE_YAW = auto()
    GLANCE_PITCH = auto()
    PITCH = auto()
    YAW = auto()
    ROLL = auto()
    BLINK = auto()
    NOD = auto()
    JAW = auto()
    LIPS = auto()
    HEAD_MOTION = auto()
    IDLE = auto()
    GAZE = auto()
    STANCE_PITCH = auto()
    STANCE_YAW = auto()
    STANCE_ROLL = auto()
    SPEAKING = auto()
    VARIATION = auto()


CHANNELS = len(EXPRESSIONS) + len(Channel)
"""Number of ramps of a face: first one of each expression, by its index, then one of each :class:`Channel`."""
FIRST_BLINK_S = (0.6, 1.8)
"""Earliest and latest time at which the first blink has shut the eyes."""
MIN_BLINK_INTERVAL_S = 0.8
"""Shortest time between two blinks."""
BLINKS_PER_S = {"silent": 0.35, "speaking": 0.38, "pausing": 3.0}
"""Rates beyond the shortest interval. They give 17 a minute to a face that does not speak and about 26 to one that does
(``python -m bench.life``): rest and conversation in Bentivoglio et al. 1997, Movement Disorders 12, 1028; people who
converse blink 10.5 to 32.5 times a minute (Doughty 2001)."""
BLINK_BEFORE_END_S, BLINK_BEHIND_END_S = 0.1, 0.5
"""Time before and after a phrase's end in which a blink begins as in a pause."""
BLINK_CLOSE_S, BLINK_SHUT_S, BLINK_OPEN_S = 0.09, 0.04, 0.17
"""Lids fall about twice as fast as they rise (Guitton et al. 1991, J. Neurophysiology 65)."""
UPPER_LID, LOWER_LID = 960.0, 100.0
"""FAPU of a full blink, before the lower lid yields: together a little over the lid distance, so no slit remains."""
LIDS_MEET = float(STEPS)
"""Sum of an eye's upper and lower lid at which they meet, FAPU: the lid distance is one IRISD."""
UPPER_LID_MAX = limits(19)[1]
"""Lowest upper lid that can be coded, FAPU."""
HEAD_AMPLITUDE_RAD = {48: 0.022, 49: 0.030, 50: 0.013}
"""Pitch, yaw, roll: about 1.3, 1.7 and 0.7 degrees, an attentive speaker."""
HEAD_BAND_HZ = (0.12, 0.55)
NOD_RISE_S, NOD_FALL_S = 0.18, 0.3
NOD_HOLD = 0.5
"""Part of a stressed phone's duration for which its nod holds."""
NOD_STRENGTH = (0.5, 1.0)
"""Least and greatest strength of a nod with primary stress; with secondary stress, half of it."""
DB_PER_DOUBLE_NOD = 8.0
"""Loudness that doubles a nod and its brows: our choice. That heads move with a speaker's level and pitch is in
Munhall et al. 2004, doi:10.1111/j.0963-7214.2004.01502010.x."""
NOD_RAD = 0.018
BROW_FAPU = 75.0
ONSET_PAUSE_S = 0.25
"""Silence after which speech begins again, and the head moves."""
ONSET_AHEAD_S, ONSET_S, SETTLE_S = 0.25, 0.6, 0.9
"""Time by which the head moves before speech; how long that takes, and how long settling does."""
STANCE_RAD = {
    Channel.STANCE_PITCH: (-0.035, -0.015),
    Channel.STANCE_YAW: (0.025, 0.050),
    Channel.STANCE_ROLL: (0.0, 0.018),
}
"""Least and greatest turn at an onset: chin up by 0.9 to 2.0 degrees, 1.4 to 2.9 to a side, and a little roll. Sizes
are ours; Hadar calls movements at onsets wide, those at ends medium."""
SETTLED, SETTLED_PITCH_RAD = 0.4, 0.010
"""Part of a turn that is left when a phrase has ended, and how far the chin is down then."""
EDGE_S = 0.5
"""Time over which head motion and drifts begin and end."""
FIXATION_S = (0.6, 1.4)
"""Shortest time that the eyes rest on a place, and mean of the exponential time added."""
GLANCE_RAD = 0.022
"""Standard deviation of where they rest, sideways; half of it up and down. 1.3 degrees stay in a listener's face."""
SACCADE_S = 0.04
"""Duration of a jump of some degrees; Bahill et al. 1975 (main sequence)."""
BREATH_HZ, BREATH_RAD = (0.2, 0.3), 0.004
DRIFTS_FAPU = {(31, 32, 33, 34): 14.0, (35, 36): 8.0, (12, 13, 59, 60): 7.0, (19, 20): 15.0}
"""Brows, their outer ends, mouth corners, upper lids: together, about a third of a millimetre."""
DRIFT_BAND_HZ = (0.05, 0.25)
LIDS_FOLLOW = {(19, 20): 600.0, (21, 22): -200.0}
"""FAPU by which upper and lower lids follow a gaze that goes down by a radian: 0.6 and 0.2 of the eye's angle. The
look-down and look-up shapes of ICT-FaceKit turn the upper lid by 24.1 and 11.4 degrees, the lower by 8.4 and 5.9, for
eyes that turn by about 33 and 30. One iris's width is 1024, 1.1 of it the radius of the eye."""
SINES = 4
"""Number of sines whose sum, of about unit size, is one wandering motion."""


def _wave_sums() -> Array:
    """(W, sines): matrix from all sines to head motion, breath and drifts, in this order."""
    counts = [SINES] * len(HEAD_AMPLITUDE_RAD) + [1] + [SINES] * len(DRIFTS_FAPU)
    sums = np.zeros((len(counts), sum(counts)))
    for row, (stop, count) in enumerate(zip(np.cumsum(counts), counts, strict=True)):
        sums[row, stop - count : stop] = 0.5 if count > 1 else 1.0
    return sums


_WAVE_SUMS = _wave_sums()
BREATH_ROW = len(HEAD_AMPLITUDE_RAD)
_UPPER_LIDS, _LOWER_LIDS = slice(fap.column(19), fap.column(20) + 1), slice(fap.column(21), fap.column(22) + 1)
_STANCE, _TURN, _LOOK, _GLANCE = (
    slice(first, last + 1)
    for first, last in (
        (Channel.STANCE_PITCH, Channel.STANCE_ROLL), (Channel.PITCH, Channel.ROLL),
        (Channel.LOOK_YAW, Channel.LOOK_PITCH), (Channel.GLANCE_YAW, Channel.GLANCE_PITCH),
    )
)  # fmt: skip
_HEAD = 48, 49, 50
_MOVES: tuple[dict[int, float], ...] = (
    *({number: rad / AU_RAD} for number, rad in HEAD_AMPLITUDE_RAD.items()),
    {48: BREATH_RAD / AU_RAD},
    *(dict.fromkeys(numbers, fapu) for numbers, fapu in DRIFTS_FAPU.items()),
    *({number: 1 / AU_RAD} for number in _HEAD),
    {48: NOD_RAD / AU_RAD} | dict.fromkeys(range(31, 37), BROW_FAPU),
    {19: UPPER_LID, 20: UPPER_LID, 21: LOWER_LID, 22: LOWER_LID},
    *(dict.fromkeys(numbers, 1 / AU_RAD) for numbers in ((23, 24), (25, 26))),
    {number: fapu for numbers, fapu in LIDS_FOLLOW.items() for number in numbers},
    *({number: 1 / AU_RAD} for number in _HEAD),
)
"""FAPU that make a face move, by FAP: a unit of each wave, then a radian of stance, a nod, shut lids, a radian of the
eyes to the side and down, one of lids that follow them, one of a turn that eyes join."""
_SIZES = np.zeros((fap.FAP_COUNT, len(_MOVES)))
for _column, _move in enumerate(_MOVES):
    _SIZES[fap.columns(*_move), _column] = list(_move.values())
_WAVES, _STANCES = slice(len(_WAVE_SUMS)), slice(len(_WAVE_SUMS), len(_WAVE_SUMS) + len(_HEAD))
_NOD, _SHUT = _STANCES.stop, _STANCES.stop + 1
_EYES, _FOLLOW = slice(_SHUT + 1, _SHUT + 3), _SHUT + 3
_HEAD_RAD = _SIZES[[fap.column(49), fap.column(48)], :_SHUT] * AU_RAD
"""(2, moves): yaw and pitch that eyes counter."""


def _draw_waves(head_rng: np.random.Generator, idle_rng: np.random.Generator) -> Array:
    """(2, sines): frequencies in rad/s and phases in rad."""
    bands = [(head_rng, HEAD_BAND_HZ, SINES)] * len(HEAD_AMPLITUDE_RAD)
    bands += [(idle_rng, BREATH_HZ, 1)] + [(idle_rng, DRIFT_BAND_HZ, SINES)] * len(DRIFTS_FAPU)
    drawn = [(2 * np.pi * rng.uniform(*band, size=n), rng.uniform(0, 2 * np.pi, size=n)) for rng, band, n in bands]
    return np.concatenate(drawn, axis=1)


class GestureGenerator:
    """The gestures of one face, drawn up to a time that never goes back.

    Stateful.

    Parameters
    ----------
    rng : numpy.random.Generator
        One generator is spawned from it for each of :data:`fapengine.speaking.GENERATORS`, and one for
        :mod:`.variation`.
    style : Style
        Gestures that are shown.
    begins_s : float
        Time at which the face begins, neutral.
    """

    def __init__(self, rng: np.random.Generator, style: Style, *, begins_s: float = 0.0) -> None:
        *own, varied = rng.spawn(len(GENERATORS) + 1)
        self._rng = dict(zip(GENERATORS, own, strict=True))
        self._style = style
        self._begins_s, self._ends_s = begins_s, inf
        self._blink_s = begins_s - BLINK_CLOSE_S + self._rng["blinks"].uniform(*FIRST_BLINK_S)
        self._has_blinked = False
        self._glance_s = begins_s + self._fixation_s()
        self._nods: list[tuple[float, float, Phone]] = []
        self._nodded_s = -inf
        self._phrases = Phrases()
        self._moved_s, self._late_s = -inf, begins_s
        self._spoken_from_s: float | None = None
        """Where the phrase begins for which the head has moved; None while it has settled."""
        self._turned = dict.fromkeys(STANCE_RAD, 0.0)
        own_waves = _draw_waves(self._rng["head_motion"], self._rng["idle"])
        self.waves = np.concatenate([own_waves, draw_variation(varied)], axis=1)
        """(2, sines): frequencies in rad/s and phases in rad of what never ends, from ``begins_s`` on; those of
        :mod:`.variation` come last."""

    @property
    def due_s(self) -> float:
        """Time of the next gesture."""
        nod_s = self._nods[0][0] if self._nods else inf
        return min(self._blink_s, self._next_glance_s(), nod_s, self._next_stance_s())

    def begin(self) -> list[Ramp]:
        """Begin head motion and drifts."""
        return _switches(self._style, self._begins_s, EDGE_S)[:2]

    def end(self, at_s: float, now_s: float) -> list[Ramp]:
        """End all gestures by a time; none follows."""
        self._ends_s = at_s
        channels = ((Channel.HEAD_MOTION, EDGE_S), (Channel.IDLE, EDGE_S), (Channel.NOD, NOD_FALL_S))
        return [Ramp(max(at_s - over_s, now_s), channel, 0.0, over_s) for channel, over_s in channels]

    def restyle(self, style: Style, now_s: float, over_s: float) -> list[Ramp]:
        """Show the gestures of another style from now on."""
        self._style = style
        return [] if now_s >= self._ends_s - EDGE_S else _switches(style, now_s, over_s)

    def hear(self, phones: Iterable[tuple[float, Phone]], now_s: float) -> None:
        """Add phones that have become known: time at which each begins, and the phone."""
        for start_s, phone in phones:
            self._phrases.learn(start_s, phone)
            if start_s - ONSET_AHEAD_S < now_s <= start_s:
                self._late_s = now_s
            if phone.stress and start_s > now_s:
                insort(self._nods, (max(start_s - NOD_RISE_S, now_s), start_s, phone), key=lambda nod: nod[:2])

    def forget(self, from_s: float) -> None:
        """Drop phones that begin at or after a time; others will be heard instead."""
        self._nods = [nod for nod in self._nods if nod[1] < from_s]
        self._phrases.forget_from(from_s)

    def hush(self, now_s: float) -> list[Ramp]:
        """Drop planned phones, and end the current nod."""
        self._nods.clear()
        self._phrases.forget_from(now_s)
        return [Ramp(now_s, Channel.NOD, 0.0, NOD_FALL_S, takes_over=True)]

    def skip_to(self, at_s: float) -> None:
        """Leave out blinks and glances before a time."""
        self._blink_s, self._glance_s = max(self._blink_s, at_s), max(self._glance_s, at_s)

    def draw(self, until_s: float) -> list[Ramp]:
        """Draw the gestures that begin up to a time."""
        ramps: list[Ramp] = []
        while self._blink_s <= until_s:
            ramps += self._blink(self._blink_s)
        while self._next_glance_s() <= until_s:
            ramps += self._glance(self._next_glance_s())
        nods = 0
        while nods < len(self._nods) and self._nods[nods][0] <= until_s:
            at_s, start_s, phone = self._nods[nods]
            nods += 1
            if self._phrases.is_outstanding(start_s, phone, self._nodded_s):
                self._nodded_s = start_s
                ramps += self._nod(at_s, phone)
        del self._nods[:nods]
        while self._next_stance_s() <= until_s:
            ramps += self._stance(self._next_stance_s())
        self._phrases.forget_before(until_s)
        return ramps

    def _blink(self, at_s: float) -> Sequence[Ramp]:
        shown = blink(at_s)
        if not shown[-1].at_s + BLINK_OPEN_S < self._ends_s:
            self._blink_s = inf  # it would be cut off
            return ()
        chance = self._rng["blinks"].uniform()
        most = max(BLINKS_PER_S.values())
        self._blink_s = at_s + self._rng["blinks"].exponential(1.0 / most)
        if chance * most >= BLINKS_PER_S[self._state(at_s)] and self._has_blinked:
            return ()
        self._has_blinked = True
        self._blink_s += MIN_BLINK_INTERVAL_S
        return shown if self._style.blinks else ()

    def _state(self, at_s: float) -> str:
        """Whether the face speaks, pauses, or is silent: a key of :data:`BLINKS_PER_S`."""
        phrase = self._phrases.around(at_s)
        if phrase is None or at_s > phrase[1] + BLINK_BEHIND_END_S:
            return "silent"
        return "speaking" if at_s < phrase[1] - BLINK_BEFORE_END_S else "pausing"

    def _next_stance_s(self) -> float:
        """Time of the next onset or end of speech."""
        if self._spoken_from_s is None:
            coming = self._phrases.following(self._moved_s)
            return inf if coming is None else max(self._moved_s, self._late_s, coming[0] - ONSET_AHEAD_S)
        phrase = self._phrases.around(self._spoken_from_s)
        if phrase is None:  # it was taken back before it began
            return self._moved_s
        while (behind := self._phrases.following(phrase[1])) is not None and behind[0] - phrase[1] < ONSET_PAUSE_S:
            phrase = behind
        return max(self._moved_s, phrase[1])

    def _stance(self, at_s: float) -> Sequence[Ramp]:
        """Move on when speech begins, settle when it ends."""
        coming = self._phrases.following(self._moved_s)
        self._moved_s = at_s
        if self._spoken_from_s is None and coming is not None:
            self._spoken_from_s = coming[0]
            rng = self._rng["head_motion"]
            for channel, sizes in STANCE_RAD.items():
                side = 1.0 if channel is Channel.STANCE_PITCH else rng.choice((-1.0, 1.0))
                self._turned[channel] = side * rng.uniform(*sizes)
            turns = [Ramp(at_s, channel, rad, ONSET_S, takes_over=True) for channel, rad in self._turned.items()]
            return [*turns, Ramp(at_s, Channel.SPEAKING, 1.0, RISE_S, takes_over=True)]
        self._spoken_from_s = None
        settled = {channel: SETTLED * rad for channel, rad in self._turned.items()}
        settled[Channel.STANCE_PITCH] = SETTLED_PITCH_RAD
        turns = [Ramp(at_s, channel, rad, SETTLE_S, takes_over=True) for channel, rad in settled.items()]
        return [*turns, Ramp(at_s, Channel.SPEAKING, 0.0, FALL_S, takes_over=True)]

    def _next_glance_s(self) -> float:
        """Time of the next glance; the last one leads back before the end."""
        return inf if self._glance_s == inf else min(self._glance_s, self._ends_s - SACCADE_S)

    def _glance(self, at_s: float) -> Sequence[Ramp]:
        is_last = at_s >= self._ends_s - FIXATION_S[0]
        goal = (0.0, 0.0) if is_last else self._rng["gaze"].normal(scale=(GLANCE_RAD, GLANCE_RAD / 2)).tolist()
        self._glance_s = inf if is_last else at_s + self._fixation_s()
        channels = (Channel.GLANCE_YAW, Channel.GLANCE_PITCH)
        return [Ramp(at_s, channel, rad, SACCADE_S) for channel, rad in zip(channels, goal, strict=True)]

    def _nod(self, at_s: float, phone: Phone) -> Sequence[Ramp]:
        strength = (1.0 if phone.stress == 1 else 0.5) * self._rng["emphasis"].uniform(*NOD_STRENGTH)
        strength *= 2.0 ** (phone.loudness_db / DB_PER_DOUBLE_NOD)
        left_s = self._ends_s - NOD_FALL_S - at_s
        if not self._style.emphasis or left_s <= 0:
            return ()
        hold_s = min(NOD_HOLD * phone.duration_s, left_s - NOD_RISE_S)
        return pulse(at_s, Channel.NOD, strength, NOD_RISE_S, hold_s, NOD_FALL_S)

    def _fixation_s(self) -> float:
        least_s, mean_s = FIXATION_S
        return float(least_s + self._rng["gaze"].exponential(mean_s))


def blink(at_s: float) -> tuple[Ramp, Ramp]:
    """Make the ramps of one blink that begins at a time."""
    return pulse(at_s, Channel.BLINK, 1.0, BLINK_CLOSE_S, BLINK_SHUT_S, BLINK_OPEN_S)


def _switches(style: Style, at_s: float, over_s: float) -> list[Ramp]:
    """Fade in what a style switches on, and fade out the rest."""
    levels = (
        (Channel.HEAD_MOTION, style.head_motion), (Channel.IDLE, style.idle), (Channel.GAZE, style.gaze),
        (Channel.VARIATION, style.variation),
    )  # fmt: skip
    return [Ramp(at_s, channel, float(level), over_s) for channel, level in levels]


def start_levels(style: Style) -> Array:
    """Return the initial levels of a style: (C,), one per channel."""
    levels = np.zeros(CHANNELS)
    levels[[Channel.JAW, Channel.LIPS]] = style.jaw_gain, style.lips_gain
    levels[[Channel.GAZE, Channel.VARIATION]] = style.gaze, style.variation
    return levels


def gesture_faps(levels: Array, waves: Array, since_s: Array) -> Array:
    """Turn channels into FAPs: N faces at one time, or one face at N times.

    Parameters
    ----------
    levels : (C, N) float64
        Value of each of :data:`CHANNELS`: angles in rad, all others 0..1; those of expressions are not used here.
    waves : (2, sines, N or 1) float64
        See ``GestureGenerator.waves``.
    since_s : (N,) float64, s
        Time since each face began.

    Returns
    -------
    (68, N) float64, FAPU
        For :func:`add_gestures`, after :func:`.closures.settle`.
    """
    moves = np.zeros((len(_MOVES), levels.shape[1]))
    moving, idle = levels[Channel.HEAD_MOTION], levels[Channel.IDLE]
    if moving.any() or idle.any():
        wander = np.matmul(_WAVE_SUMS, np.sin(waves[0, :-WAVES] * since_s + waves[1, :-WAVES]), out=moves[_WAVES])
        wander[:BREATH_ROW] *= moving
        wander[BREATH_ROW:] *= idle
        np.multiply(levels[_STANCE], moving, out=moves[_STANCES])
    moves[_NOD] = levels[Channel.NOD]
    shut = np.minimum(np.maximum(levels[Channel.BLINK], 0.0), 1.0, out=moves[_SHUT])
    eyes = np.subtract(levels[_GLANCE], _HEAD_RAD @ moves[:_SHUT], out=moves[_EYES])
    eyes *= levels[Channel.GAZE]
    eyes += levels[_LOOK]
    moves[_FOLLOW] = (1.0 - shut) * eyes[1]
    moves[_FOLLOW + 1 :] = levels[_TURN]
    return _SIZES @ moves


def varied_faps(levels: Array, waves: Array, since_s: Array) -> Array:
    """Return the natural variation of speech, (68, N) FAPU, of the channels and waves of :func:`gesture_faps`.

    It is added to the expression (:mod:`.variation`).
    """
    return variation_faps(levels[Channel.SPEAKING] * levels[Channel.VARIATION], waves[:, -WAVES:], since_s)


def add_gestures(faps: Array, gestures: Array) -> None:
    """Add gestures to FAPs in place; where lids would overlap, the lower one yields.

    Parameters
    ----------
    faps : (N, 68) float64, FAPU
        Speech and expressions; overwritten.
    gestures : (N, 68) float64, FAPU
    """
    faps += gestures
    room = LIDS_MEET - np.minimum(faps[:, _UPPER_LIDS], UPPER_LID_MAX)
    faps[:, _LOWER_LIDS] = np.minimum(faps[:, _LOWER_LIDS], room)


def gestures_of(
    times_s: Array,
    end_s: float,
    phones: Iterable[Phone],
    style: Style,
    rng: np.random.Generator,
    wanted: Iterable[Ramp] = (),
) -> Callable[[slice], tuple[Array, Array]]:
    """Draw the gestures of a file, and its variation.

    Parameters
    ----------
    times_s : (T,) float64, s
        Times from 0 on.
    end_s : float
        Time by which all gestures have ended.
    phones : iterable of Phone
        Spoken phones; accents make nods, pauses draw blinks.
    wanted : iterable of Ramp
        Further gestures.

    Returns
    -------
    callable
        A slice of the times -> :func:`varied_faps` and :func:`gesture_faps` at these times, (68, N) float64, FAPU.
    """
    generator = GestureGenerator(rng, style)
    generator.hear(((phone.start_s, phone) for phone in phones), 0.0)
    ramps = [*generator.begin(), *generator.end(end_s, 0.0), *generator.draw(end_s)]
    levels = sample_ramps(start_levels(style), [*ramps, *wanted], times_s)
    waves = generator.waves[..., None]

    def moved(piece: slice) -> tuple[Array, Array]:
        at = levels[:, piece], waves, times_s[piece]
        return varied_faps(*at), gesture_faps(*at)

    return moved
