"""The planner for a stream of phones, which may come late, early, in any order, revised, or not at all.

Theory of operation
-------------------
Times up to the *edge*, ``horizon_s`` after the last frame, are settled: what was or may have been shown there never
changes. After it the path is planned again whenever phones change. The new path need not meet the old one at the edge;
the difference in value, velocity and acceleration is added and fades over :data:`FADE_S` along a quintic, so the motion
stays C2. Velocity and acceleration fade in :data:`MOMENTUM_S` at most, and within the length of the fade that they come
from: a face that returns to neutral quickly does not overshoot when it speaks again. The path is local
(:mod:`.hermite`): phones that come :data:`AHEAD_PHONES` phones early change nothing at the edge, and the stream then
equals the offline plan. So phones that follow the planned ones wait until they matter: those of a long text that come
one by one are planned a few times, not each time that one comes.

A bilabial that comes too late still closes the lips, as soon as they can. Phones that come again change nothing, before
their time, in it or after it. When phones stop coming, the face returns to neutral after the last one; when speech is
cancelled, it is neutral after the fade, from any position.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from math import isfinite, sqrt
from operator import attrgetter

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.profiles import Profile
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone
from fapengine.trajectory import hermite
from fapengine.trajectory.closures import MIN_HOLD_S, RAMP_S, Hold, hold_late, hold_of, hold_until
from fapengine.trajectory.context import REACH
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.style import Style
from fapengine.trajectory.targets import speech_keys, spelled_of

_Timed = tuple[float, float, str]
"""Start and end of a phone, and its label."""

FADE_S = 0.08
"""Time over which a change of plan is blended in. Live lips of 40 filmed sentences, 0.25 s late, while speaking: r .606
with 0.05 s, .604 with 0.08, .599 with 0.11, .585 with 0.15; their speeds and accelerations are the same with all."""
MIN_FADE_S = 0.05
"""Shortest time for what is left of an earlier change when the plan changes again."""
MOMENTUM_S = 0.15
"""Longest time over which velocity and acceleration fade when speech is cancelled, however long the fade."""
MAX_PULL = 1000.0
"""Greatest product of an acceleration, weights/s², and the square of the time in which it fades, s²: meanwhile it moves
a weight by a sixtieth of that at most. Phones of 50 ms and more have less; phones of 4 ms reach 500,000 weights/s²,
which would open the mouth three times as wide as speech."""
AHEAD_PHONES = 5
"""Three neighbours that a phone depends on, and two keys that a segment depends on."""
PLAN_EARLY_S = 0.1
"""Phones that wait are planned this long before they first affect a frame."""
KEYS_BEHIND = 3
"""Most phones before the edge with keys that a plan needs: a segment needs two keys, and one may give way to a nearer
one."""
LONG_S = 0.06
"""Least length, for each character of its label, of a phone that keeps its keys, whatever is before it: no shorter
than twice :data:`.targets.APART_S`, and its first key comes :data:`.targets.CLOSEST_KEYS_S` after its beginning."""
PLANNED_LETTERS = 256
"""Most characters of the labels of phones that are planned after the edge; later phones are dropped."""
BEHIND_PHONES = REACH + KEYS_BEHIND
"""Number of past phones that a new plan depends on."""
_START, _END = attrgetter("start_s"), attrgetter("end_s")
LATEST_CLOSURE_S = 0.15
"""A bilabial that ended longer ago makes no closure."""
SAME_S = 1e-3
"""Phones whose times differ by less are the same."""
ROUNDING_S = 1e-6
"""A fade that ends less than this after a frame is over in it, so that rounding does not decide."""


@dataclass(slots=True)
class Counts:
    """Counts of phones that came late, or were dropped or revised. Stateful."""

    late: int = 0
    """Phones that came after their beginning had been shown."""
    dropped: int = 0
    """Phones that had ended when they came."""
    revised: int = 0
    """Phones that later ones replaced or cut short."""
    cancelled: int = 0
    unknown: int = 0
    """Phones with a label that is not IPA."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamPlan:
    """A path from ``start_s`` on, and the difference that fades out of it."""

    start_s: float
    path: hermite.Path
    fade_s: float
    """Time over which its value fades."""
    momentum_s: float
    """Time over which its velocity and acceleration do, at most ``fade_s``."""
    left_over: Array
    """(3, K): value, velocity and acceleration at ``start_s``."""

    def shortest_fade_s(self, time_s: float) -> float:
        """Length of the shorter of its fades that last at a time; infinity if none does."""
        since_s = time_s - self.start_s + ROUNDING_S
        return self.momentum_s if since_s < self.momentum_s else self.fade_s if since_s < self.fade_s else np.inf


@dataclass(slots=True)
class StreamingPlanner:
    """Planner of one stream. All times count from the stream's beginning.

    Stateful.

    Parameters
    ----------
    style : Style
        Articulation and method; gestures are not made here.
    horizon_s : float
        Time after the last frame up to which the plan is settled. 0 reacts soonest, and costs nothing: what counts is
        how early the sender knows its phones. 0.5 s ahead is as good as all of them, 0.3 s costs 0.01 mm of lip error,
        0.2 s 0.08, 0.1 s 0.23, none 1.4 (``design/look_ahead.py``).
    """

    profile: Profile
    style: Style = field(default_factory=lambda: Style.speech_only())
    horizon_s: float = 0.0
    counts: Counts = field(default_factory=Counts)
    _phones: list[Phone] = field(default_factory=list)
    _holds: dict[_Timed, Hold] = field(default_factory=dict)
    _kept_holds: list[Hold] = field(default_factory=list)
    _known: list[Phone] = field(default_factory=list)
    """Dropped and cancelled phones that ended within :data:`LATEST_CLOSURE_S` before the edge."""
    _plans: list[StreamPlan] = field(default_factory=list)
    _shown_s: float = -np.inf
    _cancelled_s: float = -np.inf
    _due: tuple[float, float] | None = None
    """Edge and fade of a plan that is to be made."""
    _waits: bool = False
    """Whether phones follow those of the plan."""
    _letters: int = 0
    """Characters of the labels of phones after the edge, or more: those that have passed it are still counted."""
    sure_s: float = -np.inf
    """Time before which phones that follow those of the plan change nothing."""
    _width: int = field(init=False)
    """Number of weights on the path: modes, then the axes of :mod:`.phonetics`."""

    def __post_init__(self) -> None:
        self._width = self.profile.space.mode_count + WIDTH
        if not self.horizon_s >= 0:
            raise UsageError(f"horizon_s: must be 0 or more, got {self.horizon_s}")
        neutral = hermite.Path(np.array([0.0, 1.0]), np.zeros((2, 3, self._width)))
        self._plans = [StreamPlan(-np.inf, neutral, 0.0, 0.0, np.zeros((3, self._width)))]

    @property
    def edge_s(self) -> float:
        """Time up to which the plan is settled."""
        return max(self._shown_s + self.horizon_s, self._cancelled_s)

    def take(self, phones: Sequence[Phone], *, is_counted: bool = True) -> int:
        """Add phones, in any order; :func:`plan_together`, which must come by :attr:`plan_by_s`, plans their path.

        Phones come in stream time. Each replaces what it overlaps; a silence removes what it overlaps.

        Parameters
        ----------
        phones : sequence of Phone
        is_counted : bool
            Whether they are counted as late or dropped; phones that replace lost ones are not.

        Returns
        -------
        int
            Number of those that are late or dropped.
        """
        edge, before = self.edge_s, self.counts.late + self.counts.dropped
        self._known = [phone for phone in self._known if phone.end_s > edge - LATEST_CLOSURE_S]
        for phone in phones:
            is_mine = is_counted and not phone.is_silence
            if self._has(phone, edge):
                continue
            if phone.end_s <= edge:
                self.counts.dropped += is_mine
                self._close_late(phone, edge)
            else:
                self.counts.late += phone.start_s < edge and is_mine
                self.counts.unknown += not phone.is_silence and not ipa.letters(phone.label)
                self._letters += len(phone.label)
                if self._place(phone) and not self._due and edge < self.sure_s:
                    self._waits = True
                else:
                    self._due = edge, FADE_S
        late = self.counts.late + self.counts.dropped - before
        if self._letters > PLANNED_LETTERS and not self._due:
            self._drop_far(edge)
        return late

    def _has(self, phone: Phone, edge: float) -> bool:
        """Whether a phone changes nothing: it is planned already, or one of its label was said in its time."""
        if phone.end_s > edge:
            if phone.is_silence:
                return not self._overlapped(phone)
            first = bisect_left(self._phones, phone.start_s, key=_START)
            return self._phones[first : first + 1] == [phone]
        first = bisect_right(self._phones, phone.start_s, key=_END)
        behind = bisect_left(self._phones, phone.end_s, key=_START)
        return any(
            known.label == phone.label and known.start_s < phone.end_s and known.end_s > phone.start_s
            for known in (*self._phones[first:behind], *self._known)
        )

    def _place(self, phone: Phone) -> bool:
        """Put a phone in its place; return whether it follows all others."""
        if not phone.is_silence and (not self._phones or phone.start_s >= self._phones[-1].end_s):
            self._phones.append(phone)
            return True
        place = self._overlapped(phone)
        overlapped = self._phones[place.start : place.stop]
        self.counts.revised += sum(old != phone for old in overlapped)
        placed = [] if phone.is_silence else [phone]
        if overlapped and overlapped[0].start_s < phone.start_s - min(SAME_S, phone.duration_s / 2):
            cut = overlapped[0]
            placed.insert(0, replace(cut, end_s=phone.start_s))
        self._phones[place.start : place.stop] = placed
        return False

    def _overlapped(self, phone: Phone) -> range:
        """Places of the planned phones that a phone overlaps; empty, but in its place, if there are none."""
        same_s = min(SAME_S, phone.duration_s / 2)
        first = bisect_right(self._phones, phone.start_s + same_s, key=_END)
        return range(first, max(bisect_left(self._phones, phone.end_s - same_s, key=_START), first))

    def _close_late(self, phone: Phone, edge: float) -> None:
        """Close the lips for a bilabial that has just ended."""
        self._known.append(phone)
        if (
            phone.end_s > edge - LATEST_CLOSURE_S
            and not phone.is_silence
            and spelled_of(phone.label, self.profile).contact == "lips"
        ):
            self._kept_holds.append(Hold(edge + RAMP_S, edge + RAMP_S + MIN_HOLD_S))
            self._due = edge, FADE_S

    def cancel(self, at_s: float, *, fade_s: float = 0.2) -> None:
        """End speech: phones at or after ``at_s`` are not said, and the face is neutral ``fade_s`` later.

        :func:`plan_together` must come next. The plan before ``at_s`` is settled; phones that
        are added afterwards are spoken after it.
        """
        if not fade_s > 0:
            raise UsageError(f"fade_s: must be a positive time, got {fade_s}")
        if not at_s < np.inf:
            raise UsageError(f"at_s: got {at_s}, expected a time")
        plan_together([self])
        edge = self._cancelled_s = max(at_s, self.edge_s)
        self.counts.cancelled += sum(phone.end_s > edge for phone in self._phones)
        self._known += [phone for phone in self._phones if phone.end_s <= edge]
        self._phones, self.sure_s = [], -np.inf
        self._due = edge, fade_s
        self._kept_holds = [hold_until(hold, edge) for hold in self.holds if hold.start_s - RAMP_S < edge]
        self._holds = {}

    def _drop_far(self, edge: float) -> None:
        """Drop phones after :data:`PLANNED_LETTERS`."""
        over = bisect_right(self._phones, edge, key=_END)
        letters = list(accumulate(map(len, [phone.label for phone in self._phones[over:]])))
        fit = bisect_right(letters, PLANNED_LETTERS)
        self.counts.dropped += len(letters) - fit
        self._letters = letters[fit - 1] if fit else 0
        del self._phones[over + fit :]

    def _to_plan(self) -> tuple[list[Phone], int]:
        """Drop old phones; return those of the new plan, and the index of the first one with keys that it needs."""
        edge, phones = self._due[0] if self._due else self.edge_s, self._phones
        if self._letters > PLANNED_LETTERS:
            self._drop_far(edge)
        over = bisect_right(phones, edge, key=_END)
        first = min(max(over - BEHIND_PHONES, 0), bisect_right(phones, edge - LATEST_CLOSURE_S, key=_END))
        del phones[:first]
        own, fewest = max(over - first - 1, 0), max(over - first - KEYS_BEHIND, 0)
        while own > fewest and (
            not self.style.context or phones[own].end_s - phones[own].start_s < LONG_S * len(phones[own].label)
        ):
            own -= 1
        return phones[max(own - REACH, 0) :], min(own, REACH)

    def _follow(
        self, path: hermite.Path, said: Sequence[tuple[Phone, str]], left_over: Array, share: float, most_pull: float
    ) -> None:
        """Follow a new path; its difference to what is shown at the edge, ``left_over``, fades.

        A difference that was already fading goes on fading in its time; ``share`` of it, 0 to 1, is new. ``most_pull``
        is its greatest acceleration, weights/s².
        """
        edge, fade_s = self._due or (self.edge_s, FADE_S)
        self._due, self._waits, phones = None, False, self._phones
        self.sure_s = phones[-1 - AHEAD_PHONES].start_s - PLAN_EARLY_S if len(phones) > AHEAD_PHONES else -np.inf
        self._renew_holds([(phone, contact) for phone, contact in said if contact != "none"], edge)
        if not isfinite(edge):  # nothing shown yet: nothing to keep
            self._plans = [StreamPlan(-np.inf, path, 0.0, 0.0, self._plans[0].left_over)]
            return
        last = self._plans[-1]
        left_s = max(last.start_s + last.fade_s - edge, MIN_FADE_S)
        if left_s < fade_s and edge > self._cancelled_s:
            fade_s = left_s + share * (fade_s - left_s)
        pull_s = sqrt(MAX_PULL / max(most_pull, 1.0))
        momentum_s = min(fade_s, MOMENTUM_S, last.shortest_fade_s(edge), pull_s)
        self._plans.append(StreamPlan(edge, path, fade_s, momentum_s, left_over))
        while self._plans[1].start_s < min(edge, self._shown_s):  # plans that are over
            del self._plans[0]

    def _renew_holds(self, contacts: Sequence[tuple[Phone, str]], edge: float) -> None:
        """Renew holds: late bilabials close as soon as they can; holds that have begun grow with their phone."""
        before, self._holds = self._holds, {}
        begun_keys = [key for key, hold in before.items() if hold.start_s - RAMP_S < edge]
        for phone, contact in contacts:
            key = key_before = phone.start_s, phone.end_s, phone.label
            if begun_keys and key not in before:  # a phone whose times have changed a little closes once, not twice
                near = (one for one in begun_keys if one[0] < phone.end_s and one[1] > phone.start_s and one in before)
                key_before = next((one for one in near if before[one].contact == contact), key)
            same = before.pop(key_before, None)
            if same is None and phone.end_s <= edge:  # its time is over, and so is what it had to hold
                continue
            hold: Hold | None = same
            if same is None:
                hold = hold_of(phone, contact)
                if hold.start_s - RAMP_S < edge:
                    hold = hold_late(hold, edge)
            elif same.stop_s > phone.end_s:
                hold = hold_until(same, max(phone.end_s, edge))
            elif same.stop_s > edge and key != key_before:
                hold = replace(same, stop_s=max(same.stop_s, hold_of(phone, contact).stop_s))
            if hold:
                self._holds[key] = hold
        begun = [hold_until(hold, edge) for hold in before.values() if hold.start_s - RAMP_S < edge]
        seen_s = min(edge, self._shown_s) - RAMP_S
        self._kept_holds = [hold for hold in (*self._kept_holds, *begun) if hold.stop_s > seen_s]

    @property
    def phones(self) -> Sequence[Phone]:
        """Phones of the plan and those that wait, in time order, without silences and old phones."""
        return self._phones

    @property
    def plan_by_s(self) -> float:
        """Time of the first frame before which :func:`plan_together` must come; infinity if all is planned."""
        return -np.inf if self._due else self.sure_s - self.horizon_s if self._waits else np.inf

    @property
    def holds(self) -> list[Hold]:
        """Holds of contacts, in any order."""
        return [*self._holds.values(), *self._kept_holds]

    def holds_near(self, from_s: float, until_s: float) -> list[Hold]:
        """List the holds that affect the time between two times."""
        starts_s, stops_s = until_s + RAMP_S, from_s - RAMP_S
        return [hold for hold in self.holds if hold.start_s < starts_s and hold.stop_s > stops_s]

    def plan_at(self, time_s: float) -> tuple[StreamPlan, float]:
        """Find the plan that is in force at a time, and when the next one takes over (``inf``: none is known)."""
        if self._plans[-1].start_s <= time_s:
            return self._plans[-1], np.inf
        index = max(bisect_right(self._plans, time_s, key=_START) - 1, 0)
        until_s = self._plans[index + 1].start_s if index + 1 < len(self._plans) else np.inf
        return self._plans[index], until_s

    def settle(self, time_s: float) -> None:
        """Settle the plan up to the horizon after ``time_s``, which was shown."""
        self._shown_s = max(self._shown_s, time_s)


def plan_together(planners: Sequence[StreamingPlanner]) -> None:
    """Plan streams with new phones, from the edge of each on; the more of them, the less each costs.

    Parameters
    ----------
    planners : sequence of StreamingPlanner
        Of one profile and style; those that took nothing new keep their path.
    """
    planners = [planner for planner in planners if planner.plan_by_s < np.inf]
    if not planners:
        return
    one = planners[0]
    tracks = [planner._to_plan() for planner in planners]
    edges_s = [planner._due[0] if planner._due else planner.edge_s for planner in planners]
    keys = speech_keys(tracks, one.profile, context=one.style.context)
    paths = keys.paths()
    for planner, edge_s in zip(planners, edges_s, strict=True):
        while isfinite(edge_s) and planner._plans[-1].start_s >= edge_s:  # never shown
            planner._plans.pop()
    at_s = np.array([edge_s if isfinite(edge_s) else 0.0 for edge_s in edges_s])
    plans = [planner._plans[-1] for planner in planners]
    both = hermite.jets_at([*paths, *(plan.path for plan in plans)], np.concatenate([at_s, at_s]))
    new, old = both[: len(plans)], both[len(plans) :]
    changes = old - new
    _add_fades(old, plans, at_s)
    left_over = old - new
    sizes = [np.abs(jets[:, :2]).sum(axis=2) @ (1.0, FADE_S) for jets in (changes, left_over - changes)]
    shares = sizes[0] / np.maximum(sizes[0] + sizes[1], 1e-9)
    pulls = np.abs(left_over[:, 2]).max(axis=1)
    for planner, *follows in zip(planners, paths, keys.said, left_over, shares.tolist(), pulls.tolist(), strict=True):
        planner._follow(*follows)


def jets_at(plans: Sequence[StreamPlan], times_s: Array) -> Array:
    """(S, 3, K): value, velocity and acceleration of many plans, each at its own time, (S,) s."""
    jets = hermite.jets_at([plan.path for plan in plans], times_s)
    _add_fades(jets, plans, times_s)
    return jets


def _add_fades(jets: Array, plans: Sequence[StreamPlan], times_s: Array) -> None:
    """Add what fades in plans at times, (S,) s, to their paths' (S, 3, K)."""
    timing = np.array([(plan.start_s, plan.fade_s, plan.momentum_s) for plan in plans])
    since_s, fade_s, momentum_s = times_s - timing[:, 0], timing[:, 1], timing[:, 2]
    fading = np.flatnonzero(since_s < fade_s)
    if len(fading):
        since_s, fade_s, momentum_s = since_s[fading], fade_s[fading], momentum_s[fading]
        both = np.concatenate([since_s, np.minimum(since_s, momentum_s)]), np.concatenate([fade_s, momentum_s])
        slow, quick = hermite.moments(*both).reshape(2, len(fading), 3, 6)
        shares = np.concatenate([slow[..., :1], quick[..., 1:3]], axis=-1)
        left_over = np.concatenate([plans[index].left_over for index in fading.tolist()])
        jets[fading] += shares @ left_over.reshape(len(fading), 3, -1)
