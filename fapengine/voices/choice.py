"""A voice by its name, as the command line, the configuration and Python choose one."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from fapengine._strict_toml import Checked
from fapengine.voices.protocol import Voice


@dataclass(frozen=True, slots=True)
class VoiceChoice(Checked):
    """A voice of espeak-ng that is not loaded yet."""

    name: str = "en-us"
    """Language code (BCP 47), such as en-gb, de or fr-fr."""
    rate_wpm: Annotated[int, Meta(ge=80, le=450)] = 160
    """Words a minute, 80..450."""

    def load(self) -> Voice:
        """Load the voice.

        Raises
        ------
        UsageError
            If the name is unknown or the rate out of range.
        ResourceError
            If espeak-ng is not installed.
        """
        from fapengine.voices.espeak import EspeakVoice

        return EspeakVoice(self.name, self.rate_wpm)
