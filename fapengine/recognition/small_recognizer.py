"""The small recognizer: a small network, trained by ``bench``, and a search over phones; requires only NumPy, no text.

Theory of operation
-------------------
The network (:mod:`.small_net`) gives each frame of 10 ms a probability for each phone. Divided by the frequency of the
phone, that is the likelihood of the sound (Bourlard and Morgan 1994, "Connectionist speech recognition"). The best path
through the phones is then searched (Viterbi 1967): a phone lasts :data:`MIN_FRAMES` frames or more, and the order of
phones counts as it is in English, a little (:data:`ORDER_WEIGHT`). Phones are final when they are over and
:data:`LOOK_AHEAD_S` old (:func:`.protocol.due`). Everything is done in blocks of 20 ms, so pieces of any length give
the same phones.

:class:`JointRecognizer` adds PocketSphinx; the two err in different places. The phone that PocketSphinx's loop finds in
a frame is a second observation; its likelihood given the true phone was counted on known sentences
(``bench/recognizer_join.py``). Both likelihoods are multiplied, the second to the power of :data:`OTHER_WEIGHT`,
because they are not independent; then the best path is searched as before. At the tip of a stream PocketSphinx is often
wrong, so the path goes on from its older phones by the network alone (:data:`SURE_AFTER`). Of a file, whole pieces are
decoded first (:class:`KnownFrames`).
"""

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.recognition import small_net
from fapengine.recognition.loudness import (
    FRAME_HZ,
    HOP,
    MAX_PHONE_S,
    QUIET_DB,
    SILENT_DB,
    RunningSoundings,
    voice_frames,
    whispered_frames,
)
from fapengine.recognition.protocol import MIN_FRAMES, RATE_HZ, BlockRecognizer, Labelled, due, phones_of
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.speech.phone_track import SILENCE, Phone

LOOK_AHEAD_S = 0.15
"""Look-ahead by default."""
BLOCK_FRAMES = 2 * small_net.STEPS
BLOCK = BLOCK_FRAMES * HOP
"""Samples that are processed at a time, 20 ms."""
LATE = 2 * small_net.AHEAD + BLOCK_FRAMES
"""Longest delay of the scores after the sound, in frames."""
ORDER_WEIGHT, CHANGE = 0.3, 0.5
"""Weight of the order of phones, and cost of another phone, natural logarithm. With .6 and 1, which trust English more,
16 recordings of flite that chose nothing, 0.25 s late, have r .855, with these .860 (``design/tried.md``)."""
SHARE_WEIGHT = 0.5
"""Weight of the frequency of a phone."""
REMEMBERED = 300
"""Frames of pitch that are kept, 3 s."""
ONSET_FRAMES = 5
"""Frames of speech after silence that are heard before it counts as begun: music and noise begin alike."""
NEAR_VOWEL = 100
"""Frames after a vowel in which a phone may be isolated; elsewhere it is a knock."""
LIKELY, SURE = np.log(0.5), np.log(0.7)
"""Least logarithm of the probability of a label of which the network is sure: beside a voice, and in a whisper."""
VOWEL_LETTERS = frozenset("aeiouæɑɔəɛɝɪʊʌ")

Floats = NDArray[np.float32]


def log_softmax(scores: Floats) -> Floats:
    """Log-likelihoods of the labels in each frame, (T, D), from scores, (T, D)."""
    scores = scores - scores.max(axis=1, keepdims=True)
    likely: Floats = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
    return likely


def phone_bonus(weights: small_net.Weights) -> Floats:
    """(C,) for each label: what turns its probability into a likelihood, natural logarithm."""
    return (-SHARE_WEIGHT * np.log(np.maximum(weights.shares, 1e-4))).astype(np.float32)


class Search:
    """The best path through the phones, as scores come. Stateful."""

    def __init__(self, weights: small_net.Weights) -> None:
        self._bonus = phone_bonus(weights)
        counts = weights.pairs.astype(np.float64) + 0.5
        order = np.log(counts / counts.sum(axis=1, keepdims=True))
        self._order = (ORDER_WEIGHT * order - CHANGE).astype(np.float32)
        np.fill_diagonal(self._order, -np.inf)
        self._labels = len(weights.labels)
        self._all = np.arange(self._labels)
        self._state = np.full((MIN_FRAMES, self._labels), -np.inf, np.float32)
        self._began = np.zeros((MIN_FRAMES, self._labels), np.int64)
        self._before: list[NDArray[np.int64]] = []
        """Best label before each, of each frame at which it begins."""
        self._last: list[NDArray[np.int64]] = []
        """Frame at which each label began that may end, of each frame."""
        self._first = self.now = 0

    def push(self, scores: Floats) -> None:
        """Add scores of more frames, (T, C)."""
        for row in log_softmax(scores) + self._bonus:
            self._step(row)

    def _step(self, row: Floats) -> None:
        state, began = self._state, self._began
        if self.now == 0:
            enter = np.full(self._labels, -4.0, np.float32)
            enter[0] = 0.0
            before = np.zeros(self._labels, np.int64)
        else:
            ways = state[-1][:, None] + self._order
            before = ways.argmax(axis=0)
            enter = ways[before, self._all]
        fresh, since = np.empty_like(state), np.empty_like(began)
        fresh[0], since[0] = enter, self.now
        fresh[1:], since[1:] = state[:-1], began[:-1]
        since[-1] = np.where(state[-1] >= state[-2], began[-1], began[-2])
        np.maximum(state[-1], state[-2], out=fresh[-1])
        fresh += row
        fresh -= fresh.max()
        self._state, self._began = fresh, since
        self._before.append(before)
        self._last.append(since[-1])
        self.now += 1

    def segments(self, reported: int) -> list[tuple[int, int, int]]:
        """Trace the best path back to frame ``reported``: number of each label, first frame, the one after the last."""
        at = int(self._state.argmax())
        sub, label = divmod(at, self._labels)
        end, first = self.now, int(self._began[sub, label])
        found = []
        while end > reported:
            found.append((label, max(first, reported), end))
            if first <= max(reported, self._first):
                break
            label, end = int(self._before[first - self._first][label]), first
            first = int(self._last[end - 1 - self._first][label])
        return found[::-1]

    def fork(self) -> "Search":
        """Copy it, with its history; scores that come to one do not change the other."""
        copied = copy(self)
        copied._before, copied._last = self._before.copy(), self._last.copy()
        return copied

    def forget(self, reported: int) -> None:
        """Drop the history of frames before ``reported``."""
        gone = max(min(reported, self.now - 1) - self._first, 0)
        del self._before[:gone], self._last[:gone]
        self._first += gone


class Scores:
    """Scores of the network's labels for each frame of a stream. Stateful."""

    def __init__(self, weights: small_net.Weights) -> None:
        self._waiting = np.zeros(small_net.BEFORE, np.int16)
        """Samples from the first of the next block's windows on."""
        self._mean = small_net.RunningMean(weights.first_mean)
        self._net = small_net.SmallNet(weights)
        self._skip = 2 * small_net.AHEAD
        """Frames of scores that lie before the first frame."""
        self._classes = len(weights.labels)
        self.seen = 0
        """Frames that the network has seen; it has scored those at least :data:`LATE` before."""

    def push(self, samples: NDArray[np.int16]) -> Floats:
        """Add (N,) int16; return the scores of the next frames, (T, C), natural logarithms up to a constant."""
        self._waiting = np.concatenate([self._waiting, np.asarray(samples, dtype=np.int16)])
        found = [np.zeros((0, self._classes), np.float32)]
        while len(self._waiting) >= BLOCK + small_net.WINDOW - HOP:
            near = np.array([self._waiting[first : first + small_net.WINDOW] for first in range(0, BLOCK, HOP)])
            seen = np.array([self._mean.push(frame) for frame in small_net.log_mel(near)])
            self._waiting = self._waiting[BLOCK:]
            self.seen += BLOCK_FRAMES
            found.append(self._net.push(seen)[self._skip :])
            self._skip = max(self._skip - BLOCK_FRAMES, 0)
        return np.concatenate(found)


def whole_scores(samples: NDArray[np.int16]) -> Floats:
    """(T, C) scores of the shipped network for each frame of a whole piece, (N,) int16."""
    silence = np.zeros(2 * LATE * HOP + BLOCK, np.int16)
    return Scores(small_net.shipped()).push(np.concatenate([samples, silence]))[: -(-len(samples) // HOP)]


def is_vowel(label: str) -> bool:
    """Whether a label of the network is a vowel."""
    return label[0] in VOWEL_LETTERS


class Voicing:
    """Pitch and loudness of the last seconds, which reject segments of a hypothesis. Stateful."""

    def __init__(self) -> None:
        self._frames = RunningSoundings()
        self._labels, self._logs = np.zeros(0, np.int64), np.zeros(0, np.float32)
        """(T,): the network's best label and the logarithm of its probability, of the frames before ``_scored``."""
        self._scored = 0
        self._vowel = -REMEMBERED
        """Frame after the last vowel."""

    def push(self, samples: NDArray[np.int16], *, is_last: bool = False) -> None:
        """Add (N,) int16, whole frames except at the end."""
        self._frames.push(samples, is_last=is_last)
        self._frames.forget(self._frames.first + len(self._frames.pitches_hz) - REMEMBERED)

    def recognize(self, scores: Floats) -> None:
        """Add the network's scores of the next frames, (T, C)."""
        likely = log_softmax(scores)
        self._labels = np.concatenate([self._labels[-REMEMBERED:], likely.argmax(axis=1)])
        self._logs = np.concatenate([self._logs[-REMEMBERED:], likely.max(axis=1, initial=-np.inf)])
        self._scored += len(scores)

    def _voices(self) -> NDArray[np.bool_]:
        """(T,): frames with a pitch near which there is a voice, or a whisper."""
        pitches_hz = self._frames.pitches_hz
        labels, logs = np.zeros(len(pitches_hz), np.int64), np.full(len(pitches_hz), -np.inf)
        place = self._scored - len(self._labels) - self._frames.first
        known = slice(max(-place, 0), max(len(pitches_hz) - place, 0))
        near = slice(max(place, 0), max(place, 0) + len(self._labels[known]))
        labels[near], logs[near] = self._labels[known], self._logs[known]
        voices = voice_frames(pitches_hz, (labels > 0) & (logs >= LIKELY))
        return voices if voices.all() else voices | whispered_frames(np.where(logs >= SURE, labels, 0), pitches_hz)

    def spoken(self, segments: list[Labelled]) -> list[Labelled]:
        """Replace segments that are voiceless, music, very quiet, or isolated by silence; without gaps."""
        first, is_silent = self._frames.first, all(label == SILENCE for label, _, _ in segments)
        voice = np.zeros(0, bool) if is_silent else self._voices()
        found: list[Labelled] = []
        for index, (label, a, b) in enumerate(segments):
            following = [one for one, _, _ in segments[index + 1 :]]
            near = slice(max(a - first, 0), max(b - first, 1))
            is_phone = (
                label != SILENCE
                and b - a <= MAX_PHONE_S[is_vowel(label)] * FRAME_HZ
                and self._frames.levels_db[near].max(initial=SILENT_DB) >= QUIET_DB
                and (
                    is_vowel(label)
                    or a - self._vowel <= NEAR_VOWEL
                    or any(map(is_vowel, following))
                    or (following and following[0] != SILENCE)
                )
                and 2 * int(voice[near].sum()) >= len(voice[near])
            )
            if not is_phone and found and found[-1][0] == SILENCE:
                found[-1] = SILENCE, found[-1][1], b
            else:
                found.append((label if is_phone else SILENCE, a, b))
            if is_phone and is_vowel(label):
                self._vowel = b
        return found


def begun(segments: list[Labelled], now: int) -> list[Labelled]:
    """Leave out speech that began after silence less than :data:`ONSET_FRAMES` before frame ``now``.

    Examples
    --------
    >>> begun([("_", 0, 20), ("m", 20, 23)], 23), begun([("_", 0, 20), ("m", 20, 25)], 25)
    ([('_', 0, 20)], [('_', 0, 20), ('m', 20, 25)])
    """
    place = max((number for number, one in enumerate(segments, 1) if one[0] == SILENCE), default=0)
    follows = place > 0 or (segments and segments[0][1] == 0)
    return segments[:place] if follows and segments[place:] and now - segments[place][1] < ONSET_FRAMES else segments


class SmallRecognizer(BlockRecognizer):
    """The small network as a :class:`.protocol.Recognizer`. Stateful.

    Parameters
    ----------
    look_ahead_s : float
        Delay of phones after their audio, 0.12 to 1 s; they come at most one block (20 ms) later.
    weights : Weights, optional
        By default those of the package.

    Examples
    --------
    >>> recognizer = SmallRecognizer()
    >>> phones = recognizer.push(np.zeros(16_000, np.int16)) + recognizer.end()
    >>> {phone.label for phone in phones}, phones[-1].end_s
    ({'_'}, 1.0)
    """

    _block = BLOCK

    def __init__(self, look_ahead_s: float = LOOK_AHEAD_S, *, weights: small_net.Weights | None = None) -> None:
        if not 0.12 <= look_ahead_s <= 1.0:
            raise UsageError(f"look_ahead_s: must be 0.12 to 1, got {look_ahead_s}")
        self.look_ahead_s = look_ahead_s
        self._weights = weights or small_net.shipped()
        self.reset()

    def _process(self, block: NDArray[np.int16]) -> list[Phone]:
        self._voicing.push(block)
        self._search.push(self._score(block))
        return self._report(self._scores.seen - round(self.look_ahead_s * FRAME_HZ))

    def end(self) -> list[Phone]:
        """End the audio; return the rest of its phones."""
        count = -(-self._came // HOP)
        if not count:
            return []
        self._voicing.push(self._waiting, is_last=True)
        silence = np.zeros((count - self._search.now + 2 * LATE) * HOP, np.int16)
        scores = self._score(np.concatenate([self._waiting, silence]), rest=len(self._waiting))
        self._search.push(scores[: count - self._search.now])
        phones = self._report(count, at_end=True)
        self.reset()
        return phones

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        super().reset()
        self._reported = 0
        self._scores, self._voicing = Scores(self._weights), Voicing()
        self._search = Search(self._weights)

    def _score(self, samples: NDArray[np.int16], *, rest: int | None = None) -> Floats:
        """Scores of more audio; with ``rest``, that many samples are the last ones, and silence follows."""
        scores = self._scores.push(samples)
        self._voicing.recognize(scores)
        return scores

    def _latest(self) -> Search:
        """Search up to the last frame that has scores."""
        return self._search

    def _report(self, horizon: int, *, at_end: bool = False) -> list[Phone]:
        names, search = self._weights.labels, self._latest()
        segments = self._voicing.spoken([(names[n], a, b) for n, a, b in search.segments(self._reported)])
        chosen = due(segments, self._reported, horizon, at_end=at_end)
        if chosen:
            self._reported = chosen[-1][2]
        self._search.forget(self._reported)
        end_s = self._came / RATE_HZ
        self.partial = phones_of(begun(due(segments, self._reported, search.now), search.now), 0.0, end_s)
        return phones_of(chosen, 0.0, end_s)


OTHER_WEIGHT, WHOLE_WEIGHT = 0.3, 1.0
"""Weight of PocketSphinx's phones as audio comes, and of whole pieces; for these .6 and 1 were tried on 20 filmed
sentences: 18 and 22 of 36 p b m met."""
SURE_AFTER = 14
"""Age in frames from which on PocketSphinx's phones count as audio comes; those at its tip do harm. Chosen with
:data:`OTHER_WEIGHT` on 56 recordings of flite, 0.25 s after the sound: mean r .907 where they count at once by 0.6,
.913 now, .914 with a weight of 0.4; 30 filmed sentences while speaking: .665, .669 and .664."""


class KnownFrames:
    """Phones that PocketSphinx found in whole pieces, for frames that the small network has scored. Stateful."""

    weight = WHOLE_WEIGHT
    sure_after = 0
    """Age in frames from which on they count."""

    def __init__(self) -> None:
        self._found: list[Labelled] = []

    def reset(self) -> None:
        """Start again."""
        self._found = []

    def add(self, found: Sequence[Labelled]) -> None:
        """Add the phones of the next piece, one or more, without gaps; frames count from its start."""
        now = self._found[-1][2] if self._found else 0
        self._found = [one for one in self._found if one[2] > now - REMEMBERED]
        self._found += [(label, now + a, now + b) for label, a, b in found]

    def push(self, block: NDArray[np.int16]) -> None:
        """Process a block, (N,) int16."""

    def skip(self, count: int) -> None:
        """Leave out samples of a block."""

    def end(self, rest: NDArray[np.int16]) -> None:
        """Process the rest, (N,) int16, shorter than a block."""

    def labels(self, first: int, end: int, numbers: Mapping[str, int]) -> NDArray[np.int64]:
        """Label numbers of frames ``first`` to ``end``, (T,); -1 where unknown."""
        found = np.full(end - first, -1)
        for label, a, b in self._found:
            if b > first and a < end:
                found[max(a - first, 0) : b - first] = numbers.get(label, -1)
        return found


class SphinxFrames(KnownFrames):
    """Phones that PocketSphinx finds as the audio comes. Stateful."""

    weight = OTHER_WEIGHT
    sure_after = SURE_AFTER

    def __init__(self) -> None:
        super().__init__()
        self._recognizer = SphinxRecognizer()

    def reset(self) -> None:
        """Start again."""
        super().reset()
        self._recognizer.reset()

    def push(self, block: NDArray[np.int16]) -> None:
        """Process a block, (N,) int16."""
        self._recognizer.push(block)
        self._found = self._recognizer.hypothesis()

    def skip(self, count: int) -> None:
        """Leave out samples of a block: their frames are unknown."""
        self._recognizer.skip(count)

    def end(self, rest: NDArray[np.int16]) -> None:
        """Process the rest, (N,) int16, shorter than a block."""
        phones = self._recognizer.push(rest) + self._recognizer.end()
        self._found += [(one.label, round(one.start_s * FRAME_HZ), round(one.end_s * FRAME_HZ)) for one in phones]


class JointRecognizer(SmallRecognizer):
    """The small network and PocketSphinx as one :class:`.protocol.Recognizer`. Stateful.

    Parameters
    ----------
    look_ahead_s : float
        Delay of phones after their audio, 0.12 to 1 s; they come at most one block (20 ms) later.
    weights : Weights, optional
        By default those of the package.
    other : KnownFrames, optional
        PocketSphinx's phones; by default they are found as the audio comes.

    Examples
    --------
    >>> recognizer = JointRecognizer()
    >>> phones = recognizer.push(np.zeros(16_000, np.int16)) + recognizer.end()
    >>> {phone.label for phone in phones}, phones[-1].end_s
    ({'_'}, 1.0)
    """

    def __init__(
        self,
        look_ahead_s: float = LOOK_AHEAD_S,
        *,
        weights: small_net.Weights | None = None,
        other: KnownFrames | None = None,
    ) -> None:
        self._other = other or SphinxFrames()
        self._is_reduced = False
        super().__init__(look_ahead_s, weights=weights)
        self._numbers = {label: number for number, label in enumerate(self._weights.labels)}

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        super().reset()
        self._other.reset()
        self._young = np.zeros((0, len(self._weights.labels)), np.float32)
        """Scores of the small network for frames that PocketSphinx is not sure of yet."""

    def reduce_work(self, is_wanted: bool) -> bool:
        """Use the small network alone from now on, or no longer; PocketSphinx is two thirds of the cost."""
        self._is_reduced = is_wanted
        return is_wanted

    def _score(self, samples: NDArray[np.int16], *, rest: int | None = None) -> NDArray[np.float32]:
        if rest is None and self._is_reduced:
            self._other.skip(len(samples))
        elif rest is None:
            self._other.push(samples)
        else:
            self._other.end(samples[:rest])
        scores = np.concatenate([self._young, super()._score(samples, rest=rest)])
        now = self._search.now
        sure = max(self._scores.seen - self._other.sure_after - now, 0) if rest is None else len(scores)
        scores, self._young = scores[:sure], scores[sure:]
        found = self._other.labels(now, now + len(scores), self._numbers)
        return weighed(scores, found, self._weights, self._other.weight)

    def _latest(self) -> Search:
        search = self._search.fork()
        search.push(self._young)
        return search


def weighed(scores: Floats, found: NDArray[np.int64], weights: small_net.Weights, weight: float) -> Floats:
    """Scores, (T, C), with PocketSphinx's labels as a second observation, (T,), -1 where unknown."""
    known = found >= 0
    logs: Floats = scores - scores.max(axis=1, keepdims=True)
    logs[known] += np.float32(weight) * weights.other[found[known]]
    return logs
