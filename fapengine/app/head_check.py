"""Checks of a head: a self-test of lips and lids, and contact sheets of phones, expressions and each FAP."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.app.inspection.faces import faps_of_weights
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.expressions import Expression
from fapengine.files.heads.import_file import find_points, load_marked
from fapengine.files.heads.tables import load_mapping
from fapengine.files.pictures import Picture, contact_sheet, save_png
from fapengine.files.profiles import load_profile
from fapengine.mesh.deform import POSE_AU, POSE_FAPU, deform, single_fap
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.import_head import PLAUSIBLE_FAPU
from fapengine.mesh.rig.placed_mesh import place_mesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import VISEMES
from fapengine.mpeg4.track import to_codable
from fapengine.render.drawing import RenderOptions
from fapengine.render.native import open_renderer
from fapengine.retarget.rig_weights import rig_weights
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.trajectory.closures import CONTACTS, settle
from fapengine.trajectory.gestures import LOWER_LID, UPPER_LID

PICTURE_PX = 384
LIPS, LIDS = ("2.2", "2.3"), (("3.1", "3.3"), ("3.2", "3.4"))
"""Feature points: the middle of the inner lips, and the middle of the lids of each eye."""
OPENING_MM, MET_MM = (8.0, 20.0), 0.5
"""Expected opening of the lips on an ah, as of adults, and gap of lips or lids that meet."""
TESTED_POINTS = (*LIPS, *LIDS[0], *LIDS[1])
HELD_FRAMES = 30
"""Frames for which a pose is held while weights are solved."""
AH, CLOSED, BITTEN = "ɑ", "m", "f"
BLINK = {19: UPPER_LID, 20: UPPER_LID, 21: LOWER_LID, 22: LOWER_LID}
GAZE = {23: 25_000.0, 24: 25_000.0, 25: -10_000.0, 26: -10_000.0}
"""FAPs of a blink, FAPU, and of a gaze to the subject's left, AU."""


def draw_check(mesh: FaceMesh, path: Path, *, title: str) -> int:
    """Draw every pose into a contact sheet (.png), and return how many there are.

    Raises UsageError if the name does not end with .png; ResourceError if it cannot be written, or there is no OpenGL.
    """
    if path.suffix != ".png":
        raise UsageError(f"path: got {path}, expected a name that ends with .png")
    rows, labels = poses()
    with open_renderer(mesh, RenderOptions(size=(PICTURE_PX, PICTURE_PX), samples=0, rest=0.0)) as renderer:
        pictures = list(renderer.frames(to_codable(rows)))
    title = f"{title}: FAPs at {POSE_FAPU} FAPU (angles at {POSE_AU / 1e5:g} rad), phones"
    save_png(path, contact_sheet(pictures, labels, title=title))
    return len(pictures)


@dataclass(frozen=True, slots=True)
class SelfTest:
    """What a head does on a few phones and a blink, against what a face does."""

    summary: str
    """One line."""
    remarks: tuple[str, ...]
    """What is out of range, one sentence each."""
    facts: dict[str, float | None]
    """Gap of the lips at rest and on the phones, and of the lids of a blink, in mm; None without such points."""


def draw_sheet(mesh: FaceMesh) -> Picture:
    """Draw a head at rest, on five phones, in a blink, in joy, and with its eyes aside.

    Raises ResourceError if there is no OpenGL.
    """
    rows, labels = _tested()
    with open_renderer(mesh, RenderOptions(size=(PICTURE_PX, PICTURE_PX), samples=0, rest=0.0)) as renderer:
        pictures = list(renderer.frames(to_codable(rows)))
    return contact_sheet(pictures, [(label, "") for label in labels], title=self_test(mesh).summary)


def self_test(mesh: FaceMesh) -> SelfTest:
    """Measure how far lips open and whether lips and lids close; a head without such points has no remarks."""
    rows, labels = _tested()
    points = {name: mesh.feature_points[name] for name in TESTED_POINTS if name in mesh.feature_points}
    moved = deform(mesh, rows)[:, [*points.values()], 1]
    tested = _judge([dict(zip(points, row, strict=True)) for row in moved.tolist()], labels)
    remarks = list(tested.remarks)
    for name, (low, high) in PLAUSIBLE_FAPU.items():
        share = getattr(mesh.fapu, name) / mesh.fapu.es0_mm
        if not low <= share <= high:
            remarks.append(
                f"FAPU: {name.removesuffix('_mm').upper()} is {getattr(mesh.fapu, name):.1f} mm, {share:.2f} of the"
                f" eyes' distance, expected {low:g} to {high:g}; points=FILE sets its feature points"
            )
    return replace(tested, remarks=tuple(remarks))


def check_avatar(path: Path, mapping: Path | None = None) -> SelfTest:
    """Measure the same on an avatar file that its own shapes move, by the weights that an animation of it gets.

    A file without a face that can be found has no gaps, and no remarks. The last files are remembered. Raises OSError
    or UsageError if a file cannot be read.
    """
    states = [file.stat() for file in (path, mapping) if file is not None]
    return _check_avatar(path, mapping, tuple((state.st_mtime_ns, state.st_size) for state in states))


@lru_cache(maxsize=4)
def _check_avatar(path: Path, mapping: Path | None, _versions: tuple[tuple[int, int], ...]) -> SelfTest:
    rows, labels = _tested()
    try:
        mesh, choice, standard, _ = load_marked(path, None, mapping)
        points = find_points(mesh, choice, {}, standard, needed=False)
        placed = place_mesh(mesh, points, standard)
    except (DataError, ResourceError):
        return _judge([{} for _ in labels], labels)
    at = {name: placed.points[name] for name in TESTED_POINTS if name in placed.points}
    source = placed.kept[[*at.values()]]
    moving = [name for name, shape in mesh.blendshapes.items() if len(shape.vertices)]
    held = np.repeat(rows, HELD_FRAMES, axis=0)  # weights are solved over time
    weights = rig_weights([moving], held, load_mapping(mapping) if mapping else None)[0]
    height = np.tile(placed.vertices_mm[[*at.values()], 1], (len(rows), 1))
    for name, weight in weights.items():
        up = placed.scale * mesh.dense(name)[source] @ placed.rotation[1]
        height += weight[HELD_FRAMES // 2 :: HELD_FRAMES, None] * up
    return _judge([dict(zip(at, row, strict=True)) for row in height.tolist()], labels)


def _judge(heights_mm: Sequence[Mapping[str, float]], labels: Sequence[str]) -> SelfTest:
    """Compare the heights of the points in each pose with what a face does."""
    by_label = dict(zip(labels, heights_mm, strict=True))

    def gap_mm(label: str, upper: str, lower: str) -> float | None:
        place = by_label[label]
        return round(place[upper] - place[lower], 2) if {upper, lower} <= set(place) else None

    facts = {f"lips_{label}_mm": gap_mm(label, *LIPS) for label in ("rest", AH, CLOSED, BITTEN)}
    facts |= {f"{side}_lid_mm": gap_mm("blink", *lids) for side, lids in zip(("left", "right"), LIDS, strict=True)}
    said, remarks = _judge_lips(facts), []
    opening, closed = facts[f"lips_{AH}_mm"], facts[f"lips_{CLOSED}_mm"]
    if opening is not None and not OPENING_MM[0] <= opening <= OPENING_MM[1]:
        remarks.append(f"lips: they open {opening:.1f} mm on {AH}, expected {OPENING_MM[0]:g} to {OPENING_MM[1]:g} mm")
    if closed is not None and closed > MET_MM:
        remarks.append(f"lips: they are {closed:.2f} mm apart on {CLOSED}, expected at most {MET_MM:g} mm")
    open_lids = [side for side in ("left", "right") if (facts[f"{side}_lid_mm"] or 0.0) > MET_MM]
    remarks += [f"lids: the {side} eye stays {facts[f'{side}_lid_mm']:.1f} mm open in a blink" for side in open_lids]
    if facts["left_lid_mm"] is None and facts["right_lid_mm"] is None:
        said.append("lids not measured")
    else:
        said.append("lids stay open" if open_lids else "lids close")
    return SelfTest(", ".join(said), tuple(remarks), facts)


def _judge_lips(facts: dict[str, float | None]) -> list[str]:
    opening, closed = facts[f"lips_{AH}_mm"], facts[f"lips_{CLOSED}_mm"]
    if opening is None or closed is None:
        return ["lips not measured"]
    closes = "close" if closed <= MET_MM else f"stay {closed:.1f} mm open"
    return [
        f"lips open {opening:.0f} mm on {AH} (expected {OPENING_MM[0]:g} to {OPENING_MM[1]:g})",
        f"{closes} on {CLOSED}",
    ]


def _tested() -> tuple[NDArray[np.float64], list[str]]:
    """(N, 68) FAPU, and N names: rest, phones under their contacts, a blink, joy, a gaze."""
    profile = load_profile(DEFAULT_PROFILE)
    phones = {name: profile.phones[name] for name in (AH, "i", "u", CLOSED, BITTEN)}
    spoken = np.concatenate([faps_of_weights(profile, phone.targets[:1]) for phone in phones.values()])
    contacts = [phone.contact for phone in phones.values()]
    spoken = settle(spoken, np.array([[float(contact == each) for contact in contacts] for each in CONTACTS]))
    blink, gaze = np.zeros((2, fap.FAP_COUNT))
    for row, values in ((blink, BLINK), (gaze, GAZE)):
        row[fap.columns(*values)] = [*values.values()]
    joy = profile.expressions[Expression.JOY]
    rows = [np.zeros(fap.FAP_COUNT), *spoken, blink, faps_of_weights(profile, joy.target[None])[0] + joy.fap, gaze]
    return np.stack(rows), ["rest", *phones, "blink", "joy", "gaze"]


def poses() -> tuple[NDArray[np.float64], list[tuple[str, str]]]:
    """Return the neutral pose, each FAP, each phone and each expression.

    Returns
    -------
    rows : (N, 68) float64, FAPU
    labels : list of (str, str)
        Name and kind of each row.
    """
    rows, labels = [np.zeros(fap.FAP_COUNT)], [("rest", "")]
    for number in range(3, fap.FAP_COUNT + 1):
        rows.append(single_fap(number))
        labels.append((str(number), fap.spec(number).name))
    profile = load_profile(DEFAULT_PROFILE)
    spelling = str.maketrans("rɒʊe", "ɹɔuɛ")  # the table's phonemes in the nearest spelling of the profile
    visemes = {
        phoneme.rstrip("ː").translate(spelling): f"viseme {row.number}" for row in VISEMES for phoneme in row.phonemes
    }
    for spoken, phone in profile.phones.items():
        rows.append(faps_of_weights(profile, phone.targets[:1])[0])
        labels.append((spoken, visemes.get(spoken, "phone")))
    for expression, face in profile.expressions.items():
        rows.append(faps_of_weights(profile, face.target[None])[0] + face.fap)
        labels.append((expression.label, "expression"))
    return np.stack(rows), labels
