"""What an imported head looks like and costs: docs/pictures/imported.jpg, and figures of docs/measurements.md.

    python -m design.imported_head data

The face is ICT-FaceKit's (MIT licence, University of Southern California, Institute for Creative Technologies): its
neutral mesh of 26,719 vertices and its 57 expressions, as its own folder of OBJ files.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

from design.data_files import FOLDER, asked_path
from fapengine.app.head_check import poses
from fapengine.files.heads.folder import save_head
from fapengine.files.heads.import_file import import_head_file
from fapengine.files.heads.load import load_head
from fapengine.files.pictures import contact_sheet
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import to_codable
from fapengine.render.camera import preset
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "imported.jpg"
SHOWN = ("rest", "m", "f", "ɑ", "u", "i", "joy", "sadness", "anger", "surprise")
FRAMES = 60


def main(data: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        ict, kept = Path(folder) / "ict", Path(folder) / "head"
        write_folder(data, ict)
        start = time.perf_counter()
        adopted, info = import_head_file(ict)
        middle = time.perf_counter()
        save_head(kept, adopted.mesh, info)
        saved = time.perf_counter()
        mesh = load_head(str(kept))
        print(
            f"import {middle - start:.1f} s, save {saved - middle:.1f} s, load {time.perf_counter() - saved:.2f} s;"
            f" {sum(path.stat().st_size for path in kept.iterdir()) / 1e6:.1f} MB;"
            f" {len(mesh.vertices_mm)} vertices, {len(mesh.feature_points)} points, {len(info.used)} shapes,"
            f" {len(adopted.moved)} FAPs, {mesh.basis.width} weights, {len(mesh.basis.entry_mm)} entries"
        )
    rows, labels = poses()
    chosen = [next(n for n, label in enumerate(labels) if label[0] == name) for name in SHOWN]
    blink = np.zeros(fap.FAP_COUNT)
    blink[[fap.column(19), fap.column(20)]] = 1024
    frames = to_codable(np.concatenate([rows[chosen], blink[None]]))
    with FaceRenderer(mesh, RenderOptions(size=(300, 300))) as renderer:
        pictures = list(renderer.frames(frames))
    with FaceRenderer(mesh, RenderOptions(size=(300, 300), camera=preset("three-quarter"))) as renderer:
        pictures.append(renderer.draw(frames[SHOWN.index("joy")]))
    names = [*((name, labels[index][1]) for name, index in zip(SHOWN, chosen, strict=True)), ("blink", ""), ("joy", "")]
    sheet = contact_sheet(pictures, names, title="ICT-FaceKit's face, moved by FAPs")
    Image.fromarray(sheet).save(PICTURE, quality=82, optimize=True)
    print(f"{PICTURE.name}: {PICTURE.stat().st_size / 1000:.0f} kB")
    for name, head in (("imported", mesh), ("default", build_head()), ("imported", mesh), ("default", build_head())):
        print(f"{name}, {len(head.vertices_mm)} vertices: {rate(head):.0f} frames/s at 512x512")


def write_folder(data: Path, folder: Path) -> None:
    """Spell the shared arrays as ICT-FaceKit's folder, in centimetres."""
    dense = np.load(data / "dense_face.npz")
    folder.mkdir()
    rest = dense["vertices"].astype(float)
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in dense["triangles"] + 1)
    (folder / "generic_neutral_mesh.obj").write_text(spell(rest) + faces)
    for name, field in zip(dense["expr_names"].tolist(), dense["expr"], strict=True):
        (folder / f"{name}.obj").write_text(spell(rest + field.astype(float)))


def spell(vertices_mm: np.ndarray) -> str:
    return "".join(f"v {x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in (vertices_mm / 10).tolist())


def rate(mesh: FaceMesh) -> float:
    """Frames a second, every FAP moving a little."""
    faps = np.random.default_rng(0).normal(0, 40, (FRAMES, fap.FAP_COUNT))
    with FaceRenderer(mesh, RenderOptions(samples=0)) as renderer:
        list(renderer.frames(faps[:8]))
        start = time.perf_counter()
        count = len(list(renderer.frames(faps)))
        return count / (time.perf_counter() - start)


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "dense_face.npz"))
