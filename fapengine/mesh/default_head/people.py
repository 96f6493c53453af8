"""People: looks with a name, and anybody by a number.

Named looks are choices of ours. ``random:7`` draws a person: the relief from the measured differences between faces
(:mod:`fapengine.mesh.default_head.relief_table`), the widths that go with it, and the rest evenly within its bounds.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from fapengine.errors import UsageError
from fapengine.mesh.colours import EYE_COLOURS, HAIR_COLOURS
from fapengine.mesh.default_head.relief_table import RELIEF_TENTHS_MM, WIDTHS
from fapengine.mesh.default_head.style import BOUNDS, HAIRCUTS, MAX_RELIEF, HeadStyle, parse_look

PEOPLE: Mapping[str, HeadStyle] = MappingProxyType({
    "default": HeadStyle(),
    "woman": HeadStyle(
        jaw_width=0.91, cheek_fullness_mm=2.4, chin_mm=-0.5, nose_length=0.84, nose_width=0.86, eye_opening_mm=11.6,
        lip_fullness=1.12, mouth_width=0.97, brow_thickness=0.62, age=0.12, skin_tone=0.15, freckles=0.3,
        hair_colour="chestnut", haircut="long", eye_colour="green",
    ),
    "man": HeadStyle(
        jaw_width=1.05, cheek_fullness_mm=0.4, chin_mm=3.0, nose_length=1.02, nose_width=1.02, eye_opening_mm=10.4,
        lip_fullness=0.8, mouth_width=1.04, brow_thickness=1.4, age=0.4, skin_tone=0.3, hair_colour="black",
        eye_colour="dark",
    ),
    "child": HeadStyle(
        jaw_width=0.93, cheek_fullness_mm=4.6, chin_mm=-2.5, nose_length=0.68, nose_width=0.85, eye_opening_mm=12.6,
        lip_fullness=1.0, mouth_width=0.9, brow_thickness=0.55, age=0.0, skin_tone=0.12, freckles=1.6,
        hair_colour="blond", eye_colour="blue",
    ),
    "older": HeadStyle(
        jaw_width=1.0, cheek_fullness_mm=-0.8, chin_mm=1.5, nose_length=1.06, nose_width=1.06, eye_opening_mm=9.8,
        lip_fullness=0.68, mouth_width=1.02, brow_thickness=1.1, age=0.95, skin_tone=0.22, freckles=0.8,
        hair_colour="grey", eye_colour="grey",
    ),
})  # fmt: skip
"""Name to look."""
RANDOM = "random"


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
    weights = np.clip(rng.normal(size=len(RELIEF_TENTHS_MM)), -MAX_RELIEF, MAX_RELIEF).round(2)
    usual = HeadStyle()
    widths: dict[str, Any] = {}
    for name in WIDTHS[0]:
        change = float(weights @ [row[name] for row in WIDTHS])
        widths[name] = round(float(np.clip(getattr(usual, name) * (1 + change), *BOUNDS[name])), 3)
    age, tone = rng.uniform(0, 1), rng.uniform(0, 1)
    hair_colours = [name for name in HAIR_COLOURS if name == "grey" or age < 0.7]
    if tone > 0.5:  # of dark skins, hair and eyes are dark
        hair_colours = ["black", "grey"] if age > 0.7 else ["black", "brown"]
    eye_colours = ["dark", "brown"] if tone > 0.5 else list(EYE_COLOURS)
    return replace(
        usual,
        **widths,
        relief=tuple(weights.tolist()),
        cheek_fullness_mm=round(rng.uniform(-1, 4), 2),
        chin_mm=round(rng.uniform(-2, 3.5), 2),
        nose_length=round(rng.uniform(0.8, 1.08), 3),
        eye_opening_mm=round(rng.uniform(10.2, 12.0), 2),
        lip_fullness=round(rng.uniform(0.75, 1.25), 3),
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
    """Read ``"woman"``, ``"woman:hair_colour=red,level=fine"``, ``"random:7"`` or ``"random:7,age=0.9"``.

    Returns
    -------
    (HeadStyle, str) or None
        Look and level of detail; None if the text names none of :data:`PEOPLE` and is not random.

    Raises
    ------
    UsageError
        If what follows the name cannot be read.
    """
    person, _, changes = name.partition(":")
    if person == RANDOM:
        seed, _, changes = changes.partition(",")
        if not seed.isdecimal():
            raise UsageError(f"head: got {name!r}, expected {RANDOM}:NUMBER such as {RANDOM}:7")
        return parse_look(changes, somebody(int(seed)))
    return parse_look(changes, PEOPLE[person]) if person in PEOPLE else None
