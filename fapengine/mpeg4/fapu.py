"""Face Animation Parameter Units: ISO/IEC 14496-2, Annex C, Table C.2."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap

AU_RAD = 1e-5
"""One angular unit in radians (Table C.2)."""
STEPS = 1024
"""Steps of a FAPU in its neutral-face distance (Table C.2)."""
EYE_LIDS = (("3.1", "3.3"), ("3.2", "3.4"))
"""Upper and lower lid of the left and the right eye."""


@dataclass(frozen=True, slots=True)
class Fapu:
    """The five neutral-face distances of one face, in mm."""

    irisd0_mm: float
    """Iris diameter: the lid distance y(3.1) - y(3.3)."""
    es0_mm: float
    """Eye separation: x(3.5) - x(3.6)."""
    ens0_mm: float
    """Eye to nose base: y(3.5) - y(9.15)."""
    mns0_mm: float
    """Nose base to mouth: y(9.15) - y(2.2)."""
    mw0_mm: float
    """Mouth width: x(8.3) - x(8.4)."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise UsageError(f"{name}: must be a positive length in mm, got {value}")

    def unit(self, unit: fap.FapUnit) -> float:
        """Size of one step: mm for lengths, rad for ``AU``.

        Examples
        --------
        >>> Fapu(irisd0_mm=11, es0_mm=62, ens0_mm=47, mns0_mm=22, mw0_mm=51.2).unit(fap.FapUnit.MW)
        0.05
        """
        if unit is fap.FapUnit.AU:
            return AU_RAD
        distance_mm: float = getattr(self, f"{unit.value.lower()}0_mm")
        return distance_mm / STEPS

    def steps(self) -> Array:
        """Size of one step of every FAP: (68,) float64, mm or rad; 0 for the high-level FAP 1 and 2."""
        sizes = np.zeros(fap.FAP_COUNT)
        for row in fap.FAPS:
            sizes[fap.column(row.number)] = self.unit(row.unit)
        return sizes

    @classmethod
    def measure(cls, points_mm: Mapping[str, ArrayLike]) -> "Fapu":
        """Measure a neutral face.

        Parameters
        ----------
        points_mm : mapping of str to (3,) array_like, mm
            Feature points 2.2, 3.1 to 3.6, 8.3, 8.4 and 9.15 in head axes: +x subject's left, +y up, +z forward.

        Raises
        ------
        UsageError
            If a point is missing or a distance is not positive.
        """
        needed = ("2.2", "3.1", "3.2", "3.3", "3.4", "3.5", "3.6", "8.3", "8.4", "9.15")
        missing = [name for name in needed if name not in points_mm]
        if missing:
            raise UsageError(f"points_mm: missing feature points {missing}; needs {list(needed)}")
        return cls(**measure_distances(points_mm))


def measure_distances(points_mm: Mapping[str, ArrayLike]) -> dict[str, float]:
    """Distances of a neutral face that some of its feature points, (3,) each, determine, by field of :class:`Fapu`.

    Points are those of :meth:`Fapu.measure`; where the lids of one eye are missing, those of the other count.
    """
    x, y = ({name: float(np.asarray(place)[axis]) for name, place in points_mm.items()} for axis in (0, 1))
    found = {}
    lids = [(upper, lower) for upper, lower in EYE_LIDS if upper in y and lower in y]
    if lids:
        found["irisd0_mm"] = sum(height for upper, lower in lids for height in (y[upper], -y[lower])) / len(lids)
    if "3.5" in x and "3.6" in x:
        found["es0_mm"] = x["3.5"] - x["3.6"]
        if "9.15" in y:
            found["ens0_mm"] = (y["3.5"] + y["3.6"]) / 2 - y["9.15"]
    if "9.15" in y and "2.2" in y:
        found["mns0_mm"] = y["9.15"] - y["2.2"]
    if "8.3" in x and "8.4" in x:
        found["mw0_mm"] = x["8.3"] - x["8.4"]
    return found


def faps_of_displacements(moved_mm: Mapping[str, Array], fapu: Fapu) -> Array:
    """FAPs of displaced feature points, (T, 68) float64, FAPU, not rounded; those of other points and angles are 0.

    Parameters
    ----------
    moved_mm : mapping of str to (T, 3) float64, mm
        From the neutral face, head axes.
    fapu : Fapu
        Of the face that moved.

    Notes
    -----
    FAP 18 moves the chin boss (2.10) against the jaw: motion of the jaw (2.1) does not count.
    """
    faps = np.zeros((len(next(iter(moved_mm.values()))), fap.FAP_COUNT))
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.point not in moved_mm or row.unit is fap.FapUnit.AU:
            continue
        moved = moved_mm[row.point]
        if row.number == 18 and "2.1" in moved_mm:
            moved = moved - moved_mm["2.1"]
        faps[:, fap.column(row.number)] = moved @ np.array(axis) / fapu.unit(row.unit)
    return faps
