"""How well does it speak? Held-out utterances from their phone timings alone, against what was captured.

    python -m bench.fidelity --train data/speech_train.npz [--test B.npz] -o report/
    python -m bench.fidelity --new-words    # the same figures for words left out of the training, in five folds
    python -m bench.fidelity --json         # both, and the word errors of python -m bench.intelligible; needs JAX

Both files hold tracked points of a talking face and its phones: :mod:`design.make_speech_data` makes them from public
sources, :mod:`design.speech_sample` the like of them in any clone.
Without --test, 100 sentences of --train are held out (fixed seed). Writes report/index.html (table, captured against
predicted) and report/fidelity.json. Frames count from the first phone to the last one.

The lips are the points that the file marks as lip (65 of the 229: both contours of both lips and what lies between); a
method moves the 22 feature points of a profile, and a linear map learned on the training sentences carries them to
all 65. Points come from a video tracker, good to about 0.7 mm: differences below a few hundredths say nothing.
"""

import argparse
import json
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

import fapengine
from bench.judge import Word
from design.data_files import FOLDER, need
from fapengine.capture.landmarks import FEATURE_POINTS
from fapengine.capture.marker_track import Interval
from fapengine.errors import FapEngineError
from fapengine.files.profiles import load_profile
from fapengine.files.report.parts import COOL, INK, WARM, new_figure, picture, table, to_svg, verdict
from fapengine.files.report.parts import page as report_page
from fapengine.geometry.rigid import RigidMotion
from fapengine.laboratory.context_fit import fit_context, lean_on_phonetics
from fapengine.laboratory.marker_driver import HeadReference
from fapengine.laboratory.phones import captured_tokens, study_phones
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.space import study_space
from fapengine.models.viseme_space import MARKERS
from fapengine.mpeg4 import fap
from fapengine.profiles import Profile
from fapengine.speech.alphabets.convert import SILENCES, to_ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory import hermite
from fapengine.trajectory.closures import BITTEN_SHARE, close_lips, holds_of
from fapengine.trajectory.faps import displacements_to_faps, speech_faps
from fapengine.trajectory.methods import dominance as spread
from fapengine.trajectory.methods import sample_path
from fapengine.trajectory.phonetics import PUSHED, ROUND, give_way, layer_faps
from fapengine.trajectory.targets import keys_of as speech_keys_of
from fapengine.trajectory.variation import draw_variation, variation_faps

ARRAYS = (
    "ids", "text", "fps", "n_frames", "offset", "marker_delta", "marker_step_mm", "marker_mediapipe", "marker_is_lip",
    "phone_clip", "phone", "phone_start", "phone_end", "word_clip", "word", "word_start", "word_end",
)  # fmt: skip
"""Arrays that are read of a file; only those of words may be missing."""
LAYOUT = "an .npz as design/make_speech_data.py writes it"
INNER = tuple(f"2.{n}" for n in range(2, 10))
NAMES = (*MARKERS, *INNER)
HELD_OUT, SEED = 100, 7
CLOSED_MM = 1.5
"""Opening against rest below which lips count as closed: twice the tracker's uncertainty."""
UNMEASURED = (*PUSHED, *(fap.column(number) for number in (44, 45, 46)))
"""Columns of what the tracker does not know, depth and tongue: what the phonetic layer adds there is not judged."""
GOAL = {"lips_mm": 1.45, "lve_mm": 2.3, "opening_r": 0.88, "width_r": 0.82, "opening_slope": 0.85, "closed": 0.98}

Array = np.ndarray


@dataclass(frozen=True)
class Clip:
    """One utterance."""

    name: str
    text: str
    points: Array
    """(T, 22, 3) mm from rest: the profile's feature points."""
    lips: Array
    """(T, L, 3)."""
    phones: PhoneTrack
    spoken: Array
    """(T,) bool."""
    words: tuple[Word, ...] = ()
    """None where the file has no words."""


@dataclass(frozen=True)
class Corpus:
    """A file of utterances."""

    clips: list[Clip]
    rate_hz: float
    middle: tuple[int, int]
    """Rows of ``lips``: inner lips, middle, upper and lower."""
    corners: tuple[int, int]
    """Left and right outer corner."""


def load(path: Path) -> Corpus:
    """Read utterances from a file in the layout of :mod:`design.make_speech_data`, or end the program with one line."""
    try:
        with np.load(need(path)) as kept:
            return _corpus({name: kept[name] for name in ARRAYS if name in kept})
    except KeyError as error:
        raise SystemExit(f"error: {path}: {error} is missing, expected {LAYOUT}") from error
    except (ValueError, TypeError, IndexError, OSError, EOFError, BadZipFile, FapEngineError) as error:
        raise SystemExit(f"error: {path}: {error}; expected {LAYOUT}") from error


def _corpus(data: Mapping[str, Array]) -> Corpus:
    numbers = [int(number) for number in data["marker_mediapipe"]]
    column = {FEATURE_POINTS[number]: index for index, number in enumerate(numbers) if number in FEATURE_POINTS}
    lips = np.flatnonzero(data["marker_is_lip"])
    row = {int(index): place for place, index in enumerate(lips)}
    steps, rate = data["marker_delta"].T.astype(np.int32), float(data["fps"])
    clips = []
    for index, (start, length) in enumerate(zip(data["offset"], data["n_frames"], strict=True)):
        moved = np.cumsum(steps[start : start + length], axis=0).reshape(length, -1, 3) * float(data["marker_step_mm"])
        mine = np.flatnonzero(data["phone_clip"] == index)
        words = _words(data, index)
        phones = []
        for n, label in zip(mine, data["phone"][mine].tolist(), strict=True):
            name = SILENCE if label.lower() in SILENCES else to_ipa(label, "arpabet")[0]
            start_s, end_s = float(data["phone_start"][n]), float(data["phone_end"][n])
            phones.append(Phone(name, start_s, end_s, word=word_at(words, (start_s + end_s) / 2)))
        track = PhoneTrack.from_phones(phones, tolerance_s=0.01)
        spoken = [phone for phone in track.phones if not phone.is_silence]
        if not spoken:
            continue
        times = np.arange(length) / rate
        clips.append(
            Clip(
                str(data["ids"][index]), str(data["text"][index]), moved[:, [column[name] for name in NAMES]],
                moved[:, lips], track, (times >= spoken[0].start_s) & (times <= spoken[-1].end_s),
                words,
            )
        )  # fmt: skip
    if not clips:
        raise ValueError("got no utterance with phones")
    middle = (row[column["2.2"]], row[column["2.3"]])
    return Corpus(clips, rate, middle, (row[column["8.3"]], row[column["8.4"]]))


def _words(data: Mapping[str, Array], index: int) -> tuple[Word, ...]:
    """Words of one utterance; none where the file has no words."""
    if "word" not in data:
        return ()
    rows = np.flatnonzero(data["word_clip"] == index)
    return tuple(
        Word(text.lower(), float(data["word_start"][row]), float(data["word_end"][row]))
        for row, text in zip(rows, data["word"][rows].tolist(), strict=True)
        if text.lower() not in SILENCES
    )


@dataclass(frozen=True)
class Learned:
    """A profile, and what else was learned from the same utterances."""

    profile: Profile
    lift: Array
    """(3 P, 3 L): from the profile's points to all lip points."""
    prepared: Prepared
    rate_hz: float


def learn(clips: list[Clip], rate_hz: float) -> Learned:
    """Learn a profile by the laboratory's own steps, and the map from its points to all lip points."""
    takes = tuple(_take(clip) for clip in clips)
    prepared = Prepared(
        subject="train", rate_hz=rate_hz, labels=NAMES, points=NAMES, neutral_mm=np.zeros((len(NAMES), 3)), scale=1.0,
        takes=takes, gaps=None, warnings=(),
        reference=HeadReference((), np.zeros((0, 3)), RigidMotion(np.eye(3), np.zeros(3))),
    )  # fmt: skip
    shipped = load_profile("grid_s1_en")  # its FAPU is this speaker's; all inner lips are recorded
    space = study_space(prepared, takes, (), modes=None, variance=0.99, standard=shipped.space).space
    order = [NAMES.index(name) for name in space.points]
    inputs = np.concatenate([clip.points[:, order] for clip in clips]).reshape(-1, 3 * len(order))
    outputs = np.concatenate([clip.lips for clip in clips]).reshape(len(inputs), -1)
    square = inputs.T @ inputs
    lift = np.linalg.solve(square + 1e-4 * np.trace(square) / len(square) * np.eye(len(square)), inputs.T @ outputs)
    blank = Learned(replace(shipped, space=space, phones={}, context=None), lift, prepared, rate_hz)
    return replace(blank, profile=learn_phones(blank, clips))


def learn_phones(learned: Learned, clips: Sequence[Clip], *, without: Set[str] = frozenset()) -> Profile:
    """Learn medians and context anew, from all but the phones of some words; their sentences keep the others."""
    space, prepared = learned.profile.space, learned.prepared
    kept = {clip.name: [p for p in clip.phones.phones if p.word not in without] for clip in clips}
    phones, _ = study_phones(tuple(_take(clip, kept[clip.name]) for clip in clips), prepared, space)
    known = {name: study.target for name, study in phones.items()}
    sentences, weights = captured_tokens(tuple(_take(clip) for clip in clips), prepared, space, known)
    for clip, tokens, values in zip(clips, sentences, weights, strict=True):
        starts = {phone.start_s for phone in kept[clip.name]}
        values[[token.phone.start_s not in starts for token in tokens]] = np.nan
    context = lean_on_phonetics(fit_context(sentences, weights), space, known)
    return replace(learned.profile, phones=known, context=context)


def word_at(words: Sequence[Word], time_s: float) -> str:
    """Word that is said at a time, or nothing."""
    return next((word.text for word in words if word.start_s <= time_s <= word.end_s), "")


def _take(clip: Clip, phones: Sequence[Phone] | None = None) -> Displacements:
    shown = clip.phones.phones if phones is None else phones
    still = RigidMotion(np.eye(3)[None], np.zeros((1, 3)))
    said = tuple(Interval(p.label, p.start_s, p.end_s, p.word) for p in shown)
    return Displacements(clip.name, clip.points, said, still)


def to_lips(points: Array, lift: Array) -> Array:
    """(T, L, 3) mm: all lip points for (T, P, 3) points of the profile."""
    lips: Array = (points.reshape(len(points), -1) @ lift).reshape(len(points), -1, 3)
    return lips


Method = Callable[[Clip, Profile, Array], Array]
"""Clip, profile, times -> (T, P, 3) displacements of the profile's points."""


def keys_of(clip: Clip, profile: Profile, *, context: bool = False) -> tuple[Array, Array]:
    keys = speech_keys_of(clip.phones, profile, context=context).keyframes()
    return keys.times_s, keys.weights[:, : profile.space.mode_count]


def rest(clip: Clip, profile: Profile, times: Array) -> Array:
    return np.zeros((len(times), len(profile.space.points), 3))


def by(interpolate: Callable[[Array, Array, Array], Array], *, context: bool = False) -> Method:
    def method(clip: Clip, profile: Profile, times: Array) -> Array:
        knots, weights = keys_of(clip, profile, context=context)
        path = interpolate(knots, weights, np.clip(times, knots[0], knots[-1]))
        return profile.space.to_points_mm(path)

    return method


def linear(knots: Array, weights: Array, times: Array) -> Array:
    return np.stack([np.interp(times, knots, column) for column in weights.T], axis=1)


def natural(knots: Array, weights: Array, times: Array) -> Array:
    return CubicSpline(knots, weights, bc_type="natural")(times)


def quintic(knots: Array, weights: Array, times: Array) -> Array:
    return hermite.paths(knots, weights, np.zeros(len(knots), np.intp), 1)[0].sample(times)


def monotone(knots: Array, weights: Array, times: Array) -> Array:
    return PchipInterpolator(knots, weights)(times)


def ramps(clip: Clip, profile: Profile, times: Array) -> Array:
    """Use a popular browser avatar's fixed ramps: up from t - 2d/3 to t + d/2, down to t + 1.5 d, added up."""
    path = np.zeros((len(times), profile.space.mode_count))
    keys = speech_keys_of(clip.phones, profile, context=False)
    targets = keys.targets[np.unique(keys.phone_of, return_index=True)[1], : profile.space.mode_count]
    for (phone, contact), target in zip(keys.said[0], targets, strict=True):
        start, length = phone.start_s, phone.duration_s
        peak = 0.6 if contact == "none" and phone.label[0] not in "aeiouæɑɔəɛɪʊʌ" else 0.9
        shape = np.interp(times, [start - 2 * length / 3, start + length / 2, start + 1.5 * length], [0, peak, 0])
        path += shape[:, None] * target
    return profile.space.to_points_mm(path)


def dominance(rate: float) -> Method:
    """Cohen and Massaro, without closures."""

    def method(clip: Clip, profile: Profile, times: Array) -> Array:
        path = spread(speech_keys_of(clip.phones, profile, context=False), times, rate)
        return profile.space.to_points_mm(path[:, : profile.space.mode_count])

    return method


def ours(method: str, *, variation: int | None = None) -> Method:
    """Do what the product does by one of its methods: keyframes, path, closures; with natural variation of a seed.

    Each clip varies by its name and the seed.
    """

    def predict(clip: Clip, profile: Profile, times: Array) -> Array:
        keys, modes = speech_keys_of(clip.phones, profile, context=method == "context"), profile.space.mode_count
        path = sample_path(method, keys, times)
        moved = profile.space.to_points_mm(path[:, :modes])
        faps = displacements_to_faps(moved, profile.space.points, profile.fapu)
        layer = path[:, modes:] @ layer_faps(profile)
        layer[:, list(UNMEASURED)] = 0.0
        shown = speech_faps(profile, path[:, :modes], context=method == "context") + layer
        if variation is not None:
            waves = draw_variation(np.random.default_rng([variation, zlib.crc32(clip.name.encode())]))[..., None]
            varied = variation_faps(np.ones(len(times)), waves, times)
            shown += give_way(varied, path[:, modes + ROUND]).T
        share = BITTEN_SHARE if method == "context" else 0.0
        change = close_lips(shown, times, holds_of(keys.said[0]), bitten_share=share) - faps
        for row in fap.FAPS:  # what the layer and the closures add to the FAPs, back as displacements
            shift = change[:, fap.column(row.number)]
            if np.abs(shift).max() > 0:
                step = profile.fapu.unit(row.unit) * np.array(fap.HEAD_AXES[row.positive])
                moved[:, profile.space.points.index(row.point)] += shift[:, None] * step
        return moved

    return predict


def captured(at_keys: bool) -> Method:
    def method(clip: Clip, profile: Profile, times: Array) -> Array:
        order = [NAMES.index(name) for name in profile.space.points]
        if not at_keys:
            return clip.points[:, order]
        knots, _ = keys_of(clip, replace(profile, context=None))
        flat = clip.points[:, order].reshape(len(times), -1)
        values = np.stack([np.interp(knots, times, column) for column in flat.T], axis=1)
        return natural(knots, values, np.clip(times, knots[0], knots[-1])).reshape(len(times), -1, 3)

    return method


METHODS: dict[str, Method] = {
    "rest pose": rest,
    "fixed ramps of a browser avatar": ramps,
    "Cohen and Massaro, 12 / s": dominance(12.0),
    "Cohen and Massaro, 20 / s": dominance(20.0),
    "phone medians at 30 %, linear": by(linear),
    "phone medians at 30 %, monotone cubic": by(monotone),
    "phone medians at 30 %, natural cubic (paper 001)": by(natural),
    "the same with closures (--method paper)": ours("paper"),
    "minimum-jerk quintic, closures": ours("minimum-jerk"),
    "Cohen and Massaro, 20 / s, closures": ours("dominance"),
    "context, quintic": by(quintic, context=True),
    "context, quintic, closures (the default)": ours("context"),
    "captured at 30 % (limit of one key)": captured(True),
    "captured (limit of the space and the map)": captured(False),
}
DEFAULT = "context, quintic, closures (the default)"
PAPER = "the same with closures (--method paper)"


def judge(corpus: Corpus, clips: list[Clip], predicted: list[Array]) -> dict[str, float]:
    """Every figure of one method."""
    spoken = [clip.spoken for clip in clips]
    guess = np.concatenate([p[s] for p, s in zip(predicted, spoken, strict=True)])
    truth = np.concatenate([clip.lips[s] for clip, s in zip(clips, spoken, strict=True)])
    distance = np.linalg.norm(guess - truth, axis=-1)
    flat = np.linalg.norm((guess - truth)[..., :2], axis=-1)
    found = {"lips_mm": distance.mean(), "lips_xy_mm": flat.mean(), "lve_mm": distance.max(axis=1).mean()}
    for name, (one, other), axis in (("opening", corpus.middle, 1), ("width", corpus.corners, 0)):
        a, b = (lips[:, one, axis] - lips[:, other, axis] for lips in (guess, truth))
        moves = np.ptp(a) > 1e-9
        found[f"{name}_r"] = np.corrcoef(a, b)[0, 1] if moves else 0.0
        found[f"{name}_slope"] = np.polyfit(b, a, 1)[0]
    found |= closures(corpus, clips, predicted)
    found |= timing(corpus, clips, predicted)
    return {name: round(float(value), 4) for name, value in found.items()}


def opening(corpus: Corpus, lips: Array) -> Array:
    return lips[:, corpus.middle[0], 1] - lips[:, corpus.middle[1], 1]


def closures(corpus: Corpus, clips: list[Clip], predicted: list[Array]) -> dict[str, float]:
    """Share of p b m that close; precision and recall of closing over all phones; opening error of f v at their key."""
    rows = []
    for clip, lips in zip(clips, predicted, strict=True):
        times = np.arange(len(lips)) / corpus.rate_hz
        guess, truth = opening(corpus, lips), opening(corpus, clip.lips)
        for phone in clip.phones.phones:
            inside = (times >= phone.start_s - 0.5 / corpus.rate_hz) & (times <= phone.end_s + 0.5 / corpus.rate_hz)
            if not phone.is_silence and inside.any():
                kind = "lips" if phone.label in "pbm" else "teeth" if phone.label in "fv" else "open"
                rows.append((kind, guess[inside].min(), truth[inside].min()))
    kind = np.array([row[0] for row in rows])
    guess, truth = (np.array([row[n] for row in rows]) for n in (1, 2))
    shut, really = guess < CLOSED_MM, truth < CLOSED_MM
    labial = kind == "lips"
    return {
        "closed": shut[labial].mean(),
        "precision": (shut & really).sum() / max(shut.sum(), 1),
        "recall": (shut & really).sum() / max(really.sum(), 1),
        "fv_mm": np.abs(guess - truth)[kind == "teeth"].mean(),
    }


def timing(corpus: Corpus, clips: list[Clip], predicted: list[Array]) -> dict[str, float]:
    """Lag that fits the opening best (positive: the prediction is late), and its fast movements over the captured."""
    lags = np.arange(-5, 6)
    score = np.zeros(len(lags))
    fast, truly = [], []
    for clip, lips in zip(clips, predicted, strict=True):
        a, b = opening(corpus, lips), opening(corpus, clip.lips)
        a, b = a - a.mean(), b - b.mean()
        score += [(np.roll(a, -lag)[5:-5] * b[5:-5]).sum() for lag in lags]
        fast.append(np.abs(np.diff(a))[clip.spoken[1:]])
        truly.append(np.abs(np.diff(b))[clip.spoken[1:]])
    best = int(np.clip(score.argmax(), 1, len(lags) - 2))
    before, at, after = score[best - 1 : best + 2]
    bend = before - 2 * at + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    ratio = np.percentile(np.concatenate(fast), 95) / np.percentile(np.concatenate(truly), 95)
    return {"lag_ms": 1000 * (lags[best] + shift) / corpus.rate_hz, "velocity_ratio": ratio}


COLUMNS = {
    "lips_mm": "lips, mm", "lips_xy_mm": "x y, mm", "lve_mm": "LVE, mm",
    "opening_r": "opening r", "opening_slope": "slope", "width_r": "width r",
    "width_slope": "slope", "closed": "p b m closed", "precision": "closing: precision", "recall": "recall",
    "fv_mm": "f v, mm", "lag_ms": "lag, ms", "velocity_ratio": "fast moves, ratio",
}  # fmt: skip


def page(
    corpus: Corpus, clips: list[Clip], results: dict[str, dict[str, float]], shown: dict[str, list[Array]]
) -> bytes:
    rows = [(name, *(f"{row[key]:.2f}" for key in COLUMNS)) for name, row in results.items()]
    parts = ["<h1>How well does it speak?</h1>"]
    if DEFAULT in results and PAPER in results:
        ours, papers = results[DEFAULT]["lips_mm"], results[PAPER]["lips_mm"]
        parts.append(verdict(
            "good" if ours < papers else "poor",
            f"The default's lips are off by {ours:.2f} mm, those of the method of the papers by {papers:.2f} mm.",
        ))  # fmt: skip
    parts += [
        f"<p>{len(clips)} held-out utterances from their phone timings alone; closed: within {CLOSED_MM} mm of rest."
        " The points are a video tracker's, good to about 0.7 mm.</p>",
        table(("method", *COLUMNS.values()), rows, marked=DEFAULT),
        "<h2>Openings</h2>",
    ]
    for index in range(min(6, len(clips))):
        figure, (axes,) = new_figure(10, 2.4)
        times = np.arange(len(clips[index].lips)) / corpus.rate_hz
        axes.plot(times, opening(corpus, clips[index].lips), color=INK, label="captured")
        for (name, predicted), colour in zip(shown.items(), (COOL, WARM), strict=True):
            axes.plot(times, opening(corpus, predicted[index]), color=colour, label=name)
        for phone in clips[index].phones.phones:
            if not phone.is_silence:
                middle_s = (phone.start_s + phone.end_s) / 2
                axes.text(middle_s, 1.0, phone.label, transform=axes.get_xaxis_transform(), ha="center", fontsize=6)
        axes.set(ylabel="opening, mm", xlabel="s")
        axes.legend(fontsize=7, frameon=False, loc="upper right")
        parts.append(picture(to_svg(figure), escape(f"Opening of the lips: {clips[index].text}")))
    parts.append(f'<p class="note">fapengine {fapengine.__version__}, <code>python -m bench.fidelity</code></p>')
    return report_page("Fidelity", parts)


def add_files(parser: argparse.ArgumentParser) -> None:
    """Give a command the options --train and --test."""
    parser.add_argument("--train", type=Path, default=FOLDER / "speech_train.npz", help="default: %(default)s")
    parser.add_argument("--test", type=Path, help=f"default: {HELD_OUT} sentences of --train, held out (fixed seed)")


def read_files(options: argparse.Namespace, *, words: bool = False) -> tuple[list[Clip], Corpus]:
    """Read what :func:`add_files` asked for: utterances to learn from, and a corpus to test on.

    ``words`` tells that both need words.
    """
    corpus = load(options.train)
    training, tested = corpus.clips, load(options.test) if options.test else corpus
    if not options.test:
        count = min(HELD_OUT, len(corpus.clips) // 4)
        out = set(np.random.default_rng(SEED).permutation(len(corpus.clips))[:count].tolist())
        tested = replace(corpus, clips=[clip for index, clip in enumerate(corpus.clips) if index in out])
        training = [clip for index, clip in enumerate(corpus.clips) if index not in out]
    test = options.test or options.train
    if tested.rate_hz != corpus.rate_hz:
        raise SystemExit(f"error: {test}: got {tested.rate_hz:g} frames/s, expected {corpus.rate_hz:g} as in --train")
    if not training or not tested.clips:
        raise SystemExit(f"error: {test}: got {len(tested.clips)} utterances to test on, expected one and more")
    if tested.clips[0].lips.shape[1] != training[0].lips.shape[1]:
        raise SystemExit(
            f"error: {test}: got {tested.clips[0].lips.shape[1]} lip points, expected"
            f" {training[0].lips.shape[1]} as in --train"
        )
    for path, clips in ((options.train, training), (test, tested.clips)):
        silent = next((clip.name for clip in clips if not clip.words), None)
        if words and silent is not None:
            raise SystemExit(
                f"error: {path}: utterance {silent} has no words, expected word, word_clip, word_start, word_end"
            )
    return training, tested


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_files(parser)
    parser.add_argument("--new-words", action="store_true", help="leave the words out of the training, in five folds")
    parser.add_argument(
        "--json", action="store_true", help="print both measures as JSON, as python -m bench.intelligible --json does"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("out/fidelity"), help="default: %(default)s")
    options = parser.parse_args(arguments)
    training, tested = read_files(options, words=options.new_words or options.json)
    if options.json:
        from bench.measures import measure

        print(json.dumps({"clips": len(tested.clips), "methods": measure(training, tested)}, indent=1))
        return 0
    if options.new_words:
        from bench.measures import measure_new_words

        print_table(measure_new_words(training, tested))
        return 0
    return report(training, tested, options.output)


def report(training: list[Clip], corpus: Corpus, output: Path) -> int:
    """Print and write the table of all methods."""
    clips, learned = corpus.clips, learn(training, corpus.rate_hz)
    mean = np.concatenate([clip.lips[clip.spoken] for clip in training]).mean(axis=0)
    results = {"mean speech pose": judge(corpus, clips, [np.tile(mean, (len(clip.lips), 1, 1)) for clip in clips])}
    shown = {}
    for name, method in METHODS.items():
        predicted = []
        for clip in clips:
            points = method(clip, learned.profile, np.arange(len(clip.points)) / corpus.rate_hz)
            predicted.append(to_lips(points, learned.lift))
        results[name] = judge(corpus, clips, predicted)
        if name in (DEFAULT, "phone medians at 30 %, natural cubic (paper 001)"):
            shown[name] = predicted
    print_table(results)
    output.mkdir(parents=True, exist_ok=True)
    (output / "fidelity.json").write_text(json.dumps({"clips": len(clips), "methods": results, "goal": GOAL}, indent=1))
    (output / "index.html").write_bytes(page(corpus, clips, results, shown))
    mine = results[DEFAULT]
    short = [name for name, goal in GOAL.items() if (mine[name] > goal if name.endswith("mm") else mine[name] < goal)]
    context = learned.profile.context
    print(f"{len(context.features) if context else 0} features; report in {output}")
    print("short of the goal:", ", ".join(f"{name} {mine[name]} ({GOAL[name]})" for name in short) or "nothing")
    return 0


def print_table(results: Mapping[str, Mapping[str, float]]) -> None:
    """Print a row a method and a column a figure."""
    width = max(map(len, results))
    print(" " * width, *(f"{text:>18}" for text in COLUMNS.values()))
    for name, row in results.items():
        print(f"{name:{width}}", *(f"{row[key]:18.3f}" for key in COLUMNS))


if __name__ == "__main__":
    sys.exit(main())
