"""``HeadStyle``: how heads differ from each other; named people and random ones.

Every number has a meaning; 1 or 0 is an average adult.

Named people are hand-made. ``random:7`` draws a person: the shape from the measured differences between faces
(:mod:`.faces`), the other values uniformly within bounds.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib.resources import files
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from fapengine._strict_toml import check_fields, parse_toml
from fapengine.errors import UsageError
from fapengine.mesh.colours import CLOTH_COLOURS, EYE_COLOURS, HAIR_COLOURS, Palette


class Detail(NamedTuple):
    """Resolution of a head's mesh: edges per length, relative to level ``normal``."""

    skin: float
    """Everything except hair."""
    hair: float
    """Hair, brows and lashes."""


LEVELS: dict[str, Detail] = {
    "coarse": Detail(0.52, 0.52),
    "calls": Detail(0.6, 1.0),
    "normal": Detail(1.0, 1.0),
    "fine": Detail(1.38, 1.38),
    "finest": Detail(2.54, 2.54),
}
"""Level of detail by name: about 7, 10, 16, 28 and 74 thousand vertices."""

HAIRCUTS = ("short", "cropped", "bob", "long")
OVER_EARS = ("bob", "long")
"""Haircuts that cover the ears."""
BROW_SHAPES = ("soft", "straight", "arched")
GARMENTS = ("crew_neck", "shirt", "high_neck")
MODES = 16
"""Number of measured modes of difference between faces (:mod:`.faces`)."""
MAX_WEIGHT = 2.5
# fmt: off
AXES: dict[str, tuple[float, ...]] = {
    "sex": (0.06, 1.03, 0.16, 0.41, -0.24, -0.32, -0.07, -0.26, 0.09, 0.10, 0.28, 0.14, -0.33, 0.81, -0.45, -0.13),
    "build": (
        0.77, 0.87, -0.49, -0.18, -0.19, 0.19, -0.46, -0.49, -0.11, -0.34, -0.04, -0.57, -0.49, -0.05, 0.41, 0.28,
    ),
    "age": (0.79, 0.42, -0.43, 0.75, 0.23, 0.04, 0.35, 0.15, -0.35, 0.03, -0.41, -0.44, 0.69, 0.47, 0.35, 0.27),
}
# fmt: on
"""Weights of the modes for one step of sex, build or age, in standard deviations (``design/learn_axes.py``)."""
MIDDLE_AGE = 0.25
"""Age of the mean face; one step of the axis leads from it to 1."""
BOUNDS: dict[str, tuple[float, float]] = {
    "jaw_width": (0.85, 1.15), "cheek_fullness_mm": (-4, 6), "chin_mm": (-5, 6), "nose_length": (0.6, 1.3),
    "nose_width": (0.75, 1.3), "eye_opening_mm": (8, 13), "lip_fullness": (0.5, 1.5), "mouth_width": (0.85, 1.15),
    "brow_thickness": (0.4, 2), "age": (0, 1), "sex": (-2, 2), "build": (-2, 2), "charm": (0, 1.3), "childlike": (0, 1),
    "beard": (0, 1),
    "skin_tone": (0, 1), "freckles": (0, 3),
}  # fmt: skip
"""Smallest and largest value of the numbers in :class:`HeadStyle`."""


@dataclass(frozen=True, slots=True)
class HeadStyle:
    """Proportions and colours; the default is an average adult (Farkas 1994; ``sections.npz``).

    Raises
    ------
    UsageError
        If a number is out of bounds, or a colour is unknown.
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
    """Lid distance in the middle, 8..13, without charm; also the diameter of the iris (the
    standard's neutral face).
    """
    lip_fullness: float = 0.92
    """Height of the red of the lips, 0.5..1.5."""
    mouth_width: float = 1.0
    """Width of the mouth, 0.85..1.15; average 50 mm."""
    brow_thickness: float = 1.0
    """Thickness of the brows, 0.4..2."""
    brow_shape: str = "soft"
    """One of :data:`BROW_SHAPES`."""
    age: float = 0.25
    """Age, 0 young to 1 old: folds, grooves under the eyes, and the differences in shape that go with age."""
    sex: float = 0.0
    """Shape of the face, -2 very female to 2 very male; -1 and 1 are usual (:data:`AXES`)."""
    build: float = 0.0
    """Shape of the face, -2 very lean to 2 very heavy."""
    skin_tone: float = 0.2
    """Skin tone, 0 very light to 1 very dark."""
    freckles: float = 0.4
    """Number of freckles, 0 none to 3 many."""
    hair_colour: str = "brown"
    """One of :data:`HAIR_COLOURS`."""
    hair: bool = True
    haircut: str = "short"
    """One of :data:`HAIRCUTS`."""
    beard: float = 0.0
    """Beard: 0 shaven, .4 stubble, 1 full and short."""
    eye_colour: str = "brown"
    """One of :data:`EYE_COLOURS`."""
    glasses: bool = False
    garment: str = "crew_neck"
    """One of :data:`GARMENTS`."""
    cloth_colour: str = "blue"
    """One of :data:`CLOTH_COLOURS`."""
    charm: float = 0.6
    """Likeness to a character of an animated film (:mod:`.stylised`): 0 is the measured anatomy, 1.3 the most."""
    childlike: float = 0.0
    """Proportions of the skull: 0 an adult's, 1 those of a child of about six years."""
    identity: tuple[float, ...] = ()
    """Weights of the measured modes, at most 16 numbers of -2.5..2.5; in people they have mean 0 and standard deviation
    1 (:mod:`.faces`). The whole face follows except the eyes.
    """

    @property
    def weights(self) -> tuple[float, ...]:
        """Weights of the modes including sex, build and age; empty for the mean face."""
        steps = {"sex": self.sex, "build": self.build, "age": (self.age - MIDDLE_AGE) / (1 - MIDDLE_AGE)}
        if not any(steps.values()):
            return self.identity
        total = [*self.identity, *[0.0] * (MODES - len(self.identity))]
        for name, step in steps.items():
            total = [weight + step * one for weight, one in zip(total, AXES[name], strict=True)]
        return tuple(min(max(weight, -MAX_WEIGHT), MAX_WEIGHT) for weight in total)

    def __post_init__(self) -> None:
        check_fields(self)
        for name, (low, high) in BOUNDS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise UsageError(f"{name}: must be {low:g} to {high:g}, got {value}")
        for name, known in (
            ("hair_colour", HAIR_COLOURS), ("haircut", HAIRCUTS), ("eye_colour", EYE_COLOURS),
            ("brow_shape", BROW_SHAPES), ("garment", GARMENTS), ("cloth_colour", CLOTH_COLOURS),
        ):  # fmt: skip
            if getattr(self, name) not in known:
                raise UsageError(f"{name}: got {getattr(self, name)!r}, expected one of {', '.join(known)}")
        if len(self.identity) > MODES or not all(abs(weight) <= MAX_WEIGHT for weight in self.identity):
            expected = f"at most {MODES} numbers from -{MAX_WEIGHT:g} to {MAX_WEIGHT:g}"
            given = "/".join(f"{weight:g}" for weight in self.identity)
            raise UsageError(f"identity: got {given}, expected {expected}")


MEASURED = HeadStyle(charm=0.0)
"""The average adult as measured: the standard of imported and fitted heads."""


def palette_of(style: HeadStyle) -> Palette:
    """Colours of skin, lips and hair of a style."""
    return Palette.of(style.skin_tone, style.hair_colour)


def parse_look(text: str, usual: HeadStyle | None = None) -> tuple[HeadStyle, str]:
    """Parse ``"hair_colour=red,age=0.8,level=fine"``: fields of :class:`HeadStyle`, and a level of detail.

    Returns
    -------
    (HeadStyle, str)
        Fields that are not named are those of ``usual``, or the defaults; the level is ``"normal"`` by default and is
        not checked.

    Raises
    ------
    UsageError
        If a name or a value is unknown.
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
    """Parse a value of the type of the default."""
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


PEOPLE: Mapping[str, HeadStyle] = MappingProxyType(
    parse_toml((files(__package__) / "people.toml").read_bytes(), dict[str, HeadStyle], "people.toml")
)
"""Style by name."""
RANDOM = "random"
PERSON = re.compile(r"([^:,]*)[:,]?(.*)", re.DOTALL)
USUAL = 2.0
"""Largest weight of a mode in random people."""


def random_person(seed: int) -> HeadStyle:
    """Draw a random person; the same seed gives the same person.

    Raises
    ------
    UsageError
        If the seed is negative.
    """
    if seed < 0:
        raise UsageError(f"{RANDOM}: got {seed}, expected 0 or more")
    rng = np.random.default_rng(seed)
    weights = np.clip(rng.normal(size=MODES), -USUAL, USUAL).round(2)
    usual = HeadStyle()
    age, tone = rng.uniform(0, 1), rng.uniform(0, 1)
    hair_colours = [name for name in HAIR_COLOURS if name == "grey" or age < 0.7]
    if tone > 0.5:  # of dark skins, hair and eyes are dark
        hair_colours = ["black", "grey"] if age > 0.7 else ["black", "brown"]
    eye_colours = ["dark", "brown"] if tone > 0.5 else list(EYE_COLOURS)
    return replace(
        usual,
        identity=tuple(weights.tolist()),
        eye_opening_mm=round(rng.uniform(10.2, 12.0), 2),
        lip_fullness=round(rng.uniform(0.8, 1.2), 3),
        brow_thickness=round(rng.uniform(0.6, 1.5), 2),
        age=round(age, 2),
        skin_tone=round(tone, 2),
        freckles=round(2 * rng.uniform(0, 1) ** 2, 2),
        hair_colour=str(rng.choice(hair_colours)),
        haircut=str(rng.choice(HAIRCUTS)),
        hair=bool(rng.uniform() > 0.25 * age),
        eye_colour=str(rng.choice(eye_colours)),
        # Drawn last: what seeds gave before stays.
        brow_shape=str(rng.choice(BROW_SHAPES)),
        garment=str(rng.choice(GARMENTS)),
        cloth_colour=str(rng.choice(_clothes_beside(tone))),
    )


def _clothes_beside(skin_tone: float) -> list[str]:
    """Colours of clothes that differ visibly from a skin."""
    skin = np.sqrt(Palette.of(skin_tone).base)  # roughly as bright as they look
    return [name for name, colour in CLOTH_COLOURS.items() if np.linalg.norm(np.sqrt(colour) - skin) > 0.2]


def parse_person(name: str) -> tuple[HeadStyle, str] | None:
    """Parse ``"woman"``, ``"woman,glasses"``, ``"woman:hair_colour=red,level=fine"`` or ``"random:7,age=0.9"``.

    Returns
    -------
    (HeadStyle, str) or None
        Style and level of detail; None if the text starts neither with a name in :data:`PEOPLE` nor with ``random``.

    Raises
    ------
    UsageError
        If the text after the name cannot be parsed.
    """
    person, changes = PERSON.match(name).groups()  # type: ignore[union-attr]  # it matches every text
    if person == RANDOM:
        seed, _, changes = changes.partition(",")
        if not seed.isdecimal():
            raise UsageError(f"head: got {name!r}, expected {RANDOM}:NUMBER such as {RANDOM}:7")
        return parse_look(changes, random_person(int(seed)))
    return parse_look(changes, PEOPLE[person]) if person in PEOPLE else None
