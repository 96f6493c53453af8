"""A recording to a pandas table: ARKit's 52 weights, a row a frame; and the three frames of the widest jaw.

Needs pandas.
"""

from pathlib import Path

import fapengine

Path("out").mkdir(exist_ok=True)
talk = fapengine.speak("The weights of a sentence.").save("out/talk.wav")  # or a recording of your own
table = fapengine.weights(fapengine.animate(talk).track, "arkit").to_frame()
table.to_csv("out/weights.csv")
print(f"out/weights.csv: {len(table)} frames of {len(table.columns)} weights")
print(table["jawOpen"].nlargest(3))
