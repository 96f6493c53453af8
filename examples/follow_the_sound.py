"""A face in this program that follows the sound card, and its frames as a table of an avatar's visemes."""

import time
from pathlib import Path

import numpy as np

from fapengine.files.paths import write_bytes
from fapengine.files.profiles import load_profile
from fapengine.live.engine.engine import Engine
from fapengine.live.loudspeaker import Loudspeaker
from fapengine.live.server.hub import Hub
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend_tracks import format_blend_csv
from fapengine.voices.espeak import EspeakVoice

RATE_HZ = 50.0
hub = Hub(Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1)), rate_hz=RATE_HZ)
hub.open("anna")
speaker = Loudspeaker(hub, "anna")  # without a sound card it keeps time by the clock, and says so
hub.say("anna", EspeakVoice("en-us").speak("Hello there."))
frames, off_ms = [], [0.0]
while speaker.is_playing:
    time.sleep(1 / RATE_HZ)
    speaker.follow(hub.clock())
    frames.append(hub.tick(hub.clock()).faps[0])
    off_ms.append(1000 * abs(speaker.off_s or 0.0))
speaker.close()
track = FapTrack.of(np.array(frames), rate_hz=RATE_HZ)
write_bytes(Path("out/hello_visemes.csv"), format_blend_csv(track, "oculus"))
print(f"{speaker.description}: {len(track)} frames, at most {max(off_ms):.1f} ms from the sound: out/hello_visemes.csv")
