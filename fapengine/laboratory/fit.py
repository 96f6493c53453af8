"""Fitting: a session to a profile, with the evidence for it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.geometry.smooth import low_pass
from fapengine.laboratory.densify import DenseStudy, densify
from fapengine.laboratory.phones import PhoneStudy, learn_context, study_phones
from fapengine.laboratory.predict import Prediction, Sentence, Takes, judge, say_sentence, targets_of
from fapengine.laboratory.prepare import Prepared
from fapengine.laboratory.selection import Selection, study_selection
from fapengine.laboratory.setup import Setup
from fapengine.laboratory.space import SpaceStudy, count_closures, find_expressions, measure_fapu, study_space
from fapengine.models.via_points import Reduction, ViaPoints, extract_via_points, reduction_curve
from fapengine.mpeg4.fapu import Fapu
from fapengine.profiles import Profile

TAKES_TO_SPLIT = 5
"""Number of takes below which none is held out."""
VIA_TOLERANCES_MM = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
VIA_FRAMES, VIA_SHOWN_MM = 600, 0.5
"""Frames of a take that are reduced at most, and the bound of the via points that the report shows."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Options of a fit; the defaults suit a first try."""

    modes: int | None = None
    """Components of the space; by default as many as carry ``variance``."""
    variance: float = 0.99
    held_out: float = 0.2
    """Fraction of the takes that is held out and predicted."""
    k: int | None = None
    """Size of the marker subset; by default the cross-validated curve decides."""
    tolerance_mm: float = 0.35
    """Largest mean error that the subset may leave: half the uncertainty of points from a video tracker."""

    def __post_init__(self) -> None:
        if not 0 < self.variance < 1:
            raise UsageError(f"variance: must be above 0 and below 1, got {self.variance}")
        if not 0 <= self.held_out <= 0.5:
            raise UsageError(f"held_out: must be 0 to 0.5, got {self.held_out}")


@dataclass(frozen=True, slots=True, eq=False)
class ViaStudy:
    """A take as via points: paper 004, "Interpolation"."""

    take: str
    motion_mm: Array
    """(T, M, 3): displacements, low-passed at 12 Hz."""
    points: ViaPoints
    """Via points of the motion with a bound of :data:`VIA_SHOWN_MM`."""
    curve: tuple[Reduction, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitted:
    """A profile, and the evidence for it."""

    prepared: Prepared
    held_out: tuple[str, ...]
    """Names of the takes that it was judged on."""
    selection: Selection | None
    space: SpaceStudy
    phones: Mapping[str, PhoneStudy]
    prediction: Prediction | None
    sentence: Sentence
    via: ViaStudy | None
    """None if all takes are too short."""
    dense: DenseStudy | None
    borrowed: tuple[Expression, ...]
    """Expressions that come from the standard profile."""
    profile: Profile
    warnings: tuple[str, ...]
    tracked: bool
    """True if the points were tracked in videos."""


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
        Facts about it that the recordings do not contain.
    profile_id : str
        Name of the new profile.
    origin : mapping of str to str
        Provenance: at least ``source`` and ``command``.
    standard : Profile
        Has the expressions that are missing in the session.
    face_fapu : Fapu
        Units of a standard face.
    rng : numpy.random.Generator
        Splits takes, hides entries, draws random subsets.
    on_step : callable
        Called with each of :data:`STEPS` but the first, which is preparing, when it begins.
    warnings : tuple of str
        From reading; those of the fit are added.
    """
    notes = [*warnings, *prepared.warnings]
    training, held_out = _split(prepared, options, rng, notes)
    on_step(STEPS[1])
    selection = study_selection(prepared, training, held_out, k=options.k, tolerance_mm=options.tolerance_mm, rng=rng)
    if selection is None:
        notes.append(f"marker subset: not studied, {len(prepared.labels)} markers are too few")
    on_step(STEPS[2])
    judged = study_space(
        prepared, training, held_out, modes=options.modes, variance=options.variance, standard=standard.space
    )
    space = replace(
        study_space(prepared, prepared.takes, (), modes=judged.space.mode_count, variance=1.0, standard=standard.space),
        error_mm=judged.error_mm,
        error_by_take_mm=judged.error_by_take_mm,
        error_from_mean_mm=judged.error_from_mean_mm,
    )
    fapu, guessed = measure_fapu(prepared, setup, face_fapu)
    on_step(STEPS[3])
    phones, strange = study_phones(prepared.takes, prepared, space.space, setup.held_phones)
    expressions, borrowed = find_expressions(prepared, setup, space.space, fapu, standard)
    notes += _notes(space, guessed, phones, strange, [expression.label for expression in borrowed], standard.id)
    profile = Profile(
        id=profile_id, language=setup.language, licence=setup.licence, origin=origin, fapu=fapu,
        space=space.space, phones=targets_of(phones), expressions=MappingProxyType(dict(expressions)),
    )  # fmt: skip
    if space.inferred:
        wanted, met = count_closures(prepared, profile)
        notes.append(
            f"feature points {', '.join(space.inferred)} were not recorded: they move as in {standard.id!r}."
            f" Of {wanted} p b m the captured lips close in {met}; {wanted - met} are lost"
        )
    on_step(STEPS[4])
    prediction = judge(training, held_out, prepared, setup, replace(profile, space=judged.space))
    on_step(STEPS[5])
    via = _reduce(held_out or training, prepared)
    on_step(STEPS[6])
    dense = densify(prepared, setup, modes=min(8, space.space.mode_count)) if setup.scans else None
    notes += dense.warnings if dense else []
    on_step(STEPS[7])
    if prediction is not None and prediction.context:
        profile = replace(profile, context=learn_context(prepared.takes, prepared, space.space, profile.phones))
    evidence = _evidence(prepared, space, prediction, len(training), len(held_out))
    return Fitted(
        prepared=prepared, held_out=tuple(take.name for take in held_out), selection=selection, space=space,
        phones=phones, prediction=prediction, sentence=say_sentence(profile), via=via, dense=dense, borrowed=borrowed,
        profile=replace(profile, origin=MappingProxyType({**origin, **evidence})), warnings=tuple(notes),
        tracked=setup.tracked,
    )  # fmt: skip


def _split(
    prepared: Prepared, options: FitOptions, rng: np.random.Generator, warnings: list[str]
) -> tuple[Takes, Takes]:
    """Choose takes to learn from and to hold out; whole ones, because neighbouring frames are nearly equal."""
    count = len(prepared.takes)
    if count < TAKES_TO_SPLIT or not options.held_out:
        warnings.append(f"no take was held out ({count} takes): errors are those of the training data, and too small")
        return prepared.takes, ()
    out = set(rng.permutation(count)[: max(1, round(options.held_out * count))].tolist())
    return (
        tuple(take for index, take in enumerate(prepared.takes) if index not in out),
        tuple(take for index, take in enumerate(prepared.takes) if index in out),
    )


def _notes(
    space: SpaceStudy,
    guessed: Sequence[str],
    phones: Mapping[str, PhoneStudy],
    strange: Sequence[str],
    borrowed: Sequence[str],
    standard: str,
) -> list[str]:
    """Warnings about feature points, FAPU, phones and expressions that the session does not have."""
    notes = [
        f"feature point {at} was not recorded: it follows {source}"
        for at, source in space.borrowed.items()
        if at not in space.inferred
    ]
    if guessed:
        notes.append(
            f"FAPU {', '.join(guessed)}: these markers do not show them, so they are a standard face's at this size"
            " ([fapu_mm] in session.toml sets them)"
        )
    notes += [f"phone {label!r} is not IPA: left out" for label in strange]
    rare = [
        f"{name} ({'with ' + ' '.join(study.like) if study.like else f'{study.tokens} tokens, none like it'})"
        for name, study in phones.items()
        if study.like or study.rare
    ]
    if rare:
        notes.append(f"phones {', '.join(rare)}: too rare alone")
    if borrowed:
        notes.append(f"expressions {', '.join(borrowed)}: no pose was recorded, borrowed from profile {standard!r}")
    return notes


def _reduce(takes: Takes, prepared: Prepared) -> ViaStudy | None:
    longest = max(takes, key=lambda take: len(take.moved_mm))
    frames = longest.moved_mm[:VIA_FRAMES]
    if len(frames) < 16:
        return None
    smooth = low_pass(frames.astype(np.float64), prepared.rate_hz, min(12.0, 0.45 * prepared.rate_hz))
    curve = tuple(reduction_curve(smooth, prepared.rate_hz, VIA_TOLERANCES_MM))
    return ViaStudy(longest.name, smooth, extract_via_points(smooth, prepared.rate_hz, VIA_SHOWN_MM), curve)


def _evidence(
    prepared: Prepared, space: SpaceStudy, prediction: Prediction | None, learned: int, judged: int
) -> dict[str, str]:
    """Entries of the profile's ``[origin]``: what it was learned from, and how well it predicts."""
    frames = sum(len(take.moved_mm) for take in prepared.takes)
    modes = space.space.mode_count
    entries = {
        "takes": f"{len(prepared.takes)} takes, {frames} frames at {prepared.rate_hz:g} Hz,"
        f" {len(prepared.labels)} markers; learned from {learned}, judged on {judged}",
        "variance": f"{modes} modes carry {100 * space.share[modes - 1]:.2f} % of the variance of"
        f" {space.space.marker_count} markers",
    }
    if prediction is not None:
        score = prediction.whole
        entries["held_out"] = (
            f"lips {score.lips_mm.value:.2f} mm (mean pose {score.mean_pose_mm.value:.2f}),"
            f" opening r {score.opening_r.value:.2f}, slope {score.opening_slope.value:.2f};"
            f" {'targets depend on neighbours' if prediction.context else 'one look for each phone'}"
        )
    return entries
