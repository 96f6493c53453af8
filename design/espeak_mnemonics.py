# ruff: noqa: E501
"""Measure what espeak-ng's mnemonics mean in IPA: one text spoken twice, its phoneme events named both ways, side by side.

The library fixes the kind of names when it starts, so each kind is a process. The table ``ESPEAK`` of
``fapengine/speech/alphabets/phone_sets.toml`` was written from what this prints.

Usage: python design/espeak_mnemonics.py
"""

import json
import subprocess
import sys
from collections import Counter, defaultdict

from fapengine.voices import espeak

TEXTS = {
    "en-us": "The birch canoe slid on the smooth planks. She judged a thin vision, yes: George, boys, how are you? Bird air ear poor hurry little bottle button singing measure father caught cot thing think this zoo shoe choose loud voice go near nurse start north force cure happy comma letter kitten.",
    "en-gb": "The birch canoe slid on the smooth planks. Bird air ear poor hurry little boat goat lot cloth thought start square near cure happy comma letter.",
    "de": "Zwölf Boxkämpfer jagen Viktor quer über den großen Sylter Deich. Ich auch, schöne Mädchen hören Häuser, Pflaume, Zeit, Deutsch, Übung.",
    "fr-fr": "Portez ce vieux whisky au juge blond qui fume. Un bon vin blanc, peu de peur, lune, agneau, huit, oui, jeûne, montagne.",
    "es": "El veloz murciélago hindú comía feliz cardillo y kiwi. La cigüeña tocaba el saxofón, perro, niño, llave, chico.",
    "it": "Quel vituperabile xenofobo zelante assaggia il whisky ed esclama: alleluja! Gnocchi, figlio, ciao, pizza, zero.",
    "pt": "Um pequeno jabuti xereta viu dez cegonhas felizes. Não, mãe, coração, filho, rapaz, vinho.",
    "pt-br": "Um pequeno jabuti xereta viu dez cegonhas felizes. Não, mãe, tia, dia.",
    "nl": "Pa's wijze lynx bezag vroom het fikse aquaduct. Huis, geel, deur, goed, schip.",
    "pl": "Zażółć gęślą jaźń. Pchnąć w tę łódź jeża lub ośm skrzyń fig. Cześć, dzień.",
    "ru": "Съешь же ещё этих мягких французских булок, да выпей чаю. Щука, жизнь, цирк.",
    "sv": "Flygande bäckasiner söka hwila på mjuka tuvor. Sju sjuksköterskor, kjol.",
    "tr": "Pijamalı hasta yağız şoföre çabucak güvendi.",
    "fi": "Törkylempijävongahdus, yö, hyvää päivää.",
    "cs": "Příliš žluťoučký kůň úpěl ďábelské ódy.",
    "hu": "Árvíztűrő tükörfúrógép, gyönyörű tyúk.",
    "el": "Ξεσκεπάζω την ψυχοφθόρα βδελυγμία.",
    "da": "Quizdeltagerne spiste jordbær med fløde.",
    "ro": "Înțelepciune, șase, țară, gând.",
    "hi": "नमस्ते दुनिया, भारत धन्यवाद।",
    "ar": "صباح الخير",
    "cmn": "你好世界，中国人说普通话。",
    "ja": "こんにちは せかい",
}


def events(kind: str) -> dict[str, list[str]]:
    """Names of the phonemes of every text; called once a process."""
    if kind == "mnemonics":
        espeak._IPA_NAMES = 0
    spoken = {voice: espeak.EspeakVoice(voice, 300)._synthesise(text)[0] for voice, text in TEXTS.items()}
    return {
        voice: [
            name.rstrip(b"\0").decode("utf-8", "replace")
            for *_, what, _, _, name in found
            if what == espeak._EVENT_PHONEME
        ]
        for voice, found in spoken.items()
    }


if len(sys.argv) > 1:
    print(json.dumps(events(sys.argv[1])))
else:
    named = [json.loads(subprocess.check_output([sys.executable, __file__, kind])) for kind in ("mnemonics", "ipa")]
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for voice in TEXTS:
        for mnemonic, ipa in zip(named[0][voice], named[1][voice], strict=True):
            table[mnemonic][ipa] += 1
    for mnemonic, meanings in sorted(table.items()):
        print(mnemonic, *(f"{ipa!r} x{count}" for ipa, count in meanings.most_common()))
