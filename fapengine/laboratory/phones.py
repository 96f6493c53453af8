"""Phones as points of the space, with error bars: paper 001, section 5.1."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fapengine._arrays import Array
from fapengine.capture.marker_track import Interval
from fapengine.errors import DataError, as_data_error
from fapengine.laboratory.context_fit import FRACTIONS, fit_context, lean_on_phonetics
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.setup import HeldPhone
from fapengine.models.viseme_space import VisemeSpace, sample_phones
from fapengine.profiles import Contact, ContextModel, PhoneTarget
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.context import Token, tokens_of

TONGUE_ON_JAW = {"6.1": np.array([0.0, 0.91, 0.52]), "6.2": np.array([0.0, 0.28, 0.21])}
"""How far the jaw carries tip and middle of the tongue, as shares of the chin's way: those of the built-in head."""
KEY, LATE = 0.3, 0.8
"""Fraction of a phone's duration at its keyframe (paper 001), and at the second one of a diphthong or affricate."""
RARE = 8
"""Number of tokens below which a median is unreliable, and those of the most similar frequent phone are added."""
MIN_CONTEXT = 1000
"""Spoken tokens from which neighbours are learned; 1,000 are about 50 sentences."""
CONTACTS: Mapping[Contact, tuple[str, ...]] = {"lips": ("p", "b", "m"), "teeth": ("f", "v", "ɱ")}
MEDIAN_OF_MEAN = 1.2533 * 1.4826
"""Standard error of a median over MAD / sqrt(n), for normal data: sqrt(pi / 2), times 1.4826 from MAD to deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class PhoneStudy:
    """Findings about one phone."""

    target: PhoneTarget
    tokens: int
    """Number of tokens of the phone itself."""
    like: tuple[str, ...]
    """Other phones with tokens that were added, because it is rare."""
    rare: bool
    """Too few tokens for a reliable median, even with those that were added."""
    error: Array
    """(keyframes, K): standard error of each weight; NaN for a single token."""


def study_phones(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace, held: tuple[HeldPhone, ...] = ()
) -> tuple[Mapping[str, PhoneStudy], tuple[str, ...]]:
    """Find every phone's median point; for a rare phone, the static shape that the subject held (section 3).

    Returns
    -------
    phones : mapping of IPA to PhoneStudy
    strange : tuple of str
        Labels that are not IPA.
    """
    tokens, strange = _tokens(takes, prepared, space)
    if not tokens:
        raise DataError("phones: missing in all takes; put timing files next to the recordings", where=prepared.subject)
    frequent = [name for name, occurrences in tokens.items() if len(occurrences) >= RARE]
    studies = {}
    for name in sorted(tokens):
        group = CONTACTS.get(_contact(name), ())
        own = [name, *(other for other in group if other != name and other in tokens)]
        like: list[str] = []
        if sum(len(tokens[each]) for each in own) < RARE:
            apart = {other: _difference(name, other) for other in frequent if other not in own}
            like = [other for other in apart if apart[other] == min(apart.values()) < np.inf][:1]
        values = np.concatenate([tokens[each] for each in (*own, *like)])  # (N, 2, K)
        values = values if len(ipa.letters(name)) > 1 else values[:, :1]
        median = np.median(values, axis=0)
        spread = np.median(np.abs(values - median), axis=0)
        error = MEDIAN_OF_MEAN * spread / np.sqrt(len(values)) if len(values) > 1 else np.full_like(spread, np.nan)
        target = _target(name, median, f"median of {len(values)} tokens of {' '.join((*own, *like))}")
        studies[name] = PhoneStudy(target, len(tokens[name]), tuple(like), len(values) < RARE, error)
    shapes: dict[str, list[Array]] = {}
    for pose in held:
        if len(tokens.get(pose.ipa, ())) < RARE:
            shown = prepared.during(pose.moment)[:, [prepared.points.index(point) for point in space.markers]]
            shapes.setdefault(pose.ipa, []).append(space.to_space(shown))
    for name, parts in shapes.items():
        values = np.concatenate(parts)
        point = np.median(values, axis=0)[None]
        target = _target(name, point, f"held pose, {len(values)} frames")
        studies[name] = PhoneStudy(target, len(tokens.get(name, ())), (), False, np.full_like(point, np.nan))
    return _with_tongue(studies, takes, prepared), strange


def _with_tongue(
    studies: dict[str, PhoneStudy], takes: tuple[Displacements, ...], prepared: Prepared
) -> dict[str, PhoneStudy]:
    """Add the median position of the tongue to phones of one letter, where sensors 6.1 and 6.2 were on it."""
    if not {"6.1", "6.2", "2.1"} <= set(prepared.named):
        return studies
    tokens: dict[str, list[Array]] = {}
    for take in takes:
        at = prepared.by_point(take.moved_mm.astype(np.float64))
        tip, body = (at[point] - share * at["2.1"] for point, share in TONGUE_ON_JAW.items())
        track = np.stack([tip[:, 1], tip[:, 2], body[:, 1]], axis=1)
        for phone in take.phones:
            name = "".join(ipa.letters(phone.label))
            row = sample_phones(track, prepared.rate_hz, [phone.start_s], [phone.end_s], KEY)[0]
            tokens.setdefault(name, []).append(row)
    for name, study in studies.items():
        if name in tokens and len(ipa.letters(name)) == 1:
            tongue_mm = tuple(np.median(tokens[name], axis=0).round(2).tolist())
            studies[name] = replace(study, target=replace(study.target, tongue_mm=tongue_mm))
    return studies


def _target(name: str, targets: Array, origin: str) -> PhoneTarget:
    """Target of a phone with the given keyframes, (1 or 2, K)."""
    fractions = (KEY, LATE)[: len(targets)]
    return PhoneTarget(ipa=name, fractions=fractions, targets=targets, contact=_contact(name), origin=origin)


def _contact(name: str) -> Contact:
    return next((kind for kind, members in CONTACTS.items() if name in members), "none")


def learn_context(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace, known: Mapping[str, PhoneTarget]
) -> ContextModel | None:
    """Learn the effect of neighbours on phones, with rules of phonetics; None if there are too few tokens."""
    sentences, weights = captured_tokens(takes, prepared, space, known)
    count = sum(token.name != SILENCE for tokens in sentences for token in tokens)
    return lean_on_phonetics(fit_context(sentences, weights), space, known) if count >= MIN_CONTEXT else None


def captured_tokens(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace, known: Mapping[str, object]
) -> tuple[list[list[Token]], list[Array]]:
    """Collect what :func:`.context_fit.fit_context` needs.

    Returns
    -------
    sentences : list of token lists
        One a take; takes without phones are left out.
    weights : list of (N, keyframes, K) arrays
        Captured weights of each token.
    """
    sentences, weights = [], []
    for take in takes:
        if take.phones:
            sentences.append(tokens_of(spoken(take), known)[0])
            weights.append(_captured(take, prepared, space, sentences[-1], FRACTIONS))
    return sentences, weights


def _captured(
    take: Displacements,
    prepared: Prepared,
    space: VisemeSpace,
    phones: Sequence[Interval | Token],
    fractions: Sequence[float],
) -> Array:
    """Captured weights of a take's phones at fractions of their durations: (N, fractions, K)."""
    weights = space.to_space(prepared.pick(space.markers, take))
    starts, ends = [phone.start_s for phone in phones], [phone.end_s for phone in phones]
    return np.stack([sample_phones(weights, prepared.rate_hz, starts, ends, at) for at in fractions], axis=1)


def spoken(take: Displacements) -> PhoneTrack:
    """Phones of a take as a track; rounding of its file is tolerated."""
    with as_data_error(where=f"take {take.name}"):
        return PhoneTrack.from_phones(
            [Phone(p.label, p.start_s, p.end_s, word=p.word) for p in take.phones], tolerance_s=0.01
        )


def _difference(name: str, other: str) -> float:
    """Distance of two labels; infinite unless they have as many symbols, with vowels in the same positions."""
    ours, theirs = ipa.letters(name), ipa.letters(other)
    if [ipa.SOUNDS[symbol].vowel for symbol in ours] != [ipa.SOUNDS[symbol].vowel for symbol in theirs]:
        return np.inf
    return sum(ipa.distance(a, b) for a, b in zip(ours, theirs, strict=True))


def _tokens(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Weights of each phone's tokens at both fractions: (N, 2, K)."""
    occurrences: dict[str, list[Array]] = {}
    strange: dict[str, None] = {}
    for take in takes:
        said = [phone for phone in take.phones if phone.label != SILENCE]
        if not said:
            continue
        for phone, values in zip(said, _captured(take, prepared, space, said, (KEY, LATE)), strict=True):
            letters = ipa.letters(phone.label)
            if letters:
                occurrences.setdefault("".join(letters), []).append(values)
            else:
                strange[phone.label] = None
    return {name: np.stack(values) for name, values in occurrences.items()}, tuple(strange)
