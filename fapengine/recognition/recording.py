"""A recording of any length, recognized in pieces: its phones, their loudness and pitch, and mismatches of its text.

Theory of operation
-------------------
Words are shared among the pieces (:mod:`.text_place`) and aligned in each. A phone loop, which has no text, mistakes
many phones, but seldom their kind (:data:`KINDS`). The fraction of the words' frames in which the loop finds the same
kind shows whether they were said: .45 to .9 of a sentence if so, 0 to .4 of another sentence. A telephone or noise
deceives the loop more than the aligner. So a whole piece that fails is judged once more: words that were said fit
better than others under the same noise (:mod:`.text_fit`).

Without a text, the loop's phones of a piece are the second observation of
:class:`.small_recognizer.JointRecognizer`, as in live audio; but the loop knows the whole piece, and phones are final
only after :data:`LOOK_AHEAD_S`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.recognition import sphinx
from fapengine.recognition.loudness import (
    FRAME_HZ,
    HOP,
    RunningSoundings,
    loudness_db,
    pitch_hz,
    soundings,
    spoken_frames,
)
from fapengine.recognition.protocol import RATE_HZ, UNSURE, Recognizer
from fapengine.recognition.small_recognizer import JointRecognizer, KnownFrames
from fapengine.recognition.sphinx import Frames
from fapengine.recognition.sphinx_aligner import Aligned, SphinxAligner
from fapengine.recognition.sphinx_recognizer import labelled
from fapengine.recognition.text_fit import fits, word_misfit
from fapengine.recognition.text_place import frame_scores, words_said
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.speech.prosody import Sounding, with_prosody

KINDS = tuple(
    frozenset(names.split())
    for names in (
        "M N NG", "B P", "D T", "G K", "F TH HH", "V DH", "S Z", "SH ZH CH JH", "L W OW AO OY", "R ER", "IY IH Y EY",
        "EH AE", "AA AH AY AW", "UW UH",
    )
)  # fmt: skip
"""Groups of similar phones of the model."""
_KIND = {name: number for number, names in enumerate(KINDS) for name in names}
QUICK_HZ = 25.0
"""More phones a second than anyone speaks."""


def same_kind(one: str, other: str) -> bool:
    """Return whether two phones of the model are of one kind; silence is of none.

    Examples
    --------
    >>> same_kind("M", "N"), same_kind("M", "SIL")
    (True, False)
    """
    return one in _KIND and _KIND.get(other) == _KIND[one]


def by_frame(phones: Sequence[Frames], frames: int) -> list[str]:
    """Name of the phone in each frame; empty between phones."""
    names = [""] * frames
    for name, first, end in phones:
        names[first : min(end, frames)] = [name] * (min(end, frames) - first)
    return names


def between(phones: Sequence[Frames], first: int, end: int) -> list[Frames]:
    """Phones from one frame to before another; those at the ends are cut."""
    return [(name, max(a, first), min(b, end)) for name, a, b in phones if min(b, end) > max(a, first)]


LOOK_AHEAD_S = 1.0
"""Delay of phones of a recording without a text; the longest that the recognizers allow."""
MIN_PIECE_S, MAX_PIECE_S = 6.0, 20.0
"""Lengths between which a piece is cut."""
_PAUSE = 25
"""Frames over which quiet is measured, 0.25 s."""
_NEARLY_DB = 3.0
"""Difference up to which a later place counts as quiet as the quietest."""


def in_pieces(sound: Iterable[NDArray[np.int16]]) -> Iterator[tuple[NDArray[np.int16], bool]]:
    """Cut audio of any length at its quietest places.

    Parameters
    ----------
    sound : iterable of (N,) int16
        At :data:`.protocol.RATE_HZ`.

    Yields
    ------
    piece : (N,) int16
        Whole frames of 10 ms, except in the last piece.
    is_last : bool
    """
    waiting: list[NDArray[np.int16]] = []
    length, longest = 0, round(MAX_PIECE_S * RATE_HZ)
    for samples in sound:
        waiting.append(samples)
        length += len(samples)
        while length > longest:
            joined = np.concatenate(waiting)
            cut = quietest(joined[:longest])
            yield joined[:cut], False
            waiting, length = [joined[cut:]], len(joined) - cut
    yield (np.concatenate(waiting) if waiting else np.zeros(0, np.int16)), True


def quietest(samples: NDArray[np.int16]) -> int:
    """Return the sample, on a frame's edge, in the middle of the last of the quietest quarters of a second.

    ``samples`` are (N,) int16. Places before :data:`MIN_PIECE_S` do not count.
    """
    levels = loudness_db(samples)
    mean = np.convolve(levels, np.ones(_PAUSE) / _PAUSE, mode="valid")
    first = min(round(MIN_PIECE_S * FRAME_HZ), len(mean) - 1)
    nearly = np.flatnonzero(mean[first:] <= mean[first:].min() + _NEARLY_DB)
    return int(first + nearly[-1] + _PAUSE // 2) * HOP


BESIDE = 2
"""Words on each side that also count for a word's agreement."""
AGREEING, AGREEING_ALL = 0.35, 0.42
"""Least fraction of frames in which the phone loop finds the same kind of phone if the text is right:
around a word, and in a whole piece. Measured on 20 filmed and 20 spoken sentences: .44 and more in 95 % of the places,
.45 and more in every whole sentence; with the text of another .40 and less in 90 % of the places."""
FOREIGN = 0.36
"""Factor of that fraction for languages that the model does not know. Measured on 35 sentences of espeak-ng in five
languages: .20 and more of a whole sentence in all but one (.08); with the text of another less than .15 in 17 of 35."""
JUDGED_FRAMES = 60
"""Least number of frames around a word that are judged; a whole piece with fewer, or one word, is judged apart."""
DOUBTFUL = 0.6
"""Misfit of a word or two above which they are doubted."""
MISSING_FROM_TEXT_S = 1.2
"""Least length of speech in a silence of the text that is reported as missing from the text."""

Progress = Callable[[float], None]
"""Called with the seconds that were processed."""


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A part of the recording where text and audio do not agree."""

    start_s: float
    end_s: float
    words: tuple[str, ...]
    """Words of the text that were not found there; empty for speech that is not in the text."""

    def __str__(self) -> str:
        if not self.words:
            return f"{self.start_s:.1f} s to {self.end_s:.1f} s: speech that the text lacks"
        words = " ".join(self.words if len(self.words) <= 6 else (*self.words[:3], "...", *self.words[-2:]))
        where = "behind the end" if self.start_s >= self.end_s else f"{self.start_s:.1f} s to {self.end_s:.1f} s"
        return f"{where}: not heard: {words}"


@dataclass(frozen=True, slots=True)
class Recording:
    """Phones of a recording, and how its text fits."""

    phones: PhoneTrack
    soundings: tuple[Sounding, ...]
    """Loudness and pitch of each phone."""
    mismatches: tuple[Mismatch, ...] = ()
    unheard: float = 0.0
    """Fraction of the text's words that were not found, 0..1."""
    doubted: tuple[tuple[float, float], ...] = ()
    """Pieces, start and end in s, whose text fits, or is too short to judge, though the phone loop finds other phones:
    noise, or a telephone; and words alone that fit badly. In clear sound 3 of 280 right words of flite are doubted, and
    19 of the 20 wrong ones that are let through."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """A piece of the recording and what the phone loop finds in it."""

    samples: NDArray[np.int16]
    found: list[Frames]
    spoken: NDArray[np.bool_]
    is_last: bool

    @cached_property
    def scores(self) -> NDArray[np.float32]:
        """(T, C) scores of its frames, see :func:`.text_place.frame_scores`."""
        return frame_scores(self.samples, labelled(self.found, self.spoken))


@dataclass(frozen=True, slots=True)
class _Judged:
    """A word, its frames, and the number of them in which aligner and phone loop agree."""

    word: int
    start: int
    stop: int
    agree: int
    total: int


def listen(sound: Iterable[NDArray[np.int16]], *, on_heard: Progress = lambda _: None) -> Recording:
    """Find the phones of a recording without its text; music and noise are silence.

    Parameters
    ----------
    sound : iterable of (N,) int16
        At :data:`.protocol.RATE_HZ`, in pieces of any length. Memory holds 20 s of it.
    on_heard : callable
        Called with the length of each processed piece in s.
    """
    loop, known = sphinx.new_phone_loop(), KnownFrames()

    def decoded() -> Iterator[NDArray[np.int16]]:
        for piece, _ in in_pieces(sound):
            if len(piece):
                found, spoken = _hear(loop, piece)
                known.add(labelled(found, spoken))
                yield piece

    return listen_by(JointRecognizer(LOOK_AHEAD_S, other=known), decoded(), on_heard=on_heard)


def listen_by(
    recognizer: Recognizer, sound: Iterable[NDArray[np.int16]], *, on_heard: Progress = lambda _: None
) -> Recording:
    """Find the phones of a recording with any recognizer that needs no text.

    Parameters
    ----------
    sound : iterable of (N,) int16
        As for :func:`listen`; processed 1 s at a time.
    on_heard : callable
        Called with the length of each processed piece in s.
    """
    recognizer.reset()
    running, gathered = RunningSoundings(), _Gathered()
    for piece in sound:
        for start in range(0, len(piece), RATE_HZ):
            samples = piece[start : start + RATE_HZ]
            running.push(samples)
            phones = recognizer.push(samples)
            gathered.extend(phones, running.of(phones))
            on_heard(len(samples) / RATE_HZ)
    phones = recognizer.end()
    running.push(np.zeros(0, np.int16), is_last=True)
    gathered.extend(phones, running.of(phones))
    return gathered.done(())


def follow(
    sound: Iterable[NDArray[np.int16]],
    aligner: SphinxAligner,
    *,
    is_trusted: bool = False,
    on_heard: Progress = lambda _: None,
) -> Recording:
    """Find the phones of a text in its recording.

    Where the text is not what is said, the phones are those of the phone loop.

    Parameters
    ----------
    sound : iterable of (N,) int16
        As for :func:`listen`; memory holds 40 s of it.
    aligner : SphinxAligner
        Contains the text.
    is_trusted : bool
        All of the text is said; nothing checks it.
    on_heard : callable
        Called with the length of each processed piece in s.
    """
    loop = sphinx.new_phone_loop()
    gathered, mismatches, doubted = _Gathered(), list[Mismatch](), list[tuple[float, float]]()
    cursor, unheard = 0, 0
    pieces = (_Piece(piece, *_hear(loop, piece), is_last) for piece, is_last in in_pieces(sound) if len(piece))
    for this, following in _with_next(pieces):
        piece, found, spoken = this.samples, this.found, this.spoken
        is_rest = is_trusted and following is None
        end = len(aligner.words) if is_rest else _words_end(aligner, this, following, cursor)
        aligned = aligner.align(piece, cursor, end)
        if end > cursor and not aligned:
            aligned = aligner.placed(piece, cursor, end)
        names = by_frame(found, len(spoken))
        judged, strictness = _judge(aligned, names), 1.0 if aligner.dictionary else FOREIGN
        missing = [] if is_trusted else _missing(judged, strictness)
        if not is_trusted and (verdict := _verdict(aligner, aligned, piece, judged, AGREEING_ALL * strictness)):
            is_said, is_doubted = verdict
            missing = [] if is_said else [(judged[0].word, judged[-1].word + 1, judged[0].start, judged[-1].stop)]
            if is_said and is_doubted:
                doubted.append((gathered.now_s, gathered.now_s + len(piece) / RATE_HZ))
        unheard += sum(len(range(a, b)) for a, b, _, _ in missing) + (end - cursor if not aligned else 0)
        mismatches += [
            Mismatch(gathered.now_s + start / FRAME_HZ, gathered.now_s + stop / FRAME_HZ, aligner.words[a:b])
            for a, b, start, stop in missing
        ]
        rows = _merged(aligned, missing, labelled(found, spoken), aligner.words, names)
        mismatches += _missing_from_text(rows, spoken, gathered.now_s)
        gathered.add(rows, piece)
        cursor = end
        on_heard(len(piece) / RATE_HZ)
    if cursor < len(aligner.words):
        mismatches.append(Mismatch(gathered.now_s, gathered.now_s, aligner.words[cursor:]))
        unheard += len(aligner.words) - cursor
    recording = gathered.done(tuple(mismatches), min(unheard / len(aligner.words), 1.0))
    return replace(recording, doubted=tuple(doubted))


class _Gathered:
    """Phones of the pieces so far. Stateful."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._phones: list[Phone] = []
        self._soundings: list[Sounding] = []

    def add(self, phones: Sequence[Phone], piece: NDArray[np.int16]) -> None:
        """Add the phones of a piece, without holes; times count from its start."""
        end_s = len(piece) / RATE_HZ
        self.extend(phones, soundings(list(phones), piece), self.now_s, self.now_s + end_s)
        self.now_s += end_s

    def extend(
        self, phones: Sequence[Phone], sounds: Sequence[Sounding], zero_s: float = 0.0, until_s: float = inf
    ) -> None:
        """Add phones, without holes; times count from ``zero_s``, and phones end at ``until_s``."""
        for phone, sounding in zip(phones, sounds, strict=True):
            stop_s = min(zero_s + phone.end_s, until_s)
            start_s = self._phones[-1].end_s if self._phones else 0.0
            last = self._phones[-1] if self._phones else None
            if last is not None and last.is_silence and phone.is_silence:
                self._phones[-1] = Phone(SILENCE, last.start_s, stop_s)
                louder = max(self._soundings[-1].loudness_db, sounding.loudness_db)
                self._soundings[-1] = Sounding(louder, 0.0)
            elif stop_s > start_s:
                self._phones.append(
                    Phone(phone.label, start_s, stop_s, phone.stress, phone.word, round(phone.confidence, 2))
                )
                self._soundings.append(sounding)

    def done(self, mismatches: tuple[Mismatch, ...], unheard: float = 0.0) -> Recording:
        phones = PhoneTrack(tuple(with_prosody(self._phones, self._soundings)))
        return Recording(phones, tuple(self._soundings), mismatches, unheard)


def _hear(loop: object, piece: NDArray[np.int16]) -> tuple[list[Frames], NDArray[np.bool_]]:
    """Find the model's phones in a piece, and which of its frames are speech."""
    sphinx.decode(loop, piece)
    found = sphinx.frames_of(loop.seg() or [])  # type: ignore[attr-defined]
    return found, spoken_frames(found, pitch_hz(piece), loudness_db(piece))


def _with_next(pieces: Iterable[_Piece]) -> Iterator[tuple[_Piece, _Piece | None]]:
    """Each piece and the one after it."""
    last: _Piece | None = None
    for piece in pieces:
        if last is not None:
            yield last, piece
        last = piece
    if last is not None:
        yield last, None


def _words_end(aligner: SphinxAligner, piece: _Piece, following: _Piece | None, cursor: int) -> int:
    """Find the word after the last one of a piece."""
    most = QUICK_HZ * (len(piece.spoken) + (len(following.spoken) if following else 0)) / FRAME_HZ
    words: list[list[str]] = []
    expected = 0
    for index in range(cursor, len(aligner.words)):
        words.append(aligner.model_phones(index))
        expected += len(words[-1])
        if expected > most:
            break
    is_rest = cursor + len(words) == len(aligner.words) and expected <= most
    if is_rest and following is None:
        return len(aligner.words)
    is_whole = is_rest and following is not None and following.is_last
    return cursor + words_said(piece.scores, following.scores if following else None, words, is_whole=is_whole)


def _judge(aligned: Sequence[Aligned], names: Sequence[str]) -> list[_Judged]:
    judged: list[_Judged] = []
    for word, group in groupby(aligned, key=lambda phone: phone.word):
        phones = list(group)
        agree = sum(_agreeing(phone, names) for phone in phones)
        total = sum(phone.end - phone.first for phone in phones)
        judged.append(_Judged(word, phones[0].first, phones[-1].end, agree, total))
    return judged


def _agreeing(phone: Aligned, names: Sequence[str]) -> int:
    return sum(
        any(same_kind(name, expected) for expected in phone.model.split()) for name in names[phone.first : phone.end]
    )


def _missing(judged: Sequence[_Judged], strictness: float) -> list[tuple[int, int, int, int]]:
    """Words that were not found: first, the one after the last, first frame, frame after the last."""
    least = AGREEING * strictness
    missing: list[tuple[int, int, int, int]] = []
    for index, word in enumerate(judged):
        around = judged[max(index - BESIDE, 0) : index + BESIDE + 1]
        total = sum(other.total for other in around)
        if total < JUDGED_FRAMES or sum(other.agree for other in around) >= least * total:
            continue
        if missing and word.word - missing[-1][1] <= BESIDE:
            missing[-1] = missing[-1][0], word.word + 1, missing[-1][2], word.stop
        else:
            missing.append((word.word, word.word + 1, word.start, word.stop))
    return missing


def _verdict(
    aligner: SphinxAligner,
    aligned: Sequence[Aligned],
    piece: NDArray[np.int16],
    judged: Sequence[_Judged],
    agreeing: float,
) -> tuple[bool, bool] | None:
    """Whether all of a piece's words are said, and whether that is in doubt; nothing if the loop hears a sentence."""
    total = sum(word.total for word in judged)
    is_denied = sum(word.agree for word in judged) < agreeing * total
    if len(judged) == 1 or total < JUDGED_FRAMES:
        misfit = word_misfit(aligned, piece) if aligner.dictionary else None
        return (True, is_denied) if misfit is None else (misfit <= 1.0, misfit > DOUBTFUL)
    return (fits(aligner, aligned, piece), True) if is_denied else None


def _merged(
    aligned: Sequence[Aligned],
    missing: Sequence[tuple[int, int, int, int]],
    heard: Sequence[Frames],
    words: Sequence[str],
    names: Sequence[str],
) -> list[Phone]:
    """Phones of the text, and where it was not found those of the phone loop; silence between."""
    rows: list[Phone] = []
    for one in aligned:
        if one.end > one.first and not any(a <= one.word < b for a, b, _, _ in missing):
            sure = _agreeing(one, names) / (one.end - one.first)
            rows.append(Phone(one.label, one.first / FRAME_HZ, one.end / FRAME_HZ, one.stress, words[one.word], sure))
    for _, _, first, end in missing:
        rows += [
            Phone(label, a / FRAME_HZ, b / FRAME_HZ, confidence=UNSURE)
            for label, a, b in between(heard, first, end)
            if label != SILENCE
        ]
    rows.sort(key=lambda phone: phone.start_s)
    whole: list[Phone] = []
    now_s = 0.0
    for phone in rows:
        if phone.start_s > now_s:
            whole.append(Phone(SILENCE, now_s, phone.start_s))
        if phone.end_s > max(now_s, phone.start_s):
            whole.append(replace(phone, start_s=max(now_s, phone.start_s)))
            now_s = phone.end_s
    if len(names) / FRAME_HZ > now_s:
        whole.append(Phone(SILENCE, now_s, len(names) / FRAME_HZ))
    return whole


def _missing_from_text(rows: Sequence[Phone], spoken: NDArray[np.bool_], now_s: float) -> list[Mismatch]:
    """Speech in the text's silences."""
    found: list[Mismatch] = []
    for phone in rows:
        if not phone.is_silence or phone.duration_s < MISSING_FROM_TEXT_S:
            continue
        frames = np.flatnonzero(spoken[round(phone.start_s * FRAME_HZ) : round(phone.end_s * FRAME_HZ)])
        if len(frames) >= MISSING_FROM_TEXT_S * FRAME_HZ:
            first, last = phone.start_s + frames[0] / FRAME_HZ, phone.start_s + frames[-1] / FRAME_HZ
            found.append(Mismatch(now_s + first, now_s + last, ()))
    return found
