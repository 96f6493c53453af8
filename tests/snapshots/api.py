"""Jobs of the Python API: public names of ``fapengine`` alone, and the arrays that they give."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

import fapengine

Arrays = Mapping[str, ArrayLike]
TEXT = "Bright moon, feel pool."


def _speech(performance: fapengine.Performance) -> Arrays:
    phones = performance.phones.phones
    times = [(phone.start_s, phone.end_s, phone.stress, phone.confidence) for phone in phones]
    return _track(performance.track) | {"phones": np.array([phone.label for phone in phones]), "times": np.array(times)}


def _track(track: fapengine.FapTrack) -> dict[str, ArrayLike]:
    return {
        "values": track.values, "mask": track.mask, "visemes": track.visemes, "expressions": track.expressions,
        "frame_numbers": track.frame_numbers, "rate_hz": track.rate_hz,
    }  # fmt: skip


def speak(inputs: Path, folder: Path) -> Arrays:
    """Say a text."""
    return _speech(fapengine.speak(TEXT, seed=5))


def speak_with_moods(inputs: Path, folder: Path) -> Arrays:
    """Say a text with moods and a style."""
    moods = [fapengine.Mood(fapengine.Expression.JOY, 0.6, 0.2, 0.9), fapengine.Mood(fapengine.Expression.FEAR, 0.3)]
    style = fapengine.Style(articulation=1.2, loudness_db=3.0).without(["blinks"])
    return _speech(fapengine.speak(TEXT, expressions=moods, style=style, rate_hz=50.0))


def animate_phones(inputs: Path, folder: Path) -> Arrays:
    """Animate a track of phones that was made in Python."""
    phones = [fapengine.Phone("m", 0.1, 0.2), fapengine.Phone("ɑː", 0.2, 0.5, 1), fapengine.Phone("p", 0.5, 0.6)]
    return _speech(fapengine.animate(fapengine.PhoneTrack.from_phones(phones), style=fapengine.Style.speech_only()))


def animate_file(inputs: Path, folder: Path) -> Arrays:
    """Animate timings, with their sound."""
    return _speech(fapengine.animate(inputs / "talk.pho", sound=inputs / "voice.wav", expressions=["joy:0.5"]))


def animate_sound(inputs: Path, folder: Path) -> Arrays:
    """Animate a recording of which the words are known."""
    return _speech(fapengine.animate(inputs / "voice.wav", transcript=TEXT, style=fapengine.Style.speech_only()))


def save_kinds(inputs: Path, folder: Path) -> Arrays:
    """Save a performance as several kinds of files."""
    performance = fapengine.animate(inputs / "talk.pho", seed=2)
    for name in ("a.fap", "a.fba", "a.csv"):
        performance.save(folder / name)
    performance.save(folder / "b.csv", shapes="oculus")
    performance.save(folder / "c.fba", encoding=fapengine.EncoderOptions(quant=4, intra_every=10))
    return {}


def load_kinds(inputs: Path, folder: Path) -> Arrays:
    """Load a motion of every kind."""
    names = ("talk.fap", "talk.fba", "arkit.csv", "oculus.csv", "vrm0.csv", "azure.json", "vmc.osc")
    tracks = {name: fapengine.load(inputs / name) for name in names}
    return {f"{name} {key}": value for name, track in tracks.items() for key, value in _track(track).items()}


def save_pose(inputs: Path, folder: Path) -> Arrays:
    """Make a pose by the names of FAPs, and save it."""
    pose = fapengine.FapTrack.pose(open_jaw=300, stretch_l_cornerlip=120, raise_l_i_eyebrow=90)
    fapengine.save(pose, folder / "pose.fap")
    fapengine.save(pose, folder / "pose.png", size=(48, 48))
    return _track(pose)


def encode_frames(inputs: Path, folder: Path) -> Arrays:
    """Encode frame by frame, and decode byte by byte."""
    track = fapengine.load(inputs / "moving.fap")
    encoder = fapengine.Encoder(rate_hz=track.rate_hz, options=fapengine.EncoderOptions(quant=3, intra_every=9))
    data = b"".join(encoder.frame(row) for row in track.values) + encoder.finish()
    decoder = fapengine.Decoder()
    frames = [frame for byte in data for frame in decoder.feed(bytes([byte]))] + decoder.close()
    return {"bytes": np.frombuffer(data, np.uint8), "values": np.array([frame.values for frame in frames])}


def profile(inputs: Path, folder: Path) -> Arrays:
    """Load a profile."""
    found = fapengine.load_profile("grid_s1_en")
    return {"phones": np.array(sorted(found.phones)), "expressions": np.array(sorted(map(int, found.expressions)))}


def heads(inputs: Path, folder: Path) -> Arrays:
    """Load our own head and one of another look."""
    arrays: dict[str, ArrayLike] = {}
    for name in ("default", "woman:age=0.7"):
        head = fapengine.load_head(name)
        arrays |= {
            f"{name} vertices": head.vertices_mm,
            f"{name} triangles": head.triangles,
            f"{name} albedo": head.albedo,
        }
        arrays[f"{name} points"] = np.array(sorted(head.feature_points))
    return arrays


def pictures(inputs: Path, folder: Path) -> Arrays:
    """Draw frames: number, size and mean levels."""
    track = fapengine.FapTrack.from_values(fapengine.load(inputs / "talk.fap").values[8:12], rate_hz=30.0)
    drawn = [np.asarray(picture) for picture in fapengine.frames(track, size=(40, 40))]
    return {
        "shape": np.array([picture.shape for picture in drawn]),
        "levels": np.array([picture.mean() / 255 for picture in drawn]),
    }


def server_config(inputs: Path, folder: Path) -> Arrays:
    """Numbers of a server's defaults."""
    config = fapengine.ServerConfig()
    return {"ports": np.array([config.listen.port, config.listen.web_port]), "rate_hz": config.face.rate_hz}


JOBS: Mapping[str, Callable[[Path, Path], Arrays]] = {
    f"python {function.__name__.replace('_', ' ')}": function
    for function in (
        speak, speak_with_moods, animate_phones, animate_file, animate_sound, save_kinds, load_kinds, save_pose,
        encode_frames, profile, heads, pictures, server_config,
    )
}  # fmt: skip
"""By the name of the job: a function of the folder of inputs and of the job's own."""
