"""Any neutral face becomes a head that FAPs move: here a wider one, as a mesh file and a table of feature points."""

from pathlib import Path

import fapengine

MARKED = ("2.1", "3.7", "3.8", "3.11", "3.12", "8.1", "8.2", "8.3", "8.4", "9.3", "9.15")
"""Feature points of chin, corners of the eyes, lips and nose; more make it better."""

# What a modelling program would have written.
model = fapengine.load_head()
vertices = model.vertices_mm * [1.15, 0.95, 1.0]
colours = model.albedo ** (1 / 2.2)
lines = ["v " + " ".join(f"{value:.4f}" for value in (*vertices[n], *colours[n])) for n in range(len(vertices))]
lines += [f"f {a} {b} {c}" for a, b, c in model.triangles + 1]
points = [f"{name},{model.feature_points[name]}" for name in MARKED]
Path("out").mkdir(exist_ok=True)
Path("out/wide.obj").write_text("\n".join(lines))
Path("out/wide.csv").write_text("\n".join(["point,vertex", *points]))

head = fapengine.load_head("out/wide.obj", points="out/wide.csv")
smile = fapengine.FapTrack.pose(
    stretch_l_cornerlip=200, stretch_r_cornerlip=200, raise_l_cornerlip_o=200, raise_r_cornerlip_o=200
)  # fmt: skip
fapengine.save(smile, "out/own.png", head=head, size=(384, 384))

print(f"out/own.png: a smile of {len(head.vertices_mm)} vertices")
