"""Speech to FAPs: the whole way from timed phones to a :class:`FapTrack`.

Theory of operation
-------------------
Phones become keyframes, keyframes a path in the viseme space, the path displacements, these FAPs; expressions are added
on the way. Contacts are settled last (:mod:`.closures`), then what only livens the face is added (:mod:`.liveliness`).

What is promised for phones of 50 ms and more at natural rate, spoken at 0.5 to 3 times that rate, and tested:

- contacts are made, whatever the expression (:mod:`.closures`);
- the opening of the lips moves at up to 2.5 :data:`FASTEST_MM_S`, and bends at up to :func:`sharpest_multiple` times
  :data:`SHARPEST_MM_S2`; most comes of the closures, which people who hurry do not always make;
- between two keyframes each weight stays in their range but for :data:`.hermite.OVERSHOOT`;
- 0.12 s (:data:`.keyframes.REST_MARGIN_S`) behind the last phone speech has left no trace on the face.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fapengine.errors import UsageError
from fapengine.mpeg4.codable import to_codable
from fapengine.mpeg4.track import FapTrack
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import Profile
from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory.closures import close_lips, holds_of
from fapengine.trajectory.expression import Mood, blend
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.keyframes import place_keyframes, resolve
from fapengine.trajectory.liveliness import enliven
from fapengine.trajectory.methods import sample_path
from fapengine.trajectory.style import Style as Style

RATES_HZ = (1.0, 240.0)
FASTEST_MM_S, SHARPEST_MM_S2 = 349.0, 9270.0
"""Speed and acceleration of the opening between captured inner lips, 99.9th percentile of 520 sentences at 25 frames a
second (``design/lip_speed.py``); frames so far apart hide the true peaks."""


def sharpest_multiple(rate: float) -> float:
    """How many :data:`SHARPEST_MM_S2` a plan stays below, for speech at ``rate`` times its natural rate."""
    return 11.0 * max(1.0, rate)


@dataclass(frozen=True, slots=True)
class Plan:
    """What :func:`plan` returns."""

    track: FapTrack
    unknown: Mapping[str, int] = field(default_factory=dict)
    """Phone labels that are no IPA, and how often they came; the neutral vowel stood in for them."""


def plan(
    phones: PhoneTrack,
    profile: Profile,
    *,
    rng: np.random.Generator,
    rate_hz: float = 30.0,
    expressions: Mapping[Expression, float] | Sequence[Mood] = (),
    style: Style | None = None,
    duration_s: float | None = None,
) -> Plan:
    """Plan the motion of a face that speaks.

    Parameters
    ----------
    phones : PhoneTrack
        What is spoken, and when.
    profile : Profile
        Whose face.
    rng : numpy.random.Generator
        Chance of what livens the face.
    rate_hz : float
        Frames a second, 1..240.
    expressions : mapping of Expression to float, or sequence of Mood
        Strength of each, from beginning to end; or each with its own times. They add up.
    style : Style, optional
        How it speaks.
    duration_s : float, optional
        Length of the track; by default that of the phones.

    Raises
    ------
    UsageError
        For a rate, a style or an expression out of range.
    """
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise UsageError(f"rate_hz: got {rate_hz}, expected {RATES_HZ[0]:g}..{RATES_HZ[1]:g}")
    style = style or Style()
    end_s = phones.duration_s if duration_s is None else duration_s
    times_s = np.arange(max(1, round(end_s * rate_hz))) / rate_hz

    resolved, unknown = resolve(phones, profile, context=style.context)
    keyframes = place_keyframes(phones, resolved, profile.space.mode_count, end_s)
    path = sample_path(style.method, resolved, keyframes, times_s) @ style.gains(profile)
    moods = [Mood(*wish) for wish in expressions.items()] if isinstance(expressions, Mapping) else expressions
    mood, mood_faps = blend(moods, profile, times_s, end_s)
    displacement_mm = profile.space.to_points_mm(path + mood)
    faps = displacements_to_faps(displacement_mm, profile.space.points, profile.fapu) + mood_faps
    faps = close_lips(faps, times_s, holds_of(resolved), openness=style.openness)
    faps += enliven(times_s, end_s, phones, style, rng)
    return Plan(FapTrack.of(to_codable(faps), rate_hz=rate_hz), dict(unknown))
