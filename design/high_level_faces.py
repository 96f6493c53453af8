"""Write ``fapengine-face/high-level-faces.js``: the faces of visemes and expressions for pages.

Run ``python -m design.high_level_faces`` after the default profile, or how a phone is spoken alone, has changed.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.files.profiles import load_profile
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.trajectory.high_level import expression_faces, viseme_faces

TARGET = Path(__file__).parent.parent / "fapengine-face" / "high-level-faces.js"


def source() -> str:
    """Return the module's text: FAPU, rounded, a row of 68 for each face."""
    profile = load_profile(DEFAULT_PROFILE)
    tables = (("VISEME_FACES", viseme_faces(profile)), ("EXPRESSION_FACES", expression_faces(profile)))
    note = f"// Written by design/high_level_faces.py from the profile {DEFAULT_PROFILE}.\n"
    return note + "".join(f"export const {name} = [\n{_rows(faces)}];\n" for name, faces in tables)


def _rows(faces: NDArray[np.float64]) -> str:
    return "".join(f"  [{','.join(map(str, face))}],\n" for face in np.rint(faces).astype(int).tolist())


if __name__ == "__main__":
    TARGET.write_text(source())
    print(f"wrote {TARGET.name}")
