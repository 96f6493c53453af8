"""The feature points of a head, drawn on it: the standard's figure of them, and figure 1 of paper 001."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from PIL import Image, ImageDraw

from fapengine.files.pictures import INK, MARGIN, PAPER, Picture, font
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.native import open_crowd_renderer

SIDE = 720
"""Width and height of a view, pixels."""
TITLE_PX, DOT_PX, LABEL_PX = 30, 4, 15
MOVED, HELD = (214, 40, 40), (255, 255, 255)
"""Colour of points of FAPs, and of the others."""
AWAY_PX = (10, 22, 36, 52)
"""Distances from a point at which there may be room for its name."""


@dataclass(frozen=True, slots=True)
class View:
    """One view of the head, and what is named in it."""

    title: str
    camera: Camera
    points: tuple[str, ...]
    """Groups, such as ``"8."``, or single points."""
    faps: tuple[tuple[int, int], ...] = ()
    """Numbers and values of a pose, FAPU."""


VIEWS = (
    View("Front: chin, brows, cheeks, nose, forehead", PRESETS["close"],
         ("2.1", "4.", "5.", *(f"9.{number}" for number in (*range(1, 8), *range(12, 16))), "11.1", "11.2", "11.3")),
    View("Left side: ear, jaw joint, cheekbone, head", PRESETS["profile"],
         ("2.1", "2.10", "2.13", "5.1", "5.3", "7.1", "9.3", "10.", "11.")),
    View("Eyes and brows", PRESETS["eyes"], ("3.", "4.")),
    View("Mouth, opened; teeth and tongue are seen through the skin", replace(PRESETS["mouth"], field_deg=12.5),
         ("2.", "6.", "8.", "9.8", "9.9", "9.10", "9.11"),
         ((3, 700), (4, -250), (5, -150), (8, -120), (9, -120), (10, -100), (11, -100), (51, -80))),
)  # fmt: skip
"""Front and side show the head; lids and lips are too small there."""
FAR_SIDE_MM = -1.0
"""Farthest to the right of the middle that a point of the left side is."""


def draw_feature_points(head: FaceMesh) -> Picture:
    """Draw the head with its feature points, (H, W, 3) uint8; those of FAPs are red, in the standard filled."""
    poses = np.zeros((len(VIEWS), fap.FAP_COUNT))
    for pose, view in zip(poses, VIEWS, strict=True):
        for number, value in view.faps:
            pose[fap.column(number)] = value
    with open_crowd_renderer([head] * len(VIEWS), RenderOptions(size=(SIDE, SIDE), rest=0.0), columns=2) as crowd:
        crowd.cameras = [view.camera for view in VIEWS]
        sheet = Image.new("RGB", (2 * SIDE, 2 * SIDE + TITLE_PX), PAPER)
        sheet.paste(Image.fromarray(np.ascontiguousarray(crowd.draw(poses)[..., :3])), (0, TITLE_PX))
    pen = ImageDraw.Draw(sheet)
    told = f"{len(head.feature_points)} feature points; red: the point of a FAP, white: of none"
    pen.text((MARGIN, 4), told, INK, font=font(18))
    for number, (view, pose) in enumerate(zip(VIEWS, poses, strict=True)):
        corner = np.array([number % 2 * SIDE, number // 2 * SIDE + TITLE_PX])
        _name_points(pen, head, view, deform(head, pose), corner)
        pen.text(tuple(corner + MARGIN), view.title, HELD, font=font(18))
    return np.asarray(sheet)


def _name_points(
    pen: ImageDraw.ImageDraw, head: FaceMesh, view: View, vertices_mm: np.ndarray, corner: np.ndarray
) -> None:
    """Draw dots on the points of a view, and their names where there is room."""
    places = {name: vertices_mm[vertex] for name, vertex in head.feature_points.items() if _is_named(name, view)}
    if view.camera.yaw_deg:
        places = {name: place for name, place in places.items() if place[0] >= FAR_SIDE_MM}
    if not places:
        return
    matrix = view.camera.clip_from_world(1.0)
    clip = np.stack([*places.values()]) @ matrix[:, :3].T + matrix[:, 3]
    dots = (clip[:, :2] / clip[:, 3:] * 0.5 + 0.5) * SIDE
    shown = np.all((dots > 0) & (dots < SIDE), axis=1)
    names, dots = [name for name, is_shown in zip(places, shown, strict=True) if is_shown], corner + dots[shown]
    taken = [_box(x, y, DOT_PX, DOT_PX) for x, y in dots]
    moved = {row.point for row in fap.FAPS}
    for name, (x, y) in zip(names, dots.tolist(), strict=True):
        pen.ellipse(_box(x, y, DOT_PX, DOT_PX), MOVED if name in moved else HELD, outline=INK)
        wide = pen.textlength(name, font=font(LABEL_PX)) / 2 + 1
        options = [
            _box(x + across * (away + wide), y + up * away, wide, LABEL_PX / 2)
            for away, (across, up) in product(AWAY_PX, product((1, -1, 0), (0, -1, 1)))
            if (across, up) != (0, 0)
        ]
        free = next(
            (box for box in options if _is_in(box, corner) and not any(_overlap(box, other) for other in taken)),
            options[0],
        )
        taken.append(free)
        middle = (free[0] + free[2]) / 2, (free[1] + free[3]) / 2
        pen.line((x, y, *middle), fill=HELD)
        pen.text(middle, name, HELD, font=font(LABEL_PX), anchor="mm", stroke_width=2, stroke_fill=INK)


def _is_named(name: str, view: View) -> bool:
    return any(name == each or (each.endswith(".") and name.startswith(each)) for each in view.points)


def _box(x: float, y: float, wide: float, high: float) -> tuple[float, float, float, float]:
    return x - wide, y - high, x + wide, y + high


def _is_in(box: tuple[float, ...], corner: np.ndarray) -> bool:
    return bool((box[:2] >= corner).all() and (box[2:] <= corner + SIDE).all())


def _overlap(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
