"""What senders call phones and visemes."""

import pytest

from fapengine.engine.commands import expression_named
from fapengine.expressions import Expression
from fapengine.mpeg4.fap import VISEMES
from fapengine.speech import ipa
from fapengine.speech.alphabets.convert import ALPHABETS
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.wire.speech_osc import phone_labels
from fapengine.wire.speech_osc.schema import WirePhone

OCULUS = ("sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou")


@pytest.mark.parametrize("number", range(15))
def test_numbers_of_mpeg4_and_names_of_oculus_mean_the_same(number):
    by_number, by_name = phone_labels.to_viseme(number), phone_labels.to_viseme(OCULUS[number])
    assert phone_labels.to_viseme(str(number)) == phone_labels.to_viseme(f"mpeg4:{number}") == by_number
    if number == 0:
        assert by_number == by_name == SILENCE
    else:
        assert by_number in VISEMES[number].phonemes
        one, other = (ipa.SOUNDS[ipa.letters(label)[0]] for label in (by_number, by_name))
        assert (one.vowel, one.lips) == (other.vowel, other.lips)


@pytest.mark.parametrize("name", OCULUS[1:])
def test_names_of_meshes_are_understood(name):
    wanted = phone_labels.to_viseme(name)
    assert wanted not in (phone_labels.UNKNOWN, SILENCE)
    for spelled in (f"viseme_{name}", f"vrc.v_{name.lower()}", f"v_{name}", f" {name} ", f"oculus:{name}"):
        assert phone_labels.to_viseme(spelled) == wanted, spelled


@pytest.mark.parametrize(("prefix", "phone_set"), sorted(phone_labels.VISEME_PREFIXES.items()))
def test_prefixes_reach_every_viseme_of_their_set(prefix, phone_set):
    for name, shown in PHONE_SETS[phone_set].table.items():
        assert phone_labels.to_viseme(f"{prefix}:{name}") == (shown or SILENCE)
        assert phone_labels.to_viseme(f"{prefix.upper()}:{name}") == (shown or SILENCE)


@pytest.mark.parametrize(
    "name", ["XX", "15", "-1", "mpeg4:15", "mpeg4:x", "mpeg4:²", "az:22", "rh:Z", "zz:1", "999999", ":"]
)
def test_strange_visemes_are_unknown(name):
    assert phone_labels.to_viseme(name) == phone_labels.UNKNOWN
    assert not ipa.letters(phone_labels.UNKNOWN)


@pytest.mark.parametrize("number", [-1, 15, 1 << 30])
def test_numbers_beyond_the_table_are_unknown(number):
    assert phone_labels.to_viseme(number) == phone_labels.UNKNOWN


def test_every_alphabet_has_its_name():
    for name in ALPHABETS:
        assert phone_labels.phone_set_named(name) == name
        assert phone_labels.phone_set_named(name.upper()) == name
    assert phone_labels.phone_set_named("") == "ipa"
    assert phone_labels.phone_set_named("MPEG4") == phone_labels.MPEG4_VISEMES
    assert phone_labels.phone_set_named("X_SAMPA") == phone_labels.phone_set_named("xsampa") == "x-sampa"
    assert phone_labels.phone_set_named("nothing") is None


def test_phones_of_several_sets():
    assert phone_labels.to_phone("AH0", "arpabet") == ("ə", 0)
    assert phone_labels.to_phone("AH1", "arpabet") == ("ʌ", 1)
    assert phone_labels.to_phone("A:", "x-sampa") == ("ɑː", 0)
    assert phone_labels.to_phone("21", "azure-visemes") == ("p", 0)
    assert phone_labels.to_phone("pau", "arpabet") == (SILENCE, 0)
    assert phone_labels.to_phone("é" * 8, "ipa") == (phone_labels.UNKNOWN, 0)  # 16 bytes
    assert phone_labels.to_phone("é" * 7, "ipa")[0] != phone_labels.UNKNOWN


def test_phones_for_the_engine():
    assert phone_labels.to_engine_phone(WirePhone("m", 20_000, 80_000), "ipa") == Phone("m", 0.02, 0.1)
    assert phone_labels.to_engine_phone(WirePhone("AA1", 0, 100_000), "arpabet").stress == 1
    assert phone_labels.to_engine_phone(WirePhone("a", 0, 100_000, flags=2), "ipa").stress == 2
    assert phone_labels.to_engine_phone(WirePhone("a", 0, 100_000, flags=3), "ipa").stress == 1
    assert phone_labels.to_engine_phone(WirePhone("a", 0, 100_000, weight=0.05), "ipa").is_silence
    nothing = phone_labels.to_engine_phone(WirePhone("a", 50_000, 0), "ipa")
    assert nothing.is_silence
    assert 0 < nothing.duration_s < 1e-5


def test_all_expressions_have_names():
    assert {expression_named(expression.name) for expression in Expression} == set(Expression)
    assert expression_named(" Happy ") == Expression.JOY
