"""Language codes to voices, on a small catalogue written by hand and on the library's own."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.voices import espeak
from fapengine.voices.catalogue import Catalogue

SMALL = Catalogue.of(
    [
        ("Chinese (Mandarin)", "sit/cmn", [(5, "cmn"), (5, "zh")]),
        ("Chinese (Cantonese)", "sit/yue", [(5, "yue"), (8, "zh")]),
        ("Chinese (Cantonese, Jyutping)", "sit/yue-Latn-jyutping", [(5, "yue"), (8, "zh")]),
        ("English (Great Britain)", "gmw/en", [(2, "en-gb"), (2, "en")]),
        ("English (America)", "gmw/en-US", [(2, "en-us"), (3, "en")]),
        ("Cherokee ", "iro/chr", [(5, "chr-US-Qaaa-x-west")]),
    ]
)


def test_a_voice_is_called_by_its_first_code_if_no_other_has_it() -> None:
    codes = ["chr-us-qaaa-x-west", "cmn", "en-gb", "en-us", "yue", "yue-latn-jyutping"]
    assert [entry.code for entry in SMALL.entries] == codes
    assert SMALL.find("chr").name == "Cherokee"


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ("en", "en-gb"), ("EN", "en-gb"), ("en_US", "en-us"), ("EN-us", "en-us"), ("en-AU", "en-gb"),
        ("en_US.UTF-8", "en-us"), ("gmw/en", "en-gb"), ("GMW/EN-us", "en-us"), (" en-us ", "en-us"),
        ("zh", "cmn"), ("zh-Hans-CN", "cmn"), ("yue-HK", "yue"), ("yue-Latn-jyutping", "yue-latn-jyutping"),
    ],
)  # fmt: skip
def test_any_spelling(asked: str, code: str) -> None:
    assert SMALL.find(asked).code == code


@pytest.mark.parametrize(
    ("asked", "identifier"),
    [
        ("fr", "roa/fr"), ("en", "gmw/en"), ("zh", "sit/cmn"), ("zh-cmn", "sit/cmn"), ("no", "gmq/nb"),
        ("pt-PT", "roa/pt"), ("pt", "roa/pt"), ("pt-BR", "roa/pt-BR"), ("hbs", "zls/hr"), ("es-mx", "roa/es-419"),
        ("hy-arevela", "ine/hy"), ("hy", "ine/hy"), ("hy-arevmda", "ine/hyw"), ("de-DE", "gmw/de"), ("fr-CA", "roa/fr"),
        ("jp", "jpx/ja"), ("ja-JP", "jpx/ja"), ("iw", "sem/he"), ("iw_IL", "sem/he"), ("in", "poz/id"),
        ("mo", "roa/ro"), ("sh", "zls/hr"), ("tlh", "art/piqd"), ("zh-yue", "sit/yue"), ("zh-TW", "sit/cmn"),
        ("yue-latn-jyutping", "sit/yue-Latn-jyutping"), ("chr", "iro/chr"), ("nb-NO", "gmq/nb"),
    ],
)  # fmt: skip
def test_codes_of_the_installed_voices(asked: str, identifier: str) -> None:
    assert espeak.catalogue().find(asked).identifier == identifier


@pytest.mark.parametrize("asked", ["", "-", "xx", "xx-en", "english", "en us", "é", "en\0", "tl", "en-" + "a" * 9])
def test_refuses(asked: str) -> None:
    with pytest.raises(UsageError, match="expected a language code such as"):
        espeak.catalogue().find(asked)


def test_a_speaker_behind_a_plus_sign() -> None:
    voices = espeak.catalogue()
    assert voices.find("fr+f3").identifier == "roa/fr+f3"
    assert voices.find("en_US+ANDY").identifier == "gmw/en-US+Andy"
    assert voices.find("fr+f3").code == voices.find("fr").code
    with pytest.raises(UsageError, match=r"speaker after the \+ such as .*f3"):
        voices.find("fr+f33")
    with pytest.raises(UsageError, match="language code"):
        voices.find("xx+f3")


def test_speakers_sound_unlike_each_other() -> None:
    one, other = (espeak.EspeakVoice(f"de{speaker}").speak("Guten Morgen.") for speaker in ("", "+f3"))
    assert [phone.label for phone in one.phones.phones] == [phone.label for phone in other.phones.phones]
    assert not np.array_equal(one.samples, other.samples)
