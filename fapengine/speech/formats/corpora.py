"""Timings of aligners and corpora: one label a line, the aligners' JSON, and Rhubarb's TSV.

============ ============================== ==========================================================
format       line                           source
============ ============================== ==========================================================
HTK          ``start end label [score       HTK Book 3.4, section 6.2.1; 100 ns; seconds if with a point
             [word]]``
Audacity     the same, with TABs            Audacity manual, "Importing and Exporting Labels"; seconds
Festival     ``end colour label``           ESPS xlabel, after a line ``#``; seconds
MARY         the same, colour 125           MaryTTS 5.2, REALISED_DURATIONS; SAMPA
HTK MLF      ``"name"``, such lines, ``.``  HTK Book 3.4, section 6.3; FAVE, P2FA, Prosodylab
Allosaurus   ``start duration phone``       xinjli/allosaurus 1.0, README, Timestamp; s; IPA
GRID         ``start end word``             GRID corpus, ``.align``; samples at 25 kHz
flite        ``phone:end`` in one line      flite ``-psdur``; seconds
MFA CSV      Begin,End,Label,Type,Speaker   Montreal Forced Aligner 3; seconds
Rhubarb TSV  ``start<TAB>shape``            Rhubarb Lip Sync 1.14; seconds, the last line is the end
CTM          ``recording channel start``    NIST; Kaldi, NeMo; seconds; words or phones
             ``duration label [confid...]``
TIMIT        ``start end label``            NIST, 1990, ``.PHN`` and ``.WRD``; samples at 16 kHz
============ ============================== ==========================================================

JSON: MFA 3 writes tiers of ``[begin, end, label]`` in seconds, as praatio does. Gentle (lowerquality/gentle) writes
``words`` with ``start``, ``end`` and ``phones`` of Kaldi's ARPAbet with durations; a word whose ``case`` is not
``success`` has no times. PocketSphinx 5 writes lines of begin ``b``, duration ``d``, text ``t`` and parts ``w``: words,
which contain phones on request. aeneas writes ``fragments`` with ``begin``, ``end`` (texts) and ``lines``.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from fapengine.errors import DataError, UnsupportedError
from fapengine.speech.alphabets.guess import guess
from fapengine.speech.formats.documents import NUMBER, Node, decode_text, number_of, only_name, parse_document, walk
from fapengine.speech.formats.entries import Entry, in_sequence, track_of, until_next, with_words, without_overlaps
from fapengine.speech.formats.table import parse_columns
from fapengine.speech.formats.textgrid import PHONE_TIERS, WORD_TIERS, Tier, choose_tier
from fapengine.speech.formats.word_lists import labelled_track, words_track
from fapengine.speech.phone_track import PhoneTrack

HTK_HZ, GRID_HZ, TIMIT_HZ = 1e7, 25_000, 16_000
ALTERNATIVES = ("<ALT_BEGIN>", "<ALT>", "<ALT_END>")
"""Marks of a CTM around what a recognizer may have heard instead."""
MAX_SPIKE_S = 0.25
"""Longest time that a phone is shown of which only the onset is known, s."""
MAX_SAMPLES = 1_000_000
"""Largest whole number that is too small for HTK's units: 0.1 s."""
_STATE = re.compile(r"(.+)\[(\d{1,2})\]")
_FULL_CONTEXT = re.compile(r"^[^-]*\^?[^-]*-([^+]+)\+")
_OPEN_JTALK = re.compile(r"/A:(xx|-?\d+)(\+(xx|\d+)){2}/B:")
"""Accents in a full-context label, which no other language's have in this form."""


def rows_of(data: bytes, what: str, fields: int) -> list[tuple[str, list[str]]]:
    """Split into the lines with content and their places; each line has at least ``fields`` fields.

    Between TABs a field may have blanks, and the last one may be empty, as in Audacity's labels.
    """
    rows: list[tuple[str, list[str]]] = []
    for number, line in enumerate(decode_text(data, what).splitlines(), start=1):
        row, where = [field.strip() for field in line.split("\t")], f"line {number}"
        if len(row) < fields or not all(row[: fields - 1]):
            row = line.split(None, fields)
        if row and len(row) < fields:
            raise DataError(f"{what}: got {' '.join(row)[:40]!r}, expected {fields} fields", where=where)
        rows += [(where, row)] if row else []
    return rows


def _three_columns(rows: Sequence[tuple[str, list[str]]], rate_hz: float) -> list[Entry]:
    """Rows of start, end and label; times in units of ``1 / rate_hz``."""
    return [
        Entry(number_of(start, "time", where) / rate_hz, number_of(end, "time", where) / rate_hz, label, where)
        for where, (start, end, label, *_) in rows
    ]


def joined_states(entries: Sequence[Entry]) -> list[Entry]:
    """Join the states of a model (``a[2]``, ``a[3]``, ...) to one phone: same label, rising number, no gap.

    Examples
    --------
    >>> states = [Entry(0, 1, "a[2]", ""), Entry(1, 2, "a[3]", ""), Entry(2, 3, "a[2]", ""), Entry(3, 4, "b", "")]
    >>> [(entry.label, entry.start_s, entry.end_s) for entry in joined_states(states)]
    [('a', 0, 2), ('a', 2, 3), ('b', 3, 4)]
    """
    joined: list[Entry] = []
    before = 0
    for entry in entries:
        match = _STATE.fullmatch(entry.label)
        label, state = (match[1], int(match[2])) if match else (entry.label, 0)
        if 0 < before < state and (joined[-1].label, joined[-1].end_s) == (label, entry.start_s):
            joined[-1] = replace(joined[-1], end_s=entry.end_s)
        else:
            joined.append(replace(entry, label=label))
        before = state
    return joined


def _from_ends(ends: Sequence[tuple[float, str, str]]) -> list[Entry]:
    """Entries from (end in s, label, where); each begins where the one before ends."""
    starts_s = [0.0, *(end_s for end_s, _, _ in ends)]
    return [Entry(start_s, *end) for start_s, end in zip(starts_s, ends, strict=False)]


def parse_htk(data: bytes, *, alphabet: str | None = None, columns: str | None = None) -> PhoneTrack:
    """Read an HTK label file; the phone of a full-context label ``a^b-c+d=e`` is c.

    Parameters
    ----------
    data : bytes
        The file. Point labels, which begin where they end, last until the next.
    alphabet : str, optional
        Of the labels; by default guessed.
    columns : str, optional
        ``hz=`` and the rate of the samples that whole numbers count; by default they are units of 100 ns.
    """
    rate_hz = parse_columns(columns).rate_hz
    text = re.sub(r"(?m)^\\\t.*$", "", decode_text(data, ".lab"))
    if text.strip() and not re.search(r"\d", text):
        told = "is it a transcript? `fapengine animate` takes one with its sound"
        raise DataError(f".lab: got text without times; {told}", where="line 1")
    rows = rows_of(text.encode(), ".lab", 3)
    whole = not any(re.search("[.,]", row[0] + row[1]) for _, row in rows)
    longest = max((number_of(row[1], "time", where) for where, row in rows), default=0.0)
    if whole and rate_hz is None and len(rows) > 1 and 1000 < longest < MAX_SAMPLES:
        raise DataError(
            f".lab: got whole numbers up to {longest:g}, {1000 * longest / HTK_HZ:.0f} ms in HTK's units of 100 ns;"
            " are they samples? say their rate with columns='hz=16000'"
        )
    entries = _three_columns(rows, (rate_hz or HTK_HZ) if whole else 1.0)
    if guess(entry.label for entry in entries).words:  # after a word there may be more of a phrase, or a score
        entries = [
            replace(entry, label=" ".join(row[2:])) if row[3:] and not re.match(NUMBER, row[3]) else entry
            for entry, (_, row) in zip(entries, rows, strict=True)
        ]
    else:
        entries = with_words(entries, _begun_words(rows, entries))
    if alphabet is None and any(_OPEN_JTALK.search(entry.label) for entry in entries):
        alphabet = "openjtalk"
    entries = [
        replace(entry, label=context[1] if (context := _FULL_CONTEXT.match(entry.label)) else entry.label)
        for entry in joined_states(entries)
    ]
    if len(entries) > 1 and all(entry.start_s == entry.end_s for entry in entries):
        entries = until_next([(entry.start_s, entry.label, entry.where) for entry in entries])
    if all(re.fullmatch(r"f\d{6}", entry.label) for entry in entries):
        raise DataError(".lab: got the numbers of fragments (aeneas), expected labels; write JSON from aeneas instead")
    return labelled_track(entries, ".lab", alphabet)


def _begun_words(rows: Sequence[tuple[str, list[str]]], entries: Sequence[Entry]) -> list[Entry]:
    """Words that HVite writes after the score of their first phone; each lasts until the next."""
    onsets = []
    for entry, (_, row) in zip(entries, rows, strict=True):
        score, *names = " ".join(row[3:]).split() or [""]
        names = [name for name in names if not re.fullmatch(NUMBER, name)]  # a score of its own may follow
        if names and re.fullmatch(NUMBER, score):
            onsets.append((entry.start_s, names[-1], entry.where))
    return until_next(onsets, entries[-1].end_s if entries else None)


def parse_mlf(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read one recording of a master label file of HTK; ``tier`` names it, if there are several."""
    recordings: dict[str, dict[int, str]] = {}
    name = ""
    lines = decode_text(data, "MLF").splitlines()
    for number, line in enumerate(lines):
        if line.lstrip().startswith('"'):
            name = re.sub(r"\.\w+$", "", re.split(r"[/\\]", line.strip().strip('"'))[-1])
        elif name and line.strip() != ".":
            recordings.setdefault(name, {})[number] = line
    if not recordings:
        raise DataError('MLF: contains no recording; "*/name.lab" goes above its labels')
    chosen = recordings[only_name(set(recordings), tier, "MLF", "recordings")]
    return parse_htk("\n".join(chosen.get(at, "") for at in range(len(lines))).encode(), alphabet=alphabet)


def parse_allosaurus(data: bytes) -> PhoneTrack:
    """Read the phones. Their lengths are that of a window: each lasts until the next, at most :data:`MAX_SPIKE_S`."""
    rows = rows_of(data, "Allosaurus", 3)
    entries = until_next([(number_of(row[0], "time", where), row[2], where) for where, row in rows])
    entries = [replace(entry, end_s=min(entry.end_s, entry.start_s + MAX_SPIKE_S)) for entry in entries]
    return track_of(entries, "Allosaurus", alphabet="ipa")


def parse_xlabel(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read a Festival or MARY label file: after ``#``, each line gives an *end*."""
    text = decode_text(data, ".lab")
    header, pieces, _ = text.partition("#")
    if not pieces:
        raise DataError("xlabel: the line with # alone, above the labels, is missing")
    blank = "\n" * header.count("\n") + text[len(header) + 1 :]
    ends = [
        (number_of(row[0], "time", where), row[2].split(";")[0].strip() or "_", where)
        for where, row in rows_of(blank.encode("utf-8", "replace"), ".lab", 3)
    ]
    return labelled_track(_from_ends(ends), ".lab", alphabet)


def parse_align(data: bytes) -> PhoneTrack:
    """Read a GRID alignment: words, in samples at 25 kHz."""
    return track_of(_three_columns(rows_of(data, ".align", 3), GRID_HZ), ".align", level="word", spelled=True)


def parse_flite(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read what ``flite -psdur`` prints: ``phone:end`` with blanks between."""
    ends = []
    for count, piece in enumerate(decode_text(data, "flite").split(), start=1):
        label, _, end = piece.rpartition(":")
        ends.append((number_of(end, "time", f"piece {count}"), label or "_", f"piece {count}"))
    return labelled_track(_from_ends(ends), "flite", alphabet)


def parse_mfa_csv(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the CSV of the Montreal Forced Aligner; ``tier`` names the speaker, if there are several."""
    lines = decode_text(data, "MFA CSV").splitlines()
    try:
        rows = list(csv.DictReader(lines))
    except csv.Error as error:
        raise DataError(f"MFA CSV: {error}") from error
    wanted = ("Begin", "End", "Label", "Type", "Speaker")
    if not rows or any(name not in rows[0] for name in wanted):
        raise DataError(
            f"MFA CSV: got {''.join(lines[:1])[:40]!r}, expected the header {','.join(wanted)}", where="line 1"
        )
    texts = [(f"line {n}", {name: row[name] or "" for name in wanted}) for n, row in enumerate(rows, start=2)]
    speaker = only_name({row["Speaker"] for _, row in texts}, tier, "MFA CSV", "speakers")
    timed: dict[str, list[Entry]] = {"phones": [], "words": []}
    for where, row in texts:
        if row["Speaker"] == speaker and row["Type"] in timed:
            start_s, end_s = (number_of(row[name], "time", where) for name in ("Begin", "End"))
            timed[row["Type"]].append(Entry(start_s, end_s, row["Label"], where))
    return track_of(with_words(timed["phones"], timed["words"]), "MFA CSV", alphabet=alphabet)


def parse_rhubarb_tsv(data: bytes) -> PhoneTrack:
    """Read Rhubarb's TSV: starts and mouth shapes; the last line gives the end of the recording."""
    onsets = [(number_of(row[0], "time", where), row[1], where) for where, row in rows_of(data, "Rhubarb TSV", 2)]
    if len(onsets) < 2:
        raise DataError("Rhubarb TSV: got fewer than two lines, expected a shape and the end")
    entries = until_next(onsets[:-1], onsets[-1][0])
    return track_of(entries, "Rhubarb TSV", alphabet="rhubarb-shapes", level="viseme")


def parse_ctm(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read a CTM; ``tier`` names the recording, if there are several, and its channel, if it has several: ``talk A``.

    Of alternatives the first is read, with a remark. Layout: sctk, doc/infmts.htm (NIST).
    """
    text = re.sub("^;;.*$", "", decode_text(data, "CTM"), flags=re.MULTILINE)
    rows = rows_of(text.encode(), "CTM", 5)
    channels = Counter(name for name, _ in {(row[0], row[1]) for _, row in rows})
    recordings = [row[0] if channels[row[0]] == 1 else f"{row[0]} {row[1]}" for _, row in rows]
    recording = only_name(set(recordings), tier, "CTM", "recordings")
    entries: list[Entry] = []
    groups = alternative = 0
    for (where, row), name in zip(rows, recordings, strict=True):
        mark = row[4].upper() if name == recording else ""
        if mark in ALTERNATIVES:
            groups += mark == "<ALT_BEGIN>"
            alternative = {"<ALT_BEGIN>": 1, "<ALT>": alternative + 1, "<ALT_END>": 0}[mark]
        elif mark and alternative <= 1:
            start_s, length_s = (number_of(text, "time", where) for text in row[2:4])
            entries.append(Entry(start_s, start_s + length_s, row[4], where))
    if entries and all(re.fullmatch(r"\d+", entry.label) for entry in entries):
        raise UnsupportedError("CTM: got numbers of phones, expected labels; map them with phones.txt (int2sym.pl)")
    track = labelled_track(entries, "CTM", alphabet)
    if not groups:
        return track
    remark = f"CTM: {groups} choices of alternatives, of which the first is read"
    return replace(track, reading=replace(track.reading, remarks=(remark, *track.reading.remarks)))


def parse_timit(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones or words of a TIMIT sentence."""
    entries = _three_columns(rows_of(data, "TIMIT", 3), TIMIT_HZ)
    return labelled_track(entries, "TIMIT", alphabet, default="arpabet")


def parse_mfa_json(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the aligner's JSON; the tier is found as in a TextGrid."""
    tiers = parse_document(data, "MFA JSON")["tiers"]
    if not isinstance(tiers.value, dict):
        raise DataError(f"tiers: got {ascii(tiers.value)[:40]}, expected an object of tiers", where="tiers")
    names = tuple(Tier(str(name), ()) for name in tiers.value)
    phones = _tier(tiers, choose_tier(names, tier, PHONE_TIERS, "phones").name)
    try:
        words = _tier(tiers, choose_tier(names, None, WORD_TIERS, "words").name)
    except DataError:
        words = []
    return track_of(with_words(phones, words), "MFA JSON", alphabet=alphabet)


def _tier(tiers: Node, name: str) -> list[Entry]:
    entries: list[Entry] = []
    for row in tiers[name]["entries"].items():
        cells = list(row.items())
        if len(cells) != 3:
            raise DataError(f"entry: got {len(cells)} values, expected begin, end, label", where=row.where)
        entries.append(Entry(cells[0].number(), cells[1].number(), cells[2].text(), row.where))
    return entries


def is_gentle(first: Node) -> bool:
    """Return whether a document is Gentle's."""
    return any(word.has("case") or word.has("alignedWord") for word in list(walk(first, "words[]"))[:3])


def parse_gentle(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones, or the words if no word has phones."""
    phones: list[Entry] = []
    words: list[Entry | tuple[str, str]] = []
    for word in parse_document(data, "Gentle")["words"].items():
        text = word.first("word", "alignedWord").text()
        if not word.has("start", "end"):
            words.append((text, word.where))
            continue
        words.append(Entry(word["start"].number(), word["end"].number(), text, word.where))
        lengths = [
            (phone["phone"].text(), phone["duration"].number(), phone.where, text) for phone in walk(word, "phones[]")
        ]
        phones += in_sequence(lengths, word["start"].number())
    if phones and len({phone.word for phone in phones}) >= sum(isinstance(word, Entry) for word in words) / 2:
        lost = [word[0] for word in words if not isinstance(word, Entry)]
        told = [
            f"Gentle: {len(lost)} of {len(words)} words were not found in the sound: {word[:40]!r}" for word in lost
        ]
        return track_of(without_overlaps(phones), "Gentle", alphabet=alphabet or "arpabet", remarks=tuple(told[:1]))
    return words_track(words, "Gentle", "was the text the one that is spoken?")


def parse_pocketsphinx(data: bytes, *, alphabet: str | None = None) -> PhoneTrack:
    """Read the phones, or the words if there are no phones."""
    phones: list[Entry] = []
    words: list[Entry] = []
    for word in (word for line in parse_document(data, "PocketSphinx").entries() for word in walk(line, "w[]")):
        text = re.sub(r"\(\d+\)$", "", word["t"].text())  # go(2) is another pronunciation of go
        words.append(_begin_and_length(word, text))
        spoken = "" if text.startswith("<") else text
        phones += [_begin_and_length(phone, phone["t"].text(), spoken) for phone in walk(word, "w[]")]
    if phones:
        return track_of(without_overlaps(phones), "PocketSphinx", alphabet=alphabet or "arpabet")
    spoken_words = [word for word in words if not word.label.startswith(("<", "["))]
    return words_track(spoken_words, "PocketSphinx", "align a text")


def _begin_and_length(node: Node, label: str, word: str = "") -> Entry:
    start_s = node["b"].number()
    return Entry(start_s, start_s + node["d"].number(), label, node.where, word)


def parse_aeneas(data: bytes) -> PhoneTrack:
    """Read the innermost fragments, which must be words."""
    words: list[Entry] = []

    def add(fragments: Node) -> None:
        for fragment in fragments.items():
            if fragment.has("children") and fragment["children"].value:
                add(fragment["children"])
            else:
                text = " ".join(fragment["lines"].texts())
                words.append(Entry(fragment["begin"].number(), fragment["end"].number(), text, fragment.where))

    add(parse_document(data, "aeneas")["fragments"])
    return words_track(words, "aeneas", "align word by word: is_text_type=mplain, and its third level")
