"""Praat TextGrid, long, short, chronological, binary, and collections of them: bytes to :class:`PhoneTrack`.

Praat reads a text file as free-standing numbers, quoted texts and ``<flags>`` and skips everything else, so that
``xmin = 0`` and ``0`` mean the same and one reader serves both forms ("TextGrid file formats", Praat manual).

The binary form has the same values: big-endian numbers, and texts after their length. Praat does not document it; this
is what Praat writes (compared with the same grid saved as text).

ELAN, ``.eaf`` (Max Planck Institute for Psycholinguistics, EAF schema 3.0): tiers of labels with times. Annotations
that refer to another one share its time evenly, and so do slots without a time between two annotations, as in
subdivided tiers: as ELAN shows them. The language of a tier is that of ``LANG_REF``, else
``DEFAULT_LOCALE``, else the only ``LANGUAGE`` of the document.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element

from fapengine.errors import DataError, TruncatedError, UnsupportedError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.documents import decode_text, number_of, parse_xml
from fapengine.speech.formats.entries import Entry, shared_out, track_of, with_words
from fapengine.speech.phone_track import PhoneTrack


@dataclass(frozen=True, slots=True)
class Tier:
    """One interval tier."""

    name: str
    intervals: tuple[tuple[float, float, str], ...]
    """(start_s, end_s, label), as written."""
    language: str = ""
    remarks: tuple[str, ...] = ()


START = b"ooBinaryFile"
_PAIRS = """
    at ɐ  as ɑ  ay ɒ  ab ɒ  ae æ  o/ ø  oe œ  Oe ɶ  e- ɘ  sw ə  sr ɚ  ef ɛ  er ɜ  kb ɞ  rh ɤ  i- ɨ
    ic ɪ  mt ɯ  o- ɵ  ct ɔ  u- ʉ  hs ʊ  vt ʌ  yc ʏ  dh ð  h- ħ  b^ ɓ  bc ʙ  cc ɕ  c, ç  d. ɖ  d^ ɗ
    j- ɟ  g^ ɠ  gs ɡ  gc ɢ  gf ɣ  G^ ʛ  ht ɥ  h^ ɦ  hj ɧ  hc ʜ  jc ʝ  l~ ɫ  l- ɬ  l. ɭ  lz ɮ  lc ʟ
    ml ɰ  mj ɱ  ng ŋ  nj ɲ  n. ɳ  nc ɴ  ff ɸ  bf β  tf θ  te θ  cf χ  rt ɹ  rl ɺ  r. ɻ  f. ɽ  fh ɾ
    rc ʀ  ri ʁ  s. ʂ  sh ʃ  j^ ʄ  t. ʈ  vs ʋ  wt ʍ  yt ʎ  z. ʐ  zc ʑ  zh ʒ  ?g ʔ  9e ʕ  ?- ʡ  9- ʢ
    O. ʘ  |1 ǀ  |2 ǁ  |- ǂ  :f ː  .f ˑ  '1 ˈ  '2 ˌ  ~^ \u0303  |v \u0329  0v \u0325  hr ˞
"""
TRIGRAPHS = dict(zip(_PAIRS.split()[::2], _PAIRS.split()[1::2], strict=True))
"""The two characters after a backslash, and what Praat shows for the three: IPA in ASCII, as ``\\sh`` for ʃ.

Source: Praat manual, "Phonetic symbols: consonants", "vowels" and "diacritics", and the table in Praat's longchar.cpp.
"""


class _Bytes:
    """The values of a binary file, in order. Stateful."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at = data, at

    def where(self) -> str:
        return f"byte {self._at}"

    def take(self, count: int) -> bytes:
        if count < 0 or self._at + count > len(self._data):
            raise TruncatedError("TextGrid: the file ends inside a value", where=self.where())
        self._at += count
        return self._data[self._at - count : self._at]

    def number(self) -> float:
        return float(struct.unpack(">d", self.take(8))[0])

    def count(self, what: str) -> int:
        value = int.from_bytes(self.take(4), signed=True)
        if not 0 <= value <= len(self._data):
            raise DataError(f"{what}: got {value}, expected a count the file can hold", where=f"byte {self._at - 4}")
        return value

    def has_tiers(self) -> bool:
        return self.take(1) != b"\0"

    def kind(self) -> str:
        """Name of a class, with one byte of length."""
        return self.take(self.take(1)[0]).decode("latin-1")

    def text(self) -> str:
        """Text with two bytes of length; a length of -1 means that UTF-16 follows."""
        length = int.from_bytes(self.take(2), signed=True)
        if length >= 0:
            return self.take(length).decode("latin-1")
        return self.take(2 * int.from_bytes(self.take(2))).decode("utf-16-be", "replace")


PHONE_TIERS = ("phones", "phone", "phonemes", "phoneme", "phonetic", "segments", "segment", "mau", "segs")
WORD_TIERS = ("words", "word", "ort-mau", "ort")

_TOKEN = re.compile(r'"(?:[^"]|"")*"|<[a-z]+>|![^\n]*|"|[^\s"]+')


class _Tokens:
    """The values of a text file, in order, with their lines. Stateful."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._found: Iterator[re.Match[str]] = _TOKEN.finditer(text)
        self._at = self._end = 0

    def where(self) -> str:
        return f"line {self._text.count(chr(10), 0, self._at) + 1}"

    def _next(self, wanted: str) -> str:
        for match in self._found:
            token = match.group()
            self._at, self._end = match.span()
            if token == '"':
                raise DataError("text: the closing quote is missing", where=self.where())
            if wanted == "text" and token[0] == '"':
                return token[1:-1].replace('""', '"')
            if wanted == "number" and re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", token):
                return token
            if token[0] == "<" and wanted == "flag":
                return token
            if token[0] in '"<':
                raise DataError(f"TextGrid: got {token[:40]}, expected a {wanted}", where=self.where())
        raise TruncatedError(f"TextGrid: the file ends where a {wanted} is expected", where="the end")

    def text(self) -> str:
        return self._next("text")

    kind = text

    def number(self) -> float:
        value = float(self._next("number"))
        if value == value + 1:  # so large that a second is lost in it, or infinite
            raise DataError(f"number: got {value:g}, expected a time or a count", where=self.where())
        return value

    def has_tiers(self) -> bool:
        return self._next("flag") == "<exists>"

    def ended(self) -> bool:
        """Return whether only comments follow."""
        rest = re.compile(r"(?:\s|![^\n]*)*").match(self._text, self._end)
        return rest is not None and rest.end() == len(self._text)

    def count(self, what: str) -> int:
        value = self.number()
        if value != int(value) or not 0 <= value <= len(self._text):
            raise DataError(f"{what}: got {value:g}, expected a count the file can hold", where=self.where())
        return int(value)


def parse_tiers(data: bytes) -> tuple[Tier, ...]:
    """Read every interval tier; point tiers are skipped."""
    if data.startswith(START):
        source = _Bytes(data, len(START))
        kind = source.kind()
        if kind != "TextGrid":
            raise DataError(f"Praat: got a binary {kind[:40]!r}, expected a TextGrid", where=f"byte {len(START)}")
        return _grid(source)
    tokens = _Tokens(_praat_text(data))
    kind = tokens.text()
    if kind == "Praat chronological TextGrid text file":
        return _chronological(tokens)
    content = tokens.text() if kind in ("ooTextFile", "ooTextFile short") else ""
    if content == "Collection":
        return _collection(tokens)
    if content != "TextGrid":
        raise DataError('TextGrid: expected a file that begins with "ooTextFile" and "TextGrid"', where="line 1")
    return _grid(tokens)


def _praat_text(data: bytes) -> str:
    """Decode; Praat wrote Latin-1 before Unicode, and still reads it where a file is not UTF-8."""
    try:
        return decode_text(data, "TextGrid")
    except DataError:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff") or not re.fullmatch(rb"[\t\n\r\x20-\x7e\xa0-\xff]*", data):
            raise
        return data.decode("latin-1")


def _collection(tokens: _Tokens) -> tuple[Tier, ...]:
    """Read several objects in one file; the name of each grid goes before the names of its tiers."""
    tiers: list[Tier] = []
    count = tokens.count("number of objects")
    for _ in range(count):
        kind, name = tokens.kind(), tokens.text()
        if kind != "TextGrid":
            raise UnsupportedError(
                f"Praat: got a collection with a {kind[:40]}, expected TextGrids alone", where=tokens.where()
            )
        tiers += [replace(tier, name=f"{name} - {tier.name}" if count > 1 else tier.name) for tier in _grid(tokens)]
    return tuple(tiers)


def _grid(source: _Tokens | _Bytes) -> tuple[Tier, ...]:
    source.number(), source.number()  # the grid's times
    tiers: list[Tier] = []
    for _ in range(source.count("number of tiers") if source.has_tiers() else 0):
        kind, name = source.kind(), source.text()
        _check_class(kind, source)
        source.number(), source.number()  # the tier's times
        count = source.count(f"size of tier {name!r}")
        if kind == "IntervalTier":
            tiers.append(Tier(name, tuple((source.number(), source.number(), source.text()) for _ in range(count))))
        else:
            for _ in range(count):
                source.number(), source.text()
    return tuple(tiers)


def _check_class(kind: str, source: _Tokens | _Bytes) -> None:
    if kind not in ("IntervalTier", "TextTier"):
        raise DataError(f"tier class: got {kind[:40]!r}, expected IntervalTier or TextTier", where=source.where())


def _chronological(tokens: _Tokens) -> tuple[Tier, ...]:
    """Read the form in which all tiers share one list: tier number, time or times, text."""
    tokens.number(), tokens.number()
    classes: list[str] = []
    names: list[str] = []
    for _ in range(tokens.count("number of tiers")):
        classes.append(tokens.kind())
        names.append(tokens.text())
        tokens.number(), tokens.number()
        _check_class(classes[-1], tokens)
    rows_by_tier: list[list[tuple[float, float, str]]] = [[] for _ in classes]
    while not tokens.ended():
        tier = tokens.count("tier number")
        if not 1 <= tier <= len(classes):
            raise DataError(f"tier number: must be 1 to {len(classes)}, got {tier}", where=tokens.where())
        if classes[tier - 1] == "IntervalTier":
            rows_by_tier[tier - 1].append((tokens.number(), tokens.number(), tokens.text()))
        else:
            tokens.number(), tokens.text()
    return tuple(
        Tier(name, tuple(rows))
        for name, kind, rows in zip(names, classes, rows_by_tier, strict=True)
        if kind == "IntervalTier"
    )


def choose_tier(tiers: tuple[Tier, ...], wanted: str | None, usual: tuple[str, ...], what: str) -> Tier:
    """Find a tier by its name, else by the usual names, else the only one."""
    names = [tier.name for tier in tiers]
    if not tiers:
        raise DataError("tier: got none with intervals; tiers of points are not read")
    if wanted is not None:
        fitting = [tier for tier in tiers if tier.name.lower() == wanted.lower()]
    else:
        fitting = [tier for tier in tiers if _last_part(tier.name) in usual]
        fitting = fitting or (list(tiers) if len(tiers) == 1 else [])
    if len(fitting) != 1:
        sought = f"{len(fitting)} tiers " + (f"named {wanted!r}" if wanted is not None else f"for {what}")
        raise DataError(
            f"tier: got {sought}, expected one; it has {[name[:40] for name in names[:12]]}; name one with tier=NAME"
        )
    return fitting[0]


def parse_textgrid(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones of a TextGrid.

    Parameters
    ----------
    data : bytes
        The file.
    tier : str, optional
        Name of the phone tier; by default the one named phones, phonemes, segments, MAU...
    alphabet : str, optional
        One of :data:`fapengine.speech.alphabets.convert.ALPHABETS`; by default guessed from all labels.
    """
    return track_of_tiers(parse_tiers(data), "TextGrid", tier, alphabet)


def track_of_tiers(tiers: tuple[Tier, ...], what: str, tier: str | None, alphabet: str | None) -> PhoneTrack:
    """Make a track of the tier of phones, with the words of the tier of words; of that alone if there is no other."""
    chosen = _chosen(tiers, tier)
    entries = _entries(chosen)
    labels = [entry.label for entry in entries]
    kind = kind_of(chosen.name)
    if kind == "words" or (kind == "" and alphabet is None and guess(labels).words):
        _refuse_blanks(entries, "one word; is this a tier of words?")
        track = track_of(entries, what, level="word", spelled=True, remarks=chosen.remarks)
        return replace(track, reading=replace(track.reading, language=chosen.language))
    _refuse_blanks(entries, "one phone; is this a tier of phones?")
    named = tuple(tier for tier in _same_owner(tiers, chosen) if kind_of(tier.name) == "words")
    try:
        words = _entries(choose_tier(named, None, WORD_TIERS, "words"))
    except DataError:
        words = []
    return track_of(with_words(entries, words), what, alphabet=alphabet, remarks=chosen.remarks)


def _same_owner(tiers: tuple[Tier, ...], chosen: Tier) -> tuple[Tier, ...]:
    """Return the tiers of the same speaker or grid, where names begin with it: ``A - phones``, ``A - words``."""
    owner, dash, _ = chosen.name.rpartition(" - ")
    others = tuple(tier for tier in tiers if tier is not chosen)
    return tuple(tier for tier in others if tier.name.rpartition(" - ")[0] == owner) if dash else others


def _refuse_blanks(entries: list[Entry], expected: str) -> None:
    for entry in entries:
        if " " in entry.label:
            raise DataError(f"label: got {entry.label[:40]!r}, expected {expected}", where=entry.where)


def _chosen(tiers: tuple[Tier, ...], wanted: str | None) -> Tier:
    """Find the tier of phones; of a grid that has none, the tier of words."""
    spoken = [tier for tier in tiers if kind_of(tier.name) == "words"]
    if wanted is None and len(tiers) > 1 and len(spoken) == 1 and not any(kind_of(t.name) == "phones" for t in tiers):
        return spoken[0]
    return choose_tier(tiers, wanted, PHONE_TIERS, "phones")


def kind_of(name: str) -> str:
    """Content of a tier by its name: phones, words, or "" for other names.

    Examples
    --------
    >>> kind_of("Words"), kind_of("A - phones"), kind_of("notes")
    ('words', 'phones', '')
    """
    plain = _last_part(name)
    return "phones" if plain in PHONE_TIERS else "words" if plain in WORD_TIERS else ""


def _last_part(name: str) -> str:
    return re.split(r"\s*-\s+", name.lower())[-1].strip()


def _entries(tier: Tier) -> list[Entry]:
    return [
        Entry(start_s, end_s, from_trigraphs(label.strip()), f"tier {tier.name!r}, interval {number}")
        for number, (start_s, end_s, label) in enumerate(tier.intervals, start=1)
    ]


def from_trigraphs(label: str) -> str:
    r"""Replace the trigraphs in a label.

    Examples
    --------
    >>> from_trigraphs(r"\sh"), from_trigraphs(r"t\sh"), from_trigraphs(r"\ae\~^"), from_trigraphs("r\\")
    ('ʃ', 'tʃ', 'æ̃', 'r\\')
    """
    return re.sub(r"\\(..)", lambda match: TRIGRAPHS.get(match[1], match[0]), label)


def parse_elan(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones, else the words of a document; tiers are chosen as in a TextGrid."""
    root = parse_xml(data, "ELAN")
    slots_ms = {slot.get("TIME_SLOT_ID", ""): slot.get("TIME_VALUE") for slot in root.iter("TIME_SLOT")}
    known = [row.get("LANG_ID", "") for row in root.iter("LANGUAGE")]
    language, elements = known[0] if len(known) == 1 else "", list(root.iter("TIER"))
    spans_s: dict[str, tuple[float, float]] = {}
    timed = [each for each in (_tier(row, slots_ms, language, spans_s) for row in elements) if each.intervals]
    if not timed:
        raise DataError("ELAN: contains no annotation with times")
    referring = [each for each in _referring(elements, language, spans_s) if each.intervals]
    is_enough = len(timed) == 1 and not any(kind_of(each.name) for each in referring)
    if tier is None and (is_enough or any(kind_of(each.name) for each in timed)):
        referring = []
    return track_of_tiers((*timed, *referring), "ELAN", tier, alphabet)


def _language(element: Element, language: str) -> str:
    return element.get("LANG_REF") or element.get("DEFAULT_LOCALE") or language


def _referring(elements: Sequence[Element], language: str, spans_s: dict[str, tuple[float, float]]) -> list[Tier]:
    """Annotations that refer to others, of each tier, in the times of those, which ``spans_s`` has by their ids."""
    children: dict[str, dict[int, list[Element]]] = {}
    for tier, element in enumerate(elements):
        for row in element.iter("REF_ANNOTATION"):
            children.setdefault(row.get("ANNOTATION_REF", ""), {}).setdefault(tier, []).append(row)
    intervals: list[list[tuple[float, float, str]]] = [[] for _ in elements]
    waiting = list(spans_s.items())
    for parent, span_s in waiting:  # which grows, as others may refer to what is placed here
        for tier, rows in children.pop(parent, {}).items():
            labels = [(row.findtext("ANNOTATION_VALUE") or "").strip() for row in _in_order(rows)]
            placed = shared_out(*span_s, labels, "")
            intervals[tier] += [(entry.start_s, entry.end_s, entry.label) for entry in placed]
            waiting += [
                (row.get("ANNOTATION_ID", ""), (entry.start_s, entry.end_s))
                for row, entry in zip(_in_order(rows), placed, strict=True)
            ]
    remark = "annotations share the times of those that they refer to evenly"
    return [
        Tier(name, tuple(sorted(rows)), _language(element, language), (f"tier {name!r}: {remark}",))
        for element, rows in zip(elements, intervals, strict=True)
        for name in [element.get("TIER_ID", "")]
    ]


def _in_order(rows: list[Element]) -> list[Element]:
    """Sort annotations by what each says is the one before; as in the file where they do not say."""
    after = {row.get("PREVIOUS_ANNOTATION"): row for row in rows}
    first = after.pop(None, None)
    ordered = [] if first is None else [first]
    while ordered and (following := after.pop(ordered[-1].get("ANNOTATION_ID"), None)) is not None:
        ordered.append(following)
    return ordered if len(ordered) == len(rows) else rows


def _tier(
    element: Element, slots_ms: dict[str, str | None], language: str, spans_s: dict[str, tuple[float, float]]
) -> Tier:
    """Annotations with times; they are added to ``spans_s``, by their ids."""
    name = element.get("TIER_ID", "")
    intervals = []
    slots_s: dict[str, float] = {}
    rows = list(element.iter("ALIGNABLE_ANNOTATION"))
    chain: list[str] = []
    """Slots of annotations that follow each other: the first has a time, the others have none."""
    for number, row in enumerate(rows, start=1):
        start, end = (row.get(f"TIME_SLOT_REF{n}", "") for n in (1, 2))
        if not chain or chain[-1] != start:
            chain = [start]
        chain.append(end)
        for slot in (start, end):
            if (time := slots_ms.get(slot)) is not None:
                slots_s[slot] = number_of(time, "time", f"tier {name!r}, annotation {number}") / 1000
        if end in slots_s:
            if chain[0] in slots_s:
                first_s, last_s, steps = slots_s[chain[0]], slots_s[end], len(chain) - 1
                slots_s |= {slot: first_s + (last_s - first_s) * n / steps for n, slot in enumerate(chain[1:-1], 1)}
            chain = [end]
    untimed = 0
    spread = sum(slots_ms.get(slot) is None for slot in slots_s)
    for row in rows:
        start, end = (row.get(f"TIME_SLOT_REF{n}", "") for n in (1, 2))
        if start in slots_s and end in slots_s:
            intervals.append((slots_s[start], slots_s[end], (row.findtext("ANNOTATION_VALUE") or "").strip()))
            spans_s[row.get("ANNOTATION_ID", "")] = intervals[-1][:2]
        else:
            untimed += 1
    intervals.sort(key=lambda row: row[:2])
    remarks = [f"tier {name!r}: {untimed} annotations without times are left out"] if untimed else []
    remarks += [f"tier {name!r}: {spread} boundaries without times are spread evenly"] if spread else []
    return Tier(name, tuple(intervals), _language(element, language), tuple(remarks))
