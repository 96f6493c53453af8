"""Speech motion for any clone: planned by our own engine, with the statistics of a recorded speaker.

    python -m design.speech_sample -o out/speech_sample.npz [--sentences 120] [--seed 1]
    python -m design.speech_sample -o out/S01 --sentences 12 --rate 100    # a session for `fapengine fit`
    python -m design.speech_sample --measure DATA    # once: tests/vectors/speech/statistics.npz from speech_train.npz

The recorded speech may not be passed on, but statistics of it may (``tests/vectors/PROVENANCE.md``). From them this
program makes sentences that move like the recorded ones: random sentences of the GRID corpus' grammar, with phones as
long and as unequal as the speaker's; the path that ``fapengine`` plans for them; the variation that the speaker adds to
that path, drawn with its covariance and its correlation from frame to frame; and 229 points that follow.

A session is a folder of recordings, as a laboratory has it: 57 markers and the inner lips on a head that moves, with
phones. Its motion is planned at the frame rate asked for; the speaker's own variation, known at 25 Hz, is interpolated.

The file written has the layout of ``speech_train.npz``, as ``design/make_speech_data.py`` describes it, so whatever
reads the one reads the other: ``python -m bench.fidelity --train out/speech_sample.npz``. Figures measured on it are
figures of this program, not of a person.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from fapengine.capture.landmarks import FEATURE_POINTS
from fapengine.capture.marker_track import MarkerTrack
from fapengine.files.profiles import load_profile
from fapengine.files.recordings import save_markers
from fapengine.profiles import Profile
from fapengine.speech.alphabets.convert import SILENCES, to_ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.targets import weights_of

Array = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]

STATISTICS = Path(__file__).resolve().parent.parent / "tests" / "vectors" / "speech" / "statistics.npz"
RATE_HZ, FRAMES, STEP_MM = 25.0, 75, 0.02
START_S = (0.45, 0.75)
"""Range of the first phone's start, s."""
REST_SHARE = 0.25
"""Share of the speaker's own variation that is left where nobody speaks."""
RESIDUAL_MODES = 16
SKULL_MM = np.array([[60, 95, 60], [-60, 95, 60], [0, 110, 75], [70, 60, 30], [-70, 60, 30]], np.float64)
"""Markers of a head band."""
GRAMMAR = (
    "bin lay place set", "blue green red white", "at by in with", "a b c d e f g h i j k l m n o p q r s t u v x y z",
    "zero one two three four five six seven eight nine", "again now please soon",
)  # fmt: skip
"""Of the GRID corpus: one word of each."""
WORDS = {
    word: phones.split()
    for word, phones in (line.split(" ", 1) for line in """
a EY
again AH G EH N
at AE T
b B IY
bin B IH N
blue B L UW
by B AY
c S IY
d D IY
e IY
eight EY T
f EH F
five F AY V
four F AO R
g JH IY
green G R IY N
h EY CH
i AY
in IH N
j JH EY
k K EY
l EH L
lay L EY
m EH M
n EH N
nine N AY N
now N AW
o OW
one W AH N
p P IY
place P L EY S
please P L IY Z
q K Y UW
r AA
red R EH D
s EH S
set S EH T
seven S EH V AH N
six S IH K S
soon S UW N
t T IY
three TH R IY
two T UW
u Y UW
v V IY
white W AY T
with W IH DH
x EH K S
y W AY
z Z EH D
zero Z IH R OW
""".strip().splitlines())
}  # fmt: skip
"""Pronunciations in ARPAbet, British where the two differ."""


Timed = tuple[str, float, float]
"""Label, start and end in s."""


def draw_sentence(statistics: Arrays, rng: np.random.Generator) -> tuple[list[Timed], list[Timed]]:
    """Draw a sentence of the grammar: its words, and its phones (ARPAbet), silence around them."""
    words = [str(rng.choice(slot.split())) for slot in GRAMMAR]
    labels = statistics["phone_labels"].tolist()
    phones, now = [("sil", 0.0, float(rng.uniform(*START_S)))], 0.0
    now = phones[0][2]
    for label in (phone for word in words for phone in WORDS[word]):
        row = labels.index(label)
        length = float(np.exp(statistics["phone_log_s"][row] + statistics["phone_log_spread"][row] * rng.normal()))
        length = min(max(length, 0.03), 0.4)
        phones.append((label, now, now + length))
        now += length
    scale = min(1.0, (FRAMES / RATE_HZ - 0.3) / now)  # all sentences are 3 s long
    phones = [(label, start * scale, end * scale) for label, start, end in phones]
    ends = np.cumsum([len(WORDS[word]) for word in words])
    timed = [
        (word, phones[end - len(WORDS[word]) + 1][1], phones[end][2]) for word, end in zip(words, ends, strict=True)
    ]
    return timed, [*phones, ("sil", now * scale, FRAMES / RATE_HZ)]


def to_track(phones: list[tuple[str, float, float]]) -> PhoneTrack:
    """Spell ARPAbet phones in IPA."""
    spelled = [
        Phone(SILENCE if label.lower() in SILENCES else to_ipa(label, "arpabet")[0], start, end)
        for label, start, end in phones
    ]
    return PhoneTrack.from_phones(spelled, tolerance_s=0.01)


def plan_scores(track: PhoneTrack, profile: Profile) -> Array:
    """(75, K): the engine's path through the viseme space, before contacts."""
    return weights_of(track, profile, np.arange(FRAMES) / RATE_HZ)


def draw_residual(spread: Array, correlation: Array, rng: np.random.Generator) -> Array:
    """(75, K): noise of given standard deviation and correlation from frame to frame (first-order autoregression)."""
    noise = rng.normal(size=(FRAMES, len(spread)))
    fresh = np.sqrt(1 - correlation**2)
    for frame in range(1, FRAMES):
        noise[frame] = correlation * noise[frame - 1] + fresh * noise[frame]
    return noise * spread


def move_points(statistics: Arrays, phones: list[tuple[str, float, float]], profile: Profile, rng: Any) -> Array:
    """(75, 229, 3) mm: displacements of all points in one sentence."""
    times = np.arange(FRAMES) / RATE_HZ
    start, end = phones[1][1], phones[-2][2]
    speaking = np.clip(np.minimum(times - start, end - times) / 0.1 + 1, 0, 1)  # rises within 0.1 s
    share = (REST_SHARE + (1 - REST_SHARE) * speaking)[:, None]
    own = draw_residual(np.ones(profile.space.mode_count), statistics["score_correlation"], rng)
    scores = plan_scores(to_track(phones), profile) + share * (own @ statistics["score_factor"].T)
    beyond = share * draw_residual(statistics["residual_spread"], statistics["residual_correlation"], rng)
    flat = scores @ statistics["lift"] + beyond @ statistics["residual_modes"]
    flat += statistics["jitter_mm"] * rng.normal(size=flat.shape)
    return flat.reshape(FRAMES, -1, 3)


def make(statistics: Arrays, sentences: int, seed: int = 1) -> dict[str, NDArray[Any]]:
    """Make so many sentences, in the arrays of ``speech_train.npz``."""
    rng, profile = np.random.default_rng(seed), load_profile("grid_s1_en")
    texts, words, phones, deltas = [], [], [], []
    for clip in range(sentences):
        said, spoken = draw_sentence(statistics, rng)
        steps = np.round(move_points(statistics, spoken, profile, rng).reshape(FRAMES, -1) / STEP_MM)
        texts.append(" ".join(word for word, _, _ in said))
        words += [(clip, *word) for word in said]
        phones += [(clip, *phone) for phone in spoken]
        deltas.append(np.diff(steps, axis=0, prepend=0))
    return {
        "fps": np.float32(RATE_HZ),
        "ids": np.array([f"made{clip:04d}" for clip in range(sentences)]),
        "text": np.array(texts),
        "n_frames": np.full(sentences, FRAMES, np.int32),
        "offset": FRAMES * np.arange(sentences, dtype=np.int32),
        "phone_clip": np.array([phone[0] for phone in phones], np.int32),
        "phone": np.array([phone[1] for phone in phones]),
        "phone_start": np.array([phone[2] for phone in phones], np.float32),
        "phone_end": np.array([phone[3] for phone in phones], np.float32),
        "word_clip": np.array([word[0] for word in words], np.int32),
        "word": np.array([word[1] for word in words]),
        "word_start": np.array([word[2] for word in words], np.float32),
        "word_end": np.array([word[3] for word in words], np.float32),
        "marker_delta": np.concatenate(deltas).T.astype(np.int16),
        "marker_step_mm": np.float32(STEP_MM),
        "marker_mediapipe": statistics["marker_mediapipe"],
        "marker_is_lip": statistics["marker_is_lip"],
        "marker_neutral": statistics["marker_neutral"][None],
    }


def write_session(folder: Path, sentences: int, seed: int = 1, rate_hz: float = 100.0) -> None:
    """Write made sentences as a session: ``made00.c3d`` and ``made00.lab`` ..., and ``session.toml``."""
    statistics, rng, profile = load_statistics(), np.random.default_rng(seed), load_profile("grid_s1_en")
    names = [FEATURE_POINTS.get(int(landmark), f"m{landmark}") for landmark in statistics["marker_mediapipe"]]
    lips = [names.index(name) for name in profile.space.points if name in names]
    columns = sorted({*statistics["layout_lucero57"].tolist(), *lips})
    coarse, fine = np.arange(FRAMES) / RATE_HZ, np.arange(round((FRAMES - 1) / RATE_HZ * rate_hz) + 1) / rate_hz
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(sentences):
        _, spoken = draw_sentence(statistics, rng)
        track = to_track(spoken)
        moved = move_points(statistics, spoken, profile, rng)[:, columns]
        own = moved - _lifted(statistics, plan_scores(track, profile))[:, columns]
        planned = _lifted(statistics, weights_of(track, profile, fine))[:, columns]
        places = statistics["marker_neutral"][columns] + planned + CubicSpline(coarse, own)(fine)
        places = np.concatenate([places, np.tile(SKULL_MM, (len(fine), 1, 1))], axis=1)
        turns = Rotation.from_rotvec(np.outer(np.sin(2 * fine + number), [0.08, 0.12, 0.04])).as_matrix()
        labels = (*(names[column] for column in columns), *(f"H{n}" for n in range(len(SKULL_MM))))
        markers = MarkerTrack(positions_mm=np.einsum("tij,tmj->tmi", turns, places), labels=labels, rate_hz=rate_hz)
        save_markers(folder / f"made{number:02}.c3d", markers)
        lines = (f"{round(start * 1e7)} {round(end * 1e7)} {label}\n" for label, start, end in spoken)
        (folder / f"made{number:02}.lab").write_text("".join(lines))
    skull = ", ".join(f'"H{n}"' for n in range(len(SKULL_MM)))
    (folder / "session.toml").write_text(f'subject = "made"\nlanguage = "en-GB"\nhead = [{skull}]\n')


def _lifted(statistics: Arrays, scores: Array) -> Array:
    """(T, 229, 3) mm: displacements of all points that go with weights, (T, K)."""
    return np.asarray(scores @ statistics["lift"]).reshape(len(scores), -1, 3)


def load_statistics() -> dict[str, NDArray[Any]]:
    """Read what ``tests/vectors/speech`` holds, in float64."""
    with np.load(STATISTICS) as data:
        return {name: data[name].astype(np.float64) if data[name].dtype.kind == "f" else data[name] for name in data}


def measure(folder: Path) -> dict[str, NDArray[Any]]:
    """Measure the statistics of ``speech_train.npz`` and ``markers.csv``."""
    from bench.fidelity import NAMES, load
    from fapengine.models.viseme_space import fit_components

    profile, corpus = load_profile("grid_s1_en"), load(folder / "speech_train.npz")
    data = np.load(folder / "speech_train.npz")
    order = [NAMES.index(name) for name in profile.space.points[: profile.space.marker_count]]
    captured = np.concatenate([profile.space.to_space(clip.points[:, order]) for clip in corpus.clips])
    planned = np.concatenate([plan_scores(clip.phones, profile) for clip in corpus.clips])
    steps = data["marker_delta"].T.astype(np.int32).reshape(-1, FRAMES, data["marker_delta"].shape[0])
    flat = np.cumsum(steps, axis=1).reshape(len(captured), -1) * float(data["marker_step_mm"])
    spoken = np.concatenate([clip.spoken for clip in corpus.clips])
    lift = np.linalg.lstsq(captured, flat, rcond=None)[0]
    off = captured - planned
    beyond = flat - captured @ lift
    modes = fit_components(beyond)[0][:RESIDUAL_MODES]
    amounts = beyond @ modes.T
    rest = beyond - amounts @ modes
    labels = sorted(set(data["phone"].tolist()) - {"sil"})
    length = np.log(np.maximum(data["phone_end"] - data["phone_start"], 0.02))
    layouts = _columns(folder / "markers.csv", data["marker_mediapipe"])
    return {
        "lift": lift.astype(np.float16),
        "score_factor": np.linalg.cholesky(np.cov(off[spoken].T)).astype(np.float32),
        "score_correlation": _correlation(off).astype(np.float32),
        "residual_modes": modes.astype(np.float16),
        "residual_spread": amounts[spoken].std(axis=0).astype(np.float32),
        "residual_correlation": _correlation(amounts).astype(np.float32),
        "jitter_mm": rest.std(axis=0).astype(np.float16),
        "phone_labels": np.array(labels),
        "phone_log_s": np.array([length[data["phone"] == label].mean() for label in labels], np.float32),
        "phone_log_spread": np.array([length[data["phone"] == label].std() for label in labels], np.float32),
        "marker_mediapipe": data["marker_mediapipe"].astype(np.int16),
        "marker_is_lip": data["marker_is_lip"],
        "marker_neutral": data["marker_neutral"][0].astype(np.float32),
        **{f"layout_{name}": np.array(columns, np.int16) for name, columns in layouts.items()},
    }


def _correlation(series: Array) -> Array:
    """Correlation of each column with itself one frame later, sentence by sentence."""
    clips = series.reshape(-1, FRAMES, series.shape[1])
    clips = clips - clips.mean(axis=(0, 1))
    earlier, later = clips[:, :-1], clips[:, 1:]
    correlation: Array = (earlier * later).sum(axis=(0, 1)) / (earlier**2).sum(axis=(0, 1))
    return correlation


def _columns(path: Path, mediapipe: NDArray[Any]) -> dict[str, list[int]]:
    import csv

    column = {int(number): index for index, number in enumerate(mediapipe)}
    layouts: dict[str, list[int]] = {}
    with path.open() as file:
        for row in csv.DictReader(file):
            if int(row["mediapipe"]) in column:
                layouts.setdefault(row["layout"], []).append(column[int(row["mediapipe"])])
    return layouts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/speech_sample.npz"))
    parser.add_argument("--sentences", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, metavar="HZ", help="write a session of this frame rate: a folder")
    parser.add_argument("--measure", type=Path, metavar="DATA", help="folder of speech_train.npz and markers.csv")
    options = parser.parse_args()
    if options.measure:
        STATISTICS.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(STATISTICS, **measure(options.measure))
        print(f"{STATISTICS.name}: {STATISTICS.stat().st_size} bytes")
        return 0
    if options.rate:
        write_session(options.output, options.sentences, options.seed, options.rate)
        print(f"{options.output}: {options.sentences} takes at {options.rate:g} Hz")
        return 0
    options.output.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(options.output, **make(load_statistics(), options.sentences, options.seed))
    print(f"{options.output}: {options.sentences} sentences")
    return 0


if __name__ == "__main__":
    sys.exit(main())
