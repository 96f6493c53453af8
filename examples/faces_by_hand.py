"""Set FAPs by name and look at them: a surprised face, from the side, without a wall behind it."""

from pathlib import Path

import numpy as np

from fapengine.files.pictures import save_png
from fapengine.mesh.head import build_head
from fapengine.mpeg4 import fap
from fapengine.render.camera import preset
from fapengine.render.renderer import FaceRenderer

surprise = {
    "open_jaw": 300, "raise_b_midlip": -300, "raise_b_lip_lm": -250, "raise_b_lip_rm": -250, "raise_b_midlip_o": -300,
    "raise_b_lip_lm_o": -250, "raise_b_lip_rm_o": -250, "raise_l_i_eyebrow": 180, "raise_r_i_eyebrow": 180,
    "raise_l_m_eyebrow": 200, "raise_r_m_eyebrow": 200, "raise_l_o_eyebrow": 150, "raise_r_o_eyebrow": 150,
    "close_t_l_eyelid": -200, "close_t_r_eyelid": -200,
}  # fmt: skip
values = np.zeros(fap.FAP_COUNT)
for name, value in surprise.items():
    values[fap.column(fap.by_name(name).number)] = value
with FaceRenderer(build_head(), camera=preset("three-quarter"), transparent=True) as renderer:
    save_png(Path("out/surprise.png"), renderer.draw(values))
print("see out/surprise.png")
