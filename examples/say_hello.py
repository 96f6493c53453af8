"""Say a sentence from Python: the FAPs as a file, and a picture of the middle of the first vowel."""

from pathlib import Path

import numpy as np

from fapengine.files.fap import save_fap
from fapengine.files.pictures import save_png
from fapengine.files.profiles import load_profile
from fapengine.mesh.head import build_head
from fapengine.render.renderer import FaceRenderer
from fapengine.trajectory.planner import plan
from fapengine.voices.espeak import EspeakVoice

speech = EspeakVoice("en-us").speak("Hello there.")
track = plan(speech.phones, load_profile("grid_s1_en"), rng=np.random.default_rng(1)).track
save_fap(Path("out/hello.fap"), track)
with FaceRenderer(build_head()) as renderer:
    save_png(Path("out/hello.png"), renderer.draw(track.values[len(track) // 3]))
print(f"{len(track)} frames; see out/hello.fap and out/hello.png")
