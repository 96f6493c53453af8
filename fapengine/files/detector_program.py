"""The detector program, which runs in MediaPipe's own environment: images in, landmarks out.

It imports nothing of this package. Usage: python detector_program.py [face_landmarker.task]

Messages on standard input and output are those of fapengine/_child.py: two lengths (<II, bytes), a JSON object and raw
bytes. In: width and height, and the image as sRGB bytes. Out, for each image: (478, 3) float32, pixels from the top
left and depth; NaN without a face.
"""

import json
import os
import struct
import sys
from contextlib import contextmanager

LANDMARKS = 478
LENGTHS = struct.Struct("<II")


def main() -> None:
    """Answer images until standard input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # standard output carries answers only; what the detector prints goes to standard error
    import numpy as np

    pictures = sys.stdin.buffer
    with _detector(sys.argv[1] if len(sys.argv) > 1 else None) as find:
        while len(lengths := pictures.read(LENGTHS.size)) == LENGTHS.size:
            size, data_size = LENGTHS.unpack(lengths)
            head, data = json.loads(pictures.read(size)), pictures.read(data_size)
            width, height = head["width"], head["height"]
            size_px = np.array([width, height, width], np.float32)
            found = np.full((LANDMARKS, 3), np.nan, np.float32)
            picture = np.frombuffer(data, np.uint8).reshape(height, width, 3)
            points = find(np.ascontiguousarray(picture))
            if points:
                found[:] = [(point.x, point.y, point.z) for point in points] * size_px
            answer = found.tobytes()
            answers.write(LENGTHS.pack(2, len(answer)) + b"{}" + answer)
            answers.flush()


@contextmanager
def _detector(model: str | None):  # type: ignore[no-untyped-def]  # types of the other environment
    """Open the face mesh that older wheels include, or the landmarker of a model file."""
    if model is None:
        from mediapipe.python.solutions.face_mesh import FaceMesh

        with FaceMesh(static_image_mode=False, max_num_faces=1, refine_landmarks=True) as mesh:

            def look(picture):  # type: ignore[no-untyped-def]
                faces = mesh.process(picture).multi_face_landmarks
                return faces[0].landmark if faces else None

            yield look
    else:
        from mediapipe import Image, ImageFormat
        from mediapipe.tasks.python import BaseOptions
        from mediapipe.tasks.python.vision import FaceLandmarker, FaceLandmarkerOptions

        options = FaceLandmarkerOptions(base_options=BaseOptions(model_asset_path=model), num_faces=1)
        with FaceLandmarker.create_from_options(options) as landmarker:

            def look(picture):  # type: ignore[no-untyped-def]
                faces = landmarker.detect(Image(image_format=ImageFormat.SRGB, data=picture)).face_landmarks
                return faces[0] if faces else None

            yield look


if __name__ == "__main__":
    main()
