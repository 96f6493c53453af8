"""Measure what each ARKit shape does in FAPs, on a face that has them, and write ``fapengine/retarget/arkit.npz``.

    python -m design.fit_arkit data

The face is the dense one of ICT-FaceKit (MIT), whose expression fields combine to 51 of the 52 shapes; feature points
as ``markers.csv`` places them. Gaze and tongue, which its fields do not move, follow definitions that stand below.
"""

import csv
from pathlib import Path

import numpy as np

from design.data_files import FOLDER, asked_path, save_table
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD, Fapu

TABLE = Path(__file__).resolve().parent.parent / "fapengine" / "retarget" / "arkit.npz"
MIN_FAPU = 2.0  # smaller entries are noise of the half-precision fields
NOT_SHAPES = (27, 28, 29, 30, *range(43, 48))  # eyes that bulge, pupils; the tongue, which rides on the jaw
GAZE_RAD = 0.52  # 30 degrees: a full eyeLook shape; the eye's usual reach before the head follows
TONGUE_FAPU = 1024.0  # tongueOut: one mouth width forward


def main(data: Path) -> None:
    dense = np.load(data / "dense_face.npz")
    with (data / "markers.csv").open() as file:
        at = {row["marker"]: int(row["vertex"]) for row in csv.DictReader(file) if row["layout"] == "mpeg4"}
    fapu = Fapu.measure({name: dense["vertices"][vertex] for name, vertex in at.items()})
    fields = dense["expr"][:, list(at.values())].astype(np.float64)
    column = {name: index for index, name in enumerate(at)}
    moved = np.tensordot(dense["arkit_from_expr"], fields, axes=1)  # (52, points, 3)
    rows = []
    for name, points in zip(dense["arkit_names"].tolist(), moved, strict=True):
        values = {}
        for row in fap.FAPS:
            axis = fap.HEAD_AXES.get(row.positive)
            if axis is None or row.point not in column or row.unit is fap.FapUnit.AU or row.number in NOT_SHAPES:
                continue
            shift = points[column[row.point]]
            if row.number == 18:  # the chin boss against the jaw
                shift = shift - points[column["2.1"]]
            value = float(shift @ np.array(axis)) / fapu.unit(row.unit)
            if abs(value) >= MIN_FAPU:
                values[row.number] = round(value, 1)
        rows.append((name, values | gaze(name)))
    table = np.zeros((len(rows), fap.FAP_COUNT))
    for row, (_, values) in zip(table, rows, strict=True):
        row[[fap.column(number) for number in values]] = list(values.values())
    save_table(TABLE, {"arkit_names": np.array([name for name, _ in rows]), "arkit": table})
    print(f"{len(rows)} shapes, {np.count_nonzero(table)} entries")


def gaze(name: str) -> dict[int, float]:
    """FAPs of the eyeballs and the tongue: positive yaw is to the subject's left, positive pitch down."""
    turn = round(GAZE_RAD / AU_RAD)
    if name == "tongueOut":
        return {45: TONGUE_FAPU}
    if not name.startswith("eyeLook"):
        return {}
    left = name.endswith("Left")
    yaw, pitch = (23, 25) if left else (24, 26)
    way = name.removeprefix("eyeLook").removesuffix("Left").removesuffix("Right")
    if way in ("Up", "Down"):
        return {pitch: turn if way == "Down" else -turn}
    to_left = (way == "Out") == left
    return {yaw: turn if to_left else -turn}


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "dense_face.npz", "markers.csv"))
