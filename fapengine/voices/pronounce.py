"""Timed words to timed phones: a voice speaks each word, and its phones are fitted into the word's time.

Each word is spoken alone, so that it begins and ends where the file says. What is lost is what neighbours change:
a flap across a border, an article before a vowel. The track keeps its ``level``, so that nobody takes it for measured.
"""

from dataclasses import replace

from fapengine.errors import UsageError
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.voices.protocol import Voice

MIN_PHONE_S = 1e-4


def pronounce(track: PhoneTrack, voice: Voice) -> PhoneTrack:
    """Replace the words of a spelled track by their phones.

    Parameters
    ----------
    track : PhoneTrack
        Spelled, or it comes back unchanged.
    voice : Voice
        Speaks each different word once.

    Returns
    -------
    PhoneTrack
        IPA; each phone knows its word; a word that the voice finds nothing to speak in stays as its own label.
    """
    if not track.spelled:
        return track
    spoken: dict[str, list[Phone]] = {}
    phones: list[Phone] = []
    for word in track.phones:
        if word.is_silence:
            phones.append(word)
            continue
        if word.label not in spoken:
            spoken[word.label] = _speak(word.label, voice)
        phones += _fitted(spoken[word.label], word) or [word]
    return PhoneTrack.of(phones, tolerance_s=MIN_PHONE_S, level=track.level)


def _speak(word: str, voice: Voice) -> list[Phone]:
    try:
        return [phone for phone in voice.speak(word).phones.phones if not phone.is_silence]
    except UsageError:  # nothing to speak: a sign, a foreign script
        return []


def _fitted(parts: list[Phone], word: Phone) -> list[Phone]:
    """Scale the lengths of phones to the time of a word."""
    total_s = sum(part.duration_s for part in parts)
    fitted: list[Phone] = []
    now_s = word.start_s
    for index, part in enumerate(parts):
        share_s = part.duration_s / total_s * word.duration_s
        end_s = word.end_s if index + 1 == len(parts) else now_s + share_s
        if end_s > now_s:
            fitted.append(replace(part, start_s=now_s, end_s=end_s, word=word.label))
            now_s = end_s
    return fitted
