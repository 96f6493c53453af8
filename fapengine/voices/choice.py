"""A voice by its name, as the command line, the configuration and Python choose one.

Voices of your own have two kinds of names. A package may declare an entry point of the group :data:`GROUP`; its name,
alone or before a colon, is that of the voice (``mytts`` or ``mytts:anna``). Or ``module:Class`` names what is imported
from the current folder or an installed package. Either must be something that, when called, returns a
:class:`fapengine.Voice`; it gets those of the keywords ``name`` (what follows the entry point's name), ``rate_wpm``,
``ssml`` and ``most_s`` that it has parameters for.
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fapengine import speaking
from fapengine._strict_toml import Checked
from fapengine.errors import ResourceError, UsageError, any_error_as
from fapengine.speaking import DEFAULT_RATE_WPM, DEFAULT_VOICE
from fapengine.speech.marks import read_marks
from fapengine.voices.pronounce import Pronouncer
from fapengine.voices.protocol import Speech, Voice

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

MODELS = {"piper": "piper:PiperVoice", "piper-plus": "piper_plus:PiperPlusVoice", "kokoro": "kokoro:KokoroVoice"}
"""Voices of models that the user has, and their classes."""
SERVICE_NAMES = ("elevenlabs", "cartesia", "inworld", "fish")
"""Services, as in :data:`fapengine.voices.services.SERVICES`: here, so that a local voice imports none of them."""
MAX_VOICES = 8
"""Number of voices that a process keeps with the words that they know."""
GROUP = "fapengine.voices"
"""Group of entry points."""
_LANGUAGE = re.compile(r"[A-Za-z]{2,3}([-_+@.].*)?")
"""Names for which no entry point is looked up."""
_OBJECT = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d][\w.]*")


@dataclass(frozen=True, slots=True)
class VoiceChoice(Checked):
    """Name and options of a voice of espeak-ng, a service, a model or your own; it is not loaded yet."""

    name: str = DEFAULT_VOICE
    """Language code (BCP 47), such as en-gb, de or fr; any code that a voice has, in any spelling. Or a service's
    voice, such as cartesia:VOICE, with the key in CARTESIA_API_KEY. Or a model: piper:/path/voice.onnx,
    piper-plus:/path/model.onnx, or kokoro:/path/model.onnx?voices=/path/voices.bin&voice=af_heart. Or a class of your
    own: module:Class."""
    rate_wpm: speaking.Rate = DEFAULT_RATE_WPM
    """Words per minute, 80..449."""
    ssml: bool = False
    """True for texts in SSML."""

    @property
    def is_language(self) -> bool:
        """False for what files, accounts or programs of this machine speak."""
        return ":" not in self.name and entry_point(self.name) is None

    def load(self, most_s: float = inf) -> Voice:
        """Load the voice; it refuses texts of more than ``most_s`` seconds of audio.

        Raises
        ------
        UsageError
            If there is no such voice.
        ResourceError
            If it cannot be loaded.
        """
        kind, colon, rest = self.name.partition(":")
        if kind in MODELS and colon:
            module, _, name = MODELS[kind].partition(":")
            kind_of_voice = getattr(import_module(f"fapengine.voices.{module}"), name)
            voice: Voice = kind_of_voice.named(self.name, self.rate_wpm, self.ssml, most_s=most_s)
            return voice
        if kind in SERVICE_NAMES:
            from fapengine.voices.service_client import ServiceVoice

            return ServiceVoice.named(self.name, most_s=most_s)
        options: dict[str, object] = {"rate_wpm": self.rate_wpm, "ssml": self.ssml, "most_s": most_s}
        if point := entry_point(kind):
            return _made(self.name, point.load, {**options, "name": rest})
        if colon:
            return _made(self.name, lambda: _imported(self.name), options)
        from fapengine.voices.espeak import EspeakVoice

        return EspeakVoice(self.name, self.rate_wpm, self.ssml, most_s=most_s)


def loaded(voice: str | VoiceChoice | Voice) -> Voice:
    """Load a voice by its name; one that is loaded is returned with its results checked. Raises as ``load``."""
    if isinstance(voice, str):
        voice = VoiceChoice(voice)
    if isinstance(voice, VoiceChoice):
        return voice.load()
    if isinstance(voice, type):
        raise UsageError(f"voice: got the class {voice.__name__}, expected an object")
    return voice if type(voice).__module__.startswith("fapengine.") else OwnVoice(type(voice).__name__, voice)


@lru_cache(MAX_VOICES)
def pronouncer_of(voice: VoiceChoice) -> Pronouncer:
    """Load a voice for words, once in a process. Raises as ``load``."""
    return Pronouncer(voice.load())


@lru_cache(maxsize=64)
def entry_point(name: str) -> "EntryPoint | None":
    """Entry point of an installed package's voice; None if there is none."""
    if _LANGUAGE.fullmatch(name):
        return None
    from importlib import metadata  # 20 ms, for other names alone

    return next(iter(metadata.entry_points(group=GROUP, name=name)), None)


@dataclass(frozen=True, slots=True)
class OwnVoice:
    """A third-party voice: it gets texts without marks, and what it returns or raises is checked."""

    name: str
    voice: Voice
    ssml: bool = False
    """True to leave the marks to the voice."""

    def speak(self, text: str) -> Speech:
        """Speak a text.

        Raises
        ------
        UsageError
            If the voice returns anything but a ``Speech``.
        ResourceError
            If it raises an exception that is not fapengine's.
        """
        marked = read_marks(text, ssml=self.ssml)
        with any_error_as(ResourceError, f"voice: {self.name} failed"):
            speech = self.voice.speak(text if self.ssml else marked.text)
        if not isinstance(speech, Speech):
            raise UsageError(f"voice: {self.name}.speak returned {speech!r:.60}, expected a fapengine.Speech")
        is_marked = marked.marks or marked.unknown or marked.sounds or marked.remarks
        return speech.marked(marked) if is_marked and not self.ssml else speech


def _imported(name: str) -> Any:
    """Import ``module:Class``, also from the current folder."""
    if not _OBJECT.fullmatch(name):
        raise UsageError(f"voice: got {name!r}, expected a language code, module:Class, piper:, piper-plus:, kokoro:"
                         f" or {', '.join(f'{each}:' for each in SERVICE_NAMES)}")  # fmt: skip
    module, _, path = name.partition(":")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    found: Any = import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    return found


def _made(name: str, find: Callable[[], Any], options: dict[str, object]) -> OwnVoice:
    """Find what makes a voice, and call it with those of the options that it takes."""
    with any_error_as(UsageError, f"voice: {name} cannot be imported"):
        maker = find()
    if not callable(maker):
        raise UsageError(f"voice: {name} is {maker!r:.60}, expected a class or a function that returns a voice")
    taken: Iterable[str] = ()
    with suppress(TypeError, ValueError):  # a class without a signature
        taken = inspect.signature(maker).parameters
    with any_error_as(ResourceError, f"voice: {name} failed"):
        voice = maker(**{key: value for key, value in options.items() if key in taken})
    if not isinstance(voice, Voice):
        raise UsageError(f"voice: {name} is {voice!r:.60}, expected an object with speak(text)")
    return OwnVoice(name, voice, bool(options["ssml"]) and "ssml" in taken)


def language_voice(language: str) -> str:
    """Code of the voice for a language, named by a code or in English; the language itself if there is none."""
    from fapengine.voices.espeak import catalogue

    return catalogue().of_language(language) or language
