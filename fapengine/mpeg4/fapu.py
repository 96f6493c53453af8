"""Face Animation Parameter Units: ISO/IEC 14496-2, Annex C, Table C.2."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap

AU_RAD = 1e-5
"""One angular unit in radians (Table C.2)."""
STEPS = 1024
"""Steps of a FAPU in its neutral-face distance (Table C.2)."""


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

    def steps(self) -> NDArray[np.float64]:
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
        p = {name: np.asarray(points_mm[name], dtype=np.float64) for name in needed}
        eyes_y = (p["3.5"][1] + p["3.6"][1]) / 2
        lids = (p["3.1"][1] - p["3.3"][1] + p["3.2"][1] - p["3.4"][1]) / 2
        return cls(
            irisd0_mm=float(lids),
            es0_mm=float(p["3.5"][0] - p["3.6"][0]),
            ens0_mm=float(eyes_y - p["9.15"][1]),
            mns0_mm=float(p["9.15"][1] - p["2.2"][1]),
            mw0_mm=float(p["8.3"][0] - p["8.4"][0]),
        )
