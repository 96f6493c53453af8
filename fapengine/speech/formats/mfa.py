"""Montreal Forced Aligner 3, JSON: tiers of ``[begin, end, label]`` in seconds, as praatio writes them."""

from fapengine.errors import DataError
from fapengine.speech.formats.documents import Node, parse_document
from fapengine.speech.formats.entries import Entry, track_of, with_words
from fapengine.speech.formats.textgrid import PHONE_TIERS, WORD_TIERS, choose_tier
from fapengine.speech.formats.tier import Tier
from fapengine.speech.phone_track import PhoneTrack


def parse_mfa_json(data: bytes, *, tier: str | None = None, alphabet: str | None = None) -> PhoneTrack:
    """Read the aligner's JSON; the tier is found as in a TextGrid.

    Raises
    ------
    DataError
        If keys lack, no or several tiers fit, or times are wrong.
    """
    tiers = parse_document(data, "MFA JSON")["tiers"]
    if not isinstance(tiers.value, dict):
        raise DataError(f"tiers: got {ascii(tiers.value)[:40]}, expected an object of tiers", where="tiers")
    names = tuple(Tier(str(name), ()) for name in tiers.value)
    phones = _entries(tiers, choose_tier(names, tier, PHONE_TIERS, "phones").name)
    try:
        words = _entries(tiers, choose_tier(names, None, WORD_TIERS, "words").name)
    except DataError:
        words = []
    return track_of(with_words(phones, words), "MFA JSON", alphabet=alphabet)


def _entries(tiers: Node, name: str) -> list[Entry]:
    entries: list[Entry] = []
    for row in tiers[name]["entries"].items():
        cells = list(row.items())
        if len(cells) != 3:
            raise DataError(f"entry: got {len(cells)} values, expected begin, end, label", where=row.where)
        entries.append(Entry(cells[0].number(), cells[1].number(), cells[2].text(), row.where))
    return entries
