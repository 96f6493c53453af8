"""A voice by its name, as the command line, the configuration and Python choose one."""

from dataclasses import dataclass
from math import inf

from fapengine import speaking
from fapengine._strict_toml import Checked
from fapengine.speaking import DEFAULT_RATE_WPM, DEFAULT_VOICE
from fapengine.voices.protocol import Voice

SERVICE_NAMES = ("elevenlabs", "cartesia", "inworld", "fish")
"""Services, as in :data:`fapengine.voices.services.SERVICES`: here, so that a local voice imports none of them."""


@dataclass(frozen=True, slots=True)
class VoiceChoice(Checked):
    """Name and options of a voice of espeak-ng, a service or a model; it is not loaded yet."""

    name: str = DEFAULT_VOICE
    """Language code (BCP 47), such as en-gb, de or fr; any code that a voice has, in any spelling. Or a service's
    voice, such as cartesia:VOICE, with the key in CARTESIA_API_KEY. Or your own model: piper:/path/voice.onnx, or
    kokoro:/path/model.onnx?voices=/path/voices.bin&voice=af_heart."""
    rate_wpm: speaking.Rate = DEFAULT_RATE_WPM
    """Words per minute, 80..449."""
    ssml: bool = False
    """True for texts in SSML."""

    def load(self, most_s: float = inf) -> Voice:
        """Load the voice; it refuses texts of more than ``most_s`` seconds of audio."""
        kind, colon, _ = self.name.partition(":")
        if kind == "piper" and colon:
            from fapengine.voices.piper import PiperVoice

            return PiperVoice.named(self.name, self.rate_wpm, self.ssml, most_s=most_s)
        if kind == "kokoro" and colon:
            from fapengine.voices.kokoro import KokoroVoice

            return KokoroVoice.named(self.name, self.rate_wpm, self.ssml, most_s=most_s)
        if kind in SERVICE_NAMES:
            from fapengine.voices.service_client import ServiceVoice

            return ServiceVoice.named(self.name, most_s=most_s)
        from fapengine.voices.espeak import EspeakVoice

        return EspeakVoice(self.name, self.rate_wpm, self.ssml, most_s=most_s)
