"""A voice by its name, as the command line, the configuration and Python choose one."""

from dataclasses import dataclass
from math import inf
from typing import Annotated

from fapengine._strict_toml import Between, Checked
from fapengine.voices.espeak import DEFAULT_RATE_WPM, DEFAULT_VOICE, RATES_WPM, EspeakVoice
from fapengine.voices.models.kokoro import KokoroVoice
from fapengine.voices.models.piper import PiperVoice
from fapengine.voices.protocol import Voice
from fapengine.voices.streams.services import SERVICES

MODELS: dict[str, type[PiperVoice] | type[KokoroVoice]] = {"piper": PiperVoice, "kokoro": KokoroVoice}
"""Kinds of models that speak, by what their names begin with."""


@dataclass(frozen=True, slots=True)
class VoiceChoice(Checked):
    """A voice that is not loaded yet: espeak-ng's, a service's, or a model's."""

    name: str = DEFAULT_VOICE
    """Language code (BCP 47), such as en-gb, de or fr; any code that a voice has, in any spelling. Or a service's
    voice, such as cartesia:VOICE, with the key in CARTESIA_API_KEY. Or a model of your own: piper:/path/voice.onnx, or
    kokoro:/path/model.onnx?voices=/path/voices.bin&voice=af_heart."""
    rate_wpm: Annotated[int, Between(RATES_WPM[0], RATES_WPM[1])] = DEFAULT_RATE_WPM
    """Words a minute, 80..449."""
    ssml: bool = False
    """Flag of texts that are SSML."""

    def load(self, most_s: float = inf) -> Voice:
        """Load the voice; texts of more than ``most_s`` seconds of sound are refused.

        Raises
        ------
        UsageError
            If the name is unknown or the rate out of range.
        ResourceError
            If espeak-ng is not installed, or what runs the model.
        DataError
            If a model's files are none.
        """
        if (model := MODELS.get(self.name.partition(":")[0])) and ":" in self.name:
            return model.named(self.name, self.rate_wpm, self.ssml, most_s=most_s)
        if self.name.partition(":")[0] in SERVICES:
            from fapengine.voices.streams.client import ServiceVoice  # asyncio and ssl, for services alone

            return ServiceVoice.named(self.name, most_s=most_s)
        return EspeakVoice(self.name, self.rate_wpm, self.ssml, most_s=most_s)
