"""Measure the profile's six expressions on the dense face again, and write them into ``profiles/grid_s1_en``.

    python -m design.fit_expressions data

Everything else in the profile stays as it is. Each expression is a sum of expression fields of ICT-FaceKit's head (MIT
licence), chosen by the words of the standard's table of expressions and by what a stranger tells from neutral at 200
pixels with a strength of 0.6 (``tests/detector``). One unit of browDown lowers a brow by 2 to 4 mm, a faint anger; so
brows go beyond 1. A smile parts the lips: lips that stay shut read as a smirk. The eyes of sadness stay nearly open, or
it is sleep. Fear draws the brows together and the mouth wide, surprise rounds both.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from design.data_files import FOLDER, asked_path
from fapengine.expressions import Expression
from fapengine.files.profiles import load_profile, save_profile
from fapengine.models.viseme_space import VisemeSpace
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.profiles import ExpressionTarget
from fapengine.trajectory.faps import displacements_to_faps

PROFILE = Path(__file__).resolve().parent.parent / "profiles" / "grid_s1_en"
# fmt: off
EXPRESSIONS = {  # weights of fields of the dense face
    "joy": {"mouthSmile": 0.8, "mouthDimple": 0.1, "mouthStretch": 0.15, "mouthLowerDown": 0.6, "jawOpen": 0.1,
            "mouthShrugUpper": 0.1, "cheekRaiser": 0.5, "cheekSquint": 0.3, "eyeSquint": 0.15},
    "sadness": {"browInnerUp": 2.0, "browOuterUp": -0.6, "browDown": 0.4, "mouthFrown": 1.3, "eyeBlink": 0.15,
                "mouthShrugLower": 0.35},
    "anger": {"browDown": 2.6, "noseSneer": 0.35, "eyeWide": 0.2, "eyeSquint": 0.6, "mouthPress": 0.8,
              "mouthFrown": 0.7},
    "fear": {"browInnerUp": 1.3, "browOuterUp": 0.3, "browDown": 0.5, "eyeWide": 0.85, "mouthStretch": 1.0,
             "jawOpen": 0.12, "mouthLowerDown": 0.4},
    "disgust": {"noseSneer": 1.0, "mouthUpperUp": 0.25, "eyeSquint": 0.6, "eyeBlink": 0.1, "mouthFrown": 0.6,
                "browDown": 1.0, "mouthShrugLower": 0.3},
    "surprise": {"browInnerUp": 1.0, "browOuterUp": 1.1, "eyeWide": 0.8, "jawOpen": 0.42},
}
# fmt: on
BY_EYE = {  # FAPU in place of the fields' own; those of the right half are those of the left
    "joy": {
        "open_jaw": 60,
        "lower_t_midlip": -150,
        "lower_t_midlip_o": -60,
        "raise_b_midlip": -120,
        "raise_b_midlip_o": -130,
        "lower_t_lip_lm": -215,
        "lower_t_lip_lm_o": -125,
        "raise_b_lip_lm": -40,
        "raise_b_lip_lm_o": -45,
        "stretch_l_cornerlip": 190,
        "stretch_l_cornerlip_o": 190,
        "raise_l_cornerlip": 390,
        "raise_l_cornerlip_o": 420,
        "lift_l_cheek": 165,
        "close_t_l_eyelid": 30,
        "close_b_l_eyelid": 190,
    },
    "anger": {
        "raise_l_i_eyebrow": -200,
        "raise_l_m_eyebrow": -110,
        "raise_l_o_eyebrow": 0,
        "squeeze_l_eyebrow": 85,
        "close_t_l_eyelid": 40,
        "close_b_l_eyelid": 250,
        "lower_t_midlip": 0,
        "raise_b_midlip": 0,
        "lower_t_lip_lm": 0,
        "raise_b_lip_lm": 0,
        "lower_t_midlip_o": 130,
        "raise_b_midlip_o": 220,
        "lower_t_lip_lm_o": 110,
        "raise_b_lip_lm_o": 200,
        "stretch_l_cornerlip": -20,
        "stretch_l_cornerlip_o": -20,
        "raise_l_cornerlip": -110,
        "raise_l_cornerlip_o": -150,
        "depress_chin": 90,
    },
    "sadness": {"raise_l_i_eyebrow": 220},
    "surprise": {"close_t_l_eyelid": -200, "close_b_l_eyelid": 100},
    "fear": {"close_t_l_eyelid": -200, "close_b_l_eyelid": 130},
}  # fmt: skip
"""Corrections by eye: between the corners the lower lip of the fields' joy was a V, the upper as thick as at rest. A
real smile's lower lip is a bow, its upper lip thins, and the lids narrow. Brows of the fields' anger were level, which
reads as tired, and folded over the lids; in life their inner ends go down and together, and pressed lips are thin.
The slant of sadness was faint on arched brows. Surprise and fear showed white all round the iris; in life the lower lid
stays at it."""
PROVENANCE = (
    "sums of expression fields of the ICT-FaceKit head, as the standard words them, large enough to be told from"
    " neutral at 200 pixels with strength 0.6; joy's lips, cheeks and lids, anger's brows, lids and"
    " lips, the inner brows of sadness, and the lids of surprise and fear by eye"
    " (python -m design.fit_expressions); not acted"
)
SPACE_FAPS = {*range(3, 19), *range(39, 43), *range(51, 61)}
"""FAPs that the markers determine (:mod:`fapengine.trajectory.faps`)."""


def main(data: Path) -> None:
    layout = {row["marker"]: row for row in csv.DictReader((data / "markers.csv").open()) if row["layout"] == "mpeg4"}
    profile = load_profile(PROFILE)
    targets = measure_expressions(profile.space, data, layout)
    origin = {**profile.origin, "expressions": PROVENANCE}
    save_profile(PROFILE, replace(profile, origin=origin, expressions=targets))
    print(f"wrote {len(targets)} expressions")


def measure_expressions(
    space: VisemeSpace, data: Path, layout: dict[str, dict[str, str]]
) -> dict[Expression, ExpressionTarget]:
    """Points in the space, and the FAPs beyond it, measured on the dense face in its own FAPU."""
    dense = np.load(data / "dense_face.npz")
    names = [str(name) for name in dense["expr_names"]]
    at = {name: int(row["vertex"]) for name, row in layout.items()}
    fapu = Fapu.measure({name: dense["vertices"][vertex] for name, vertex in at.items()})
    found = {}
    for expression, parts in EXPRESSIONS.items():
        field = np.zeros_like(dense["vertices"], dtype=np.float64)
        for part, strength in parts.items():
            for name in names:
                if name == part or name in (f"{part}_L", f"{part}_R"):
                    field += strength * dense["expr"][names.index(name)].astype(np.float64)
        moved = {name: field[vertex] for name, vertex in at.items()}
        target = space.to_space(np.stack([moved[name] for name in space.points[: space.marker_count]]))
        carried = dict(zip(space.points, space.to_points_mm(target), strict=True))
        faps = np.zeros(fap.FAP_COUNT)
        for row in fap.FAPS:
            axis = fap.HEAD_AXES.get(row.positive)
            if axis is None or row.point not in moved or row.unit is fap.FapUnit.AU or 27 <= row.number <= 30:
                continue
            beyond = moved[row.point] - (carried[row.point] if row.number in SPACE_FAPS else 0)
            if row.number == 18:  # the chin boss against the jaw, as in trajectory/faps.py
                beyond = beyond - (moved["2.1"] - carried["2.1"])
            value = float(beyond @ np.array(axis)) / fapu.unit(row.unit)
            faps[fap.column(row.number)] = value if abs(value) >= 1 else 0.0
        in_space = displacements_to_faps(space.to_points_mm(target[None]), space.points, fapu)[0]
        for left, value in BY_EYE.get(expression, {}).items():
            for name in {left, left.replace("_l_", "_r_").replace("_lm", "_rm")}:
                column = fap.column(fap.by_name(name).number)
                faps[column] = value - in_space[column]
        found[Expression[expression.upper()]] = ExpressionTarget(target=target, fap=faps)
    return found


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "dense_face.npz", "markers.csv"))
