"""A program for the detector's own environment: pictures in, landmarks out.

python landmarks.py PICTURES.npy LANDMARKS.npy

In: (T, H, W, 3) uint8, sRGB. Out: (T, 478, 3) float64, pixels from the top left and depth; NaN where no face was found.
Every picture is searched on its own: no tracking helps the detector over a bad one.
"""

import sys

import numpy as np
from mediapipe.python.solutions.face_mesh import FaceMesh

LANDMARKS = 478


def main(pictures: str, landmarks: str) -> None:
    frames = np.load(pictures)
    found = np.full((len(frames), LANDMARKS, 3), np.nan)
    size = np.array([frames.shape[2], frames.shape[1], frames.shape[2]])
    with FaceMesh(static_image_mode=True, refine_landmarks=True, min_detection_confidence=0.5) as detector:
        for row, frame in zip(found, frames, strict=True):
            faces = detector.process(np.ascontiguousarray(frame)).multi_face_landmarks
            if faces:
                row[:] = [(point.x, point.y, point.z) for point in faces[0].landmark] * size
    np.save(landmarks, found)


if __name__ == "__main__":
    main(*sys.argv[1:])
