"""``HeadStyle``: what differs from head to head. Every number has a meaning; 1 or 0 is an average adult's."""

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from fapengine.errors import UsageError
from fapengine.mesh.colours import EYE_COLOURS, HAIR_COLOURS, Palette
from fapengine.mesh.default_head.faces_axes import AXES, MIDDLE_AGE
from fapengine.mesh.default_head.faces_table import MODES


class Detail(NamedTuple):
    """Fineness of a head's mesh: edges a length, as a multiple of those of level ``normal``."""

    skin: float
    """All but hair."""
    hair: float
    """Hair, brows and lashes."""


LEVELS: dict[str, Detail] = {
    "coarse": Detail(0.52, 0.52),
    "calls": Detail(0.6, 1.0),
    "normal": Detail(1.0, 1.0),
    "fine": Detail(1.38, 1.38),
    "finest": Detail(2.54, 2.54),
}
"""Level of detail by name: about 6, 10, 15, 26 and 71 thousand vertices."""

HAIRCUTS = ("short", "cropped", "bob", "long")
MAX_WEIGHT = 2.5
BOUNDS: dict[str, tuple[float, float]] = {
    "jaw_width": (0.85, 1.15), "cheek_fullness_mm": (-4, 6), "chin_mm": (-5, 6), "nose_length": (0.6, 1.3),
    "nose_width": (0.75, 1.3), "eye_opening_mm": (8, 13), "lip_fullness": (0.5, 1.5), "mouth_width": (0.85, 1.15),
    "brow_thickness": (0.4, 2), "age": (0, 1), "sex": (-2, 2), "build": (-2, 2),
    "skin_tone": (0, 1), "freckles": (0, 3),
}  # fmt: skip
"""Numbers of :class:`HeadStyle` to the least and the most that they may be."""


@dataclass(frozen=True, slots=True)
class HeadStyle:
    """Proportions and colours; the default is an average adult (Farkas 1994; :mod:`.sections`).

    Raises
    ------
    UsageError
        If a number lies where no head has it, or a colour has no name here.
    """

    jaw_width: float = 0.955
    """Width of the lower face, 0.85..1.15."""
    cheek_fullness_mm: float = 1.6
    """Bulge of the cheeks, -4..6."""
    chin_mm: float = 1.0
    """Bulge of the chin, -5..6."""
    nose_length: float = 0.93
    """Length of the nose, 0.6..1.3; 1 is average."""
    nose_width: float = 0.93
    """Width from wing to wing, 0.75..1.3; average 33 mm for women, 35 mm for men."""
    eye_opening_mm: float = 11.2
    """Distance of the lids in the middle, 8..13; the iris is as wide (the standard's neutral face)."""
    lip_fullness: float = 0.92
    """Height of the red of the lips, 0.5..1.5."""
    mouth_width: float = 1.0
    """Width of the mouth, 0.85..1.15; average 50 mm."""
    brow_thickness: float = 1.0
    """Thickness of the brows, 0.4..2."""
    age: float = 0.25
    """Age, 0 young to 1 old: folds, grooves under the eyes, and what else goes with it in the measured faces."""
    sex: float = 0.0
    """Shape of the face, -2 very female to 2 very male; -1 and 1 are usual (:mod:`.faces_axes`)."""
    build: float = 0.0
    """Shape of the face, -2 very lean to 2 very heavy."""
    skin_tone: float = 0.2
    """Tone of the skin, 0 very light to 1 very dark."""
    freckles: float = 0.4
    """Number of freckles, 0 none to 3 many."""
    hair_colour: str = "brown"
    """One of :data:`HAIR_COLOURS`."""
    hair: bool = True
    haircut: str = "short"
    """One of :data:`HAIRCUTS`."""
    eye_colour: str = "brown"
    """One of :data:`EYE_COLOURS`."""
    glasses: bool = False
    identity: tuple[float, ...] = ()
    """Weights of the measured differences between people, at most 16 numbers of -2.5..2.5: people are spread about 0
    with a standard deviation of 1 (:mod:`.faces`). The whole face follows but the eyes."""

    @property
    def weights(self) -> tuple[float, ...]:
        """Weights of the measured differences, sex, build and age among them; none if they are those of the mean."""
        steps = {"sex": self.sex, "build": self.build, "age": (self.age - MIDDLE_AGE) / (1 - MIDDLE_AGE)}
        if not any(steps.values()):
            return self.identity
        total = [*self.identity, *[0.0] * (MODES - len(self.identity))]
        for name, step in steps.items():
            total = [weight + step * one for weight, one in zip(total, AXES[name], strict=True)]
        return tuple(min(max(weight, -MAX_WEIGHT), MAX_WEIGHT) for weight in total)

    def __post_init__(self) -> None:
        for name, (low, high) in BOUNDS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise UsageError(f"{name}: got {value}, expected {low:g}..{high:g}")
        for name, known in (("hair_colour", HAIR_COLOURS), ("haircut", HAIRCUTS), ("eye_colour", EYE_COLOURS)):
            if getattr(self, name) not in known:
                raise UsageError(f"{name}: got {getattr(self, name)!r}, expected one of {', '.join(known)}")
        if len(self.identity) > MODES or not all(abs(weight) <= MAX_WEIGHT for weight in self.identity):
            expected = f"at most {MODES} numbers of -{MAX_WEIGHT:g}..{MAX_WEIGHT:g}"
            given = "/".join(f"{weight:g}" for weight in self.identity)
            raise UsageError(f"identity: got {given}, expected {expected}")


def palette_of(style: HeadStyle) -> Palette:
    """Make the colours of skin, lips and hair that go with a style."""
    return Palette.of(style.skin_tone, style.hair_colour)


def parse_look(text: str, usual: HeadStyle | None = None) -> tuple[HeadStyle, str]:
    """Read ``"hair_colour=red,age=0.8,level=fine"``: fields of :class:`HeadStyle`, and a level of detail.

    Returns
    -------
    (HeadStyle, str)
        What is not named is as ``usual`` has it, or as by default; the level, by default ``"normal"``, is not looked
        at here.

    Raises
    ------
    UsageError
        If a name or a value is none.
    """
    defaults = {field.name: getattr(HeadStyle(), field.name) for field in fields(HeadStyle)}
    style, level = usual or HeadStyle(), "normal"
    for item in filter(None, text.split(",")):
        name, equals, value = (part.strip() for part in item.partition("="))
        if name == "level" and equals:
            level = value
        elif name in defaults and (equals or isinstance(defaults[name], bool)):  # "glasses" alone says true
            value = value if equals else "true"
            changed: dict[str, Any] = {name: _as(defaults[name], name, value)}
            style = replace(style, **changed)
        else:
            raise UsageError(f"head: got {item.strip()!r}, expected NAME=VALUE with level, {', '.join(defaults)}")
    return style, level


def _as(like: object, name: str, value: str) -> float | str | bool | tuple[float, ...]:
    """Read a value of the kind that the default has."""
    if isinstance(like, str):
        return value
    if isinstance(like, tuple):
        return tuple(float(_as(0.0, name, part)) for part in value.split("/"))  # type: ignore[arg-type]
    if isinstance(like, bool):
        if value not in ("true", "false"):
            raise UsageError(f"{name}: got {value!r}, expected true or false")
        return value == "true"
    try:
        return float(value)
    except ValueError as error:
        raise UsageError(f"{name}: got {value!r}, expected a number") from error
