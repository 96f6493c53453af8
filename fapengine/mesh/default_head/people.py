"""People: looks with a name, and anybody by a number.

Named looks are choices of ours. ``random:7`` draws a person: the shape from the measured differences between faces
(:mod:`fapengine.mesh.default_head.faces`), and the rest evenly within its bounds.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fapengine.errors import UsageError
from fapengine.mesh.colours import EYE_COLOURS, HAIR_COLOURS
from fapengine.mesh.default_head.faces_table import MODES
from fapengine.mesh.default_head.style import HAIRCUTS, HeadStyle, parse_look

PEOPLE: Mapping[str, HeadStyle] = MappingProxyType({
    "default": HeadStyle(),
    "woman": HeadStyle(
        identity=(-0.45, -1.35, 0.3, 0.15, 0.6, 0.15, -0.45, 0.3, 0.3, -0.15, -0.15, 0.15, 0.3, -0.9, 0.6, -0.15),
        cheek_fullness_mm=2.0, chin_mm=0.2, nose_length=0.88, nose_width=0.9, eye_opening_mm=11.8,
        lip_fullness=1.06, brow_thickness=0.62, age=0.12, skin_tone=0.15, freckles=0.3,
        hair_colour="chestnut", haircut="long", eye_colour="green",
    ),
    "man": HeadStyle(
        identity=(0.6, 1.65, -0.15, 0.15, -0.6, -0.15, 0.15, -0.3, -0.6, 0.15, 0, -0.3, -0.15, 0.75, -0.6, 0.15),
        chin_mm=2.0, nose_length=0.97, nose_width=0.96, eye_opening_mm=10.4, lip_fullness=0.86, brow_thickness=1.4,
        age=0.4, skin_tone=0.3, hair_colour="black", eye_colour="dark",
    ),
    "child": HeadStyle(
        identity=(-0.75, -1.95, 0, -1.05, 0.9, 0.3, -0.3, 0.15, 0.6, -0.3, 0, 0.75, 0.15, -1.65, 1.05, -0.6),
        jaw_width=0.94, cheek_fullness_mm=4.2, chin_mm=-1.0, nose_length=0.74, nose_width=0.86, eye_opening_mm=12.6,
        mouth_width=0.93, brow_thickness=0.55, age=0.0, skin_tone=0.12, freckles=1.6, hair_colour="blond",
        eye_colour="blue",
    ),
    "older": HeadStyle(
        identity=(0.75, 0.9, 0, 0.15, 0.15, 0.15, 0.45, 0, 0.15, 0, -0.3, -0.3, 0.15, 1.05, 0.15, 0.15),
        cheek_fullness_mm=-0.2, nose_length=0.98, nose_width=0.98, eye_opening_mm=9.8, lip_fullness=0.78,
        brow_thickness=1.1, age=0.95, skin_tone=0.22, freckles=0.8, hair_colour="grey", eye_colour="grey",
    ),
})  # fmt: skip
"""Name to look."""
RANDOM = "random"
PERSON = re.compile(r"([^:,]*)[:,]?(.*)", re.DOTALL)
USUAL = 2.0
"""Weight of a mode beyond which random people do not go."""


def somebody(seed: int) -> HeadStyle:
    """Draw a person; the same number is the same person.

    Parameters
    ----------
    seed : int
        0 and more.

    Raises
    ------
    UsageError
        If it is negative.
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
    )


def parse_person(name: str) -> tuple[HeadStyle, str] | None:
    """Read ``"woman"``, ``"woman,glasses"``, ``"woman:hair_colour=red,level=fine"`` or ``"random:7,age=0.9"``.

    Returns
    -------
    (HeadStyle, str) or None
        Look and level of detail; None if the text names none of :data:`PEOPLE` and is not random.

    Raises
    ------
    UsageError
        If what follows the name cannot be read.
    """
    person, changes = PERSON.match(name).groups()  # type: ignore[union-attr]  # it matches every text
    if person == RANDOM:
        seed, _, changes = changes.partition(",")
        if not seed.isdecimal():
            raise UsageError(f"head: got {name!r}, expected {RANDOM}:NUMBER such as {RANDOM}:7")
        return parse_look(changes, somebody(int(seed)))
    return parse_look(changes, PEOPLE[person]) if person in PEOPLE else None
