"""Language that a file of timed words names.

Recognizers name it in JSON: Whisper, OpenAI, ElevenLabs and Rev ``language`` (a code or a name), AssemblyAI and Amazon
``language_code``, Google ``languageCode``, Deepgram ``detected_language``, Azure ``locale``, whisper.cpp
``result.language``, Speechmatics ``metadata.transcription_config.language``. WebVTT files of YouTube name it in the
header: ``Language: fr``.
"""

import re
from collections import Counter
from typing import Any

from fapengine.errors import DataError
from fapengine.speech.formats.documents import decode_text, parse_document

_KEYS = (
    "language", "language_code", "languageCode", "detected_language", "detectedLanguage", "lang", "locale", "Language"
)  # fmt: skip
_UNKNOWN = frozenset({"", "auto", "detect", "unknown", "und", "multi", "mul", "none", "null"})
_HEADER = re.compile(r"^(?:X-)?Language\s*[:=]\s*\"?([A-Za-z0-9_-]+)\"?\s*$", re.MULTILINE | re.IGNORECASE)
_SPAN = re.compile(r"<lang ([A-Za-z0-9-]+)>")
_DEPTH, _ITEMS = 9, 20
"""Levels of a document, and items of a list, that are searched."""


def language_of(data: bytes) -> str:
    r"""Find the language in a file, as it is spelled there; empty if the file names none.

    Examples
    --------
    >>> language_of(b'{"segments": [], "language": "french"}'), language_of(b"WEBVTT\nLanguage: pt-BR\n\n")
    ('french', 'pt-BR')
    """
    try:
        text = decode_text(data, "file").lstrip()
        if text.startswith("WEBVTT"):
            header = _HEADER.search(re.split(r"\r?\n\r?\n", text, maxsplit=1)[0]) or _SPAN.search(text)
            return header[1] if header else ""
        return _named([parse_document(data, "file").value])
    except DataError:  # neither: lines of labels
        return ""


def _named(values: list[Any]) -> str:
    """Search values level by level; where a level names several languages, the commonest counts."""
    for _ in range(_DEPTH):
        below: list[Any] = []
        found: Counter[str] = Counter()
        for value in values:
            if isinstance(value, list):
                below += value[:_ITEMS]
            elif isinstance(value, dict):
                listed = value.get("languages")
                named = [*(value.get(key) for key in _KEYS), *(listed if isinstance(listed, list) else ())]
                known = [str(name).strip() for name in named if isinstance(name, str)]
                found.update([name for name in known if name.lower() not in _UNKNOWN][:1])
                below += value.values()
        if found:
            return found.most_common(1)[0][0]
        values = below
    return ""
