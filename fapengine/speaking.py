"""The speaking options, defined once for the command line, ``batch``, the server's configuration and Python.

Each has its type, range, default, help and other names here. ``say``, ``animate``, ``view`` and ``serve`` make options
of them (:mod:`fapengine.cli._command`), ``batch`` columns; in configuration files and in Python they have the names
that :class:`Described` gives. To add one, add a field to :class:`MannerOptions`; a test says where else it is missing.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from fapengine._strict_toml import Between, Checked
from fapengine.expressions import EXPRESSION_NAMES

DEFAULT_PROFILE, DEFAULT_VOICE, DEFAULT_RATE_WPM = "grid_s1_en", "en-us", 160
MAX_GAIN = 3.0
LOUDNESS_DB = (-20.0, 20.0)
RATES_HZ = (1.0, 240.0)
RATES_WPM = (80, 449)
"""Rates that espeak-ng speaks itself, words per minute (espeakRATE).

From 450 on it speeds up the finished sound, and the times of its events become wrong: they are up to 16 ms early, and
the last one is after the end of the sound (measured with 1.52).
"""
Method = Literal["context", "paper", "published", "minimum-jerk", "dominance"]
METHOD_NAMES: tuple[Method, ...] = get_args(Method)
GENERATORS = ("blinks", "head_motion", "gaze", "idle", "emphasis")
"""Fields of :class:`fapengine.trajectory.style.Style` that switch gestures."""
PROVENANCE = "provenance"
"""Leaves out the mark of :mod:`fapengine.files.provenance`."""
WITHOUT = (*(name.replace("_", "-") for name in GENERATORS), "all", PROVENANCE)


@dataclass(frozen=True, slots=True)
class Described:
    """The help of an option, and its other names."""

    help: str
    """Help of the command line; ``{range}`` and ``{choices}`` are filled in."""
    python: str
    """Its name in Python: ``Style.jaw``, or a parameter of :func:`fapengine.speak`."""
    config: str | None
    """Its table and key in the server's configuration, if any."""
    short: str | None = None
    """Short flag."""
    choices: tuple[str, ...] = ()
    """All values, or beginnings of values."""


Voice = Annotated[
    str,
    Described(
        "Voice. A language code for espeak-ng (en-gb, de, fr), a cloud voice (elevenlabs:ID, cartesia:ID, inworld:ID,"
        " fish:ID; the key in ELEVENLABS_API_KEY and so on), a local model (piper:/path/voice.onnx,"
        " piper-plus:/path/model.onnx?language=es, kokoro:/path/model.onnx?voices=/path/voices.bin&voice=af_heart), or"
        " your own: module:Class, or the name of an entry point fapengine.voices.",
        python="VoiceChoice.name",
        config="voice.name",
        short="-v",
    ),
]
Rate = Annotated[
    int,
    Between(*RATES_WPM),
    Described("Speaking rate, {range} words per minute.", python="VoiceChoice.rate_wpm", config="voice.rate_wpm"),
]
Ssml = Annotated[bool, Described("Treat texts as SSML.", python="VoiceChoice.ssml", config="voice.ssml")]
Expressions = Annotated[
    tuple[str, ...],
    Described(
        "Expression, NAME:STRENGTH, optionally with a time in seconds or a word: joy:0.4, joy:0.4@1.5-3, joy:0.4@word."
        " Names: {choices}. Repeatable.",
        python="speak.expressions",
        config=None,
        short="-e",
        choices=EXPRESSION_NAMES,
    ),
]
ProfileName = Annotated[
    str, Described("Speaker profile: a built-in name or a folder.", python="speak.profile", config="face.profile")
]
Fps = Annotated[
    float,
    Between(*RATES_HZ),
    Described("Frame rate, {range} frames per second.", python="speak.rate_hz", config="face.rate_hz"),
]
Articulation = Annotated[
    float,
    Between(0.0, MAX_GAIN),
    Described(
        "Overall amplitude of mouth movement, {range}; 1 is natural.",
        python="Style.articulation",
        config="style.articulation",
    ),
]
Jaw = Annotated[
    float,
    Between(0.0, MAX_GAIN),
    Described("Amplitude of jaw movement, {range}.", python="Style.jaw", config="style.jaw"),
]
Lips = Annotated[
    float,
    Between(0.0, MAX_GAIN),
    Described(
        "Amplitude of lip movement, {range}: below 1 mumbles, above 1 exaggerates.",
        python="Style.lips",
        config="style.lips",
    ),
]
Loudness = Annotated[
    float,
    Between(*LOUDNESS_DB),
    Described(
        "Loudness relative to the speaker profile, {range} dB. Louder speech opens the jaw wider.",
        python="Style.loudness_db",
        config="style.loudness_db",
    ),
]
Liveliness = Annotated[
    float,
    Between(0.0, 1.0),
    Described(
        "Natural variation of the mouth, {range}: 0 says a word the same way each time.",
        python="Style.liveliness",
        config="style.liveliness",
    ),
]
MethodName = Annotated[
    str, Described("Motion planner: {choices}.", python="Style.method", config="style.method", choices=METHOD_NAMES)
]
Without = Annotated[
    tuple[str, ...],
    Described(
        "Turn off automatic movement, or the mark that says that a file is synthetic (provenance): {choices};"
        " all also sets liveliness to 0, and keeps the mark. Repeatable.",
        python="Style.without",
        config="style",  # a key of its own for each
        choices=WITHOUT,
    ),
]
Seed = Annotated[
    int,
    Between(0),
    Described(
        "Random seed, {range}, for blinks, glances, head motion and variation. The same seed gives the same motion.",
        python="speak.seed",
        config="face.seed",
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class MannerOptions(Checked):
    """How a face speaks."""

    expression: Expressions = ()
    profile: ProfileName = DEFAULT_PROFILE
    fps: Fps = 30.0
    articulation: Articulation = 1.0
    jaw: Jaw = 1.0
    lips: Lips = 1.0
    loudness: Loudness = 0.0
    liveliness: Liveliness = 1.0
    method: MethodName = "context"
    without: Without = ()
    seed: Seed = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeakingOptions(MannerOptions):
    """How a text is spoken, by a voice and by a face."""

    voice: Voice = DEFAULT_VOICE
    wpm: Rate = DEFAULT_RATE_WPM
    ssml: Ssml = False
