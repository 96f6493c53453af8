"""Loudness and pitch of audio, in frames of 10 ms and for each phone, and which frames are speech.

Loudness is the level in dB below full scale. Pitch is the lag at which a frame is most similar to itself (the
autocorrelation, normalised by the frame's energy; as in Boersma, "Accurate short-term analysis of the fundamental
frequency", IFA Proceedings 17, 1993, without his path through the candidates).

Theory of operation: speech
---------------------------
A phone loop finds phones in music, too. The model's own noise estimate removes steady noise; what is left is speech and
tones. The pitch of a voice is never still: within 50 ms it moves by half a percent and more, where that of an
instrument's note stays. So a moment is music if, within :data:`REACH_S`, most frames that have a pitch keep it
(:data:`STEADY_FRAMES`, :data:`STEADY_SHARE`). Singing with vibrato is speech, and so is a whisper, which has no pitch.

Noise has a pitch by chance, too: the fewer of its frequencies are strong, the more often a frame is like itself. But it
jumps, where a voice's pitch glides through a vowel (:func:`gliding`). In the noise of fans and in hum it may glide;
there the network is sure of no phone, so a voice needs both, or long glides with pauses: of quiet speech after loud
speech, the network is sure of nothing.

There is no speech without vowels: what has none of :data:`VOWEL_FRAMES` around it is noise. So are phones that last
longer than any speaker holds them (:data:`MAX_PHONE_S`), and what is hardly there (:data:`QUIET_DB`).
"""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fapengine.recognition.protocol import FRAME_HZ as FRAME_HZ
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.sphinx import MODEL_PHONES, VOWELS, Frames
from fapengine.speech.phone_track import Phone
from fapengine.speech.prosody import Sounding

HOP = RATE_HZ // FRAME_HZ
SILENT_DB = -100.0
"""Level of digital silence."""
PITCH_HZ = (60.0, 450.0)
"""Pitches that are looked for."""
PIECE_S = 20.0
VOICED = 0.5
"""Least similarity of a frame to itself, one period later, that counts as voiced."""
_EVEN = 1e-6  # of a frame: times of whole frames are not quite whole
_WINDOW = 640  # 40 ms: more than two periods of the lowest pitch
_LATE, _CONTEXT = 2, 6  # frames after and before one that its window, or that of one without a pitch, reaches into
_MIN_LAG, _MAX_LAG = int(RATE_HZ / PITCH_HZ[1]), int(RATE_HZ / PITCH_HZ[0])
_LENGTH = 1 << (_WINDOW + _MAX_LAG - 1).bit_length()  # of the transform: no lag that is looked at wraps round


def loudness_db(samples: NDArray[np.int16]) -> NDArray[np.float64]:
    """Level of each frame of 10 ms.

    Parameters
    ----------
    samples : (N,) int16
        At :data:`.protocol.RATE_HZ`.

    Returns
    -------
    (ceil(N / 160),) float64, dB
        Against full scale, from :data:`SILENT_DB` up.

    Examples
    --------
    >>> loudness_db(np.full(320, 16384, np.int16)).round(1).tolist()
    [-6.0, -6.0]
    """
    count = -(-len(samples) // HOP)
    padded = np.zeros(count * HOP)
    padded[: len(samples)] = samples
    power = (padded.reshape(count, HOP) ** 2).mean(axis=1) / 2.0**30
    level: NDArray[np.float64] = np.maximum(10 * np.log10(np.maximum(power, 1e-12)), SILENT_DB)
    return level


def pitch_hz(samples: NDArray[np.int16], first: int = 0, stop: int | None = None) -> NDArray[np.float64]:
    """Pitch of frames of 10 ms, 0 where they are not voiced.

    Parameters
    ----------
    samples : (N,) int16
        At :data:`.protocol.RATE_HZ`.
    first, stop : int
        Frames wanted, by default all ceil(N / 160).

    Returns
    -------
    (stop - first,) float64, Hz

    Examples
    --------
    >>> tone = (8000 * np.sin(np.arange(1600) * 2 * np.pi / 80)).astype(np.int16)
    >>> pitch_hz(tone)[2:8].round().tolist()
    [200.0, 200.0, 200.0, 200.0, 200.0, 200.0]
    """
    whole = -(-len(samples) // HOP)
    count = min(whole, whole if stop is None else stop) - first
    if count <= 0:
        return np.zeros(0)
    padded = np.zeros((count - 1) * HOP + _WINDOW)
    begin = first * HOP - (_WINDOW - HOP) // 2
    sound = samples[max(begin, 0) : begin + len(padded)]
    padded[max(-begin, 0) :][: len(sound)] = sound
    frames = sliding_window_view(padded, _WINDOW)[::HOP]
    frames = frames - frames.mean(axis=1, keepdims=True)
    searched = _similarity(frames)
    # A multiple of the period is as good as the period; the first peak nearly as high as the highest is taken.
    inner = searched[:, 1:-1]
    peaks = inner >= 0.9 * searched.max(axis=1, keepdims=True)
    peaks &= inner >= searched[:, :-2]
    peaks &= inner >= searched[:, 2:]
    rows, lag = np.arange(count), peaks.argmax(axis=1) + 1
    before, at, after = (searched[rows, lag + step] for step in (-1, 0, 1))
    found = peaks[rows, lag - 1] & (at >= VOICED)
    bend = before - 2 * at + after
    shift = np.where(np.abs(bend) > 1e-12, 0.5 * (before - after) / np.where(bend == 0, 1.0, bend), 0.0)
    return np.where(found, RATE_HZ / (lag + _MIN_LAG + np.minimum(np.maximum(shift, -0.5), 0.5)), 0.0)


def _similarity(frames: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, lags): correlation of each frame with itself, shifted; every lag by the energy of the parts compared."""
    spectrum = np.fft.rfft(frames, n=_LENGTH, axis=1)
    power = spectrum.real**2 + spectrum.imag**2
    product = np.fft.irfft(power, axis=1)[:, _MIN_LAG : _MAX_LAG + 1]
    energy = np.cumsum(frames**2, axis=1)
    total = energy[:, -1:]
    head = energy[:, _WINDOW - 1 - _MAX_LAG : _WINDOW - _MIN_LAG][:, ::-1]
    tail = total - energy[:, _MIN_LAG - 1 : _MAX_LAG]
    return product / np.sqrt(np.maximum(head * tail, 1e-9 * np.maximum(total, 1.0) ** 2) + 1e-9)


def soundings(phones: Sequence[Phone], samples: NDArray[np.int16], begins_s: float = 0.0) -> list[Sounding]:
    """Loudness and pitch of each phone.

    Parameters
    ----------
    samples : (N,) int16
        At :data:`.protocol.RATE_HZ`.
    begins_s : float
        Time of the first sample.
    """
    levels, pitches = loudness_db(samples), pitch_hz(samples)
    return [_sounding(phone, levels, pitches, begins_s) for phone in phones]


def _sounding(
    phone: Phone, levels_db: NDArray[np.float64], pitches_hz: NDArray[np.float64], begins_s: float
) -> Sounding:
    first, end = (max(int((at_s - begins_s) * FRAME_HZ + _EVEN), 0) for at_s in (phone.start_s, phone.end_s))
    first = min(first, max(len(levels_db) - 1, 0))
    frames = slice(first, max(first + 1, end))
    voiced = pitches_hz[frames][pitches_hz[frames] > 0]
    return Sounding(float(levels_db[frames].max(initial=SILENT_DB)), float(np.median(voiced)) if len(voiced) else 0.0)


def soundings_at(phones: Sequence[Phone], samples: NDArray[np.int16], rate_hz: int) -> list[Sounding]:
    """Loudness and pitch of each phone, from audio of any rate and length, :data:`PIECE_S` at a time.

    Parameters
    ----------
    phones : sequence of Phone
        In order.
    samples : (N,) int16
    """
    from scipy.signal import resample_poly

    found: list[Sounding] = []
    for _, group in groupby(phones, key=lambda phone: phone.start_s // PIECE_S):
        piece = list(group)
        first = int(piece[0].start_s * rate_hz)
        sound = samples[first : int(piece[-1].end_s * rate_hz) + 1]
        if rate_hz != RATE_HZ and len(sound):
            resampled = resample_poly(sound.astype(np.float32), RATE_HZ, rate_hz)
            sound = np.clip(np.rint(resampled), -32768, 32767).astype(np.int16)
        found += soundings(piece, sound, first / rate_hz)
    return found


class RunningSoundings:
    """Loudness and pitch of the frames of a stream, and of phones in it. Stateful."""

    def __init__(self) -> None:
        self._sound = np.zeros(0, np.int16)
        """Samples from frame ``_begins`` on."""
        self._begins = 0
        self.levels_db = self.pitches_hz = np.zeros(0)
        """(T,) of the frames from ``first`` on; the last :data:`_LATE` of them have no pitch yet."""
        self.first = 0

    def push(self, samples: NDArray[np.int16], *, is_last: bool = False) -> None:
        """Add audio, (N,) int16."""
        self._sound = np.concatenate([self._sound, samples])
        stop = -(-len(self._sound) // HOP) if is_last else len(self._sound) // HOP
        before = self.first - self._begins
        levels = loudness_db(self._sound[(before + len(self.levels_db)) * HOP : stop * HOP])
        pitches = pitch_hz(self._sound, before + len(self.pitches_hz), stop - (0 if is_last else _LATE))
        self.levels_db = np.concatenate([self.levels_db, levels])
        self.pitches_hz = np.concatenate([self.pitches_hz, pitches])
        over = max(stop - _CONTEXT, 0)
        self._sound, self._begins = self._sound[over * HOP :], self._begins + over

    def look(self, phones: Sequence[Phone]) -> list[Sounding]:
        """Loudness and pitch of phones that have sounded."""
        return [_sounding(phone, self.levels_db, self.pitches_hz, self.first / FRAME_HZ) for phone in phones]

    def of(self, phones: Sequence[Phone]) -> list[Sounding]:
        """Loudness and pitch of the next phones; their frames are dropped."""
        found = self.look(phones)
        if phones:
            self.forget(int(phones[-1].end_s * FRAME_HZ + _EVEN))
        return found

    def forget(self, frame: int) -> None:
        """Drop the frames before one."""
        over = min(max(frame - self.first, 0), len(self.pitches_hz))
        self.levels_db, self.pitches_hz = self.levels_db[over:], self.pitches_hz[over:]
        self.first += over


REACH_S = 1.0
"""Time on both sides of a moment that decides about it."""
GLIDE_FRAMES = 5
"""Frames of 10 ms over which a glide is measured."""
STILL = 0.004
"""Largest change of pitch, natural logarithm, that counts as none."""
STEADY_FRAMES = 8
"""Least number of steady frames that make a moment music."""
STEADY_SHARE = 0.5
"""Least fraction of them among the frames that have a pitch: plucked notes had .56 and more."""
VOWEL_FRAMES = 4
"""Least number of frames in vowels around a moment of speech."""
MAX_GLIDE = 0.06
"""Change of pitch in a frame, natural logarithm, from which on it jumps: a semitone in 10 ms. Of the changes in flite's
sentences 95 % are smaller, in 60 filmed ones 90 %."""
GLIDING_FRAMES = 3
"""Least number of frames in a row of a pitch that glides. With 2, pink noise opened the lips by 19 mm; with 5, those of
30 filmed sentences were followed less (r .725 and not .742)."""
VOICED_FRAMES = 5
"""Least number of frames with a pitch that glides around a moment of speech that is not whispered."""
SURE_FRAMES = 4
"""Least number of frames around it in which the network is sure of a phone. Of noises with such a pitch it was in 3 at
most, of speech in noise as loud as itself in 11 and more; with 5, the first word comes later."""
LONG_GLIDE_FRAMES, LONG_FRAMES = 10, 60
"""Least number of frames in a row of a long glide, and of frames in long glides around a moment of speech of which the
network is not sure. Of flite's sentences 105 to 187 are, of 21 kinds of noise none, of hum 51 at most, of a chord all.
"""
WHISPER_FRAMES, WHISPER_LABELS, LABEL_FRAMES = 30, 5, 3
"""Least number of frames around a whispered moment in which the network is sure of a phone, of labels that it is sure
of, and of frames of each. Whispers of flite's sentences had 9 labels (median of 20), noise that swells 2 to 12 times a
second 4 at most. Of 16 whispers with wide formants, of which none moved the lips, 14 do; other speech is as before."""
MAX_PHONE_S = {True: 1.5, False: 0.6}
"""Longest vowel, and longest consonant."""
QUIET_DB = -62.0
"""Loudness, dB below full scale, under which nothing is speech: the noise of a microphone that is switched on."""


def steady(pitch_hz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,): frames whose pitch is that of :data:`GLIDE_FRAMES` before.

    Examples
    --------
    >>> int(steady(np.full(20, 200.0)).sum()), int(steady(200.0 * 1.002 ** np.arange(20)).sum())
    (15, 0)
    """
    still = np.zeros(len(pitch_hz), dtype=bool)
    before, now = pitch_hz[:-GLIDE_FRAMES], pitch_hz[GLIDE_FRAMES:]
    voiced = (before > 0) & (now > 0)
    still[GLIDE_FRAMES:][voiced] = np.abs(np.log(now[voiced] / before[voiced])) < STILL
    return still


def gliding(pitch_hz: NDArray[np.float64], frames: int = GLIDING_FRAMES) -> NDArray[np.bool_]:
    """(T,): frames of a pitch that changes by less than :data:`MAX_GLIDE` in each of so many frames and more.

    Examples
    --------
    >>> gliding(np.array([100.0, 101, 102, 120, 121, 0, 122])).astype(int).tolist()
    [1, 1, 1, 0, 0, 0, 0]
    """
    is_voiced = pitch_hz > 0
    logs = np.log(np.where(is_voiced, pitch_hz, 1.0))
    goes_on = is_voiced[1:] & is_voiced[:-1] & (np.abs(np.diff(logs)) < MAX_GLIDE)
    runs = np.concatenate([[0], np.cumsum(~goes_on)])[: len(pitch_hz)]
    long: NDArray[np.bool_] = is_voiced & (np.bincount(runs)[runs] >= frames)
    return long


def spoken_frames(
    segments: Sequence[Frames], pitch_hz: NDArray[np.float64], loudness_db: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(T,): frames of a hypothesis that are speech.

    Parameters
    ----------
    segments : sequence of Frames
        Phones of the loop.
    pitch_hz, loudness_db : (T,)
        Of the same frames.
    """
    count = len(pitch_hz)
    vowels, sounds = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for name, start, end in segments:
        if name not in MODEL_PHONES or end - start > MAX_PHONE_S[name in VOWELS] * FRAME_HZ:
            continue
        if loudness_db[start:end].max(initial=SILENT_DB) < QUIET_DB:
            continue
        sounds[start:end] = True
        vowels[start:end] = name in VOWELS
    _, music = _voiced_and_musical(pitch_hz)
    return sounds & ~music & (_around(vowels & ~music) >= VOWEL_FRAMES)


def voice_frames(pitch_hz: NDArray[np.float64], is_sure: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,): frames near which there is a voice: a pitch that glides and is mostly not kept, and phones or long glides.

    Parameters
    ----------
    pitch_hz : (T,)
    is_sure : (T,) bool
        Frames of whose phone the network is sure.

    Examples
    --------
    >>> glide_hz, sure = 200.0 * 1.002 ** np.arange(50), np.ones(50, bool)
    >>> [int(voice_frames(*one).sum()) for one in ((glide_hz, sure), (glide_hz, ~sure), (np.full(50, 200.0), sure))]
    [50, 0, 0]
    """
    voiced, musical = _voiced_and_musical(pitch_hz * gliding(pitch_hz))
    sure, long, near = _around(np.array([is_sure, gliding(pitch_hz, LONG_GLIDE_FRAMES), np.ones(len(pitch_hz), bool)]))
    is_spoken: NDArray[np.bool_] = (sure >= SURE_FRAMES) | ((long >= LONG_FRAMES) & (long < near))
    return (voiced >= VOICED_FRAMES) & ~musical & is_spoken


def whispered_frames(sure: NDArray[np.int64], pitch_hz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,): frames near which somebody whispers: many phones that the network is sure of, and nothing with a pitch.

    Parameters
    ----------
    sure : (T,) int64
        Label that the network is sure of, 0 for silence and none.
    pitch_hz : (T,)
    """
    whispered: NDArray[np.bool_] = _around(pitch_hz > 0) < VOICED_FRAMES
    if not whispered.any() or np.count_nonzero(sure) < WHISPER_FRAMES:
        return np.zeros(len(sure), bool)
    counts = _around(sure == np.unique(sure[sure > 0])[:, None])
    whispered &= counts.sum(axis=0) >= WHISPER_FRAMES
    whispered &= (counts >= LABEL_FRAMES).sum(axis=0) >= WHISPER_LABELS
    return whispered


def _voiced_and_musical(pitch_hz: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(T,) each: how many frames near one have a pitch, and whether most of them keep it."""
    voiced, still = _around(np.array([pitch_hz > 0, steady(pitch_hz)]))
    return voiced, (still >= STEADY_FRAMES) & (still >= STEADY_SHARE * voiced)


def _around(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(..., T): how many frames are marked within :data:`REACH_S`."""
    count, reach = marked.shape[-1], round(REACH_S * FRAME_HZ)
    total = np.zeros((*marked.shape[:-1], count + 1 + 2 * reach), np.int64)
    np.cumsum(marked, axis=-1, out=total[..., reach + 1 : reach + 1 + count])
    total[..., reach + 1 + count :] = total[..., reach + count, None]
    return total[..., 2 * reach + 1 :] - total[..., :count]
