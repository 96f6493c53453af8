"""A face in this program that follows the sound card, and its frames as a table of an avatar's visemes."""

import numpy as np

import fapengine

with fapengine.Face(rate_hz=50.0) as face:  # without a sound card it keeps time by the clock, and says so
    face.say("Hello there.")
    frames, off_ms = [], [0.0]
    for faps in face.frames():  # each when it is due; in a loop of your own: face.frame()
        frames.append(faps)
        off_ms.append(1000 * abs(face.sync_error_s or 0.0))
    device = face.sound

track = fapengine.FapTrack.from_values(np.array(frames), rate_hz=50.0)
fapengine.save(track, "out/hello_visemes.csv", shapes="oculus")
print(f"{device}: {len(track)} frames, at most {max(off_ms):.1f} ms from the sound: out/hello_visemes.csv")
