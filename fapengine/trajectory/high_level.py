"""FAP 1 and 2, visemes and expressions: as the low-level FAPs that show them, and chosen to follow low-level FAPs.

Theory of operation
-------------------
FAP 1 names two visemes and a blend, FAP 2 two expressions and their intensities (FBA section 9)::

    viseme     = select1 * blend / 63 + select2 * (1 - blend / 63)
    expression = select1 * intensity1 / 63 + select2 * intensity2 / 63

A viseme's face is the profile's first phone of that viseme, spoken alone; an expression's is the profile's. A
low-level FAP whose mask bit is set takes precedence. Any other FAP shows the sum of viseme and expression, from the
first frame on in which FAP 1 or 2 is sent; both keep their last value while they are not sent.

Deviation: the standard's text on these points was not at hand. Our reading is: ``viseme_def`` stores the low-level FAPs
of its frame as the face of the viseme that weighs more, ``expression_def`` stores them as that of the first expression
at its intensity, and while ``init_face`` is on, low-level FAPs move the face away from the expression: they are added.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.errors import DataError
from fapengine.expressions import EXPRESSIONS, Expression
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FAP_2_EXPRESSIONS, FULL_WEIGHT, VISEMES
from fapengine.mpeg4.track import MOUTH, FapTrack, to_codable
from fapengine.profiles import Profile
from fapengine.retarget.blend import PARTED_MM
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style

SPOKEN_S = (0.2, 0.7)
"""Start and end of a phone that is spoken alone; its face is that of the middle."""
HIGH_LEVEL = fap.column(3)
"""Number of columns before FAP 3: those of FAP 1 and 2."""
INNER_LIPS = [MOUTH.index(column) for column in fap.columns(4, 5)]
BLENDS = 9
"""Steps of a blend; 63 is a multiple of it."""
MEETING, SPEAKING, CHANGE_MM = 200.0, 12.0, 5.5
"""How much the square of the opening counts where lips meet and where they are parted, and the error as which a
viseme's share counts that changes by 1 in 1/60 s: less than for weights of all visemes, as only two are shown."""
MAX_STEP, FORBIDDEN = 0.3, 1e9
"""Greatest change of a share in 1/60 s, and the cost of more, which only a leap of the mouth itself is worth."""
KEPT = 128
"""Pairs of a frame from which the next one may come: the cheapest."""


@lru_cache(maxsize=16)
def viseme_faces(profile: Profile) -> Array:
    """(15, 68) float64, FAPU: the face of each viseme of Table C.4. Read-only."""
    still = Style.speech_only()
    faces = np.zeros((len(VISEMES), fap.FAP_COUNT))
    for viseme in VISEMES[1:]:
        phones = PhoneTrack.from_phones([Phone(viseme.phonemes[0], *SPOKEN_S)])
        frames = plan(phones, profile, rng=np.random.default_rng(0), rate_hz=100.0, style=still).track.values
        faces[viseme.number] = frames[round(50 * sum(SPOKEN_S))]
    faces.setflags(write=False)
    return faces


@lru_cache(maxsize=16)
def expression_faces(profile: Profile) -> Array:
    """(7, 68) float64, FAPU: the face of each expression of Table C.5 at full intensity. Read-only."""
    of_profile = expression_faps(profile)
    columns = [EXPRESSIONS.index(Expression[name.upper()]) for name in FAP_2_EXPRESSIONS[1:]]
    faces = np.vstack([np.zeros(fap.FAP_COUNT), of_profile[:, columns].T])
    faces.setflags(write=False)
    return faces


class HighLevelFaps:
    """Shows FAP 1 and 2 of a stream, frame by frame. Stateful."""

    def __init__(self, profile: Profile) -> None:
        self._visemes, self._expressions = viseme_faces(profile).copy(), expression_faces(profile).copy()
        self._viseme: Array | None = None
        self._expression: Array | None = None
        self._is_base = False

    def show(
        self,
        values: NDArray[np.int32],
        mask: NDArray[np.bool_],
        viseme: NDArray[np.int32],
        expression: NDArray[np.int32],
    ) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """Turn one frame into low-level FAPs.

        Parameters
        ----------
        values, mask : (68,) int32, FAPU, and bool
            As rows of :class:`FapTrack`; values count where the mask is set.
        viseme, expression : (4,) and (6,) int32
            FAP 1 and 2; they count where the mask's first two are set.

        Returns
        -------
        values, mask : (68,) int32, FAPU, and bool
            The low-level FAPs that are known in this frame; FAP 1 and 2 are not set.

        Raises
        ------
        DataError
            If there is no such viseme or expression.
        """
        sent = mask.copy()
        sent[:HIGH_LEVEL] = False
        if mask[0]:
            first, second, blend, is_definition = viseme
            _check_selects("viseme", (first, second), len(self._visemes))
            blend = min(max(blend, 0), FULL_WEIGHT)
            if is_definition:
                self._visemes[first if 2 * blend > FULL_WEIGHT else second, sent] = values[sent]
            self._viseme = (blend * self._visemes[first] + (FULL_WEIGHT - blend) * self._visemes[second]) / FULL_WEIGHT
        if mask[1]:
            first, intensity, second, other, is_base, is_definition = expression
            _check_selects("expression", (first, second), len(self._expressions))
            intensity, other = (min(max(weight, 0), FULL_WEIGHT) for weight in (intensity, other))
            self._is_base = bool(is_base)
            if is_definition and intensity:
                self._expressions[first, sent] = values[sent] * (FULL_WEIGHT / intensity)
            self._expression = (intensity * self._expressions[first] + other * self._expressions[second]) / FULL_WEIGHT
        if self._viseme is None and self._expression is None:
            return np.where(sent, values, 0), sent
        zero = np.zeros(fap.FAP_COUNT)
        base = zero if self._expression is None else self._expression
        shown = base + (zero if self._viseme is None else self._viseme)
        shown[sent] = values[sent] + (base[sent] if self._is_base else 0.0)
        known = np.ones(fap.FAP_COUNT, np.bool_)
        known[:HIGH_LEVEL] = False
        return to_codable(shown[None])[0], known


def _check_selects(what: str, selects: tuple[int, int], count: int) -> None:
    for select in selects:
        if not 0 <= select < count:
            raise DataError(f"{what}_select: got {select}, expected 0 to {count - 1}")


def expand(track: FapTrack, profile: Profile) -> FapTrack:
    """Replace FAP 1 and 2 by the low-level FAPs that show them.

    Parameters
    ----------
    track : FapTrack
    profile : Profile
        Its phones are the faces of visemes, its expressions those of FAP 2.

    Returns
    -------
    FapTrack
        Without FAP 1 and 2. A track that has none of them is returned as it is.

    Raises
    ------
    DataError
        If a frame names a viseme or an expression that does not exist.
    """
    if not track.mask[:, :HIGH_LEVEL].any():
        return track
    state = HighLevelFaps(profile)
    rows = [
        state.show(*frame) for frame in zip(track.values, track.mask, track.visemes, track.expressions, strict=True)
    ]
    return replace(
        track,
        values=np.stack([values for values, _ in rows]),
        mask=np.stack([mask for _, mask in rows]),
        visemes=np.zeros_like(track.visemes),
        expressions=np.zeros_like(track.expressions),
    )


def to_visemes(track: FapTrack, profile: Profile) -> FapTrack:
    """Choose the two visemes and the blend of each frame that show a mouth over time; nothing else is kept.

    Parameters
    ----------
    track : FapTrack
        Low-level FAPs.
    profile : Profile
        Its phones are the faces of visemes.

    Returns
    -------
    FapTrack
        FAP 1 in every frame, no other FAP.

    Notes
    -----
    The cheapest sequence of all (Viterbi 1967, doi:10.1109/TIT.1967.1054010): distances of the feature points of jaw,
    lips and chin on the profile's face, squared, in mm; the opening of the lips, which counts as in
    :mod:`fapengine.retarget.blend`; and change between frames. Blends are multiples of 1 / :data:`BLENDS`.
    """
    if not len(track):
        return track
    unit_mm, pace = profile.fapu.steps()[MOUTH], track.rate_hz / 60.0
    shares = _pairs()
    shown, wanted = shares @ (viseme_faces(profile)[:, MOUTH] * unit_mm), track.values[:, MOUTH] * unit_mm
    opened = np.maximum(-wanted[:, INNER_LIPS].sum(axis=1), 0.0)[:, None]
    counted = np.interp(opened, (0.0, PARTED_MM), (MEETING, SPEAKING))
    cost = (shown**2).sum(axis=1) - 2 * wanted @ shown.T + counted * (-shown[:, INNER_LIPS].sum(axis=1) - opened) ** 2
    most = max(MAX_STEP / pace, 1.01 / BLENDS)  # a blend changes by one step at least, at any rate
    change = np.zeros((len(shares), len(shares)))
    for share in shares.T:
        step = np.abs(share[:, None] - share)
        change += (CHANGE_MM * pace * step) ** 2 + FORBIDDEN * (step > most)
    best, before = cost[0], []
    for row in cost[1:]:
        kept = np.argpartition(best, KEPT)[:KEPT]
        through = best[kept, None] + change[kept]
        cheapest = through.argmin(axis=0)
        before.append(kept[cheapest])
        best = through[cheapest, np.arange(len(shares))] + row
    path = [int(best.argmin())]
    for came_from in reversed(before):
        path.append(int(came_from[path[-1]]))
    chosen = shares[path[::-1]]
    visemes = np.zeros((len(track), 4), np.int32)
    visemes[:, :2] = np.sort(np.argpartition(-chosen, 1, axis=1)[:, :2], axis=1)
    visemes[:, 2] = np.rint(np.take_along_axis(chosen, visemes[:, :1], axis=1)[:, 0] * FULL_WEIGHT)
    mask = np.zeros_like(track.mask)
    mask[:, 0] = True
    return replace(
        track, values=np.zeros_like(track.values), mask=mask, visemes=visemes,
        expressions=np.zeros_like(track.expressions),
    )  # fmt: skip


def _pairs() -> Array:
    """(N, 15): every viseme, and every two of them in every blend, as fractions of the 15."""
    alone = np.eye(len(VISEMES))
    first, second = np.triu_indices(len(VISEMES), 1)
    blends = np.arange(1, BLENDS)[:, None, None] / BLENDS
    return np.concatenate([alone, (blends * alone[first] + (1.0 - blends) * alone[second]).reshape(-1, len(VISEMES))])
