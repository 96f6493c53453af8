"""Speech of a living face as shapes of other rigs, and back: millimetres per phone, and which shapes are at work.

    python -m bench.retarget [--avatar avatar.glb] [--json]

Six sentences of espeak-ng are planned with everything that lives and become ARKit's 52, Oculus' visemes, VRM's presets
and MPEG-4's visemes, which become FAPs again. Per phone, in the middle of its hold: how far the inner lips are open,
and what came back of it, with the lower lip's height and the mouth's width; ARKit beside plain least squares on the
same rows, which is what stood here before. Of each set: closures that are kept, the largest step of a weight of the
mouth between two frames, the correlation of the opening, and the time of one frame. ``--avatar`` also opens the mouth
of an avatar with ARKit's shapes, by its own shapes alone.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fapengine
from fapengine.files.heads.meshes import load_rig
from fapengine.files.motion import as_visemes
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.rig.blendshape_mesh import JAW, LEFT, RIGHT
from fapengine.mesh.rig.feature_points import locate
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FULL_WEIGHT
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.retarget.arkit import approximate_arkit, arkit_map, arkit_to_faps
from fapengine.retarget.blend import ARKIT_NAMES, weights_mm
from fapengine.retarget.visemes import (
    VRM0_NAMES,
    approximate_presets,
    approximate_visemes,
    presets_to_faps,
    visemes_to_faps,
)
from fapengine.scoring.mouth import closures_of_truth, mouth_of
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.high_level import viseme_faces
from fapengine.wire.shapes import ArkitFollower, PresetFollower, VisemeFollower

Array = NDArray[np.float64]

SENTENCES = (
    "Hello there my good friend how are you doing today.",
    "Bright sunshine shimmers on the ocean.",
    "Peter put the big pumpkin above the barn, and my baby moved five of them by himself.",
    "You choose two blue shoes while we were fishing for very few fat puffins.",
    "She said that the weather would be warmer in the afternoon; perhaps we should go.",
    "Why would a wise woman love huge puddles?",
)
RATE_HZ = 60.0
CLASSES = {
    "p b m": ("p", "b", "m"), "f v": ("f", "v"), "w": ("w",), "u ʊ": ("uː", "u", "ʊ"),
    "ʃ ʒ tʃ dʒ": ("ʃ", "ʒ", "tʃ", "dʒ"),
    "s z": ("s", "z"), "t d n l": ("t", "d", "n", "l"), "θ ð": ("θ", "ð"), "i ɪ": ("iː", "i", "ɪ"), "ɛ eɪ": ("ɛ", "eɪ"),
    "æ ʌ": ("æ", "ʌ"), "ɑ aɪ aʊ": ("ɑː", "ɑ", "aɪ", "aʊ"), "ɔ oʊ": ("ɔː", "ɔ", "oʊ"),
}  # fmt: skip


def fractions_of(track: FapTrack) -> Array:
    """(T, 15): fractions of MPEG-4's visemes in FAP 1."""
    first, second, blend, _ = track.visemes.T
    rows, share = np.eye(15), blend[:, None] / FULL_WEIGHT
    mixed: Array = share * rows[first] + (1 - share) * rows[second]
    return mixed


def fractions_to_faps(fractions: Array) -> Array:
    faces = viseme_faces(fapengine.load_profile("grid_s1_en"))
    shown: Array = fractions @ faces
    return shown


SETS: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "arkit": (approximate_arkit, arkit_to_faps),
    "plain": (lambda faps: arkit_map().approximate_weights(faps), arkit_to_faps),
    "oculus": (approximate_visemes, visemes_to_faps),
    "vrm0": (approximate_presets, presets_to_faps),
    "mpeg4": (
        lambda faps: fractions_of(as_visemes(FapTrack.from_values(to_codable(faps), rate_hz=RATE_HZ))),
        fractions_to_faps,
    ),
}
FOLLOWERS: dict[str, Callable[[], ArkitFollower | VisemeFollower | PresetFollower]] = {
    "arkit": ArkitFollower, "oculus": VisemeFollower, "vrm0": PresetFollower,
}  # fmt: skip
MOUTHS = {
    "arkit": [
        number for number, name in enumerate(ARKIT_NAMES) if name.startswith(("jaw", "mouth", "cheek", "tongue"))
    ],
    "oculus": list(range(15)),
    "vrm0": [VRM0_NAMES.index(vowel) for vowel in "AIUEO"],
    "mpeg4": list(range(15)),
}
"""Columns of the mouth in each set."""
NO_SPEECH = ("jawForward", "mouthFrownLeft", "cheekPuff", "noseSneerLeft", "mouthLeft", "jawLeft")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--avatar", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    frames, rows = [], []
    for number, sentence in enumerate(SENTENCES):
        spoken = fapengine.speak(sentence, rate_hz=RATE_HZ, seed=number)
        first = sum(len(each) for each in frames)
        frames.append(spoken.track.values.astype(float))
        rows += [(phone.label, first + middle(phone)) for phone in spoken.phones.phones if not phone.is_silence]
    faps = np.concatenate(frames)
    weights = {name: there(faps) for name, (there, _) in SETS.items()}
    back = {name: SETS[name][1](weights[name]) for name in SETS}
    avatar = None if options.avatar is None else avatar_rows(options.avatar)
    table = {}
    for title, labels in CLASSES.items():
        at = [frame for label, frame in rows if label in labels]
        wanted = opening_mm(faps[at])
        table[title] = {
            "phones": len(at),
            "opening_mm": wanted.mean(),
            **{f"{name}_opening_mm": opening_mm(found[at]).mean() for name, found in back.items()},
            **{f"{name}_off_mm": np.abs(opening_mm(found[at]) - wanted).mean() for name, found in back.items()},
            **{f"{name}_most_mm": opening_mm(found[at]).max() for name, found in back.items()},
            "arkit_lower_lip_off_mm": np.abs(one_mm(back["arkit"][at] - faps[at], 5)).mean(),
            "arkit_width_off_mm": np.abs(width_mm(back["arkit"][at] - faps[at])).mean(),
        }
        if avatar is not None:
            table[title]["avatar_opening_mm"] = opening_mm(weights["arkit"][at] @ avatar).mean()
            table[title]["avatar_most_mm"] = opening_mm(weights["arkit"][at] @ avatar).max()
    sets = {name: of_a_set(name, frames) for name in MOUTHS}
    report = {"phones": table, "sets": sets, "channels": channels(weights, faps)}
    print(json.dumps(report, indent=2, default=float, ensure_ascii=False) if options.json else as_text(report))


def middle(phone: Phone) -> int:
    """Frame in the middle of a phone's hold; closures come early, lips at the teeth late."""
    share = {"p": 0.25, "b": 0.25, "m": 0.25, "f": 0.55, "v": 0.55}.get(phone.label, 0.4)
    return round((phone.start_s + share * phone.duration_s) * RATE_HZ)


def one_mm(faps: Array, number: int) -> Array:
    moved: Array = faps[..., fap.column(number)] * weights_mm()[fap.column(number)]
    return moved


def opening_mm(faps: Array) -> Array:
    return -one_mm(faps, 4) - one_mm(faps, 5)


def width_mm(faps: Array) -> Array:
    return one_mm(faps, 6) + one_mm(faps, 7)


def channels(weights: dict[str, Array], faps: Array) -> dict[str, float]:
    """Greatest weights of what is no business of speech, and how much of the opening is the jaw's."""
    wanted, found = opening_mm(faps), {}
    jaw_mm = float(opening_mm(arkit_map().faps[ARKIT_NAMES.index("jawOpen")]))
    for name in ("arkit", "plain"):
        for shape in (*NO_SPEECH, "jawOpen"):
            found[f"{name} {shape}"] = weights[name][:, ARKIT_NAMES.index(shape)].max()
        left, right = (weights[name][:, ARKIT_NAMES.index(f"mouth{side}")] for side in ("Left", "Right"))
        found[f"{name} mouthLeft with mouthRight"] = np.minimum(left, right).max()
        jaw, close = (weights[name][:, ARKIT_NAMES.index(shape)] for shape in ("jawOpen", "mouthClose"))
        ajar, wide = jaw - close, wanted > 3.0
        found[f"{name} share of the opening that is the jaw's"] = jaw_mm * ajar[wide].sum() / wanted[wide].sum()
        found[f"{name} jaw ajar, correlation with the opening"] = np.corrcoef(ajar, wanted)[0, 1]
    for preset in ("Joy", "Angry", "Sorrow", "Surprised", "A", "I", "U", "E", "O"):
        found[f"vrm0 {preset}"] = weights["vrm0"][:, VRM0_NAMES.index(preset)].max()
    return {name: float(value) for name, value in found.items()}


def of_a_set(name: str, sentences: list[Array]) -> dict[str, float]:
    """Closures and openings that a set keeps, steps of its weights, and microseconds per frame."""
    there, back = SETS[name]
    count = sum(len(faps) for faps in sentences)
    begin = time.process_time()
    weights = [there(faps) for faps in sentences]
    row = {"frame_us": (time.process_time() - begin) / count * 1e6, "largest_step": largest_step(name, weights)}
    pairs = [
        tuple(mouth_of(FapTrack.from_values(to_codable(values), rate_hz=RATE_HZ)) for values in (back(found), faps))
        for found, faps in zip(weights, sentences, strict=True)
    ]
    closures = [closures_of_truth(shown, wanted) for shown, wanted in pairs]
    row["closures"] = sum(each.met for each in closures)
    row["closures_wanted"] = sum(each.wanted for each in closures)
    row["opening_r"] = min(np.corrcoef(shown.opening_mm, wanted.opening_mm)[0, 1] for shown, wanted in pairs)
    if name in FOLLOWERS:
        begin = time.process_time()
        followed = [live(name, faps) for faps in sentences]
        row["live_frame_us"] = (time.process_time() - begin) / count * 1e6
        row["live_largest_step"] = largest_step(name, followed)
    return {key: float(value) for key, value in row.items()}


def live(name: str, faps: Array) -> Array:
    follower = FOLLOWERS[name]()
    return np.array([follower.follow(values) for values in faps])


def largest_step(name: str, weights: list[Array]) -> float:
    return float(max(np.abs(np.diff(each[:, MOUTHS[name]], axis=0)).max() for each in weights))


def avatar_rows(path: Path) -> Array:
    """(52, 68) FAPU: what the shapes of an avatar do to its own feature points; what it lacks does nothing."""
    rig = load_rig(path)
    moves = {LEFT: rig.dense("eyeBlinkLeft"), RIGHT: rig.dense("eyeBlinkRight"), JAW: rig.dense("jawOpen")}
    points = locate(rig, moves, build_head())
    places = {name: rig.vertices[vertex] for name, vertex in points.items()}
    fapu = fapengine.load_profile("grid_s1_en").fapu.measure(places)
    rows = np.zeros((len(ARKIT_NAMES), fap.FAP_COUNT))
    for index, name in enumerate(ARKIT_NAMES):
        if name not in rig.blendshapes:
            continue
        moved = rig.dense(name)
        for row in fap.FAPS:
            axis = fap.HEAD_AXES.get(row.positive)
            if axis is not None and row.point in points and row.unit is not fap.FapUnit.AU:
                rows[index, fap.column(row.number)] = moved[points[row.point]] @ np.array(axis) / fapu.unit(row.unit)
    return rows


def as_text(report: dict[str, object]) -> str:
    phones, sets, found = report["phones"], report["sets"], report["channels"]
    assert isinstance(phones, dict)
    assert isinstance(sets, dict)
    assert isinstance(found, dict)
    names = ["arkit", "oculus", "vrm0"]
    lines = [
        "| phones | opening mm | ARKit | plain least squares | Oculus | VRM | lower lip off | width off |",
        "|" + "---|" * 8,
    ]
    for title, row in phones.items():
        cells = [
            f"{row[f'{name}_opening_mm']:.1f} (off {row[f'{name}_off_mm']:.1f})"
            for name in ("arkit", "plain", *names[1:])
        ]
        lines.append(
            f"| {title} ({row['phones']}) | {row['opening_mm']:.1f} | {' | '.join(cells)} |"
            f" {row['arkit_lower_lip_off_mm']:.1f} | {row['arkit_width_off_mm']:.1f} |"
        )
        if "avatar_opening_mm" in row:
            lines[-1] += f" avatar {row['avatar_opening_mm']:.1f}, at most {row['avatar_most_mm']:.1f} |"
    for title in ("p b m", "f v"):
        row = phones[title]
        lines.append(
            f"{title}: widest that comes back {row['arkit_most_mm']:.1f} mm (plain {row['plain_most_mm']:.1f})"
        )
    lines += [f"{name}: {value:.2f}" for name, value in found.items()]
    lines += ["| set | closures | largest step, live | opening r | us a frame | us a frame, live |", "|" + "---|" * 6]
    for name, row in sets.items():
        steps, live = f"{row['largest_step']:.2f}", ""
        if name in FOLLOWERS:
            steps, live = f"{steps}, {row['live_largest_step']:.2f}", f"{row['live_frame_us']:.0f}"
        kept = f"{row['closures']:.0f} of {row['closures_wanted']:.0f}"
        lines.append(f"| {name} | {kept} | {steps} | {row['opening_r']:.4f} | {row['frame_us']:.0f} | {live} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
