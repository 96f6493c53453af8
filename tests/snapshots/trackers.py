"""What face trackers write of a face that speaks: 478 landmarks, OpenFace's table, Azure's frames and VMC."""

import json

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LANDMARKS = (
    "2.1 152; 2.2 13; 2.3 14; 2.4 308; 2.5 78; 2.6 310; 2.7 80; 2.8 318; 2.9 88; 2.10 200; 2.11 400; 2.12 176; "
    "2.13 397; 2.14 172; 3.1 386; 3.2 159; 3.3 374; 3.4 145; 3.7 263; 3.8 133; 3.9 253; 3.10 23; 3.11 362; 3.12 "
    "33; 3.13 257; 3.14 27; 4.1 336; 4.2 107; 4.3 334; 4.4 105; 4.5 300; 4.6 70; 5.1 425; 5.2 205; 5.3 346; 5.4 "
    "117; 8.1 0; 8.2 17; 8.3 291; 8.4 61; 8.5 270; 8.6 40; 8.7 405; 8.8 181; 8.9 37; 8.10 267; 9.1 358; 9.2 129; "
    "9.3 4; 9.4 98; 9.5 327; 9.6 193; 9.7 417; 9.12 197; 9.13 456; 9.14 236; 9.15 2 "
)
"""Feature point and its landmark of the face mesh."""
OPENFACE = (
    "2.1 8; 8.4 48; 8.3 54; 8.1 51; 8.2 57; 8.6 49; 8.5 53; 8.7 55; 8.8 59; 8.9 50; 8.10 52; 2.5 60; 2.4 64; 2.2 "
    "62; 2.3 66; 2.7 61; 2.6 63; 2.8 65; 2.9 67; 4.6 17; 4.4 19; 4.2 21; 4.1 22; 4.3 24; 4.5 26; 3.12 36; 3.8 39; "
    "3.11 42; 3.7 45; 3.2 37 38; 3.4 40 41; 3.1 43 44; 3.3 46 47; 9.15 33; 9.2 31; 9.1 35; 9.3 30 "
)
"""Feature point and its points of OpenFace's 68."""
SHAPES = ("eyeBlinkLeft", "eyeBlinkRight", "mouthSmileLeft", "mouthSmileRight", "mouthFunnel", "mouthClose")


def _places(text: str) -> dict[str, list[int]]:
    words = [entry.split() for entry in text.split(";") if entry.strip()]
    return {name: [int(number) for number in numbers] for name, *numbers in words}


def wobble(count: int, width: int) -> Array:
    """(count, width) in 0..1, without an order; the same on every machine."""
    return np.asarray((np.arange(count * width).reshape(count, width) * 7919 % 1009) / 1009.0)


def landmarks_json(moved: dict[str, Array]) -> str:
    """468 points and two irises a frame, as shares of a picture of 640 x 480; ``moved`` are mm, (T, 3)."""
    frames = len(next(iter(moved.values())))
    found = np.tile((wobble(478, 3) - 0.5) * [120, 180, 40], (frames, 1, 1))
    for name, (index,) in _places(LANDMARKS).items():
        if name in moved:
            found[:, index] = moved[name]
    found[:, 10] = (0.0, 90.0, 60.0)
    for iris, first, second in ((468, "3.12", "3.8"), (473, "3.7", "3.11")):
        middle = (moved[first] + moved[second]) / 2
        found[:, iris : iris + 5] = middle[:, None] + [(0, 0, 0), (6, 0, 0), (0, 6, 0), (-6, 0, 0), (0, -6, 0)]
    shares = found * [1.5 / 640, -1.5 / 480, -1.5 / 640] + [0.5, 0.5, 0.0]
    return json.dumps(shares.round(5).tolist())


def openface_csv(moved: dict[str, Array]) -> str:
    """68 points in mm from the camera, gaze and two action units; the sixth frame is lost."""
    frames = len(next(iter(moved.values())))
    found = np.tile((wobble(68, 3) - 0.5) * [120, 160, 40], (frames, 1, 1))
    for name, indices in _places(OPENFACE).items():
        if name in moved:
            found[:, indices] = moved[name][:, None]
    found[:, [27, 28, 29]] = [(0, 20, 75), (0, 12, 80), (0, 5, 85)]
    found[:, [30]] = (0, -2, 90)
    found[:, [0, 16]] = [(-70, 10, 0), (70, 10, 0)]
    seen = found * [1, -1, -1] + [0, 0, 600]
    header = ["frame", "timestamp", "confidence", "success", "gaze_angle_x", "gaze_angle_y"]
    header += [f"{axis}_{n}" for axis in "XYZ" for n in range(68)] + ["AU06_r", "AU45_r"]
    lines = [",".join(header)]
    for frame, points in enumerate(seen):
        cells = [str(frame), f"{frame / 30:.4f}", "0.95", str(int(frame != 5)), f"{0.01 * (frame % 5):.3f}", "0.02"]
        cells += [f"{value:.2f}" for value in points.T.ravel()] + [f"{frame % 4}", f"{frame % 3}"]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def azure_json() -> str:
    """Frames of 55 weights."""
    return json.dumps({"FrameIndex": 0, "BlendShapes": wobble(12, 55).round(3).tolist()})


def vmc_osc(values: NDArray[np.int32]) -> str:
    """A stream of VMC, as ``oscdump`` prints it; ``values`` are FAPs, (T, 68)."""
    lines: list[str] = []
    for frame, row in enumerate(values[:20]):
        at = f"eeada2a5.{frame * 0x0888_8888:08x}"
        shapes = {"jawOpen": row[2] / 1500, "mouthPucker": abs(int(row[15])) / 1500, "browInnerUp": 0.1 * (frame % 4)}
        shapes |= {name: 0.05 * ((frame + place) % 5) for place, name in enumerate(SHAPES)}
        lines.append(f"{at} /VMC/Ext/T f {frame / 30:f}")
        lines += [f'{at} /VMC/Ext/Blend/Val sf "{name}" {weight:f}' for name, weight in shapes.items()]
        lines.append(f"{at} /VMC/Ext/Blend/Apply ")
    return "\n".join(lines)
