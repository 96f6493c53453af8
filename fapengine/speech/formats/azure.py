"""Azure Speech viseme events (SDK ``VisemeReceived``): onset in ticks of 100 ns and one of 22 ids, as JSON (lines)."""

from fapengine.errors import UnsupportedError
from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import track_of, until_next
from fapengine.speech.phone_track import PhoneTrack

TICKS_HZ = 1e7
OFFSETS = ("audio_offset", "AudioOffset", "audioOffset", "privAudioOffset", "Offset", "offset")
IDS = ("viseme_id", "VisemeId", "visemeId", "privVisemeId")
"""Spellings of the Python, C#, JavaScript SDKs and of the REST batch result."""


def is_event(node: Node) -> bool:
    """Whether a value looks like an event of Azure, visemes or blend shapes."""
    return any(node.has(key) for key in IDS) or node.has("BlendShapes")


def parse_azure(data: bytes) -> PhoneTrack:
    """Read the viseme events; each lasts until the next.

    Raises
    ------
    DataError
        If keys lack or times fall.
    UnsupportedError
        For blend-shape frames: they are 55 weights 60 times a second, a motion and not phone timings.
    """
    document = parse_document(data, "Azure visemes")
    events = document.entries()
    if any(event.has("BlendShapes") for event in events):
        raise UnsupportedError(
            "Azure: got blend-shape frames (55 weights at 60 Hz), expected viseme events; frames are a motion, not"
            " phones: `fapengine render` and `convert` take them"
        )
    onsets = [
        (event.first(*OFFSETS).number() / TICKS_HZ, f"{event.first(*IDS).number():g}", event.where) for event in events
    ]
    return track_of(until_next(onsets), "Azure visemes", alphabet="azure-visemes", level="viseme")
