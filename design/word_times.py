"""What an ear adds to word times that are a little off: error of the onsets of phones, with and without it.

``python -m design.word_times`` reads 20 sentences of GRID beside the checkout, whose reference is a forced alignment.
Its word times are moved at random (normal, standard deviation in ms), as those of a TTS are.
"""

from itertools import groupby

import numpy as np

from fapengine.files.sound import stream_sound
from fapengine.host.words import adjusted
from fapengine.recognition.sphinx import ipa_of
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.speech.phone_track import Phone
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.pronounce import Pronouncer
from tests.conftest import SHARED

SENTENCES = 20
LIPS = "pbmfv"


def main() -> None:
    data = np.load(SHARED / "data" / "speech_train.npz")
    ids = [str(name) for name in data["ids"]]
    sounds = [path for path in sorted((SHARED / "data" / "speech_sound").glob("*.flac")) if path.stem in ids]
    voice = VoiceChoice("en-gb").load()
    for off_ms in (0, 20, 40):
        rng = np.random.default_rng(1)
        errors: dict[str, list[tuple[str, float]]] = {"words": [], "and the ear": []}
        for path in sounds[:SENTENCES]:
            clip = ids.index(path.stem)
            words = _moved(_rows(data, "word", clip), off_ms / 1e3, rng)
            known = [(ipa_of(label), start_s) for label, start_s, _ in _rows(data, "phone", clip)]
            phones = [phone for phone in Pronouncer(voice).words(words) if not phone.is_silence]
            ear = SphinxRecognizer()
            heard = ear.push(np.concatenate(list(stream_sound(path, rate_hz=16_000)))) + ear.end()
            moved = [
                phone
                for _, word in groupby(phones, key=lambda phone: sum(a <= phone.start_s + 1e-6 for _, a, _ in words))
                for phone in adjusted(list(word), heard)
            ]
            errors["words"] += _errors(phones, known)
            errors["and the ear"] += _errors(moved, known)
        for name, found in errors.items():
            lips_ms = 1e3 * np.mean([error for label, error in found if label in LIPS])
            all_ms = 1e3 * np.mean([error for _, error in found])
            print(f"words {off_ms:2d} ms off, {name:12s}: all {all_ms:5.1f} ms, p b m f v {lips_ms:5.1f} ms")


def _rows(data: np.lib.npyio.NpzFile, kind: str, clip: int) -> list[tuple[str, float, float]]:
    """Label, start and end of what is said in a clip."""
    chosen = data[f"{kind}_clip"] == clip
    rows = zip(data[kind][chosen], data[f"{kind}_start"][chosen], data[f"{kind}_end"][chosen], strict=True)
    return [
        (str(label), float(a), float(b)) for label, a, b in rows if str(label).lower() not in ("sil", "sp") and b > a
    ]


def _moved(
    words: list[tuple[str, float, float]], off_s: float, rng: np.random.Generator
) -> list[tuple[str, float, float]]:
    moved, last_s = [], 0.0
    for text, start_s, end_s in words:
        start_s = max(last_s, start_s + rng.normal() * off_s)
        last_s = max(start_s + 0.05, end_s + rng.normal() * off_s)
        moved.append((text, start_s, last_s))
    return moved


def _errors(phones: list[Phone], known: list[tuple[str, float]]) -> list[tuple[str, float]]:
    """Label and distance to the nearest onset of the same phone, where there is one."""
    found = []
    for phone in phones:
        nearest = min((abs(start_s - phone.start_s) for label, start_s in known if label == phone.label), default=1.0)
        if nearest < 0.2:
            found.append((phone.label, nearest))
    return found


if __name__ == "__main__":
    main()
