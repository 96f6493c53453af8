"""Held-out takes predicted from their phones alone, and the paper's own sentence: paper 001, section 5.

Intervals are 95 % bootstrap intervals: those of a take resample its pieces of half a second, those of all takes
resample takes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError
from fapengine.expressions import Expression
from fapengine.laboratory.phones import PhoneStudy, learn_context, spoken, study_phones
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.setup import Setup
from fapengine.profiles import PhoneTarget, Profile
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.methods import as_published, sample_path
from fapengine.trajectory.targets import keys_of, weights_of

Takes = tuple[Displacements, ...]
LIPS = (*(f"8.{n}" for n in range(1, 9)), *(f"2.{n}" for n in range(2, 10)))
MIDDLE_OF_LIPS = (("2.2", "2.3"), ("8.1", "8.2"))
"""Middle of the upper and the lower lip; the inner contour is preferred."""
DRAWS, PIECE_S = 1000, 0.5
"""Draws of the bootstrap, and length of the pieces of a take that it resamples."""
SENTENCE = "Bright sunshine shimmers on the ocean."
"""Sentence of the paper's figures 5 to 7."""
SENTENCE_PHONES = "b ɹ aɪ t s ʌ n ʃ aɪ n ʃ ɪ m ə z ɒ n ð iː oʊ ʃ ə n"
SENTENCE_PHONE_S, SENTENCE_RATE_HZ = 0.09, 100.0
"""Length of each of its phones: our choice; the paper's timings came from a recognizer and are not printed."""
MOODS = (Expression.JOY, Expression.SADNESS)
"""Expressions of figures 6 and 7, at full strength."""


class Estimate(NamedTuple):
    """A figure with the ends of its 95 % interval."""

    value: float
    low: float
    """NaN, as is ``high``, for a single piece or take, which has no interval."""
    high: float


@dataclass(frozen=True, slots=True)
class TakeScore:
    """Prediction of one take, or of all."""

    take: str
    """Its name; ``all`` for all takes together."""
    lips_mm: Estimate
    """Mean distance of the lip points from the recorded ones."""
    mean_pose_mm: Estimate
    """The same for the mean pose: the score of a face that does not move."""
    opening_r: Estimate
    opening_slope: Estimate
    """Correlation and slope of the opening against the recorded one."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Prediction of held-out takes from their phones alone, by a profile of the other takes."""

    whole: TakeScore
    by_take: tuple[TakeScore, ...]
    opening_mm: tuple[Array, Array]
    """Captured and predicted opening of the first take."""
    context: bool = False
    """True if targets depend on neighbours, which predicted better than one target for each phone."""


@dataclass(frozen=True, slots=True, eq=False)
class Sentence:
    """The components of :data:`SENTENCE`: figures 5 to 7 of the paper."""

    phones: PhoneTrack
    plain: Array
    """(T, K) weights, mm, at :data:`SENTENCE_RATE_HZ`: one key for each phone, a cubic spline, no expression."""
    moods: Mapping[Expression, Array]
    """(T, K): the same with an expression of :data:`MOODS` at full strength."""
    dominant: Mapping[Expression, int]
    """Component, from 0, that each expression moves farthest."""


def judge(training: Takes, held_out: Takes, prepared: Prepared, setup: Setup, profile: Profile) -> Prediction | None:
    """Predict held-out takes with phones of the others in a profile's space, with a context model if that is better.

    Returns None if no take with phones is held out.
    """
    if not any(take.phones for take in held_out):
        return None
    studies, _ = study_phones(training, prepared, profile.space, setup.held_phones)
    profile = replace(profile, phones=targets_of(studies))
    prediction = _predict(held_out, prepared, profile)
    context = learn_context(training, prepared, profile.space, profile.phones)
    if context is None:
        return prediction
    better = _predict(held_out, prepared, replace(profile, context=context))
    is_better = better.whole.lips_mm < prediction.whole.lips_mm
    return replace(better, context=True) if is_better else prediction


def targets_of(studies: Mapping[str, PhoneStudy]) -> Mapping[str, PhoneTarget]:
    """Targets of a profile's phones."""
    return MappingProxyType({name: study.target for name, study in studies.items()})


def _predict(takes: Takes, prepared: Prepared, profile: Profile) -> Prediction:
    lips = tuple(point for point in LIPS if point in prepared.named)
    middle = next((pair for pair in MIDDLE_OF_LIPS if set(pair) <= set(lips)), None)
    if middle is None:
        raise DataError("lips: middle points are missing; requires markers 8.1 and 8.2, or 2.2 and 2.3")
    upper, lower = (lips.index(point) for point in middle)
    columns = [profile.space.points.index(point) for point in lips]
    mean_pose = prepared.pick(lips, *takes).mean(axis=0)
    rows = []
    for take in takes:
        truth = prepared.pick(lips, take)
        planned = weights_of(spoken(take), profile, np.arange(len(truth)) / prepared.rate_hz)
        guess = profile.space.to_points_mm(planned)[:, columns]
        off = np.linalg.norm(guess - truth, axis=-1).mean(axis=1)
        still = np.linalg.norm(mean_pose - truth, axis=-1).mean(axis=1)
        openings = (points[:, upper, 1] - points[:, lower, 1] for points in (truth, guess))
        rows.append(np.stack([off, still, *openings], axis=1))
    sizes = [max(1, round(len(row) / prepared.rate_hz / PIECE_S)) for row in rows]
    return Prediction(
        whole=_score("all", rows),
        by_take=tuple(
            _score(take.name, np.array_split(row, size)) for take, row, size in zip(takes, rows, sizes, strict=True)
        ),
        opening_mm=(rows[0][:, 2], rows[0][:, 3]),
    )


def _score(take: str, pieces: list[Array]) -> TakeScore:
    """Score pieces of motion, (T, 4) each: lip error, error of the mean pose, captured and predicted opening."""
    sums = np.stack([_moments(piece) for piece in pieces])
    rng = np.random.default_rng(len(pieces))  # the same intervals whatever else was drawn
    drawn = rng.multinomial(len(pieces), np.full(len(pieces), 1 / len(pieces)), DRAWS) @ sums
    low, high = np.percentile(_measures(drawn), [2.5, 97.5], axis=0) if len(pieces) > 1 else np.full((2, 4), np.nan)
    return TakeScore(
        take, *(Estimate(*map(float, each)) for each in zip(_measures(sums.sum(axis=0)), low, high, strict=True))
    )


def _moments(piece: Array) -> Array:
    """Sums over the frames of a piece from which :func:`_measures` follow; those of two pieces add up."""
    off, still, captured, predicted = piece.T
    sums = [len(piece), off.sum(), still.sum(), captured.sum(), predicted.sum()]
    return np.array([*sums, (captured**2).sum(), (predicted**2).sum(), (captured * predicted).sum()])


def _measures(moments: Array) -> Array:
    """(..., 4): mean lip error, that of the mean pose, correlation and slope of the opening; 0 where nothing moves."""
    off, still, x, y, xx, yy, xy = np.moveaxis(moments[..., 1:] / moments[..., :1], -1, 0)
    across, ours, theirs = xy - x * y, xx - x**2, yy - y**2
    is_moving = (ours > 1e-12) & (theirs > 1e-12)
    ours, theirs = np.where(is_moving, ours, 1.0), np.where(is_moving, theirs, 1.0)
    r, slope = (np.where(is_moving, across / below, 0.0) for below in (np.sqrt(ours * theirs), ours))
    return np.stack([off, still, r, slope], axis=-1)


def say_sentence(profile: Profile) -> Sentence:
    """Plan the paper's sentence as the paper does, alone and with expressions."""
    labels = SENTENCE_PHONES.split()
    ends = SENTENCE_PHONE_S * np.arange(1, len(labels) + 1) + 2 * SENTENCE_PHONE_S
    phones = PhoneTrack.from_phones(
        [Phone(label, end - SENTENCE_PHONE_S, end) for label, end in zip(labels, ends.tolist(), strict=True)]
    )
    times_s = np.arange(round((ends[-1] + 2 * SENTENCE_PHONE_S) * SENTENCE_RATE_HZ)) / SENTENCE_RATE_HZ
    keys = keys_of(phones, as_published(profile))
    plain = sample_path("published", keys, times_s)[:, : profile.space.mode_count]
    faces = {mood: profile.expressions[mood].target for mood in MOODS if mood in profile.expressions}
    return Sentence(
        phones,
        plain,
        MappingProxyType({mood: plain + target for mood, target in faces.items()}),
        MappingProxyType({mood: int(np.abs(target).argmax()) for mood, target in faces.items()}),
    )
