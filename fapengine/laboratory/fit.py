"""Fitting: a session to a profile, with the evidence for it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.expressions import EXPRESSIONS, Expression
from fapengine.laboratory.densify import DenseStudy, densify
from fapengine.laboratory.phones import PhoneStudy, learn_context, spoken, study_phones
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.selection import Selection, study_selection
from fapengine.laboratory.setup import Setup
from fapengine.laboratory.space import SpaceStudy, find_expressions, measure_fapu, pick, study_space
from fapengine.models.via_points import Reduction, reduction_curve, without_noise
from fapengine.mpeg4.fapu import Fapu
from fapengine.profiles import PhoneTarget, Profile
from fapengine.trajectory.expression import Mood, mood_ramps
from fapengine.trajectory.ramps import sample_ramps
from fapengine.trajectory.targets import weights_of

Array = NDArray[np.float64]

TAKES_TO_SPLIT = 5
"""Fewer takes leave none to judge by."""
VIA_TOLERANCES_MM = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
VIA_FRAMES = 600
LIPS = (*(f"8.{n}" for n in range(1, 9)), *(f"2.{n}" for n in range(2, 10)))

STEPS = (
    "head motion and gaps",
    "marker subset",
    "viseme space",
    "phones",
    "prediction of held-out takes",
    "via points",
    "scans",
    "profile",
)
"""Steps of :func:`fit_session`, in order."""

MOOD = Mood(Expression.JOY, 0.6)
"""Expression of the report's picture of components."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Choices of a fit; the defaults suit a first try."""

    modes: int | None = None
    """Components of the space; by default as many as carry ``variance``."""
    variance: float = 0.99
    held_out: float = 0.2
    """Share of takes to judge by."""
    k: int | None = None
    """Size of the marker subset; by default the cross-validated curve decides."""
    tolerance_mm: float = 0.35
    """Mean error that the subset may leave: half of what points from a video tracker are uncertain by."""

    def __post_init__(self) -> None:
        if not 0 < self.variance < 1:
            raise UsageError(f"variance: must be above 0 and below 1, got {self.variance}")
        if not 0 <= self.held_out <= 0.5:
            raise UsageError(f"held_out: must be 0 to 0.5, got {self.held_out}")


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Held-out takes from their phones alone, with a profile of the other takes."""

    lips_mm: float
    """Mean distance of the recorded lip points."""
    mean_pose_mm: float
    """The same for the mean pose: the score of a face that does not move."""
    opening_r: float
    opening_slope: float
    opening_mm: tuple[Array, Array]
    """Captured and predicted opening of the first take."""
    components: tuple[Array, Array, Array]
    """Weights of the space in the first take, (T, K) each: captured, predicted, predicted with :data:`MOOD`."""
    take: str
    context: bool = False
    """Targets depend on neighbours: that predicts better than one look for each phone."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitted:
    """A profile, and the evidence for it."""

    prepared: Prepared
    options: FitOptions
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    selection: Selection | None
    space: SpaceStudy
    phones: Mapping[str, PhoneStudy]
    prediction: Prediction | None
    reduction: tuple[Reduction, ...]
    dense: DenseStudy | None
    borrowed: tuple[Expression, ...]
    """Expressions that come from the standard profile."""
    profile: Profile
    warnings: tuple[str, ...]


def fit_session(
    prepared: Prepared,
    setup: Setup,
    *,
    profile_id: str,
    origin: Mapping[str, str],
    standard: Profile,
    face_fapu: Fapu,
    options: FitOptions,
    rng: np.random.Generator,
    on_step: Callable[[str], None] = lambda step: None,
    warnings: tuple[str, ...] = (),
) -> Fitted:
    """Learn a profile from a session.

    Parameters
    ----------
    prepared : Prepared
        From :func:`fapengine.laboratory.prepare.prepare`; its session, which may be large, is not needed any more.
    setup : Setup
        What the laboratory says about it.
    profile_id : str
        Name of the new profile.
    origin : mapping of str to str
        Provenance: at least ``source`` and ``command``.
    standard : Profile
        Lends the expressions that the session lacks.
    face_fapu : Fapu
        Units of a standard face.
    rng : numpy.random.Generator
        Splits takes, hides entries, draws random subsets.
    on_step : callable
        Told each of :data:`STEPS` but the first, which preparing is, as it begins.
    warnings : tuple of str
        From reading; those of the fit are added.
    """
    remarks = [*warnings, *prepared.warnings]
    training, held_out = _split(prepared, options, rng, remarks)
    on_step(STEPS[1])
    selection = study_selection(prepared, training, held_out, k=options.k, tolerance_mm=options.tolerance_mm, rng=rng)
    if selection is None:
        remarks.append(f"marker subset: not studied, {len(prepared.labels)} markers are too few")
    on_step(STEPS[2])
    judged = study_space(prepared, training, held_out, modes=options.modes, variance=options.variance)
    space = replace(
        study_space(prepared, prepared.takes, (), modes=judged.space.mode_count, variance=1.0),
        error_mm=judged.error_mm,
        error_from_mean_mm=judged.error_from_mean_mm,
    )
    fapu, guessed = measure_fapu(prepared, setup, face_fapu)
    remarks += _space_remarks(space, guessed)
    on_step(STEPS[3])
    phones, strange = study_phones(prepared.takes, prepared, space.space, setup.held_phones)
    remarks += _phone_remarks(phones, strange)
    expressions, borrowed = find_expressions(prepared, setup, space.space, fapu, standard)
    if borrowed:
        names = ", ".join(expression.label for expression in borrowed)
        remarks.append(f"expressions {names}: no pose was recorded, borrowed from profile {standard.id!r}")
    profile = Profile(
        id=profile_id, language=setup.language, licence=setup.licence, origin=MappingProxyType(dict(origin)), fapu=fapu,
        space=space.space, phones=_targets(phones), expressions=MappingProxyType(dict(expressions)),
    )  # fmt: skip
    on_step(STEPS[4])
    prediction = _judge(training, held_out, prepared, setup, replace(profile, space=judged.space))
    on_step(STEPS[5])
    reduction = _reduce(held_out or training, prepared)
    on_step(STEPS[6])
    dense = densify(prepared, setup, modes=min(8, space.space.mode_count)) if setup.scans else None
    on_step(STEPS[7])
    context = None
    if prediction is not None and prediction.context:
        context = learn_context(prepared.takes, prepared, space.space, profile.phones)
    evidence = _evidence(prepared, space, prediction, training, held_out)
    return Fitted(
        prepared=prepared, options=options, training=tuple(take.name for take in training),
        held_out=tuple(take.name for take in held_out), selection=selection, space=space, phones=phones,
        prediction=prediction, reduction=reduction, dense=dense, borrowed=borrowed,
        profile=replace(profile, origin=MappingProxyType({**origin, **evidence}), context=context),
        warnings=tuple(remarks),
    )  # fmt: skip


Takes = tuple[Displacements, ...]


def _split(
    prepared: Prepared, options: FitOptions, rng: np.random.Generator, warnings: list[str]
) -> tuple[Takes, Takes]:
    """Choose takes to learn from and to judge by; whole ones, because neighbouring frames are nearly equal."""
    count = len(prepared.takes)
    if count < TAKES_TO_SPLIT or not options.held_out:
        warnings.append(f"no take was held out ({count} takes): errors are those of the training data, and flatter")
        return prepared.takes, ()
    out = set(rng.permutation(count)[: max(1, round(options.held_out * count))].tolist())
    return (
        tuple(take for index, take in enumerate(prepared.takes) if index not in out),
        tuple(take for index, take in enumerate(prepared.takes) if index in out),
    )


def _space_remarks(space: SpaceStudy, guessed: Sequence[str]) -> list[str]:
    remarks = [f"feature point {at} was not recorded: it follows {source}" for at, source in space.borrowed.items()]
    if guessed:
        remarks.append(
            f"FAPU {', '.join(guessed)}: not to be measured from these markers, a standard face's at this size"
            " ([fapu_mm] in session.toml gives them)"
        )
    return remarks


def _phone_remarks(phones: Mapping[str, PhoneStudy], strange: Sequence[str]) -> list[str]:
    remarks = [f"phone {label!r} is no IPA: left out" for label in strange]
    rare = [
        f"{name} ({'with ' + ' '.join(study.like) if study.like else f'{study.tokens} tokens, none like it'})"
        for name, study in phones.items()
        if study.like or study.rare
    ]
    if rare:
        remarks.append(f"phones {', '.join(rare)}: too rare alone")
    return remarks


def _judge(training: Takes, held_out: Takes, prepared: Prepared, setup: Setup, profile: Profile) -> Prediction | None:
    """Predict held-out takes with phones of the others in a profile's space, with a context model if that is better."""
    if not any(take.phones for take in held_out):
        return None
    studies, _ = study_phones(training, prepared, profile.space, setup.held_phones)
    profile = replace(profile, phones=_targets(studies))
    prediction = _predict(held_out, prepared, profile)
    context = learn_context(training, prepared, profile.space, profile.phones)
    if context is None:
        return prediction
    better = _predict(held_out, prepared, replace(profile, context=context))
    return replace(better, context=True) if better.lips_mm < prediction.lips_mm else prediction


def with_mood(weights: Array, profile: Profile, rate_hz: float) -> Array:
    """Add :data:`MOOD` to weights of the space, (T, K), from beginning to end (paper 001, figures 6 and 7)."""
    times_s = np.arange(len(weights)) / rate_hz
    levels = sample_ramps(np.zeros(len(EXPRESSIONS)), mood_ramps([MOOD], profile, len(weights) / rate_hz), times_s)
    level = levels[EXPRESSIONS.index(MOOD.expression)]
    added: Array = level[:, None] * profile.expressions[MOOD.expression].target
    return weights + added


def _predict(takes: Takes, prepared: Prepared, profile: Profile) -> Prediction:
    lips = tuple(point for point in LIPS if point in prepared.named)
    columns = [profile.space.points.index(point) for point in lips]
    guesses, truths, planned = [], [], []
    for take in takes:
        times = np.arange(len(take.moved_mm)) / prepared.rate_hz
        phones = spoken(take)
        planned.append(weights_of(phones, profile, times))
        guesses.append(profile.space.to_points_mm(planned[-1])[:, columns])
        truths.append(pick((take,), prepared, lips))
    guess, truth = np.concatenate(guesses), np.concatenate(truths)
    upper, lower = _opening_points(lips)
    captured, predicted = (a[:, upper, 1] - a[:, lower, 1] for a in (truth, guess))
    first = len(truths[0])
    moves = np.ptp(captured) > 0 and np.ptp(predicted) > 0
    return Prediction(
        lips_mm=float(np.linalg.norm(guess - truth, axis=-1).mean()),
        mean_pose_mm=float(np.linalg.norm(truth - truth.mean(axis=0), axis=-1).mean()),
        opening_r=float(np.corrcoef(captured, predicted)[0, 1]) if moves else 0.0,
        opening_slope=float(np.polyfit(captured, predicted, 1)[0]) if moves else 0.0,
        opening_mm=(captured[:first], predicted[:first]),
        components=(
            profile.space.to_space(pick(takes[:1], prepared, profile.space.points[: profile.space.marker_count])),
            planned[0],
            with_mood(planned[0], profile, prepared.rate_hz),
        ),
        take=takes[0].name,
    )


def _opening_points(lips: tuple[str, ...]) -> tuple[int, int]:
    """Middle of upper and lower lip, the inner contour if it was recorded."""
    for upper, lower in (("2.2", "2.3"), ("8.1", "8.2")):
        if upper in lips and lower in lips:
            return lips.index(upper), lips.index(lower)
    raise DataError("lips: middle points are missing; the markers need 8.1 and 8.2, or 2.2 and 2.3")


def _reduce(takes: Takes, prepared: Prepared) -> tuple[Reduction, ...]:
    longest = max(takes, key=lambda take: len(take.moved_mm))
    frames = longest.moved_mm[:VIA_FRAMES]
    if len(frames) < 16:
        return ()
    smooth = without_noise(frames, prepared.rate_hz, min(12.0, 0.45 * prepared.rate_hz))
    return tuple(reduction_curve(smooth, prepared.rate_hz, VIA_TOLERANCES_MM))


def _targets(studies: Mapping[str, PhoneStudy]) -> Mapping[str, PhoneTarget]:
    return MappingProxyType({name: study.target for name, study in studies.items()})


def _evidence(
    prepared: Prepared, space: SpaceStudy, prediction: Prediction | None, training: Takes, held_out: Takes
) -> dict[str, str]:
    """Entries of the profile's ``[origin]`` that say what it was learned from, and how well it predicts."""
    frames = sum(len(take.moved_mm) for take in prepared.takes)
    remarks = {
        "takes": f"{len(prepared.takes)} takes, {frames} frames at {prepared.rate_hz:g} Hz,"
        f" {len(prepared.labels)} markers; learned from {len(training)}, judged on {len(held_out)}",
        "variance": f"{space.space.mode_count} modes carry {100 * space.share[space.space.mode_count - 1]:.2f} % of the"
        f" variance of {space.space.marker_count} markers",
    }
    if prediction is not None:
        remarks["held_out"] = (
            f"lips {prediction.lips_mm:.2f} mm (mean pose {prediction.mean_pose_mm:.2f}),"
            f" opening r {prediction.opening_r:.2f}, slope {prediction.opening_slope:.2f};"
            f" {'targets depend on neighbours' if prediction.context else 'one look for each phone'}"
        )
    return remarks
