"""Style: how large a face's movements are in speaking, how they are planned, and which gestures it makes.

Theory of operation
-------------------
Jaw and lips have gains of their own, as in the two-axis field of JALI (Edwards et al. 2016,
doi:10.1145/2897824.2925984): from mumbled (both small) over stiff-jawed and slack-lipped to over-articulated.
In a space of modes the jaw's
share of a pose is what goes with its drop of the chin: with ``c`` the drop that each mode makes and ``S`` the second
moment of the profile's phones, ``g = S c / (c S c)`` is the pose that a millimetre of drop brings on average. A pose
``w`` is ``(c w) g``, the jaw's, plus the rest, the lips'. Both are scaled, so the gains are one matrix.

How fast the speech is needs no setting: phones too short to be reached undershoot, by the durations that the context
model knows (:mod:`.context`) and by the merging of keyframes that stand too near (:data:`.targets.APART_S`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import check_fields, checked
from fapengine.errors import UsageError
from fapengine.models.viseme_space import VisemeSpace
from fapengine.profiles import PhoneTarget, Profile
from fapengine.speaking import GENERATORS, LOUDNESS_DB, MAX_GAIN, METHOD_NAMES, PROVENANCE, WITHOUT, Method

DB_PER_DOUBLE_DROP = 12.0
"""Loudness that opens the jaw twice as far: our choice, not a measurement. That loud speech opens it farther is in
Schulman 1989, doi:10.1121/1.397737."""
DB_PER_DOUBLE_LIPS = 60.0
"""Loudness that moves the lips twice as far: the captured upper lip of 390 vowels is 0.028 mm higher per dB (standard
error 0.016) than planned, 1.2 % of its 2.3 mm. Loud speakers open and spread their lips more (Garnier et al. 2006,
Journées d'Étude sur la Parole)."""
MAX_JAW_DB = 15.0
"""Loudness beyond which the jaw opens no farther: in 5 % of the frames of five English sentences lips are then 29 mm or
more apart (12 mm at 0 dB)."""


@dataclass(frozen=True, slots=True)
class Style:
    """Size of speech's movements, way of planning them, and gestures that are made."""

    articulation: float = 1.0
    """Size of the mouth's movements, 0..3; 1 is the recorded speaker's average."""
    jaw: float = 1.0
    """Size of the jaw's part of them, 0..3."""
    lips: float = 1.0
    """Size of the lips' part, 0..3: what the jaw does not explain."""
    loudness_db: float = 0.0
    """Against the recorded speaker, -20..20: louder speech opens the jaw farther, and moves the lips a little more."""
    method: Method = "context"
    """Method from phones to a path: see :mod:`fapengine.trajectory.methods`."""
    blinks: bool = True
    head_motion: bool = True
    gaze: bool = True
    """Eyes that keep looking ahead while the head moves, and small shifts."""
    idle: bool = True
    """Breath, and slow drifts of brows and mouth corners."""
    emphasis: bool = True
    """A nod and raised brows with the strongest accent of a phrase."""
    liveliness: float = 1.0
    """Natural variation of speech, 0..1: see :mod:`fapengine.trajectory.variation`."""

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("articulation", "jaw", "lips"):
            if not 0 <= getattr(self, name) <= MAX_GAIN:
                raise UsageError(f"{name}: must be 0 to {MAX_GAIN:g}, got {getattr(self, name)}")
        if not 0 <= self.liveliness <= 1:
            raise UsageError(f"liveliness: must be 0 to 1, got {self.liveliness}")
        if not LOUDNESS_DB[0] <= self.loudness_db <= LOUDNESS_DB[1]:
            raise UsageError(f"loudness_db: must be {LOUDNESS_DB[0]:g} to {LOUDNESS_DB[1]:g}, got {self.loudness_db}")
        parse_method(self.method)

    @classmethod
    def speech_only(cls, *, articulation: float = 1.0, method: Method = "context") -> "Style":
        """Speech alone: no gestures, no variation."""
        return cls(articulation, method=method).without(["all"])

    @checked
    def without(self, names: Sequence[str]) -> "Style":
        """Switch generators off.

        Parameters
        ----------
        names : sequence of str
            Of :data:`GENERATORS`, with ``-`` or ``_``; ``"all"`` is every one, and variation. ``"provenance"`` is about
            files, and changes nothing here.

        Raises
        ------
        UsageError
            If there is no such generator.

        Examples
        --------
        >>> Style().without(["head-motion", "gaze"]) == Style(head_motion=False, gaze=False)
        True
        """
        off = [name.replace("-", "_") for name in names]
        for name in off:
            if name not in (*GENERATORS, "all", PROVENANCE):
                raise UsageError(f"without: unknown value {name!r}; use one of {', '.join(WITHOUT)}")
        switched: dict[str, Any] = {name: False for name in GENERATORS if name in off or "all" in off}
        if "all" in off:
            switched["liveliness"] = 0.0
        return replace(self, **switched)

    @property
    def has_gestures(self) -> bool:
        """Whether anything moves beside speech."""
        return any(getattr(self, name) for name in GENERATORS)

    @property
    def context(self) -> bool:
        """Whether a phone's targets depend on its neighbours."""
        return self.method == "context"

    @property
    def jaw_gain(self) -> float:
        """Size of the jaw's movements in all."""
        loudness_db = min(self.loudness_db, MAX_JAW_DB)
        return float(self.articulation * self.jaw * 2.0 ** (loudness_db / DB_PER_DOUBLE_DROP))

    @property
    def openness(self) -> float:
        """Share of the promised opening that an open vowel of this style keeps, 0..1."""
        return min(1.0, self.jaw_gain)

    @property
    def lips_gain(self) -> float:
        """Size of the lips' movements in all."""
        return float(self.articulation * self.lips * 2.0 ** (self.loudness_db / DB_PER_DOUBLE_LIPS))

    @property
    def variation(self) -> float:
        """Share of natural variation that is shown, 0..1; a face that hardly moves hardly varies."""
        return self.liveliness * min(1.0, self.articulation)

    def gains(self, profile: Profile) -> NDArray[np.float64]:
        """Matrix that turns a path of weights, (T, K), into this style's: ``path @ gains``, (K, K)."""
        jaws, lips = jaw_share(profile), self.lips_gain
        return lips * np.eye(len(jaws)) + (self.jaw_gain - lips) * jaws


def parse_method(name: str) -> Method:
    """Find a method by its name."""
    if name in METHOD_NAMES:
        return name
    raise UsageError(f"method: unknown value {name!r}; use one of {', '.join(METHOD_NAMES)}")


@lru_cache(maxsize=16)
def jaw_share(profile: Profile) -> NDArray[np.float64]:
    """Matrix (K, K) that keeps of a pose, a row of weights, what is the jaw's."""
    return np.outer(_chin_drop(profile.space), jaw_pose(profile.space, profile.phones))


def jaw_pose(space: VisemeSpace, phones: Mapping[str, PhoneTarget]) -> NDArray[np.float64]:
    """(K,) weights that go with 1 mm of the chin's drop, on average over phones; 0 where they do not drop it."""
    drop = _chin_drop(space)
    targets = np.concatenate([phone.targets for phone in phones.values()])
    brought: NDArray[np.float64] = (targets @ drop) @ targets
    reach = brought @ drop
    return brought / reach if reach > 0 else np.zeros_like(drop)


def _chin_drop(space: VisemeSpace) -> NDArray[np.float64]:
    """(K,) mm that each mode brings the chin down."""
    return -space.modes_mm[:, space.points.index("2.1"), 1]
