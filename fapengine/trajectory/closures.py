"""Closures: guaranteed contacts (lips, lips and teeth), vowels that open, jaws that stay high. Applied last.

Theory of operation
-------------------
A spline through keyframes leaves the lips apart in many bilabials, and an expression added on top opens more of them,
lifts the lower lip off the teeth, or presses a vowel shut. So the three pairs of inner-lip points (middle, left, right)
are corrected last, in FAPs, and so in shares of the face's own mouth-nose distance; millimetres below are the recorded
face's. Each contact has a *hold* with C2 ramps, a bump ``b`` between 0 and 1; with ``p`` for :func:`soft_positive`:

0. ``jaw``: teeth are near each other in s and z; the jaw is down by at most :data:`SIBILANT_FAPU`.
1. ``open``: an open vowel, θ or ð parts the lips by at least :data:`OPEN_FAPU`; ``b p(floor - opening)`` is added.
2. ``teeth``: the lower lip rises to the upper teeth, its height in the neutral face, and not far beyond:
   ``b (p(height - lower) - p(lower - top))`` is added to it; the upper lip moves a little less (:data:`BITTEN_SHARE`).
3. lips that are near each other come nearer (:data:`NEAR_SHARE`), and where they would pass through each other the
   opening is held at zero: ``p(opening)``, C2;
4. ``lips``: over the hold of every p b m it is multiplied by ``1 - b``: zero through the hold; ``glide``: over that
   of w by ``1 - GLIDE_SHARE b``;
5. what the upper lip cannot carry the lower one takes, so that no contact is lost when values are clipped.

What comes later wins. The lower lip takes :data:`LOWER_SHARE` of each change of the opening, the upper lip the rest;
while the lower lip is held at the teeth the upper one takes all of 3 and 4. Outer lips follow the inner. Lips come in
within what a stream can carry; styles and expressions that exaggerate leave it. Every step is C2 in time, but where
a value is at the end of its range, and acts on each frame alone, so it serves a stream as well.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array
from fapengine.geometry.smooth import bump, smoothstep, soft_positive
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import limits
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.context import MAX_DURATION_S

PAIRS = ((4, 5, 51, 52), (8, 10, 55, 57), (9, 11, 56, 58))
"""FAPs of the inner upper, inner lower, outer upper and outer lower lip: middle, left, right. All count in MNS; upper
ones are positive downwards and lower ones upwards, so a pair's opening is minus its sum."""
LOWER_SHARE = 0.6
"""The lower lip does more of a closure; it has the jaw's help."""
HOLD = {"lips": (0.0, 1.0), "teeth": (0.4, 0.7), "open": (0.35, 0.65), "jaw": (0.2, 0.8), "glide": (0.0, 0.4)}
"""Part of a phone in which its contact holds, as fractions of its duration. Of those tried these fit the captured lips
best: the lower lip is highest at 0.67 of f and v (median), lips that say w are nearest to each other at 0.05 of it."""
CONTACTS = tuple(HOLD)
TOUCHES = "lips", "teeth"
BURST_S = 0.03
"""Time before the end of p b m at which the lips begin to part, for the burst is within the phone. Captured lips are
1.5 mm apart 32 ms before the end of p, 18 ms before that of b (medians of 279 and 395), planned ones 22 and 10."""
JOINED_SHARE = 0.5
"""Part of a label of several letters, such as pf, in which its touch holds."""
MIN_HOLD_S = 0.04
"""Least duration of a touch; a phone that is shorter holds it from its beginning."""
RAMP_S = 0.045
"""Duration of the ramp before a hold, and after those that :data:`RELEASE_S` lacks. Shorter ones before it fit the
captured lips a little better and move them faster than people do."""
RELEASE_S = {"lips": 0.03, "glide": 0.03}
"""Duration of the ramp after a hold: a burst opens the lips within a frame of video. In the 40 ms after they are 1.5 mm
apart, captured lips open by 5.9 mm out of p b, planned ones by 6.1 (means of 674)."""
GLIDE_SHARE = 0.6
"""Part of their opening that lips lose in w. The least opening of captured ones is 0.5 mm, of planned ones 0.7, and 1.5
without it (means of 323)."""
SOFTNESS_FAPU = 20.0
"""About 0.4 mm on the recorded face."""
TEETH_FAPU = 0.0
"""Height of the lower lip at the teeth. Captured in 239 f and v: -0.2 mm (median at the least opening); the edge of the
default head's upper teeth stands 0.3 mm below the neutral lips."""
BITTEN_FAPU = 110.0
"""2.3 mm: higher the lower lip is not in 99 of 100 captured f and v. It matters to styles that exaggerate."""
BITTEN_SHARE = 1 / 6
"""Part of the upper lip's movement that the context model leaves out at the teeth: what :data:`.faps.UPPER_GAIN` adds,
which f and v do not have. Their opening is off by 1.13 mm with it, 1.22 without, 1.17 where a fourth is left out."""
OPEN_FAPU = 180.0
"""3.7 mm, of which 3.5 are seen in θ, with the tongue between the lips (JD3: 3.4 to 4.0). Captured vowels with an
open jaw, of 60 ms and more, open by 8.6 mm and more in 99 of 100 cases; what is promised is less, so that it shapes
nothing that was not in the way. It is kept by vowels of 80 ms and more; between two closures shorter ones open by what
the ramps leave (half of it at 60 ms)."""
SIBILANT_FAPU = 240.0
"""Greatest open_jaw: 5 mm at the chin. Planned s and z have 4.3 on the average, so what is promised shapes only what an
expression or a style adds."""
NEAR_FAPU = 264.0
"""5.5 mm: the opening below which lips come nearer to each other than a space's modes tell."""
NEAR_SHARE = 0.5
"""Share of ``1 - smoothstep(opening / NEAR_FAPU)`` by which they do. Lips that touch are pressed while the rest of
the mouth goes on closing, which no sum of modes shows: where the captured markers' modes say 1.3, 2.5, 3.5, 4.5 mm
the lips are 0.3, 0.8, 2.1, 3.8 mm apart, about what a share of 1 makes of it. A plan is a mean, which is rarely as
extreme as what it is the mean of, so it gets half: no mean error grows, and of closing lips 59 % are found where 43 %
were."""
SIDE_OPENING = 0.6
"""Opening at the sides, as a share of the middle's."""


_COLUMNS = np.array([fap.columns(*numbers) for numbers in PAIRS]).T
_INNER, _OUTER = _COLUMNS[:2], _COLUMNS[2:]
"""(2, 3): columns of the upper and lower lip, in the middle, left and right."""
_JAW = fap.column(3)
_LOW, _HIGH = (
    np.array(ends).reshape(3, 2).T[..., None]
    for ends in zip(*(limits(n) for pair in PAIRS for n in pair[:2]), strict=True)
)
"""(2, 3, 1), FAPU."""
_SCALE = np.array([[1.0], [SIDE_OPENING], [SIDE_OPENING]])
_OPEN, _PER_NEAR = _SCALE * OPEN_FAPU + SOFTNESS_FAPU / 2, 1.0 / (_SCALE * NEAR_FAPU)


@dataclass(frozen=True, slots=True)
class Hold:
    """Time in which a contact holds."""

    start_s: float
    stop_s: float
    contact: str = "lips"
    """A key of :data:`HOLD`."""


def hold_of(phone: Phone, contact: str = "lips") -> Hold:
    """Time in which a phone keeps its contact; from its ends as far as in the longest that counts."""
    begin, end = HOLD[contact]
    more_s = max(phone.duration_s - MAX_DURATION_S, 0.0)
    counted_s = phone.duration_s - more_s
    start_s, stop_s = phone.start_s + begin * counted_s, phone.start_s + end * counted_s + more_s
    if contact == "lips":
        is_joined = len(ipa.letters(phone.label)) > 1
        stop_s = phone.start_s + JOINED_SHARE * phone.duration_s if is_joined else stop_s - BURST_S
    if contact in TOUCHES and stop_s - start_s < MIN_HOLD_S:
        start_s = max(min(start_s, phone.end_s - MIN_HOLD_S), phone.start_s)
        stop_s = start_s + MIN_HOLD_S
    return Hold(start_s, stop_s, contact)


def hold_late(hold: Hold, edge_s: float) -> Hold | None:
    """Delay a hold so that nothing of it is seen before ``edge_s``; None if it is not a touch and is over by then."""
    start_s = edge_s + RAMP_S
    if hold.contact not in TOUCHES:
        return Hold(start_s, hold.stop_s, hold.contact) if start_s < hold.stop_s else None
    return Hold(start_s, max(hold.stop_s, start_s + MIN_HOLD_S), hold.contact)


def hold_until(hold: Hold, end_s: float) -> Hold:
    """End a hold early, with speech or with its phone; a touch lasts :data:`MIN_HOLD_S` nevertheless."""
    stop_s = max(end_s, hold.start_s + MIN_HOLD_S)
    return Hold(hold.start_s, stop_s, hold.contact) if stop_s < hold.stop_s else hold


def holds_of(said: Iterable[tuple[Phone, str]]) -> list[Hold]:
    """List the holds of all phones that touch or must open; each phone comes with its contact."""
    return [hold_of(phone, contact) for phone, contact in said if contact != "none"]


class Holds:
    """Holds of a long track, from which those near a stretch of time are taken."""

    def __init__(self, holds: Sequence[Hold]) -> None:
        self._holds = holds
        self._from_s = np.array([hold.start_s for hold in holds]) - RAMP_S
        self._until_s = np.array([hold.stop_s for hold in holds]) + RAMP_S

    def near(self, times_s: Array) -> list[Hold]:
        """Those that may be seen at any of these times, (T,) s, rising."""
        seen = (self._from_s <= times_s[-1]) & (self._until_s >= times_s[0])
        return [self._holds[index] for index in np.flatnonzero(seen).tolist()]


def held(times_s: Array, holds: Sequence[Hold]) -> Array:
    """(5, T): how far each moment is under a hold of each of :data:`CONTACTS`, 0 to 1; times rise."""
    free = np.ones((len(CONTACTS), len(times_s)))
    for hold in holds:
        first, last = np.searchsorted(times_s, (hold.start_s - RAMP_S, hold.stop_s + RAMP_S)).tolist()
        release_s = RELEASE_S.get(hold.contact, RAMP_S)
        heights = bump(times_s[first:last], hold.start_s, hold.stop_s, RAMP_S, release_s)
        free[CONTACTS.index(hold.contact), first:last] *= 1.0 - heights
    return 1.0 - free


def close_lips(
    faps: Array, times_s: Array, holds: Sequence[Hold], *, openness: float = 1.0, bitten_share: float = 0.0
) -> Array:
    """Correct lip FAPs, (T, 68) FAPU, so that contacts are made and lips never pass through each other.

    ``openness``, 0..1, scales what open vowels are held to, for a face that mumbles; ``bitten_share``: :func:`settle`.
    """
    shares = held(times_s, holds) * np.array([1.0, 1.0, openness, 1.0, 1.0])[:, None]
    return settle(faps, shares, bitten_share=bitten_share)


def settle(faps: Array, held: Array, *, bitten_share: float = 0.0) -> Array:
    """Make contacts, frame by frame: steps 0 to 5 of the theory of operation.

    Parameters
    ----------
    faps : (N, 68) float64, FAPU
    held : (5, N) float64
        How far each frame is under a hold of each of :data:`CONTACTS`, 0 to 1.
    bitten_share : float
        Part of the upper lip's movement that is left out at the teeth.

    Returns
    -------
    (N, 68) float64, FAPU
    """
    lips, teeth, vowels, jaw, glide = held
    shuts, bites, opens, lifts, glides = np.logical_or.reduce(held, axis=1).tolist()
    settled = faps.copy(order="K")
    columns = settled.T
    if lifts:
        down = columns[_JAW]
        down -= jaw * soft_positive(down + SOFTNESS_FAPU / 2 - SIBILANT_FAPU, SOFTNESS_FAPU)
    wished = columns[_INNER]
    upper, lower = np.minimum(np.maximum(wished, _LOW), _HIGH)  # (3, N): middle, left, right
    if opens:
        parted = vowels * soft_positive(_OPEN + upper + lower, SOFTNESS_FAPU)
        upper -= (1 - LOWER_SHARE) * parted
        lower -= LOWER_SHARE * parted
    if bites:
        upper *= 1.0 - bitten_share * teeth
        short = soft_positive(TEETH_FAPU + SOFTNESS_FAPU / 2 - lower, SOFTNESS_FAPU)
        beyond = soft_positive(lower + SOFTNESS_FAPU / 2 - BITTEN_FAPU, SOFTNESS_FAPU)
        lower += teeth * (short - beyond)
    opening = np.negative(upper + lower)
    parting = soft_positive(opening, SOFTNESS_FAPU)
    near = 1.0 - smoothstep(parting * _PER_NEAR)  # and as far as nothing holds them open
    near *= NEAR_SHARE * ((1.0 - teeth) * (1.0 - vowels)) if bites or opens else NEAR_SHARE
    parting -= near * parting
    if shuts or glides:
        parting *= (1.0 - lips) * (1.0 - GLIDE_SHARE * glide)
    opening -= parting
    opening *= 1.0 - LOWER_SHARE * (1.0 - teeth) if bites else 1.0 - LOWER_SHARE
    upper += opening
    carried = np.minimum(np.maximum(upper, _LOW[0]), _HIGH[0])
    inner = np.array([carried, np.negative(parting + carried)])
    columns[_INNER] = inner
    inner -= wished
    columns[_OUTER] += inner
    return settled
