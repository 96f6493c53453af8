"""PocketSphinx: its model, its phones, and the decoders that the ears are made of.

The model (US English, 16 kHz; 39 phones of the CMU dictionary) lies inside the wheel, so nothing is fetched.
PocketSphinx 5: Huggins-Daines and others, BSD; "Pocketsphinx: a free, real-time continuous speech recognition system
for hand-held devices", ICASSP 2006.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import ResourceError
from fapengine.speech.alphabets.convert import from_arpabet
from fapengine.speech.phone_track import SILENCE

Frames = tuple[str, int, int]
"""A phone of the model or a silence, its first frame and the one behind its last, 100 a second."""

MODEL_PHONES = (
    "AA", "AE", "AH", "AO", "AW", "AY", "B", "CH", "D", "DH", "EH", "ER", "EY", "F", "G", "HH", "IH", "IY", "JH", "K",
    "L", "M", "N", "NG", "OW", "OY", "P", "R", "S", "SH", "T", "TH", "UH", "UW", "V", "W", "Y", "Z", "ZH",
)  # fmt: skip
"""Phones that the model knows, in ARPAbet."""
VOWELS = frozenset(name for name in MODEL_PHONES if name[0] in "AEIOU")
_LOOP = {"lw": 2.0, "beam": 1e-20, "pbeam": 1e-20}
"""Weight of the phone language model and beams of the phone loop (``bench/ears.py``: 1 to 4 differ by .02 of r)."""

_WORDS = {"fwdflat": False, "bestpath": False, "pl_window": 5, "maxhmmpf": 5000, "maxwpf": 10}
"""One pass over the words, with phones looked at 50 ms ahead: 2.6 times quicker than the three passes by default, for
169 instead of 171 right words of 205 (20 sentences of Festival's voice ked)."""


def new_decoder(**options: Any) -> Any:
    """Make a decoder with the shipped acoustic model.

    Raises
    ------
    ResourceError
        If PocketSphinx is not installed.
    """
    try:
        from pocketsphinx import Config, Decoder
    except ImportError as error:
        raise ResourceError('ear: PocketSphinx is not installed; mend it with: pip install "fapengine[ear]"') from error
    return Decoder(Config(hmm=str(_folder() / "en-us"), loglevel="FATAL", **options))


def new_phone_loop() -> Any:
    """Make a decoder of any phone behind any other, weighed by a model of phone sequences. Raises as it."""
    return new_decoder(allphone=str(_folder() / "en-us-phone.lm.bin"), **_LOOP) if _installed() else new_decoder()


def new_aligner(*, beam: float, silence: float, noise: float) -> Any:
    """Make a decoder for texts that are known, with the shipped dictionary. Raises as :func:`new_decoder`.

    ``silence`` and ``noise`` are the probabilities of a pause and of a noise between two words.
    """
    if not _installed():
        return new_decoder()
    words = {"beam": beam, "pbeam": beam, "wbeam": beam**0.75, "silprob": silence, "fillprob": noise}
    return new_decoder(dict=str(_folder() / "cmudict-en-us.dict"), lm=None, bestpath=False, **words)


def new_word_decoder() -> Any:
    """Make a decoder of English words, by the shipped model of word triples. Raises as :func:`new_decoder`."""
    if not _installed():
        return new_decoder()
    return new_decoder(dict=str(_folder() / "cmudict-en-us.dict"), lm=str(_folder() / "en-us.lm.bin"), **_WORDS)


def dictionary() -> Iterator[tuple[str, list[str]]]:
    """Words of the shipped dictionary, in small letters, with the model's phones. Raises as :func:`new_decoder`."""
    if not _installed():
        new_decoder()
    for line in (_folder() / "cmudict-en-us.dict").read_text().splitlines():
        word, *phones = line.split()
        yield word, phones


def pronounced(decoder: Any, word: str) -> list[str]:
    """Phones of the model for a word of a hypothesis; none for a silence or a noise."""
    if word.startswith(("<", "[", "+")):
        return []
    return str(decoder.lookup_word(word) or "").split()


def ipa_of(name: str) -> str:
    """IPA of a phone of the model; a silence or a noise is :data:`SILENCE`.

    Examples
    --------
    >>> ipa_of("AY"), ipa_of("SIL"), ipa_of("+SPN+")
    ('aɪ', '_', '_')
    """
    return SILENCE if name not in MODEL_PHONES else from_arpabet(name) or SILENCE


def frames_of(segments: Iterable[Any]) -> list[Frames]:
    """Segments of a hypothesis."""
    return [(segment.word, segment.start_frame, segment.end_frame + 1) for segment in segments]


def decode(decoder: Any, samples: NDArray[np.int16]) -> None:
    """Hear a whole utterance, (N,) int16, at once: its mean spectrum is then known from its start."""
    decoder.start_utt()
    decoder.process_raw(samples.tobytes(), full_utt=True)
    decoder.end_utt()


def _installed() -> bool:
    from importlib.util import find_spec

    return find_spec("pocketsphinx") is not None


def _folder() -> Path:
    from pocketsphinx import get_model_path

    return Path(get_model_path()) / "en-us"
