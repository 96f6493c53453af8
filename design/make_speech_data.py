"""Make the speech data that profiles and figures are learned from, out of public sources.

    python -m design.make_speech_data track VIDEOS -o work --detector .venv/detector/bin/python [--model FILE]
    python -m design.make_speech_data phones VIDEOS -o work
    python -m design.make_speech_data assemble work --face dense_face.npz --layouts markers.csv -o data/speech_train.npz

What you fetch yourself:

VIDEOS          a folder with the videos of one speaker of the GRID corpus (``bbaf2n.mpg`` and so on: 360 x 288, 25
                frames a second, 3 s); Zenodo record 3625687; docs/references.md has the citation and the licence
--model         MediaPipe's ``face_landmarker_v2_with_blendshapes.task`` (Apache-2.0); without it the older mesh inside
                mediapipe's wheel is used: the same 478 points, about 0.7 mm apart from the other's on the lips
dense_face.npz  a face in whose fields the motion is expressed: ``vertices`` (V, 3) mm, ``expr`` (F, V, 3) mm,
                ``expr_names``, and ``mediapipe468``, the vertex of each point; ours was ICT-FaceKit (MIT)
markers.csv     layouts of markers: columns ``layout, marker, vertex, mediapipe, x_mm, y_mm, z_mm, description``

``make detector`` makes the tracker's environment; the extra ``ear`` adds PocketSphinx.

Steps: (1) every frame is tracked on its own; (2) pixels become mm by the outer eye corners, which are set to those of
the dense face, one scale a clip: the speaker's true size is unknown, so mm are good to about 5 %; (3) head motion is
removed, one rigid motion a frame; (4) the bias that the tracker has in turned heads is removed by a quadratic
regression on the head's pose in silent frames; (5) displacements from the rest face, the mean of the silent frames, are
stored in steps of 0.02 mm, the first frame of a clip absolute, then differences; (6) expression weights between 0 and 1
by ridge regression, mostly on the picture's plane, lips weighted most; (7) phones by PocketSphinx' forced alignment of
the sentence, which the file's name spells.

Not run again since: the whole on the videos themselves. The steps and their settings are those of the run that made the
data of ``profiles/grid_s1_en``; its own program is not kept, and three choices here are new: which points count as
rigid, the ridge, and the weight of each point. Tried: step 1 on drawn pictures; step 7 on twelve recorded sentences
(where both say "with" alike, nine of them, phones begin 3 ms apart from that run's on average, 0 at the median); step 6
on that run's points (0.35 mm are left on the lips, 0.34 by its weights); the others on made input (tests/unit/design).
Figures that docs quote come from that run.
"""

import argparse
import csv
import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
from fapengine.geometry.rigid import fit_rigid

Array = NDArray[np.float64]

STEP_MM, DEPTH_WEIGHT, RIDGE = 0.02, 0.15, 1e-3
EYE_CORNERS = (33, 263)
"""Points of MediaPipe's mesh: outer corners of the right and the left eye."""
RIGID = (
    6, 8, 9, 10, 21, 33, 54, 67, 103, 109, 127, 133, 151, 162, 168, 195, 197, 251, 263, 284, 297, 332, 338, 356, 362,
    389,
)  # fmt: skip
"""26 points that speech does not move: forehead, temples, bridge of the nose, corners of the eyes."""
LIP_WEIGHT = 4.0
SLOTS = (
    {"b": "bin", "l": "lay", "p": "place", "s": "set"},
    {"b": "blue", "g": "green", "r": "red", "w": "white"},
    {"a": "at", "b": "by", "i": "in", "w": "with"},
    {letter: letter for letter in "abcdefghijklmnopqrstuvxyz"},
    dict(
        zip("z123456789", ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"], strict=True)
    ),
    {"a": "again", "n": "now", "p": "please", "s": "soon"},
)
"""Words for each letter of a file's name."""
SILENT = {"sil", "sp", ""}


def text_of(name: str) -> str:
    """Spell the sentence that a GRID file's name encodes.

    >>> text_of("bbaf2n")
    'bin blue at f two now'
    """
    if len(name) != len(SLOTS) or any(letter not in slot for letter, slot in zip(name, SLOTS, strict=True)):
        raise DataError(f"name: got {name!r}, expected six letters of the GRID corpus, like bbaf2n")
    return " ".join(slot[letter] for letter, slot in zip(name, SLOTS, strict=True))


def encode_deltas(moves_mm: ArrayLike) -> NDArray[np.int16]:
    """(T, M, 3) mm -> (3 M, T) int16 in steps of 0.02 mm: the first frame absolute, then differences.

    Differences of rounded values, so that rounding does not add up.
    """
    moves = np.asarray(moves_mm, dtype=np.float64)
    steps = np.round(moves.reshape(len(moves), -1) / STEP_MM)
    return np.diff(steps, axis=0, prepend=0).T.astype(np.int16)


def decode_deltas(deltas: ArrayLike, lengths: Iterable[int]) -> Array:
    """(3 M, T) steps of clips of given lengths -> (T, M, 3) mm."""
    steps, start, clips = np.asarray(deltas).T.astype(np.int64), 0, []
    for length in lengths:
        clips.append(np.cumsum(steps[start : start + length], axis=0))
        start += length
    return np.concatenate(clips).reshape(len(steps), -1, 3) * STEP_MM


def scale_to_mm(points_px: Array, eye_distance_mm: float) -> Array:
    """(T, 478, 3) pixels, y down and z away -> mm, y up and z towards the viewer; one scale for all frames."""
    left, right = points_px[:, EYE_CORNERS[1]], points_px[:, EYE_CORNERS[0]]
    apart = float(np.median(np.linalg.norm(left - right, axis=-1)))
    return points_px * np.array([1.0, -1.0, -1.0]) * (eye_distance_mm / apart)


def remove_head_motion(points_mm: Array, template_mm: Array) -> tuple[Array, Array]:
    """Carry each frame's rigid points onto the template.

    Parameters
    ----------
    points_mm : (T, 478, 3)
    template_mm : (26, 3)
        Where :data:`RIGID` lie in head axes.

    Returns
    -------
    points : (T, 478, 3) mm
        In head axes.
    poses_rad : (T, 3)
        Rotation vector of the head in each frame.
    """
    from scipy.spatial.transform import Rotation

    motion = fit_rigid(points_mm[:, RIGID], np.broadcast_to(template_mm, (len(points_mm), *template_mm.shape)))
    return motion.apply(points_mm), Rotation.from_matrix(motion.rotation).inv().as_rotvec()


def pose_features(poses_rad: Array) -> Array:
    """(T, 10): 1, the three angles, and their six products."""
    one, two = np.triu_indices(3)
    return np.concatenate([np.ones((len(poses_rad), 1)), poses_rad, poses_rad[:, one] * poses_rad[:, two]], axis=1)


def remove_pose_bias(points_mm: Array, poses_rad: Array, silent: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Take away what depends on the pose in silent frames: displacements (T, M, 3) and the rest face (M, 3), mm.

    In silence the face rests, so what still changes with the pose is the tracker's error. The rest face is the mean of
    the silent frames.
    """
    if silent.sum() < 20:
        raise DataError(f"silent frames: got {silent.sum()}, expected at least 20 to fit the pose's bias")
    features, flat = pose_features(poses_rad), points_mm.reshape(len(points_mm), -1)
    coefficients = np.linalg.lstsq(features[silent], flat[silent], rcond=None)[0]
    rest = flat[silent].mean(axis=0)
    return (flat - features @ coefficients).reshape(points_mm.shape), rest.reshape(points_mm.shape[1:])


def solve_weights(moves_mm: Array, fields_mm: Array, point_weights: ArrayLike, *, ridge: float = RIDGE) -> Array:
    """Expression weights 0..1 of each frame: ridge least squares in a box.

    Parameters
    ----------
    moves_mm : (T, M, 3)
    fields_mm : (F, M, 3)
        Displacements at weight 1.
    point_weights : (M,)
        Depth counts :data:`DEPTH_WEIGHT` of that, because a picture shows little of it.

    Returns
    -------
    (T, F)
    """
    from scipy.optimize import lsq_linear

    weights = np.sqrt(np.asarray(point_weights, dtype=np.float64))[:, None] * np.sqrt([1.0, 1.0, DEPTH_WEIGHT])
    design = (fields_mm * weights).reshape(len(fields_mm), -1).T
    gram = design.T @ design
    gram += ridge * np.trace(gram) / len(gram) * np.eye(len(gram))
    factor = np.linalg.cholesky(gram).T  # |factor w - right|^2 differs from the objective by a constant
    right = np.linalg.solve(factor.T, design.T @ (moves_mm * weights).reshape(len(moves_mm), -1).T)
    return np.stack([lsq_linear(factor, column, bounds=(0.0, 1.0), method="bvls").x for column in right.T])


def frames_in(intervals: Iterable[tuple[str, float, float]], count: int, rate_hz: float) -> NDArray[np.bool_]:
    """(T,): frames in which no phone but silence sounds, 0.1 s away from any."""
    times, silent = np.arange(count) / rate_hz, np.ones(count, bool)
    for label, start, end in intervals:
        if label.lower() not in SILENT:
            silent &= (times < start - 0.1) | (times > end + 0.1)
    return silent


def find_videos(folder: Path) -> list[Path]:
    """List a folder's videos, or say where to get them."""
    videos = sorted(path for path in folder.glob("*") if path.suffix in {".mpg", ".mp4", ".avi"})
    if not videos:
        raise UsageError(
            f"VIDEOS: got no .mpg, .mp4 or .avi in {folder}, expected the videos of one GRID speaker"
            " (Zenodo record 3625687; see docs/references.md)"
        )
    return videos


def track(options: argparse.Namespace) -> None:
    """Run step 1: write ``NAME.points.npz`` for each video."""
    from rich.progress import Progress

    videos = find_videos(options.videos)
    if not options.detector.is_file():
        raise ResourceError(f"--detector: got {options.detector}, expected a Python with mediapipe (make detector)")
    if options.model and not options.model.is_file():
        raise UsageError(f"--model: got {options.model}, expected MediaPipe's face landmarker (.task, Apache-2.0)")
    options.output.mkdir(parents=True, exist_ok=True)
    command = [str(options.detector), str(Path(__file__).with_name("track_faces.py")), str(options.output)]
    command += [str(options.model or ""), *map(str, videos)]
    with Progress() as progress, subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as detector:
        bar = progress.add_task("videos", total=len(videos))
        for _ in detector.stdout or ():
            progress.advance(bar)
    if detector.returncode:
        raise ResourceError(f"track_faces.py: ended with {detector.returncode}; its messages stand above")


def align(samples: NDArray[np.int16], text: str) -> list[tuple[str, float, float]]:
    """Run step 7 on one sound: ARPAbet phones with start and end in s, silence between them.

    Parameters
    ----------
    samples : (N,) int16
        16 kHz, mono.
    text : str
        What is said.
    """
    from pocketsphinx import Decoder

    decoder = Decoder(lm=None, loglevel="FATAL")
    for word, phones in dictionary().items():
        decoder.add_word(word, phones, word == "grid_zero")  # the last one rebuilds the search
    decoder.set_align_text(" ".join(f"grid_{word}" for word in text.split()))
    _decode(decoder, samples)  # words first
    if decoder.hyp() is None:
        raise DataError(f"alignment: got none, expected {text!r}")
    decoder.set_alignment()
    _decode(decoder, samples)  # then the phones inside them
    frame_s = 1 / decoder.config["frate"]
    return [
        (
            "sil" if phone.name == "SIL" or phone.name.startswith("+") else phone.name,
            phone.start * frame_s,
            (phone.start + phone.duration) * frame_s,
        )
        for word in decoder.get_alignment()
        for phone in word
    ]


def _decode(decoder: Any, samples: NDArray[np.int16]) -> None:
    decoder.start_utt()
    decoder.process_raw(samples.tobytes(), full_utt=True)
    decoder.end_utt()


def dictionary() -> dict[str, str]:
    """Pronunciations of the corpus' 51 words, under names that are in no other dictionary."""
    from design.speech_sample import WORDS

    return {f"grid_{word}": " ".join(phones) for word, phones in WORDS.items()}


def read_sound(path: Path) -> NDArray[np.int16]:
    """Decode a file's sound: 16 kHz, mono, int16."""
    import av

    with av.open(str(path)) as container:
        resampler = av.AudioResampler(format="s16", layout="mono", rate=16000)
        parts = [part.to_ndarray()[0] for frame in container.decode(audio=0) for part in resampler.resample(frame)]
        parts += [part.to_ndarray()[0] for part in resampler.resample(None)]
    return np.concatenate(parts)


def phones(options: argparse.Namespace) -> None:
    """Run step 7 on all videos: write ``NAME.phones.json``."""
    from rich.progress import track as bar

    options.output.mkdir(parents=True, exist_ok=True)
    for video in bar(find_videos(options.videos), "sentences"):
        try:
            found = align(read_sound(video), text_of(video.stem))
        except DataError as error:
            print(f"{video.name}: left out: {error}", file=sys.stderr)
            continue
        (options.output / f"{video.stem}.phones.json").write_text(json.dumps(found))


def assemble(options: argparse.Namespace) -> None:
    """Run steps 2 to 6 on what ``track`` and ``phones`` wrote."""
    from rich.progress import track as bar

    names = sorted(path.name.removesuffix(".points.npz") for path in options.work.glob("*.points.npz"))
    names = [name for name in names if (options.work / f"{name}.phones.json").is_file()]
    if not names:
        raise UsageError(
            f"work: got no NAME.points.npz with its NAME.phones.json in {options.work}; run track and phones"
        )
    for path, what in ((options.face, "--face"), (options.layouts, "--layouts")):
        if not path.is_file():
            raise UsageError(f"{what}: got {path}, expected a file; --help says what it holds")
    face = np.load(options.face)
    on_face = face["vertices"][face["mediapipe468"]].astype(np.float64)
    eyes_mm = float(np.linalg.norm(on_face[EYE_CORNERS[1]] - on_face[EYE_CORNERS[0]]))
    tracked = [np.load(options.work / f"{name}.points.npz") for name in names]
    spoken = [json.loads((options.work / f"{name}.phones.json").read_text()) for name in names]
    clips = [
        scale_to_mm(fill_gaps(clip["points_px"], name), eyes_mm) for clip, name in zip(tracked, names, strict=True)
    ]
    template = on_face[list(RIGID)]
    for _ in range(2):  # first onto the dense face, then onto the speaker's own points
        moved = [remove_head_motion(clip, template) for clip in bar(clips, "head motion")]
        template = np.concatenate([points[:, RIGID] for points, _ in moved]).mean(axis=0)
    rate_hz = float(tracked[0]["rate_hz"])
    silent = np.concatenate([frames_in(row, len(clip), rate_hz) for row, clip in zip(spoken, clips, strict=True)])
    moves, rest = remove_pose_bias(
        np.concatenate([points for points, _ in moved]), np.concatenate([poses for _, poses in moved]), silent
    )
    chosen, is_lip = read_layouts(options.layouts)
    fields = face["expr"][:, face["mediapipe468"]].astype(np.float64)
    importance = np.where(np.isin(np.arange(len(on_face)), chosen[is_lip]), LIP_WEIGHT, 1.0)
    weights = [
        solve_weights(part, fields, importance)
        for part in bar(np.array_split(moves[:, : len(on_face)], 100), "weights")
    ]
    lengths = [len(clip) for clip in clips]
    deltas = [encode_deltas(part) for part in np.split(moves[:, chosen], np.cumsum(lengths)[:-1])]
    rows = [(index, *phone) for index, row in enumerate(spoken) for phone in row]
    options.output.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        options.output, fps=np.float32(rate_hz), ids=np.array(names), text=np.array([text_of(name) for name in names]),
        speaker=np.full(len(names), "grid"), speaker_names=np.array(["grid"]), n_frames=np.array(lengths, np.int32),
        offset=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int32), ict_names=face["expr_names"],
        ict_w=np.concatenate(weights).astype(np.float16), phone_clip=np.array([row[0] for row in rows], np.int32),
        phone=np.array([row[1] for row in rows]), phone_start=np.array([row[2] for row in rows], np.float32),
        phone_end=np.array([row[3] for row in rows], np.float32), marker_delta=np.concatenate(deltas, axis=1),
        marker_step_mm=np.float32(STEP_MM), marker_mediapipe=chosen.astype(np.int32), marker_is_lip=is_lip,
        marker_neutral=rest[chosen].astype(np.float32)[None],
    )  # fmt: skip
    print(f"{options.output}: {len(names)} sentences, {sum(lengths)} frames")


def fill_gaps(points_px: Array, name: str) -> Array:
    """Interpolate frames in which no face was found; refuse a clip that has none."""
    seen = ~np.isnan(points_px[:, 0, 0])
    if not seen.any():
        raise DataError("points: got no frame with a face, expected at least one", where=f"{name}.points.npz")
    times = np.arange(len(points_px))
    flat = points_px.reshape(len(points_px), -1)
    return np.stack([np.interp(times, times[seen], column[seen]) for column in flat.T], axis=1).reshape(points_px.shape)


def read_layouts(path: Path) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Points of MediaPipe's mesh to keep, and which are lips: layout ``berger209``, then 20 of the inner lips."""
    inner = (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308, 415, 310, 311, 312, 13, 82, 81, 80, 191)
    with path.open() as file:
        rows = [row for row in csv.DictReader(file) if row["layout"] == "berger209"]
    numbers = [int(row["mediapipe"]) for row in rows]
    outer = ["lip" in row["description"] for row in rows]
    return np.array([*numbers, *inner]), np.array([*outer, *(True for _ in inner)])


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for run, help_text in ((track, "points of each frame"), (phones, "phones of each sentence")):
        command = commands.add_parser(run.__name__, help=help_text)
        command.add_argument("videos", type=Path)
        command.add_argument("-o", "--output", type=Path, default=Path("out/speech_data"))
        command.set_defaults(run=run)
    commands.choices["track"].add_argument("--detector", type=Path, default=Path(".venv/detector/bin/python"))
    commands.choices["track"].add_argument("--model", type=Path)
    command = commands.add_parser("assemble", help="everything else: the file that profiles are learned from")
    command.add_argument("work", type=Path)
    command.add_argument("--face", type=Path, required=True)
    command.add_argument("--layouts", type=Path, required=True)
    command.add_argument("-o", "--output", type=Path, default=Path("data/speech_train.npz"))
    command.set_defaults(run=assemble)
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except FapEngineError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
