"""Speech to FAPs: from timed phones to a :class:`FapTrack`.

Theory of operation
-------------------
Phones become keyframes, keyframes a path in the viseme space, the path displacements, these FAPs; expressions and
natural variation (:mod:`.variation`) are added on the way. After the weights of the space the same path carries what is
not recorded: how far lips come forward, and the tongue (:mod:`.phonetics`). Closures are settled last
(:mod:`.closures`), then gestures added (:mod:`.gestures`).

Guaranteed, and tested, for phones of 50 ms and more at natural rate, spoken at 0.5 to 3 times that rate:

- contacts are made, whatever the expression (:mod:`.closures`);
- the speed of the lips' opening is at most 2.5 times, and its acceleration 11 times, what was captured (the latter
  times the rate, if the speech is faster than natural; ``docs/trajectories.md``);
- between two keyframes each weight stays in their range but for :data:`.hermite.OVERSHOOT`;
- 0.12 s (:data:`.targets.REST_MARGIN_S`) after the last phone nothing of the speech is left on the face.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSIONS, Expression
from fapengine.mpeg4.fap import FAP_COUNT
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.profiles import Profile
from fapengine.speaking import RATES_HZ
from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory.closures import Holds, held, holds_of
from fapengine.trajectory.expression import Mood, expression_faps, mood_ramps
from fapengine.trajectory.faps import Composer, Overlay
from fapengine.trajectory.gestures import gestures_of
from fapengine.trajectory.methods import as_published, sample_path
from fapengine.trajectory.ramps import Ramp, sample_ramps
from fapengine.trajectory.style import Style as Style
from fapengine.trajectory.targets import REST_MARGIN_S, keys_of

PIECE = 4096
"""Frames that are computed at a time, as real numbers; so a long plan needs little more memory than its result."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What :func:`plan` returns."""

    track: FapTrack
    unknown: Mapping[str, int] = field(default_factory=dict)
    """Phone labels that are not IPA, with counts; the neutral vowel replaces them."""


def plan(
    phones: PhoneTrack,
    profile: Profile,
    *,
    rng: np.random.Generator,
    rate_hz: float = 30.0,
    expressions: Mapping[Expression, float] | Sequence[Mood] = (),
    style: Style | None = None,
    duration_s: float | None = None,
    gestures: Sequence[Ramp] = (),
) -> Plan:
    """Plan the motion of a face that speaks.

    Parameters
    ----------
    phones : PhoneTrack
        What is spoken, and when.
    profile : Profile
        Whose face.
    rng : numpy.random.Generator
        Draws the gestures.
    rate_hz : float
        Frames a second, 1..240.
    expressions : mapping of Expression to float, or sequence of Mood
        Strength of each, from beginning to end; or each with its own times. They add up.
    style : Style, optional
        How it speaks.
    duration_s : float, optional
        Length of the track, by default that of the phones; it is longer where the face takes longer to come to rest
        (:data:`.targets.REST_MARGIN_S` after the last phone).
    gestures : sequence of Ramp
        Glances, nods and blinks in addition to those of the style.
    """
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise UsageError(f"rate_hz: must be {RATES_HZ[0]:g} to {RATES_HZ[1]:g}, got {rate_hz}")
    style = style or Style()
    end_s = rest_s(phones, duration_s)
    times_s = np.arange(max(1, round(end_s * rate_hz))) / rate_hz
    moods = [Mood(*item) for item in expressions.items()] if isinstance(expressions, Mapping) else expressions

    spoken = as_published(profile) if style.method == "published" else profile
    keys = keys_of(phones, spoken, context=style.context)
    path = sample_path(style.method, keys, times_s)
    levels = sample_ramps(np.zeros(len(EXPRESSIONS)), mood_ramps(moods, profile, end_s), times_s)
    holds, composer = Holds(holds_of(keys.said[0])), Composer(profile, style)
    moved = gestures_of(times_s, end_s, phones.phones, style, rng, gestures)
    values = np.zeros((len(times_s), FAP_COUNT), np.int32)
    for start in range(0, len(times_s), PIECE):
        piece = slice(start, start + PIECE)
        near_s, one = times_s[piece], np.ones(len(times_s[piece]))
        varied, gestured = moved(piece)
        overlay = Overlay(expression_faps(profile) @ levels[:, piece] + varied, gestured, one, one)
        values[piece] = to_codable(composer.faps(path[piece].T, held(near_s, holds.near(near_s)), overlay))
    return Plan(FapTrack.from_values(values, rate_hz=rate_hz), dict(keys.unknown))


def rest_s(phones: PhoneTrack, duration_s: float | None = None) -> float:
    """Length of a track: ``duration_s``, or longer until the face has come to rest after speaking."""
    last_s = next((phone.end_s + REST_MARGIN_S for phone in reversed(phones.phones) if not phone.is_silence), 0.0)
    return max(phones.duration_s if duration_s is None else duration_s, last_s)
