"""One face as JSON text, for programs with a JSON parser and blend shapes: Unity, Godot, a page, a script.

A frame is one object::

    {"t": 12.35,                           engine time, s
     "session": "face",
     "arkit": {"jawOpen": 0.31, ...},      all 52, 0..1
     "visemes": {"sil": 0.2, "aa": ...},   Oculus' 15, 0..1, together 1
     "head": [pitch, yaw, roll]}           degrees; positive is down, the subject's left, right ear down

A receiver uses either the shapes or the visemes, whichever its model has.
"""

import json

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import frozen
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.visemes import OCULUS_NAMES
from fapengine.wire.shapes import turns_rad

DIGITS = 4
"""Decimal places."""


def encode_weights(session: str, time_s: float, arkit: ArrayLike, visemes: ArrayLike, faps: ArrayLike) -> bytes:
    """Encode one frame.

    Parameters
    ----------
    session : str
    time_s : float
        Engine time.
    arkit : (52,)
        Weights in the order of ``ARKIT_NAMES``.
    visemes : (15,)
        Shares in the order of ``OCULUS_NAMES``.
    faps : (68,) FAPU
        FAP 48 to 50 are the head.

    Examples
    --------
    >>> encode_weights("face", 1.5, [0.0] * 52, [1.0] + [0.0] * 14, [0] * 68)[-24:].decode()
    '"head": [0.0, 0.0, 0.0]}'
    """
    shapes = frozen(arkit, "arkit", (len(ARKIT_NAMES),), np.float64)
    mouth = frozen(visemes, "visemes", (len(OCULUS_NAMES),), np.float64)
    yaw, pitch, roll = np.degrees(turns_rad(faps)[0]).tolist()
    frame = {
        "t": round(time_s, DIGITS),
        "session": session,
        "arkit": dict(zip(ARKIT_NAMES, shapes.round(DIGITS).tolist(), strict=True)),
        "visemes": dict(zip(OCULUS_NAMES, mouth.round(DIGITS).tolist(), strict=True)),
        "head": [round(angle, 2) for angle in (pitch, yaw, roll)],
    }
    return json.dumps(frame).encode()
