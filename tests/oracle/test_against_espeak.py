"""Phones of our voices against two transcriptions of the same texts: the library's own, and Debian's program.

Both write what they would say without saying it (espeak_TextToPhonemes; ``espeak-ng -q --ipa``). Stress, length, tones
and the marks of a change of language are set aside: phones keep them elsewhere or not at all. What else differs is
explained, a line each.
"""

import re
import shutil
import subprocess
import unicodedata

import pytest

from fapengine.voices.espeak import EspeakVoice

TEXTS = {
    "en-us": "The quick brown fox jumps over the lazy dog while seventeen children watch from behind the garden "
    "wall. Nobody thought that measuring pleasure would be easy.",
    "en-gb": "The quick brown fox jumps over the lazy dog while seventeen children watch from behind the garden "
    "wall. Nobody thought that measuring pleasure would be easy.",
    "de": "Der Zug nach München fährt heute um achtzehn Uhr ab, und die Kinder möchten noch schnell Brötchen "
    "kaufen. Zwei Ärzte üben Geige.",
    "fr": "Le petit garçon mange une pomme rouge dans le jardin, et sa sœur chante une vieille chanson. Un bon "
    "vin blanc vaut bien huit francs.",
    "es": "El perro de mi vecino ladra toda la noche y no puedo dormir. Mañana llegará la lluvia a Madrid, "
    "según dice el periódico.",
    "it": "La ragazza scrive una lettera alla zia di Roma. Gli gnocchi della nonna sono buoni, e il vino costa poco.",
    "nl": "De schipper zag gisteren een grote vogel boven het water vliegen. Mijn broer heeft negen boeken gelezen.",
    "pl": "Szybki brązowy lis przeskakuje nad leniwym psem. Dzieci chętnie jedzą świeże pierogi u babci.",
    "ru": "Быстрая лиса прыгает через ленивую собаку. Завтра мы поедем в большой город смотреть музей.",
    "cs": "Rychlá hnědá liška skáče přes líného psa. Třicet tři stříbrných křepelek přeletělo přes střechu.",
    "sv": "Sju sjösjuka sjömän sköttes av sköna sjuksköterskor. Den lilla flickan läser en bok i trädgården.",
    "el": "Η γρήγορη αλεπού πηδάει πάνω από το τεμπέλικο σκυλί. Αύριο θα πάμε στη θάλασσα.",
    "ro": "Vulpea maro sare peste câinele leneș. Astăzi este o zi frumoasă și copiii se joacă în grădină.",
    "ko": "오늘 날씨가 좋습니다. 우리는 공원에서 친구를 만났어요.",
    "tr": "Hızlı kahverengi tilki tembel köpeğin üzerinden atlar. Çocuklar bahçede oynuyor.",
    "fi": "Nopea ruskea kettu hyppää laiskan koiran yli. Yöllä sataa lunta.",
    "hi": "आज मौसम बहुत अच्छा है। बच्चे बगीचे में खेल रहे हैं।",
    "ja": "きょうは とても いい てんきです。ともだちと こうえんへ いきました。",
    "cmn": "今天天气很好。我们去公园吃苹果。",
    "pt": "A raposa marrom pula sobre o cão preguiçoso. Hoje as crianças brincam no jardim.",
    "ar": "اليوم الطقس جميل جدا. يلعب الأطفال في الحديقة.",
    "sw": "Watoto wanacheza mpira shuleni. Leo hali ya hewa ni nzuri sana.",
}
"""Sentences written for this test, by language code of the voice."""
CORRECTED = {"ru": [("y", "ɨ")], "pt": [("ɹ", "ɾ")], "ja": [("ũ", "ɴ")], "cmn": [("nɡ", "ŋ")]}
"""Mnemonics in place of IPA, in both (fapengine.voices.espeak_labels); in the sentence above ũ stands before h."""
OURS: dict[str, list[tuple[str, str]]] = {
    **CORRECTED,
    "hi": [("cʰcʰ", "cʰ")],  # a long consonant before a vowel has one event, not two
    "cmn": [
        *CORRECTED["cmn"],
        ("ts.h", "ʈʂʰ"), ("s.", "ʂ"), ("i.", "ɨ"),  # mnemonics instead of IPA
        ("ph", "pʰ"), ("th", "tʰ"), ("kh", "kʰ"), ("ɕh", "ɕʰ"),  # a letter h for aspiration
        ("ɜ", ""),  # the third tone's mark
    ],
}  # fmt: skip
"""By language: what the library writes, and what the phones are."""
DEBIANS = {
    **CORRECTED,
    "de": [("mynç", "mʏnç")],  # the dictionary of 1.51 has another ü in München
    "hi": [("cʰcʰ", "cʰ")],
}
"""By language: what espeak-ng 1.51 writes, and what the phones are."""
NOT_COMPARED = {"cmn"}  # Debian's 1.51 spells the pinyin of these words as English letters


def bare(text: str, explained: list[tuple[str, str]]) -> str:
    """Leave only the letters of the phones."""
    text = re.sub(r"[ˈˌː\s_‿]|\([a-z-]*\)", "", text)
    for written, phone in explained:
        text = text.replace(written, phone)
    return re.sub(r"[0-9.#|-]", "", unicodedata.normalize("NFD", text))


def spoken(code: str) -> str:
    phones = EspeakVoice(code).speak(TEXTS[code]).phones.phones
    return bare("".join(phone.label for phone in phones if not phone.is_silence), [])


@pytest.mark.parametrize("code", TEXTS)
def test_phones_are_those_that_the_library_writes(code: str) -> None:
    written = bare(EspeakVoice(code).transcribe(TEXTS[code]), OURS.get(code, []))
    assert len(written) > 30
    assert spoken(code) == written


def test_phones_are_those_of_debians_program() -> None:
    program = shutil.which("espeak-ng")
    if program is None:
        pytest.skip("the program espeak-ng is not installed (.ci/system-packages)")
    differing, equal = {}, []
    for code in TEXTS.keys() - NOT_COMPARED:
        voice = EspeakVoice(code).entry.identifier.rpartition("/")[2]
        command = [program, "-q", "--ipa", "-v", voice, TEXTS[code]]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
        ours, theirs = spoken(code), bare(done.stdout, [])
        if ours == theirs:
            equal.append(code)
        elif ours != bare(done.stdout, DEBIANS.get(code, [])):
            differing[code] = (theirs, ours)
    assert differing == {}
    assert len(equal) >= 15
