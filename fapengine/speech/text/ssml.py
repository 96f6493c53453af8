"""SSML (W3C Speech Synthesis Markup Language 1.1): the subset that espeak-ng speaks."""

import re
from xml.etree import ElementTree

from fapengine.errors import UnsupportedError, UsageError

ELEMENTS = frozenset(
    ("speak", "p", "s", "voice", "prosody", "emphasis", "break", "say-as", "sub", "phoneme", "mark", "metadata", "desc")
)
"""Allowed elements. Not ``audio``: it would open files named by the text."""
_LOOKS = re.compile(r"</?(speak|voice|prosody|emphasis|break|say-as|sub|phoneme|audio)(\s[^<>]*)?/?>")


def find_tag(text: str) -> str | None:
    """Return the first tag of SSML in a text, or None.

    Examples
    --------
    >>> find_tag("a < b"), find_tag('Wait <break time="1s"/> here')
    (None, '<break time="1s"/>')
    """
    found = _LOOKS.search(text)
    return found[0] if found else None


def check_ssml(text: str) -> str:
    """Check a text in SSML and return its words without the tags.

    Parameters
    ----------
    text : str
        With or without its root element ``speak``.
    """
    if "<!" in text or "<?xml-" in text:
        raise UsageError("text: got a declaration, expected SSML without any")
    body = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)
    head = '<all xmlns:tts="tts" xmlns:xlink="xlink">'
    try:
        root = ElementTree.fromstring(f"{head}{body}</all>")
    except ElementTree.ParseError as error:
        line, column = error.position
        place = f"line {line}, column {column - len(head) if line == 1 else column}"
        message = ElementTree.ParseError.__str__(error).partition(":")[0]
        raise UsageError(f"text: got SSML with an error at {place} ({message}), expected well-formed XML") from error
    for element in list(root.iter())[1:]:
        name = element.tag.rpartition("}")[2]
        if name not in ELEMENTS:
            raise UnsupportedError(
                f"text: got the SSML element {name!r}, expected one of {', '.join(sorted(ELEMENTS))}"
            )
    return " ".join("".join(root.itertext()).split())
