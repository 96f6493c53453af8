"""A program for the detector's own environment: videos in, the points of every frame out.

    python track_faces.py FOLDER MODEL VIDEO...

Writes ``FOLDER/NAME.points.npz``: ``points_px`` (T, 478, 3), pixels from the top left and depth, NaN where no face was
found; ``scores`` (T, 52), NaN where the model gives none; ``rate_hz``. Says each name when it is done. MODEL is a
``.task`` file of MediaPipe's face landmarker, or empty for the mesh inside its wheel. Each frame is searched on its
own.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import mediapipe
import numpy as np

LANDMARKS, SCORES = 478, 52
Answer = tuple[object, list[float]]
Detector = Callable[[np.ndarray], Answer | None]


def mesh_detector() -> Detector:
    mesh = mediapipe.solutions.face_mesh.FaceMesh(static_image_mode=True, refine_landmarks=True)

    def detect(picture: np.ndarray) -> Answer | None:
        faces = mesh.process(picture).multi_face_landmarks
        return (faces[0].landmark, []) if faces else None

    return detect


def task_detector(model: str) -> Detector:
    vision = mediapipe.tasks.vision
    options = vision.FaceLandmarkerOptions(
        base_options=mediapipe.tasks.BaseOptions(model_asset_path=model),
        running_mode=vision.RunningMode.IMAGE,
        output_face_blendshapes=True,
    )
    landmarker = vision.FaceLandmarker.create_from_options(options)

    def detect(picture: np.ndarray) -> Answer | None:
        found = landmarker.detect(mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=picture))
        if not found.face_landmarks:
            return None
        return found.face_landmarks[0], [shape.score for shape in found.face_blendshapes[0]]

    return detect


def track(path: str, detect: Detector, folder: Path) -> None:
    video = cv2.VideoCapture(path)
    points, scores = [], []
    while True:
        there, picture = video.read()
        if not there:
            break
        size = np.array([picture.shape[1], picture.shape[0], picture.shape[1]])
        found = detect(np.ascontiguousarray(picture[:, :, ::-1]))
        points.append(np.full((LANDMARKS, 3), np.nan) if found is None else [(p.x, p.y, p.z) * size for p in found[0]])
        scores.append(found[1] if found and found[1] else [np.nan] * SCORES)
    np.savez_compressed(
        folder / f"{Path(path).stem}.points.npz",
        points_px=np.array(points),
        scores=np.array(scores),
        rate_hz=video.get(cv2.CAP_PROP_FPS),
    )


def main(folder: str, model: str, *videos: str) -> None:
    detect = task_detector(model) if model else mesh_detector()
    for path in videos:
        track(path, detect, Path(folder))
        print(Path(path).stem, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
