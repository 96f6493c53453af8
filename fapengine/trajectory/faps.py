"""From the viseme space to FAPs, for files and live sessions.

Displacements become FAPs through the FAPU of the recorded face and each FAP's direction
(:func:`displacements_to_faps`). The space determines FAP 3-18 (jaw, inner lips, chin), 39-42 (cheeks) and 51-60 (outer
lips). FAP 18 moves the chin boss against the jaw: what the jaw carries it is taken off.

So speech is one matrix product (:class:`Composer`). An expression is added to it, less where it pulls at held corners
(:func:`.phonetics.give_way`); then contacts are made (:func:`.closures.settle`), and gestures are added.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu, faps_of_displacements
from fapengine.profiles import Profile
from fapengine.trajectory.closures import BITTEN_SHARE, settle
from fapengine.trajectory.gestures import add_gestures
from fapengine.trajectory.phonetics import ROUND, give_way, layer_faps, layer_gain
from fapengine.trajectory.style import Style, jaw_share

DETERMINED = (*range(3, 19), *range(39, 43), *range(51, 61))
UPPER_LIP = fap.columns(4, 8, 9, 51, 55, 56)
UPPER_GAIN = 1.2
"""Size of the upper lip's share of what the context model plans, a mean that moves less than a person: so the upper lip
has 0.95 of the captured standard deviation, 0.81 without, and 0.98 with natural variation. Chosen on three splits of
training sentences, where with natural variation as many words are misread as at 1.1 (15.0 and 15.1 %)."""
DETERMINED_POINTS = tuple(dict.fromkeys(fap.spec(number).point for number in DETERMINED))
"""Feature points of these FAPs; no other FAP moves one of them."""


def displacements_to_faps(displacement_mm: Array, points: Sequence[str], fapu: Fapu) -> Array:
    """Measure the determined FAPs.

    Parameters
    ----------
    displacement_mm : (T, P, 3) float64, mm
        From the rest face, head axes.
    points : sequence of str
        P feature point names.
    fapu : Fapu
        Of the face that moved.

    Returns
    -------
    (T, 68) float64, FAPU, not rounded; other columns are 0.
    """
    index = {name: column for column, name in enumerate(points)}
    return faps_of_displacements({point: displacement_mm[:, index[point]] for point in DETERMINED_POINTS}, fapu)


def speech_faps(profile: Profile, weights: Array, *, context: bool = True) -> Array:
    """(T, 68) FAPU that speech shows for (T, K) weights of the space, before contacts are made."""
    space = profile.space
    faps = displacements_to_faps(space.to_points_mm(weights), space.points, profile.fapu)
    faps[:, UPPER_LIP] *= UPPER_GAIN if context else 1.0
    return faps


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """Expressions, gestures and gains of N frames of speech."""

    expression: Array
    """(68, N) FAPU, added before contacts are made."""
    gestures: Array
    """(68, N) FAPU, added afterwards."""
    jaw: Array
    """(N,): size of the jaw's part of speech, times that of the style."""
    lips: Array
    """(N,): the same of the lips' part."""


class Composer:
    """FAPs of a profile's speech in a style."""

    def __init__(self, profile: Profile, style: Style) -> None:
        self._modes, self._jaws = profile.space.mode_count, jaw_share(profile).T
        self._jaw_gain, self._lips_gain, self._settles = style.jaw_gain, style.lips_gain, style.method != "published"
        self._size, self._openness = layer_gain(style.lips_gain), np.minimum(1.0, np.array(style.jaw_gain))
        self._bitten_share = BITTEN_SHARE if style.context else 0.0
        modes = speech_faps(profile, style.gains(profile), context=style.context)
        self._lift = np.vstack([modes, layer_faps(profile)]).T
        """(68, K + axes) FAPU per weight, and per unit of :mod:`.phonetics`."""

    def faps(self, weights: Array, held: Array, overlay: Overlay | None) -> Array:
        """Compose N frames: of many sessions at one time, or of one file.

        Parameters
        ----------
        weights : (K + axes, N) float64
            Places on paths; overwritten.
        held : (5, N) float64
            How far each frame is under a hold of each of :data:`.closures.CONTACTS`, 0 to 1; overwritten.
        overlay : Overlay, optional

        Returns
        -------
        (N, 68) float64, FAPU
        """
        modes, layer = weights[: self._modes], weights[self._modes :]
        size, openness = self._size, self._openness
        if overlay:
            jaws = (overlay.jaw - overlay.lips) * (self._jaws @ modes)
            modes *= overlay.lips
            modes += jaws
            size = layer_gain(self._lips_gain * overlay.lips)
            openness = np.minimum(1.0, self._jaw_gain * overlay.jaw)
        layer *= size
        faps = (self._lift @ weights).T
        if overlay and overlay.expression.any():
            faps += give_way(overlay.expression, layer[ROUND]).T
        held[2] *= openness
        settled = settle(faps, held, bitten_share=self._bitten_share) if self._settles else faps
        if overlay:
            add_gestures(settled, overlay.gestures.T)
        return settled
