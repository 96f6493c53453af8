"""A face with shapes becomes a head that FAPs move: here ours, made wider, with ARKit's names as a file would have."""

from pathlib import Path

import numpy as np

from fapengine.files.pictures import contact_sheet, save_png
from fapengine.mesh.deform import deform
from fapengine.mesh.head import build_head
from fapengine.mesh.morphs import MorphMesh, Shape
from fapengine.mesh.morphs_adopt import adopt_morphs
from fapengine.mesh.morphs_axes import JAW, LEFT, RIGHT
from fapengine.mesh.morphs_locate import locate
from fapengine.mpeg4 import fap
from fapengine.render.renderer import FaceRenderer
from fapengine.retarget.arkit import arkit_map

WIDER = np.array([1.15, 0.95, 1.0])

head, arkit = build_head(), arkit_map()
shapes = {}
for name, faps in zip(arkit.names, arkit.faps, strict=True):
    if not name.startswith(("eyeLook", "tongue")):  # eyes and tongue have bones of their own
        moves = (deform(head, faps) - head.vertices_mm) * WIDER
        shapes[name] = Shape(np.arange(len(moves)), moves)
mesh = MorphMesh(vertices=head.vertices_mm * WIDER, triangles=head.triangles, shapes=shapes, albedo=head.albedo)

roles = {LEFT: mesh.dense("eyeBlinkLeft"), RIGHT: mesh.dense("eyeBlinkRight"), JAW: mesh.dense("jawOpen")}
adopted = adopt_morphs(mesh, list(shapes), locate(mesh, roles, head), head)

smile = np.zeros(fap.FAP_COUNT)
smile[[fap.column(number) for number in (12, 13, 59, 60)]] = 200
with FaceRenderer(adopted.mesh, size=(384, 384)) as renderer:
    pictures = list(renderer.frames([np.zeros(fap.FAP_COUNT), smile]))
save_png(Path("out/own.png"), contact_sheet(pictures, [("rest", ""), ("smile", "FAP 12, 13, 59, 60")]))
print(f"out/own.png: {len(adopted.moved)} FAPs move it")
