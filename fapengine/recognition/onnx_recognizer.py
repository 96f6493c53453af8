"""A recognizer by a CTC phone model of the user's, in ONNX; none is shipped or downloaded.

Theory of operation
-------------------
The model turns audio, float32 (1, N), into scores, float32 (1, T, V), of V labels in T frames: wav2vec 2.0 and similar
models, exported unchanged. :class:`ModelCard` describes its labels: JSON next to the model (``phones.onnx``,
``phones.json``), or the entry ``fapengine`` of the model's metadata.

Every :data:`BLOCK_S` the model runs on the last ``context_s`` again, and phones older than ``look_ahead_s`` are final
(:func:`.protocol.due`); so pieces of any length give the same phones. One second of audio costs
``context_s / BLOCK_S`` seconds of the model's.

A model trained with connectionist temporal classification (Graves et al. 2006, doi:10.1145/1143844.1143891) marks a
phone in a few frames, a *spike*, somewhere within it, and *blank* between. Frames are labelled by their best class and
equal neighbours joined. The phone of a spike reaches half way to its neighbours, but no more than :data:`REACH_S` from
either end of the spike to its other edge; the rest is silence, as are frames that the model itself labels so.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from fapengine._late import needed
from fapengine.errors import DataError, UsageError, any_error_as
from fapengine.recognition.loudness import FRAME_HZ
from fapengine.recognition.protocol import RATE_HZ, BlockRecognizer, Labelled, due
from fapengine.speech import ipa
from fapengine.speech.alphabets.convert import ALPHABETS, is_silence, spelled_out
from fapengine.speech.phone_track import SILENCE, Phone

BLANK = ""
"""Label of a frame without a phone."""
REACH_S = 0.1
"""Longest time from a spike's end to the phone's other edge. It changes nothing for a model that labels whole
phones."""


def softmax(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn scores, (T, V) of any scale, into probabilities that sum to 1 in each frame.

    Logarithms of probabilities come out as these.
    """
    raised = np.exp(scores - scores.max(axis=1, keepdims=True))
    shares: NDArray[np.float64] = raised / raised.sum(axis=1, keepdims=True)
    return shares


def segments_of(labels: Sequence[str], frame_hz: float) -> list[Labelled]:
    """Turn the best label of each frame into phones without holes.

    Parameters
    ----------
    labels : sequence of str
        IPA, :data:`BLANK` or silence, one a frame.

    Returns
    -------
    list of (label, first frame, frame after the last)

    Examples
    --------
    >>> segments_of(["", "m", "", "", "a", "a", "", "", "", "", "", "", ""], 50.0)
    [('m', 0, 3), ('a', 3, 9), ('_', 9, 13)]
    """
    reach = max(round(REACH_S * frame_hz), 1)
    spikes: list[Labelled] = []
    at = 0
    for label, frames in groupby(labels):
        end = at + sum(1 for _ in frames)
        if label != BLANK:
            spikes.append((label, at, end))
        at = end
    found: list[Labelled] = []
    for index, (label, first, end) in enumerate(spikes):
        if label == SILENCE:
            continue
        before = spikes[index - 1] if index else (SILENCE, 0, 0)
        after = spikes[index + 1] if index + 1 < len(spikes) else (SILENCE, at, at)
        begins = before[2] if before[0] == SILENCE else (before[2] + first) // 2
        ends = after[1] if after[0] == SILENCE else (end + after[1]) // 2
        room = max(reach - (end - first), 0)
        last, begins = (found[-1][2] if found else 0), max(begins, first - room)
        if begins > last:
            found.append((SILENCE, last, begins))
        found.append((label, max(begins, last), min(ends, end + room)))
    last = found[-1][2] if found else 0
    return [*found, (SILENCE, last, at)] if at > last else found


BLOCK_S = 0.16
"""Time between two runs."""
METADATA = "fapengine"
"""Key of a model's metadata for its card."""
MAX_LABELS = 4096
BLANKS = ("<blank>", "<pad>", "[PAD]", "<eps>", "blank")
"""Labels of a blank, if the card names none."""
_PROBE_S = 1.0


class ModelCard(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A model's labels, and the input that it needs."""

    labels: Annotated[list[str], Meta(min_length=2, max_length=MAX_LABELS)]
    """Label of each class, in the model's order."""
    alphabet: str = "ipa"
    """Alphabet of the labels: a name of :data:`fapengine.speech.alphabets.convert.ALPHABETS`."""
    blank: str | None = None
    """Label that means no phone; by default the one of :data:`BLANKS` that is there."""
    silences: list[str] = []
    """Labels of silence and noise, in addition to those of every alphabet."""
    rate_hz: Annotated[int, Meta(ge=8_000, le=48_000)] = RATE_HZ
    look_ahead_s: Annotated[float, Meta(ge=0.05, le=1.0)] = 0.3
    """Length of audio after a frame that makes its scores reliable."""
    context_s: Annotated[float, Meta(ge=1.0, le=30.0)] = 4.0
    """Length of audio before a frame that the model gets as well."""
    normalized: bool = False
    """True if the model requires audio of mean 0 and deviation 1, as wav2vec 2.0 does."""


@dataclass(frozen=True, slots=True, eq=False)
class PhoneModel:
    """A model that is loaded and checked."""

    path: Path
    card: ModelCard
    ipa: tuple[str, ...]
    """IPA of each class, silence, or :data:`.onnx_recognizer.BLANK`."""
    session: Any
    """``onnxruntime.InferenceSession``."""
    input_name: str

    def scores(self, sound: NDArray[np.float32]) -> NDArray[np.float64]:
        """Scores of a sound, (N,) float32 at the card's rate: (T, V)."""
        if self.card.normalized:
            sound = (sound - sound.mean()) / np.sqrt(sound.var() + 1e-7)
        with any_error_as(DataError, f"{self.path}: the model failed"):
            answer = self.session.run(None, {self.input_name: sound[None].astype(np.float32)})[0]
        answer = np.asarray(answer)
        expected = f"(1, frames, {len(self.ipa)}) numbers, a score for each label"
        shape_fits = answer.ndim == 3 and len(answer) == 1 and answer.shape[2] == len(self.ipa)
        if not np.issubdtype(answer.dtype, np.floating) or not shape_fits:
            got = f"{answer.dtype} of shape {answer.shape}"
            raise DataError(f"{self.path}: got an answer {got}, expected {expected}")
        scores: NDArray[np.float64] = answer[0].astype(np.float64)
        if not np.isfinite(scores.max(axis=1, initial=-np.inf)).all() or np.isnan(scores).any():
            raise DataError(f"{self.path}: got scores that are not finite, expected {expected}")
        return scores


def load_model(path: Path) -> PhoneModel:
    """Load a model and its card, and run it on a second of silence."""
    runtime = needed("onnxruntime", "onnxruntime", "recognizer")
    if not path.is_file():
        raise UsageError(f"recognizer: got {path}, expected an ONNX model")
    options = runtime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = 1, 4
    with any_error_as(DataError, f"{path}: cannot be read as an ONNX model"):
        session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    inputs = session.get_inputs()
    if len(inputs) != 1 or inputs[0].type != "tensor(float)" or len(inputs[0].shape) != 2:
        got = ", ".join(f"{each.name} {each.type} {each.shape}" for each in inputs)
        raise DataError(f"{path}: got input {got}, expected one of float, (1, samples)")
    card = _card(path, session.get_modelmeta().custom_metadata_map)
    model = PhoneModel(path, card, _ipa(path, card), session, inputs[0].name)
    frames = len(model.scores(np.zeros(round(_PROBE_S * card.rate_hz), np.float32)))
    if not 10 <= frames <= 1000:
        raise DataError(f"{path}: must be 10 to 1000, got {frames} frames for a second of sound")
    return model


class OnnxRecognizer(BlockRecognizer):
    """An ONNX model as a :class:`.protocol.Recognizer`. Stateful."""

    _block = round(BLOCK_S * RATE_HZ)

    def __init__(self, model: "str | Path | PhoneModel") -> None:
        self.model = model if isinstance(model, PhoneModel) else load_model(Path(model))
        self.look_ahead_s = self.model.card.look_ahead_s
        self._kept = -(-round((self.model.card.context_s + self.look_ahead_s) * RATE_HZ) // self._block) * self._block
        self.reset()

    def _process(self, block: NDArray[np.int16]) -> list[Phone]:
        self._add(block)
        return self._report(at_end=False)

    def end(self) -> list[Phone]:
        """End the audio; return the rest of its phones."""
        self._add(self._waiting)
        self._waiting = self._waiting[:0]
        return self._report(at_end=True) if len(self._sound) else []

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        super().reset()
        self._sound = np.zeros(0, np.int16)
        self._forgotten = 0
        """Samples before those of ``_sound``."""
        self._reported_s = 0.0

    def _add(self, block: NDArray[np.int16]) -> None:
        sound = np.concatenate([self._sound, block])
        over = max(len(sound) - self._kept, 0)
        self._sound, self._forgotten = sound[over:], self._forgotten + over

    def _report(self, *, at_end: bool) -> list[Phone]:
        sound = self._sound.astype(np.float32) / np.float32(2**15)
        whole = np.pad(sound, (0, max(self._block - len(sound), 0)))  # models fail on less than one frame
        shares = softmax(self.model.scores(_resampled(whole, self.model.card.rate_hz)))
        length_s = len(sound) / RATE_HZ
        frame_hz = len(shares) * RATE_HZ / len(whole)
        best = shares.argmax(axis=1)
        rescale = FRAME_HZ / frame_hz
        segments = [
            (label, round(first * rescale), round(end * rescale))
            for label, first, end in segments_of([self.model.ipa[index] for index in best], frame_hz)
        ]
        start_s = self._forgotten / RATE_HZ

        def found(until_s: float) -> list[Phone]:
            """Phones after the final ones."""
            now_s, phones = self._reported_s, []
            reported, horizon = round((now_s - start_s) * FRAME_HZ), round(until_s * FRAME_HZ)
            for label, first, end in due(segments, reported, horizon, at_end=at_end):
                is_rest = at_end and end == segments[-1][2]
                ends_s = start_s + (length_s if is_rest else min(end / FRAME_HZ, length_s))
                if ends_s > now_s:
                    frames = slice(int(first / rescale), int(end / rescale) + 1)
                    confidence = 1.0 if label == SILENCE else self._confidence(shares[frames], label)
                    phones.append(Phone(label, now_s, ends_s, confidence=confidence))
                    now_s = ends_s
            return phones

        final = found(length_s - self.look_ahead_s)
        self._reported_s = final[-1].end_s if final else self._reported_s
        self.partial = found(length_s)
        return final

    def _confidence(self, shares: NDArray[np.float64], label: str) -> float:
        """Highest probability of a phone among its frames, (T, V)."""
        columns = [index for index, name in enumerate(self.model.ipa) if name == label]
        return round(min(float(shares[:, columns].sum(axis=1).max(initial=0.0)), 1.0), 3)


def _resampled(sound: NDArray[np.float32], rate_hz: int) -> NDArray[np.float32]:
    if rate_hz == RATE_HZ:
        return sound
    from scipy.signal import resample_poly

    return resample_poly(sound, rate_hz, RATE_HZ).astype(np.float32)


def _card(path: Path, metadata: dict[str, str]) -> ModelCard:
    beside = path.with_suffix(".json")
    where = beside.name if beside.exists() else f"metadata {METADATA!r} of {path.name}"
    try:
        text = beside.read_text(encoding="utf-8") if beside.exists() else metadata.get(METADATA)
    except (OSError, UnicodeError) as error:
        raise DataError(f"{path}: its card cannot be read ({error})", where=where) from error
    if text is None:
        raise DataError(
            f"{path}: its labels are unknown; expected {beside.name} next to it with labels and alphabet, or the same"
            f" JSON as {METADATA!r} in its metadata"
        )
    try:
        return msgspec.convert(json.loads(text), ModelCard)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: its card is wrong: {error}", where=where) from error


def _ipa(path: Path, card: ModelCard) -> tuple[str, ...]:
    if card.alphabet not in ALPHABETS:
        raise DataError(f"{path}: got alphabet {card.alphabet!r}, expected one of {', '.join(ALPHABETS)}")
    blank = card.blank if card.blank is not None else next((each for each in BLANKS if each in card.labels), None)
    if blank not in card.labels:
        raise DataError(f"{path}: its labels have no blank; name the label that means no phone as blank")
    found = [_label(each, card, blank) for each in card.labels]
    if unknown := [each for each, name in zip(card.labels, found, strict=True) if name is None]:
        listed = ", ".join(map(repr, unknown[:8]))
        raise DataError(f"{path}: got labels {listed}, expected {card.alphabet}, or silences that are listed")
    if not any(name not in (BLANK, SILENCE) for name in found):
        raise DataError(f"{path}: contains no label of a phone")
    return tuple(name or BLANK for name in found)


def _label(label: str, card: ModelCard, blank: str | None) -> str | None:
    """IPA of a label; None if the label is unknown."""
    if label == blank:
        return BLANK
    if label in card.silences or is_silence(label) or label in ("|", " ", "<unk>", "[UNK]"):
        return SILENCE
    name, _ = spelled_out(label, card.alphabet)
    return name if name and ipa.letters(name) else None
