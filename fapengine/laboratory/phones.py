"""Phones as points of the space, with error bars: paper 001, section 5.1."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.laboratory.context_fit import FRACTIONS, fit_context, lean_on_phonetics
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.setup import HeldPhone
from fapengine.laboratory.space import pick
from fapengine.models.viseme_space import VisemeSpace, sample_phones
from fapengine.profiles import Contact, ContextModel, PhoneTarget
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.context import Token, tokens_of

Array = NDArray[np.float64]

KEY, LATE = 0.3, 0.8
"""Fraction of a phone's duration at its keyframe (paper 001), and at the second one of a diphthong or affricate."""
RARE = 8
"""Tokens; below it a median is luck, and the tokens of the most similar frequent phone are taken in."""
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
    """Too few tokens for a median that is not luck, whatever was taken in."""
    error: Array
    """(keyframes, K): standard error of each weight; NaN where a single token cannot tell."""


def study_phones(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace, held: tuple[HeldPhone, ...] = ()
) -> tuple[Mapping[str, PhoneStudy], tuple[str, ...]]:
    """Find every phone's median point; of a phone said too seldom, the static shape that the subject held (section 3).

    Returns
    -------
    phones : mapping of IPA to PhoneStudy
    strange : tuple of str
        Labels that are not IPA.
    """
    tokens, strange = _tokens(takes, prepared, space)
    if not tokens:
        raise DataError("phones: missing in all takes; put timings beside the recordings", where=prepared.subject)
    frequent = [name for name, occurrences in tokens.items() if len(occurrences) >= RARE]
    studies = {}
    for name in sorted(tokens):
        used = [name]
        group = next((list(members) for members in CONTACTS.values() if name in members), [])
        used += [other for other in group if other != name and other in tokens]
        own = tuple(used)
        if sum(len(tokens[ipa_label]) for ipa_label in used) < RARE:
            like = [other for other in frequent if other not in used and _comparable(name, other)]
            used += [min(like, key=lambda other: _difference(name, other))] if like else []
        values = np.concatenate([tokens[ipa_label] for ipa_label in used])  # (N, 2, K)
        values = values if len(ipa.letters(name)) > 1 else values[:, :1]
        target = np.median(values, axis=0)
        spread = np.median(np.abs(values - target), axis=0)
        studies[name] = PhoneStudy(
            PhoneTarget(
                ipa=name,
                fractions=(KEY, LATE)[: len(target)],
                targets=target,
                contact=_contact(name),
                origin=f"median of {len(values)} tokens of {' '.join(used)}",
            ),
            len(tokens[name]),
            tuple(ipa_label for ipa_label in used if ipa_label not in own),
            len(values) < RARE,
            MEDIAN_OF_MEAN * spread / np.sqrt(len(values)) if len(values) > 1 else np.full_like(spread, np.nan),
        )
    return studies | _static(held, prepared, space, tokens), strange


def _static(
    held: tuple[HeldPhone, ...], prepared: Prepared, space: VisemeSpace, tokens: Mapping[str, Array]
) -> dict[str, PhoneStudy]:
    """Find the points of static shapes, for phones with less than :data:`RARE` tokens."""
    frames: dict[str, list[Array]] = {}
    for pose in held:
        take = next(candidate for candidate in prepared.takes if candidate.name == pose.moment.take)
        weights = space.to_space(pick((take,), prepared, space.points[: space.marker_count]))
        first = round(pose.moment.start_s * prepared.rate_hz)
        last = max(round(pose.moment.end_s * prepared.rate_hz), first + 1)
        frames.setdefault(pose.ipa, []).append(weights[first:last])
    studies = {}
    for name, parts in frames.items():
        said = len(tokens.get(name, ()))
        if said >= RARE:
            continue
        values = np.concatenate(parts)
        point = np.median(values, axis=0)[None]
        target = PhoneTarget(
            ipa=name, fractions=(KEY,), targets=point, contact=_contact(name), origin=f"held pose, {len(values)} frames"
        )
        studies[name] = PhoneStudy(target, said, (), False, np.full_like(point, np.nan))
    return studies


def _contact(name: str) -> Contact:
    return next((kind for kind, members in CONTACTS.items() if name in members), "none")


def learn_context(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace, known: Mapping[str, PhoneTarget]
) -> ContextModel | None:
    """Learn what neighbours do to a phone, with what phonetics knows of it; None where there are too few tokens."""
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
    markers = space.points[: space.marker_count]
    sentences, weights = [], []
    for take in takes:
        if not take.phones:
            continue
        tokens, _ = tokens_of(spoken(take), known)
        starts, ends = [token.start_s for token in tokens], [token.end_s for token in tokens]
        captured = space.to_space(pick((take,), prepared, markers))
        at = [sample_phones(captured, prepared.rate_hz, starts, ends, fraction) for fraction in FRACTIONS]
        sentences.append(tokens)
        weights.append(np.stack(at, axis=1))
    return sentences, weights


def spoken(take: Displacements) -> PhoneTrack:
    """Phones of a take as a track; rounding of its file is tolerated."""
    try:
        return PhoneTrack.of([Phone(p.label, p.start_s, p.end_s) for p in take.phones], tolerance_s=0.01)
    except UsageError as error:
        raise DataError(str(error), where=f"take {take.name}") from error


def _comparable(ipa_label: str, other: str) -> bool:
    """Whether two labels have as many letters, with vowels at the same places."""
    a, b = ([ipa.SOUNDS[letter].vowel for letter in ipa.letters(name)] for name in (ipa_label, other))
    return a == b


def _difference(ipa_label: str, other: str) -> float:
    return sum(ipa.distance(a, b) for a, b in zip(ipa.letters(ipa_label), ipa.letters(other), strict=True))


def _tokens(
    takes: tuple[Displacements, ...], prepared: Prepared, space: VisemeSpace
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Weights of each phone's tokens at both fractions: (N, 2, K)."""
    occurrences: dict[str, list[Array]] = {}
    strange: dict[str, None] = {}
    markers = space.points[: space.marker_count]
    for take in takes:
        weights = space.to_space(pick((take,), prepared, markers))
        spoken = [phone for phone in take.phones if phone.label != SILENCE]
        if not spoken:
            continue
        starts, ends = [p.start_s for p in spoken], [p.end_s for p in spoken]
        both = np.stack([sample_phones(weights, prepared.rate_hz, starts, ends, f) for f in (KEY, LATE)], axis=1)
        for phone, values in zip(spoken, both, strict=True):
            letters = ipa.letters(phone.label)
            if letters:
                occurrences.setdefault("".join(letters), []).append(values)
            else:
                strange[phone.label] = None
    return {name: np.stack(values) for name, values in occurrences.items()}, tuple(strange)
