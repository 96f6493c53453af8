"""Colours of skin, lips, hair and the inside of the mouth, linear RGB per vertex."""

from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep, spot

TONES = np.array(
    [[0.78, 0.505, 0.368], [0.69, 0.395, 0.258], [0.50, 0.25, 0.138], [0.27, 0.118, 0.060], [0.11, 0.051, 0.028]]
)
"""Skin from very light to very dark."""
BLUSHES = np.array(
    [[0.75, 0.32, 0.25], [0.65, 0.25, 0.175], [0.45, 0.145, 0.09], [0.24, 0.08, 0.048], [0.10, 0.035, 0.024]]
)
LIPS = np.array(
    [[0.56, 0.172, 0.160], [0.530, 0.172, 0.148], [0.345, 0.095, 0.085], [0.20, 0.06, 0.05], [0.115, 0.036, 0.031]]
)

HAIR_COLOURS: dict[str, tuple[float, float, float]] = {
    "black": (0.022, 0.019, 0.018),
    "brown": (0.080, 0.040, 0.021),
    "chestnut": (0.130, 0.055, 0.026),
    "blond": (0.420, 0.270, 0.120),
    "red": (0.260, 0.075, 0.024),
    "grey": (0.300, 0.290, 0.280),
}
"""Hair colours by name, linear RGB."""

EYE_COLOURS: dict[str, tuple[float, float, float]] = {
    "brown": (0.175, 0.080, 0.036),
    "dark": (0.115, 0.058, 0.028),
    "hazel": (0.250, 0.180, 0.072),
    "green": (0.140, 0.172, 0.085),
    "blue": (0.150, 0.245, 0.360),
    "grey": (0.215, 0.250, 0.275),
}
"""Iris colour near the pupil, by name, linear RGB."""
LIP = LIPS[1]
DARK_BROWS = 0.06
"""Mean linear RGB of hair above which brows are darker than the hair."""
MOUTH = np.array([0.27, 0.074, 0.054])
GUM = np.array([0.50, 0.16, 0.15])
TONGUE = np.array([0.52, 0.160, 0.125])
TEETH = np.array([0.795, 0.62, 0.545])
"""Warmer than ivory: light on teeth has been reflected by lips and tongue, and the renderer's light is that of the sky.
"""
EYE = np.array([0.80, 0.77, 0.74])
LASH = np.array([0.030, 0.018, 0.013])
CLOTH_COLOURS: dict[str, tuple[float, float, float]] = {
    "blue": (0.030, 0.060, 0.105),
    "teal": (0.020, 0.090, 0.090),
    "green": (0.040, 0.078, 0.046),
    "plum": (0.090, 0.028, 0.055),
    "rust": (0.210, 0.066, 0.028),
    "mustard": (0.330, 0.190, 0.040),
    "grey": (0.120, 0.122, 0.128),
    "sky": (0.260, 0.350, 0.450),
    "cream": (0.520, 0.460, 0.370),
}
"""Colours of clothes by name, linear RGB."""
CLOTH = np.array(CLOTH_COLOURS["blue"])

BLOOD = np.array([0.35, 1.0, 0.9])
"""Fractions of red, green and blue that more blood in the skin absorbs."""


def _spot(points: Array, centre: tuple[float, float], size: tuple[float, float]) -> Array:
    """(..., 1): a spot on either side of the face, 1 in its middle, that ends before the ears."""
    front = smoothstep((points[..., 2] - 10.0) / 50.0)
    return (spot(np.abs(points[..., 0]), points[..., 1], centre, size) * front)[..., None]


def linear_rgb(srgb: Array) -> Array:
    """Convert sRGB, (...) 0 to 1, to linear RGB (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def brow_colour(hair_colour: str) -> Array:
    """(3,) linear RGB of the brows for a hair colour; those of light hair are darker, so that faces stay readable."""
    hair = np.array(HAIR_COLOURS[hair_colour])
    return hair * min(1.0, DARK_BROWS / float(hair.mean())) ** 0.75


@dataclass(frozen=True, slots=True, eq=False)
class Palette:
    """Colours of one face, linear RGB."""

    base: Array
    blush: Array
    lips: Array
    hair: Array
    brows: Array
    """Darker than light hair."""

    @classmethod
    def of(cls, skin_tone: float = 0.2, hair_colour: str = "brown") -> "Palette":
        """Palette for a skin tone, 0 very light to 1 very dark, and a name in :data:`HAIR_COLOURS`."""
        tones, tables = np.linspace(0, 1, len(TONES)), (TONES, BLUSHES, LIPS)
        base, blush, lips = (np.array([np.interp(skin_tone, tones, part) for part in table.T]) for table in tables)
        return cls(base, blush, lips, np.array(HAIR_COLOURS[hair_colour]), brow_colour(hair_colour))

    def skin(self, points: Array) -> Array:
        """(..., 3) skin: redder cheeks, nose and chin, darker around the eyes, lighter bridge and forehead."""
        colour = np.broadcast_to(self.base, points.shape).copy()
        for centre, size, share in (
            ((46, 0), (20, 15), 0.64), ((0, 0), (13, 10), 0.55), ((0, -66), (15, 9), 0.25), ((20, 0), (5, 10), 0.22),
            ((0, -22), (30, 7), 0.10), ((78, 10), (12, 34), 0.55), ((31, 25), (15, 4), 0.14), ((31, 47), (19, 5), 0.22),
        ):  # fmt: skip
            colour += share * _spot(points, centre, size) * (self.blush - colour)
        colour *= 1 - 0.05 * _spot(points, (30, 36), (20, 13)) - 0.06 * _spot(points, (18, 32), (6, 8))
        colour *= 1 + 0.05 * _spot(points, (0, 72), (36, 18)) + 0.05 * _spot(points, (0, 18), (5, 14))
        return colour

    def lip(self, points: Array, t: Array, level: float) -> Array:
        """(..., 3) lip colour, darker at the mouth line and at the corners."""
        shade = (0.66 + 0.34 * min(level / 0.3, 1.0)) * (1 - 0.38 * np.abs(t) ** 5)
        return self.lips * np.broadcast_to(shade[..., None], points.shape)
