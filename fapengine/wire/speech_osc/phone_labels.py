"""Labels of phones and visemes that senders use, and their IPA.

A viseme is shown as a phone that looks like it (:mod:`fapengine.speech.alphabets.phone_sets`). Names without a prefix
are of Oculus (``PP``, ``viseme_PP``, ``vrc.v_pp``), numbers are of MPEG-4, in the order of Oculus; ``az:19``, ``rh:D``
and ``po:p`` are of Azure, Rhubarb and Polly.
"""

from functools import lru_cache

from fapengine.mpeg4.fap import VISEMES
from fapengine.speech.alphabets import convert as alphabets
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.wire.speech_osc.schema import LABEL_BYTES, PRIMARY_STRESS, SECONDARY_STRESS, WirePhone

UNKNOWN = "?"
"""Not IPA: the engine counts it and shows a neutral vowel."""
MIN_PHONE_S = 1e-6
"""A phone of no length becomes a silence of this length: it keeps its index and shows nothing."""
MIN_WEIGHT = 0.1
"""Weight below which a phone or viseme is not shown."""
VISEME_PREFIXES = {
    "az": "azure-visemes", "azure": "azure-visemes", "rh": "rhubarb-shapes", "rhubarb": "rhubarb-shapes",
    "po": "polly-visemes", "polly": "polly-visemes", "oc": "oculus-visemes", "oculus": "oculus-visemes",
}  # fmt: skip
MPEG4_PREFIXES = ("mpeg4", "mp4", "m4")
PHONE_SET_NAMES = {
    "": "ipa", "cmu": "arpabet", "arpa": "arpabet", "xsampa": "x-sampa", "sampa": "x-sampa", "espeak-ng": "espeak",
    "azure": "azure-visemes", "rhubarb": "rhubarb-shapes", "polly": "polly-visemes", "oculus": "oculus-visemes",
    "mpeg4": "mpeg4-visemes",
}  # fmt: skip
MPEG4_VISEMES = "mpeg4-visemes"
_OCULUS = {name.lower(): name for name in PHONE_SETS["oculus-visemes"].table}
_OCULUS["i"], _OCULUS["o"], _OCULUS["u"] = "ih", "oh", "ou"


def phone_set_named(name: str) -> str | None:
    """Return the phone set of a name or synonym; None if there is none.

    Examples
    --------
    >>> phone_set_named("ARPAbet"), phone_set_named("cmu"), phone_set_named("azure"), phone_set_named("klingon")
    ('arpabet', 'arpabet', 'azure-visemes', None)
    """
    plain = name.strip().lower().replace("_", "-")
    plain = PHONE_SET_NAMES.get(plain, plain)
    return plain if plain in alphabets.ALPHABETS or plain == MPEG4_VISEMES else None


def to_phone(label: str, phone_set: str) -> tuple[str, int]:
    """Return the IPA (or :data:`SILENCE`) and stress of a label; :data:`UNKNOWN` if it is too long.

    Examples
    --------
    >>> to_phone("AY1", "arpabet"), to_phone("sil", "ipa"), to_phone("7", "mpeg4-visemes"), to_phone("p" * 16, "ipa")
    (('aɪ', 1), ('_', 0), ('s', 0), ('?', 0))
    """
    plain = label.strip()
    return (UNKNOWN, 0) if len(plain.encode()) > LABEL_BYTES else _to_phone(plain, phone_set)


@lru_cache(maxsize=4096)
def _to_phone(plain: str, phone_set: str) -> tuple[str, int]:
    if phone_set == MPEG4_VISEMES:
        return to_viseme(plain), 0
    if alphabets.is_silence(plain):
        return SILENCE, 0
    as_ipa, stress = alphabets.to_ipa(plain, phone_set)
    return as_ipa or SILENCE, stress


@lru_cache(maxsize=1024)
def to_viseme(name: str | int) -> str:
    """Return the phone that shows a viseme; :data:`UNKNOWN` if there is no such viseme.

    Examples
    --------
    >>> [to_viseme(name) for name in ("PP", "viseme_aa", "vrc.v_ss", 7, "12", "az:19", "rh:D", "po:@", "sil", "XX")]
    ['p', 'ɑ', 's', 's', 'ɪ', 'd', 'ɑ', 'ə', '_', '?']
    """
    if isinstance(name, int):
        return _mpeg4(name)
    plain = name.strip()
    prefix, colon, rest = plain.partition(":")
    if colon:
        if prefix.lower() in MPEG4_PREFIXES:
            return _mpeg4(int(rest)) if rest.isascii() and rest.isdigit() and len(rest) < 4 else UNKNOWN
        table = PHONE_SETS[VISEME_PREFIXES[prefix.lower()]].table if prefix.lower() in VISEME_PREFIXES else {}
        return table[rest] or SILENCE if rest in table else UNKNOWN
    if plain.isascii() and plain.isdigit() and len(plain) < 4:
        return _mpeg4(int(plain))
    for before in ("viseme_", "vrc.v_", "v_"):
        plain = plain.removeprefix(before)
    if plain.lower() in alphabets.SILENCES:
        return SILENCE
    oculus = PHONE_SETS["oculus-visemes"].table
    return oculus[plain] if plain in oculus else oculus.get(_OCULUS.get(plain.lower(), ""), UNKNOWN)


def _mpeg4(number: int) -> str:
    if not 0 <= number < len(VISEMES):
        return UNKNOWN
    return VISEMES[number].phonemes[0] if number else SILENCE


def to_engine_phone(phone: WirePhone, phone_set: str) -> Phone:
    """Convert a phone to the engine's form."""
    start_s, end_s = phone.start_us / 1e6, (phone.start_us + phone.duration_us) / 1e6
    label, stress = to_phone(phone.label, phone_set)
    if phone.flags & PRIMARY_STRESS:
        stress = 1
    elif phone.flags & SECONDARY_STRESS:
        stress = 2
    if phone.duration_us == 0:
        return Phone(SILENCE, start_s, start_s + MIN_PHONE_S)
    if phone.weight < MIN_WEIGHT:
        label = SILENCE
    return Phone(label, start_s, end_s, stress)
