"""Normal form of a text for voices, with the original place of each character.

Theory of operation
-------------------
1. Characters that cannot be spoken are dropped: control characters, whole colour codes of terminals, and format
   characters (soft hyphens, marks of direction, zero-width spaces). Zero-width joiners stay where a script or an emoji
   needs them. Other separators of lines become line feeds. Half a surrogate pair becomes U+FFFD.
2. Each base character with its marks is composed (NFC). Compatibility forms that a voice spells (full-width and
   mathematical letters, circled digits, Arabic presentation forms) become plain ones (NFKC); no others do, for a voice
   reads ``½`` and ``²`` better than ``1⁄2`` and ``2``.

The normal form of a normal form is itself, and every character of the result has its stretch of the original.

SSML
----
The subset of the W3C's Speech Synthesis Markup Language 1.1 that espeak-ng speaks is checked here, too.
"""

import re
import unicodedata
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from fapengine.errors import UnsupportedError, UsageError

REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
_JOINER, _NON_JOINER, _ZERO_WIDTH_SPACE = "\u200d", "\u200c", "\u200b"

_TERMINAL_CODE = re.compile(r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)")
"""ECMA-48: control sequences, such as colours; titles of windows."""
_LINE_ENDS = "\x0b\x0c\x85\u2028\u2029"
_VISIBLE_FORMAT = re.compile("[\u0600-\u0605\u06dd\u070f\u0890\u0891\u08e2\U000110bd\U000110cd]")
"""Signs before a number in Arabic, Syriac and Kaithi: visible format characters."""
_JOINING = re.compile("[\u0600-\u109f\u1780-\u18af\ua800-\uabff\ufb50-\ufdff\ufe70-\ufefc\U00010a00-\U00011fff]")
"""Scripts in which a joiner changes letters: Arabic to Myanmar, Khmer, Mongolian, Indic ones of later blocks."""
_UNSPACED = re.compile("[\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff]")
"""Thai, Lao, Myanmar, Khmer: a zero-width space is their space."""
_PLAIN = re.compile(
    "[\u2102-\u2138\u2145-\u2149\u214e\u2160-\u217f\u2460-\u24ea\u3000\ufb50-\ufdff\ufe70-\ufefc"
    "\uff04\uff05\uff0b\uff10-\uff19\uff20-\uff3a\uff41-\uff5a\uff61-\uffdc\uffe0-\uffe6\U0001d400-\U0001d7ff]"
)
"""Forms that are made plain. Not full-width punctuation: voices pause at it without a space after it, and the plain
``& < >`` would be markup."""
_NOT_PLAIN = re.compile(
    "[\u2104-\u2108\u210f\u2114\u2116-\u2118\u211e-\u2123\u2125\u2127\u212e"
    "\uff01-\uff03\uff06-\uff0a\uff0c-\uff0f\uff1a-\uff1f\uff3b-\uff40\uff5b-\uff60]"
)
"""Signs between the letters of these blocks, such as ``№``; full-width punctuation, also before a voicing mark."""
_FOLLOWS = re.compile("[\u1161-\u1175\u11a8-\u11c2\uff9e\uff9f]")
"""Letters that join the character before: Korean vowels and finals, half-width kana's voicing."""


@dataclass(frozen=True, slots=True)
class SpeakableText:
    """A text in normal form."""

    text: str
    starts: tuple[int, ...]
    """Index in the original at which the stretch of each character begins; never falls."""
    stops: tuple[int, ...]
    """Index after that stretch; never falls, and is greater than the start."""
    replaced: int = 0
    """Halves of surrogate pairs that are U+FFFD now: bytes that were not text."""


def speakable(text: str) -> SpeakableText:
    """Bring a text into the normal form for voices.

    Parameters
    ----------
    text : str
        Anything, half surrogate pairs too.

    Examples
    --------
    >>> speakable("cafe\u0301 wor\u00adld \uff11").text
    'café world 1'
    >>> speakable("cafe\u0301!").stops
    (1, 2, 3, 5, 6)
    """
    kept = _kept(text)
    joins = [unicodedata.category(char)[0] == "M" or _FOLLOWS.match(char) is not None for char, _, _ in kept]
    cuts = [index for index, joined in enumerate(joins) if not (index and joined)]
    characters, starts, stops = [], [], []
    for first, last in pairwise([*cuts, len(kept)]):
        stretch = "".join(char for char, _, _ in kept[first:last])
        plain = _PLAIN.search(stretch) is not None and not _NOT_PLAIN.search(stretch)
        form: Literal["NFKC", "NFC"] = "NFKC" if plain else "NFC"
        formed = unicodedata.normalize(form, stretch)
        one_for_one = formed == "".join(unicodedata.normalize(form, char)[:1] for char in stretch)
        for offset, char in enumerate(formed):
            whole = kept[first + offset : first + offset + 1] if one_for_one else kept[first:last]
            characters.append(char)
            starts.append(whole[0][1])
            stops.append(whole[-1][2])
    replaced = sum(0xD800 <= ord(char) <= 0xDFFF for char in text) - 2 * len(
        re.findall("[\ud800-\udbff][\udc00-\udfff]", text)
    )
    return SpeakableText("".join(characters), tuple(starts), tuple(stops), replaced)


def decoded(data: bytes) -> str:
    """Decode any bytes: UTF-8, or UTF-16 with its byte order mark.

    Bytes outside UTF-8 become half surrogates, which :func:`speakable` counts.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace")
    return data.decode("utf-8", "surrogateescape")


def same_word(word: str) -> str:
    """Return the form in which spellings of a word are equal: normal form, lower case, straight apostrophes."""
    return unicodedata.normalize("NFC", speakable(word).text.casefold().replace("\u2019", "'").strip())


def _kept(text: str) -> list[tuple[str, int, int]]:
    """Characters that stay, each with the stretch of the original that it comes from."""
    gone = {index for match in _TERMINAL_CODE.finditer(text) for index in range(*match.span())}
    kept: list[tuple[str, int, int]] = []
    for index, char in enumerate(text):
        if index in gone:
            continue
        before = kept[-1][0] if kept else ""
        if "\udc00" <= char <= "\udfff" and index and "\ud800" <= text[index - 1] <= "\udbff":
            code = 0x10000 + ((ord(text[index - 1]) - 0xD800) << 10) + ord(char) - 0xDC00
            kept[-1] = (chr(code), index - 1, index + 1)
        elif "\ud800" <= char <= "\udfff":
            kept.append((REPLACEMENT, index, index + 1))
        elif form := _form(char, before):
            kept.append((form, index, index + 1))
    return kept


def _form(char: str, before: str) -> str:
    """Form of one character after another; empty if it is dropped."""
    category = unicodedata.category(char)
    if char in _LINE_ENDS:
        return "\n"
    if category == "Cc":
        return char if char in "\t\n\r" else ""
    if category != "Cf" or _VISIBLE_FORMAT.match(char):
        return char
    if char == _ZERO_WIDTH_SPACE and _UNSPACED.match(before):
        return " "
    if char in (_JOINER, _NON_JOINER) and before and _JOINING.match(before):
        return char
    in_emoji = before == "\ufe0f" or (before and unicodedata.category(before) in ("So", "Sk"))
    return char if char == _JOINER and in_emoji else ""


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
    from xml.etree import ElementTree  # for SSML alone

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
