"""How a face speaks, as one value: speaker profile, style, expressions, seed and frame rate."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fapengine._strict_toml import Checked
from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSION_NAMES, Expression
from fapengine.profiles import Profile
from fapengine.speaking import DEFAULT_PROFILE, MannerOptions, Seed, SpeakingOptions
from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory.expression import Mood, during_word
from fapengine.trajectory.style import Style, parse_method

if TYPE_CHECKING:
    from fapengine.voices.choice import VoiceChoice

Expressions = Mapping[str | Expression, float] | Mapping[str, float] | Mapping[Expression, float] | Sequence[str | Mood]
"""Strengths by name, for the whole utterance; or texts such as ``"joy:0.4@1.5-3"``, and moods with their own times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner(Checked):
    """How a face speaks."""

    profile: str | Path | Profile = DEFAULT_PROFILE
    """Speaker profile: a built-in name, a folder, or a loaded profile."""
    style: Style = Style()  # noqa: RUF009  frozen
    expressions: Expressions = ()
    seed: Seed = 1
    """Random seed of blinks, glances and head motion; the same seed gives the same motion."""
    rate_hz: float = 30.0
    """Frame rate, 1 to 240 Hz."""


def manner_of(options: MannerOptions) -> Manner:
    """Check the speaking options, and make a manner of them. Raises UsageError for an invalid one."""
    check_expressions(options.expression)
    style = Style(
        articulation=options.articulation,
        jaw=options.jaw,
        lips=options.lips,
        loudness_db=options.loudness,
        liveliness=options.liveliness,
        method=parse_method(options.method),
    ).without(options.without)
    return Manner(
        profile=options.profile, style=style, expressions=options.expression, seed=options.seed, rate_hz=options.fps
    )


def voice_of(options: SpeakingOptions) -> "VoiceChoice":
    """Return the voice of the speaking options, not loaded yet."""
    from fapengine.voices.choice import VoiceChoice

    return VoiceChoice(options.voice, options.wpm, options.ssml)


def expression_of(name: str | Expression) -> Expression:
    """Find an expression by its name. Raises UsageError for an unknown name."""
    if isinstance(name, Expression):
        return name
    if name.lower() not in EXPRESSION_NAMES:
        raise UsageError(f"expressions: got {name!r}, expected one of {', '.join(EXPRESSION_NAMES)}")
    return Expression[name.upper()]


def parse_expression(text: str) -> tuple[Expression, float, str]:
    """Split ``"joy:0.4@word"`` into expression, strength (1 if not stated), and when (empty: all the time).

    Raises UsageError for an unknown expression, or a strength that is not a number.

    Examples
    --------
    >>> parse_expression("joy:0.4@1.5-3")
    (<Expression.JOY: 1>, 0.4, '1.5-3')
    """
    what, _, when = text.partition("@")
    name, _, strength = what.partition(":")
    expression = expression_of(name)
    try:
        return expression, float(strength or 1.0), when
    except ValueError as error:
        raise UsageError(f"expressions: got strength {strength!r}, expected a number as in joy:0.4") from error


def moods_of(expressions: Expressions, phones: PhoneTrack) -> list[Mood]:
    """Turn expressions into moods with their times.

    Raises UsageError for an invalid expression or strength, and a word that is not spoken.

    Parameters
    ----------
    expressions : mapping or sequence
        ``{"joy": 0.4}``, or ``["joy:0.4", "surprise@1.5-3", "anger@word"]``, or moods.
    phones : PhoneTrack
        Phones in which words are looked up.
    """
    if isinstance(expressions, Mapping):
        return [Mood(expression_of(name), strength) for name, strength in expressions.items()]
    moods: list[Mood] = []
    for entry in expressions:
        moods += [entry] if isinstance(entry, Mood) else _moods(entry, phones)
    return moods


def check_expressions(expressions: Expressions) -> None:
    """Reject invalid names and strengths before the phones are known. Raises as :func:`moods_of`."""
    if isinstance(expressions, Mapping):
        moods_of(expressions, PhoneTrack.from_phones([]))
    else:
        for entry in expressions:
            if isinstance(entry, str):
                parse_expression(entry)


def _moods(text: str, phones: PhoneTrack) -> list[Mood]:
    expression, strength, when = parse_expression(text)
    if not when:
        return [Mood(expression, strength)]
    span = re.fullmatch(r"([0-9.]+)-([0-9.]+)", when)
    if not span:
        return during_word(expression, strength, when, phones)
    try:
        start_s, stop_s = float(span[1]), float(span[2])
    except ValueError as error:
        raise UsageError(f"expressions: got {when!r}, expected seconds as in joy:0.4@1.5-3") from error
    return [Mood(expression, strength, start_s, stop_s)]
