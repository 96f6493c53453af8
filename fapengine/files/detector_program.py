"""A program for the face detector's own environment: pictures in, landmarks out. It imports nothing of this package.

python detector_program.py

In, on standard input: width and height as two uint32, little-endian, then pictures of so many sRGB bytes each. Out, on
standard output: a byte 1 when the detector is there; then for each picture (478, 3) float32, pixels from the top left
and depth; NaN where no face was found.
"""

import os
import struct
import sys

LANDMARKS = 478


def main() -> None:
    """Be the program."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the detector prints is no answer
    import numpy as np
    from mediapipe.python.solutions.face_mesh import FaceMesh

    width, height = struct.unpack("<II", sys.stdin.buffer.read(8))
    size = np.array([width, height, width], dtype=np.float32)
    with FaceMesh(static_image_mode=False, max_num_faces=1, refine_landmarks=True) as detector:
        answers.write(b"\1")
        answers.flush()
        while len(data := sys.stdin.buffer.read(width * height * 3)) == width * height * 3:
            found = np.full((LANDMARKS, 3), np.nan, np.float32)
            picture = np.frombuffer(data, np.uint8).reshape(height, width, 3)
            faces = detector.process(np.ascontiguousarray(picture)).multi_face_landmarks
            if faces:
                found[:] = [(point.x, point.y, point.z) for point in faces[0].landmark] * size
            answers.write(found.tobytes())
            answers.flush()


if __name__ == "__main__":
    main()
