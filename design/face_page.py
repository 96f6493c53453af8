"""Draw the pictures of ``docs/face.md``: the head from several sides, visemes, expressions, gaze, styles, a real face.

    python -m design.face_page

The real face is the neutral of ICT-FaceKit (USC, MIT licence), brought in as anybody's head is; it is drawn where
``data`` holds it.
"""

import csv
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from design import phones_sheet
from design.imported_head import write_folder
from fapengine.app.inspection.feature_points import draw_feature_points
from fapengine.expressions import EXPRESSIONS
from fapengine.files.heads.import_file import import_head_file
from fapengine.files.heads.load import load_head
from fapengine.files.pictures import font
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.import_head import import_head
from fapengine.mpeg4 import fap
from fapengine.profiles import Profile
from fapengine.render.camera import Camera, preset
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.trajectory.closures import close_lips
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.gestures import LIDS_FOLLOW

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
DENSE_FACE, MARKERS = (ROOT / "data" / name for name in ("dense_face.npz", "markers.csv"))
VISEMES = ("m", "f", "θ", "t", "k", "ʃ", "s", "n", "ɹ", "ɑ", "ɛ", "ɪ", "ɔ", "u")
"""A phone of each of the standard's visemes 1 to 14."""
CLOSE = Camera(target_mm=(0.0, 8.0, 60.0), distance_mm=900.0, field_deg=12.5)
PEOPLE = ("default", "woman", "man", "child", "older", *(f"random:{seed}" for seed in (1, 3, 4, 5, 7, 10, 11)))
EVERYBODY = (*PEOPLE[:5], "man:haircut=cropped", "woman:haircut=bob", *PEOPLE[5:10])
COLOURS = {  # linear RGB of the real face's parts, which its file leaves open
    "gums_tongue": (0.5, 0.16, 0.15), "teeth": (0.8, 0.75, 0.66), "mouth_socket": (0.25, 0.07, 0.06),
    "eyeball_left": (0.8, 0.77, 0.74), "eyeball_right": (0.8, 0.77, 0.74), "eye_socket_left": (0.5, 0.2, 0.18),
    "eye_socket_right": (0.5, 0.2, 0.18),
}  # fmt: skip
LEFT_OUT = ("lacrimal_left", "lacrimal_right", "eye_blend", "eye_occlusion", "eyelashes")


def frame(**values: float) -> NDArray[np.float64]:
    """FAPs by name, FAPU."""
    faps = np.zeros(fap.FAP_COUNT)
    for name, value in values.items():
        faps[fap.column(fap.by_name(name).number)] = value
    return faps


def gaze(yaw_rad: float, pitch_rad: float) -> NDArray[np.float64]:
    """Both eyes, and the lids with them."""
    faps = frame(yaw_l_eyeball=yaw_rad * 1e5, yaw_r_eyeball=yaw_rad * 1e5)
    faps += frame(pitch_l_eyeball=pitch_rad * 1e5, pitch_r_eyeball=pitch_rad * 1e5)
    for numbers, per_rad in LIDS_FOLLOW.items():
        faps[[fap.column(number) for number in numbers]] += per_rad * pitch_rad
    return faps


def pose(profile: Profile, name: str) -> NDArray[np.float64]:
    """FAPs of an expression, or of a sound alone."""
    expressions = {key.name.lower(): value for key, value in profile.expressions.items()}
    if name not in expressions:
        return phones_sheet.pose(name).astype(float)
    moved = profile.space.to_points_mm(expressions[name].target[None])
    faps = displacements_to_faps(moved, profile.space.points, profile.fapu) + expressions[name].fap
    return close_lips(faps, np.zeros(1), [])[0]


def draw(head: FaceMesh, faps: Sequence[NDArray[np.float64]], camera: Camera, size: int) -> list[NDArray[np.uint8]]:
    with FaceRenderer(head, RenderOptions(size=(size, size), camera=camera)) as renderer:
        return list(renderer.frames(faps))


def sheet(name: str, tiles: Mapping[str, NDArray[np.uint8]], columns: int) -> None:
    """Write tiles of one size, each with its label in a corner."""
    size = next(iter(tiles.values())).shape[0]
    rows = -(-len(tiles) // columns)
    page = Image.new("RGB", (columns * size + (columns - 1) * 4, rows * size + (rows - 1) * 4), "white")
    for number, (label, tile) in enumerate(tiles.items()):
        picture = Image.fromarray(tile)
        ImageDraw.Draw(picture).text((8, 5), label, "white", font=font(max(13, size // 18)))
        page.paste(picture, (number % columns * (size + 4), number // columns * (size + 4)))
    page.save(PICTURES / f"{name}.jpg", quality=80, optimize=True)


def everybody(name: str, rows: Mapping[str, FaceMesh], profile: Profile, *, drawn: int, shown: int) -> None:
    """Write a sheet of people and what they do, drawn at one size in pixels and shown at another."""
    poses = {"neutral": np.zeros(fap.FAP_COUNT)}
    poses |= {what: pose(profile, what) for what in ("joy", "surprise", "anger", "u", "ʃ", "f", "θ")}
    poses["blink"] = frame(close_t_l_eyelid=1024, close_t_r_eyelid=1024)
    page = Image.new("RGB", ((len(poses) + 1) * shown, len(rows) * shown), "white")
    for row, (who, mesh) in enumerate(rows.items()):
        side = draw(mesh, [poses["neutral"]], preset("profile"), drawn)
        for column, tile in enumerate([*draw(mesh, list(poses.values()), CLOSE, drawn), *side]):
            small = Image.fromarray(tile[..., :3]).resize((shown, shown), Image.Resampling.LANCZOS)
            label = who if column == 0 else (*poses, "profile")[column] if row == 0 else ""
            ImageDraw.Draw(small).text((4, 2), label, "white", font=font(max(12, shown // 16)))
            page.paste(small, (column * shown, row * shown))
    page.save(PICTURES / f"{name}.jpg", quality=72, optimize=True)


def imported_face() -> FaceMesh:
    """Make a head of ICT-FaceKit's neutral and its own 57 expressions."""
    with tempfile.TemporaryDirectory() as folder:
        write_folder(DENSE_FACE.parent, Path(folder) / "ict")
        return import_head_file(Path(folder) / "ict")[0].mesh


def real_face(standard: FaceMesh) -> FaceMesh:
    """Make a head of the neutral of ICT-FaceKit."""
    data = np.load(DENSE_FACE)
    vertices, triangles = data["vertices"].astype(float), data["triangles"]
    albedo = np.full((len(vertices), 3), (0.66, 0.40, 0.29))
    for part, (start, end) in zip(data["region_names"], data["region_ranges"], strict=True):
        if part in COLOURS:
            albedo[start:end] = COLOURS[part]
        elif part in LEFT_OUT:
            inside = (triangles >= start) & (triangles < end)
            triangles = triangles[~inside.any(axis=1)]
    with MARKERS.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["layout"] == "mpeg4"]
    points = {row["marker"]: int(row["vertex"]) for row in rows}
    mesh = BlendshapeMesh(vertices=vertices, triangles=triangles, blendshapes={}, albedo=albedo)
    return import_head(mesh, (), points, standard).mesh


def main() -> None:
    profile, head, still = load_profile("grid_s1_en"), build_head(), np.zeros(fap.FAP_COUNT)
    views = {name: draw(head, [still], preset(name), 400)[0] for name in ("front", "three-quarter", "profile")}
    with FaceRenderer(head, RenderOptions(size=(400, 400), wire=True)) as renderer:
        views[f"{len(head.vertices_mm)} vertices"] = renderer.draw(still)
    sheet("face-views", views, 2)
    visemes = draw(head, [pose(profile, name) for name in VISEMES], CLOSE, 260)
    sheet(
        "face-visemes",
        {f"{i + 1}  {name}": tile for i, (name, tile) in enumerate(zip(VISEMES, visemes, strict=True))},
        5,
    )
    faces = {f"joy {share}": share * pose(profile, "joy") for share in (0.3, 0.6)}
    faces |= {name: pose(profile, name) for name in ("joy", "sadness", "anger", "fear", "disgust", "surprise")}
    for mood in (each for each in EXPRESSIONS if each.mix):
        faces[mood.label] = expression_faps(profile)[:, EXPRESSIONS.index(mood)]
    faces["blink"] = frame(close_t_l_eyelid=1024, close_t_r_eyelid=1024)
    faces |= {"gaze left": gaze(0.45, 0), "gaze up": gaze(0, -0.3), "gaze down": gaze(0, 0.45)}
    sheet("face-expressions", dict(zip(faces, draw(head, list(faces.values()), CLOSE, 300), strict=True)), 5)
    Image.fromarray(draw_feature_points(head)).save(PICTURES / "face-points.jpg", quality=80, optimize=True)
    people = {name: load_head(name) for name in PEOPLE}
    sheet("face-people", {name: draw(mesh, [still], CLOSE, 300)[0] for name, mesh in people.items()}, 6)
    rows = {name: load_head(name) for name in EVERYBODY}
    if DENSE_FACE.exists():
        rows["measured, imported"] = imported_face()
    everybody("face-everybody", rows, profile, drawn=1024, shown=240)
    if DENSE_FACE.exists():
        poses = {"neutral": still, "ɑ": pose(profile, "ɑ"), "joy": pose(profile, "joy")}
        turned = Camera(yaw_deg=35.0, pitch_deg=4.0, target_mm=(0.0, 8.0, 30.0), field_deg=14.5)
        tiles = {}
        for whose, mesh in (("real", real_face(build_head(MEASURED))), ("ours", head)):
            for name, tile in zip(poses, draw(mesh, list(poses.values()), CLOSE, 300), strict=True):
                tiles[f"{whose}: {name}"] = tile
            tiles[f"{whose}: from the side"] = draw(mesh, [still], turned, 300)[0]
        sheet("face-real", tiles, 4)


if __name__ == "__main__":
    main()
