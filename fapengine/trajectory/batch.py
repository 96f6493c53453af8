"""Many sessions at once: what a ``StreamingPlanner`` shows, for all sessions of a server in one call.

Theory of operation
-------------------
Each session has its own planner, because their phones differ; phones of all sessions since the last frame are planned
together (:func:`.targets.speech_keys`). Showing is the same for all, so it is done on arrays with one row a session:

1. *window*: the next :data:`KNOTS` knots of a session's plan, its fade, and its holds. Copied from the planner when the
   plan has changed, when another plan takes over, or when the window is used up.
2. *segment*: coefficients of the quintic between two knots. Computed when a session crosses a knot, for all that do.
3. every frame: one Horner scheme over all sessions in the space of modes, what is left of fades, FAPs with expressions,
   contacts and gestures (:mod:`.faps`), and rounding.

A row equals the frame of a planner of its own, FAP for FAP; only the order of additions differs.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.geometry.smooth import smoothstep
from fapengine.mpeg4.track import to_codable
from fapengine.profiles import Profile
from fapengine.speech.phone_track import Phone
from fapengine.trajectory import hermite
from fapengine.trajectory.closures import CONTACTS, RAMP_S, RELEASE_S, Hold
from fapengine.trajectory.faps import Composer, Overlay
from fapengine.trajectory.phonetics import WIDTH
from fapengine.trajectory.stream import Counts, StreamingPlanner, plan_together
from fapengine.trajectory.style import Style

KNOTS = 16
"""Number of knots of a plan in a session's window; two or three fall to a phone, so they last for half a second and
more."""
RELEASES_S = np.array([RELEASE_S.get(contact, RAMP_S) for contact in CONTACTS])
_BOTH, _POWERS = np.arange(2), np.arange(3.0)
FIRST_ROWS, FIRST_HOLDS = 16, 4
"""Numbers of rows, and of holds in each, that a batch begins with; they double when they are full."""


class _Rows:
    """State of each session, (rows, ...) each; times are the session's own. Stateful."""

    def __init__(self, rows: int, holds: int, modes: int) -> None:
        self.session = np.zeros(rows, np.int64)
        self.begins_s = np.zeros(rows)
        """Batch's time at which the session's time is 0."""
        self.shown_s = np.full(rows, -np.inf)
        """Its time in the last frame; minus infinity before the first."""
        self.plan_by_s = np.full(rows, np.inf)
        """:attr:`.stream.StreamingPlanner.plan_by_s`."""
        self.reload_s = np.full(rows, -np.inf)
        """Time from which the window is of no use."""
        self.knots_s = np.zeros((rows, KNOTS))
        """Rising, filled up with infinity."""
        self.jets = np.zeros((rows, KNOTS, 3, modes))
        """Value, velocity and acceleration at the knots."""
        self.last = np.zeros(rows, np.int64)
        """Knot that begins the last segment."""
        self.fade_from_s = np.zeros(rows)
        self.fade_until_s = np.full(rows, -np.inf)
        self.fade_rate = np.zeros(rows)
        """One over the length of the fade."""
        self.momentum_rate = np.zeros(rows)
        """One over the time in which velocity and acceleration fade."""
        self.fade = np.moveaxis(np.zeros((3, modes, rows)), -1, 0)
        """Value, velocity and acceleration that fade, the last two per their fade and its square. Sessions are next to
        each other in memory."""
        self.hold_from_s = np.full((rows, holds), np.inf)
        """Time at which its ramp begins; filled up with infinity; so the next."""
        self.hold_until_s = np.full((rows, holds), np.inf)
        """Time at which its release has ended."""
        self.hold_contact = np.zeros((rows, holds), np.int64)
        """Index in :data:`.closures.CONTACTS`."""
        self.until_s = np.zeros(rows)
        """End of the segment."""
        self.from_s = np.zeros(rows)
        self.rate = np.zeros(rows)
        """One over the segment's length."""
        self.quintic = np.moveaxis(np.zeros((6, modes, rows)), -1, 0)
        """Coefficients of the segment. Sessions are next to each other in memory."""

    def grown(self, rows: int, holds: int) -> "_Rows":
        """Copy into more room."""
        wider = _Rows(rows, holds, self.jets.shape[-1])
        for name, old in vars(self).items():
            getattr(wider, name)[tuple(slice(length) for length in old.shape)] = old
        return wider

    def move(self, source: int, target: int) -> None:
        """Copy a row to another."""
        for array in vars(self).values():
            array[target] = array[source]


class BatchPlanner:
    """Streams of many sessions, shown together. Sessions open and close at any time.

    Stateful.

    Parameters
    ----------
    profile : Profile
        Of all sessions.
    style : Style, optional
        Of all sessions; see :class:`~fapengine.trajectory.stream.StreamingPlanner`.
    horizon_s : float
        See :class:`~fapengine.trajectory.stream.StreamingPlanner`.
    """

    def __init__(self, profile: Profile, style: Style | None = None, *, horizon_s: float = 0.0) -> None:
        self._profile = profile
        self._style = style or Style.speech_only()
        self._horizon_s = horizon_s
        self._new_planner()  # refuses what it cannot do, at once
        self._planners: list[StreamingPlanner] = []
        self._row_of: dict[int, int] = {}
        self._opened = 0
        self._now_s = -np.inf
        self._rows = _Rows(FIRST_ROWS, FIRST_HOLDS, profile.space.mode_count + WIDTH)
        self._composer = Composer(profile, self._style)

    @property
    def sessions(self) -> NDArray[np.int64]:
        """(S,) numbers of the open sessions, in the order of a frame's rows. The last moves where one closes."""
        return self._rows.session[: len(self._planners)].copy()

    def row(self, session: int) -> int:
        """Find a session's row."""
        if session not in self._row_of:
            raise UsageError(f"session: got {session}, expected one of {len(self._planners)} that are open")
        return self._row_of[session]

    def open(self, begins_s: float = 0.0) -> int:
        """Begin a session.

        Parameters
        ----------
        begins_s : float
            When its time is 0, in the batch's time; its phones count from there.

        Returns
        -------
        int
            Its number, never used again.
        """
        if not np.isfinite(begins_s):
            raise UsageError(f"begins_s: got {begins_s}, expected a time")
        row, session = len(self._planners), self._opened
        if row == len(self._rows.session):
            self._rows = self._rows.grown(2 * row, self._rows.hold_from_s.shape[1])
        self._opened += 1
        self._planners.append(self._new_planner())
        self._row_of[session] = row
        self._rows.session[row] = session
        self._rows.begins_s[row] = begins_s
        self._rows.shown_s[row] = self._rows.reload_s[row] = -np.inf
        self._rows.plan_by_s[row] = np.inf
        return session

    def close(self, session: int) -> None:
        """End a session; another may move into its row."""
        row, last = self.row(session), len(self._planners) - 1
        self._rows.move(last, row)
        self._row_of[int(self._rows.session[row])] = row
        self._planners[row] = self._planners[last]
        self._planners.pop()
        del self._row_of[session]

    def feed(self, session: int, phones: Sequence[Phone], *, is_counted: bool = True) -> int:
        """Add phones, in the session's time; see :meth:`~fapengine.trajectory.stream.StreamingPlanner.take`."""
        planner = self._settled(row := self.row(session))
        late = planner.take(phones, is_counted=is_counted)
        self._rows.plan_by_s[row] = planner.plan_by_s
        return late

    def cancel(self, session: int, at_s: float, *, fade_s: float = 0.2) -> None:
        """End speech at a moment of its time; see :meth:`~fapengine.trajectory.stream.StreamingPlanner.cancel`."""
        self._settled(row := self.row(session)).cancel(at_s, fade_s=fade_s)
        self._rows.plan_by_s[row] = -np.inf

    def retime(self, session: int, begins_s: float) -> None:
        """Shift a session's time against the batch's. It never goes back: it pauses until the new time catches up."""
        if not np.isfinite(begins_s):
            raise UsageError(f"begins_s: got {begins_s}, expected a time")
        self._rows.begins_s[self.row(session)] = begins_s

    def planned(self, session: int) -> Sequence[Phone]:
        """Phones that a session has, from a little before its last frame on, in its time."""
        return self._planners[self.row(session)].phones

    def sure_s(self, session: int) -> float:
        """See :attr:`~fapengine.trajectory.stream.StreamingPlanner.sure_s`."""
        return self._planners[self.row(session)].sure_s

    def counts(self, session: int) -> Counts:
        """Return counts of phones that came late, or were dropped or revised."""
        return self._planners[self.row(session)].counts

    def renew(self, session: int, time_s: float) -> None:
        """Prepare one session's frame again, as :meth:`frames` does for all; an error comes from this session."""
        row, count = np.array([self.row(session)]), len(self._planners)
        times = np.maximum(time_s - self._rows.begins_s[:count], self._rows.shown_s[:count])
        self._plan(row[times[row] >= self._rows.plan_by_s[row]])
        self._load(row, times)
        self._renew_segments(row, times)

    def plan(self) -> None:
        """Plan what was fed and cannot wait; :meth:`frames` does it by itself."""
        self._plan(np.flatnonzero(self._rows.plan_by_s[: len(self._planners)] == -np.inf))

    def frames(self, time_s: float, overlay: Overlay | None = None) -> NDArray[np.int32]:
        """One frame of every session, in the order of :attr:`sessions`; what is shown is settled.

        Parameters
        ----------
        time_s : float
            In the batch's time, not before the last frame asked for.
        overlay : Overlay, optional
            What is added to speech.

        Returns
        -------
        (S, 68) int32, FAPU
            The sessions' values of one FAP are next to each other in memory.
        """
        if not self._now_s <= time_s < np.inf:
            raise UsageError(f"time_s: must be rising times from {self._now_s:g} s, got {time_s:g} s")
        self._now_s = time_s
        count = len(self._planners)
        times = np.maximum(time_s - self._rows.begins_s[:count], self._rows.shown_s[:count])
        self._plan((times >= self._rows.plan_by_s[:count]).nonzero()[0])
        self._rows.shown_s[:count] = times
        self._load((times >= self._rows.reload_s[:count]).nonzero()[0], times)
        self._renew_segments((times >= self._rows.until_s[:count]).nonzero()[0], times)
        faps = self._composer.faps(self._weights(times), self._held(times), overlay)
        return to_codable(faps)

    def _new_planner(self) -> StreamingPlanner:
        return StreamingPlanner(self._profile, self._style, self._horizon_s)

    def _settled(self, row: int) -> StreamingPlanner:
        """Planner of a row; it learns what has been shown."""
        planner = self._planners[row]
        planner.settle(float(self._rows.shown_s[row]))
        return planner

    def _plan(self, rows: NDArray[np.intp]) -> None:
        if len(rows):
            plan_together([self._settled(row) for row in rows.tolist()])
            self._rows.plan_by_s[rows], self._rows.reload_s[rows] = np.inf, -np.inf

    def _load(self, rows: NDArray[np.intp], times_s: Array) -> None:
        """Copy what sessions need from now on out of their planners."""
        if not len(rows):
            return
        now_s = times_s[rows]
        planners = [self._planners[row] for row in rows.tolist()]
        found = [planner.plan_at(time_s) for planner, time_s in zip(planners, now_s.tolist(), strict=True)]
        plans, untils_s = zip(*found, strict=True)
        state, path = self._rows, hermite.in_a_row([plan.path for plan in plans], now_s)
        counts = np.minimum(path.counts - path.left, KNOTS)
        begins = path.first + path.left
        more = path.left + KNOTS < path.counts
        until_s = np.minimum(untils_s, np.where(more, path.times_s[begins + counts - 1], np.inf))
        state.reload_s[rows], state.until_s[rows] = until_s, -np.inf
        slots = _slots(rows, counts)
        state.knots_s[rows] = np.inf
        state.knots_s[slots] = path.times_s[np.repeat(begins, counts) + slots[1]]
        windows = zip(plans, path.left.tolist(), strict=True)
        state.jets[slots] = np.concatenate([plan.path.jets[left : left + KNOTS] for plan, left in windows])
        state.last[rows] = counts - 2
        start_s, fade_s, momentum_s = np.array([(plan.start_s, plan.fade_s, plan.momentum_s) for plan in plans]).T
        ends_s = state.fade_until_s[rows] = start_s + fade_s
        fades = now_s < ends_s
        state.fade_from_s[rows] = np.where(fades, start_s, 0.0)
        state.fade_rate[rows] = 1.0 / np.where(fades, fade_s, 1.0)
        momentum_s = np.where(fades, momentum_s, 1.0)
        state.momentum_rate[rows] = 1.0 / momentum_s
        left_over = np.concatenate([plan.left_over for plan in plans]).reshape(len(plans), 3, -1) * fades[:, None, None]
        state.fade[rows] = left_over * (momentum_s[:, None] ** np.arange(3.0))[..., None]
        near = zip(planners, now_s.tolist(), until_s.tolist(), strict=True)
        self._load_holds(rows, [planner.holds_near(from_s, until_s) for planner, from_s, until_s in near])

    def _load_holds(self, rows: NDArray[np.intp], held: list[list[Hold]]) -> None:
        counts = np.array([len(holds) for holds in held])
        if counts.max() > self._rows.hold_from_s.shape[1]:
            self._rows = self._rows.grown(len(self._rows.session), 2 * int(counts.max()))
        state, slots = self._rows, _slots(rows, counts)
        state.hold_from_s[rows] = np.inf
        every = [hold for holds in held for hold in holds]
        if every:
            contacts = state.hold_contact[slots] = [CONTACTS.index(hold.contact) for hold in every]
            state.hold_from_s[slots] = np.array([hold.start_s for hold in every]) - RAMP_S
            state.hold_until_s[slots] = np.array([hold.stop_s for hold in every]) + RELEASES_S[contacts]

    def _renew_segments(self, rows: NDArray[np.intp], times_s: Array) -> None:
        """Compute coefficients for sessions that have crossed a knot."""
        if not len(rows):
            return
        state = self._rows
        knots, last = state.knots_s[rows], state.last[rows]
        left = np.minimum(np.maximum((knots <= times_s[rows, None]).sum(axis=1) - 1, 0), last)
        every = np.arange(len(rows))
        start_s, end_s = knots[every, left], knots[every, left + 1]
        length_s = end_s - start_s
        state.from_s[rows], state.rate[rows] = start_s, 1.0 / length_s
        state.until_s[rows] = np.where(left < last, end_s, np.inf)
        ends = state.jets[rows[:, None], left[:, None] + _BOTH]
        ends *= (length_s[:, None] ** _POWERS)[:, None, :, None]
        state.quintic[rows] = hermite.UNITS @ ends.reshape(len(rows), 6, -1)

    def _weights(self, times_s: Array) -> Array:
        """(K + axes, S): where every session is in the space, then :mod:`.phonetics`."""
        state, count = self._rows, len(times_s)
        s = _share((times_s - state.from_s[:count]) * state.rate[:count])
        weights: Array = np.einsum("ps,spk->ks", hermite.powers(s), state.quintic[:count])
        if (times_s < state.fade_until_s[:count]).any():
            since = times_s - state.fade_from_s[:count]
            slow, quick = _share(since * state.fade_rate[:count]), _share(since * state.momentum_rate[:count])
            for left, share in zip(state.fade[:count].transpose(1, 2, 0), hermite.fading(slow, quick), strict=True):
                weights += left * share
        return weights

    def _held(self, times_s: Array) -> Array:
        """(5, S): what :func:`.closures.held` says of each session and contact, 0..1."""
        state, count = self._rows, len(times_s)
        now, free = times_s[:, None], np.ones((len(CONTACTS), count))
        rows, slots = ((state.hold_from_s[:count] < now) & (now < state.hold_until_s[:count])).nonzero()
        if len(rows):
            contacts, at_s = state.hold_contact[rows, slots], times_s[rows]
            since_s, left_s = at_s - state.hold_from_s[rows, slots], state.hold_until_s[rows, slots] - at_s
            rising, falling = smoothstep([since_s / RAMP_S, left_s / RELEASES_S[contacts]])
            np.multiply.at(free, (contacts, rows), 1.0 - rising * falling)
        return 1.0 - free


def _share(s: Array) -> Array:
    """Limit to 0..1; np.clip takes three times as long for a few sessions."""
    return np.minimum(np.maximum(s, 0.0), 1.0)


def _slots(rows: NDArray[np.intp], counts: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Rows and columns of the first ``counts`` places in each row."""
    before = np.cumsum(counts) - counts
    return np.repeat(rows, counts), np.arange(counts.sum()) - np.repeat(before, counts)
