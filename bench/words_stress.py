"""Fits where English words are stressed, for ``fapengine-face/words-en``, and adds it to the file of its network.

    python -m bench.words_stress CMUDICT [-o design/words-en.bin]

CMUDICT: see ``bench/words_train.py``, which makes the file. Takes half a minute.

Theory of operation
-------------------
Vowels that are reduced (:data:`REDUCED`) have no stress. Of the others in a word, one has the highest sum of weights
of its :func:`features`: letters at both ends of the word, its own label, and consonants and vowels around it, each with
the place of the vowel from the word's end or beginning. The weights maximize the likelihood of the primary stresses of
the dictionary (a softmax over the vowels of each word). A twentieth of the words is left out, and measured. Weights are
int8; small ones are left out. The file has the features as lines of a text, and a weight for each line.
"""

import argparse
import json
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.sparse import csr_matrix

from bench.words_train import LEFT_OUT, ipa
from design.live_tables import MAGIC, packed

REDUCED = ("ə", "ɚ")
"""Vowels that CMUdict has without stress only."""
ENDS, BEGINNINGS = 5, (2, 3, 4)
"""Letters of the word's end, and of its beginning, that count."""
LEAST_COUNT, LEAST_WEIGHT, SCALE = 20, 0.2, 12
"""Vowels that a feature must have, its least weight, and the integer that a weight of 1 is."""


class Stressed(NamedTuple):
    """A word with the stress that it should have."""

    word: str
    phones: tuple[str, ...]
    vowels: tuple[int, ...]
    """Places of vowels among the phones."""
    stressed: int
    """Place of the one with primary stress."""

    @property
    def choices(self) -> list[int]:
        """Numbers of the vowels that may be stressed."""
        return [number for number, place in enumerate(self.vowels) if self.phones[place] not in REDUCED]


def dictionary(path: Path) -> list[Stressed]:
    """First pronunciation of each word of letters with a primary stress."""
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        word, *labels = line.partition("#")[0].split()
        stresses = [label[-1] for label in labels]
        if re.fullmatch("[a-z'][a-z']*[a-z][a-z']*|[a-z]", word) and "1" in stresses:
            vowels = tuple(number for number, stress in enumerate(stresses) if stress.isdigit())
            found.append(Stressed(word, tuple(map(ipa, labels)), vowels, stresses.index("1")))
    return found


def features(word: str, phones: Sequence[str], vowels: Sequence[int], number: int) -> list[str]:
    """Name what is known of a vowel; ``words-en/stress.js`` does the same."""
    count, place = len(vowels), vowels[number]
    behind = vowels[number + 1] if number + 1 < count else len(phones)
    before = vowels[number - 1] if number else -1
    last = min(count - 1 - number, 3)
    return [
        f"{phones[place]}{last}", f"v{phones[place]}{min(number, 1)}", f"#{min(count, 5)}{last}",
        f"s{min(number, 2)}{min(count, 4)}", f"c{min(behind - place - 1, 3)}{last}",
        f"o{min(place - before - 1, 2)}{last}",
        *(f"{word[-letters:]}${last}" for letters in range(1, ENDS + 1)),
        *(f"^{word[:letters]}{min(number, 3)}" for letters in BEGINNINGS),
    ]  # fmt: skip


def table(words: Sequence[Stressed], numbers: dict[str, int]) -> tuple[csr_matrix, NDArray[np.int64], NDArray[Any]]:
    """(V, F) which known features each choice has; (W,) first choice of each word; (V,) 1 for the stressed ones."""
    columns: list[int] = []
    ends, starts, right = [0], [], []
    for one in words:
        starts.append(len(right))
        for number in one.choices:
            columns += [numbers[name] for name in features(*one[:3], number) if name in numbers]
            ends.append(len(columns))
            right.append(float(one.vowels[number] == one.stressed))
    shape = len(right), len(numbers)
    return csr_matrix((np.ones(len(columns)), columns, ends), shape=shape), np.array(starts), np.array(right)


def fit(words: Sequence[Stressed]) -> dict[str, int]:
    """Weights of features."""
    counts = Counter(name for one in words for number in one.choices for name in features(*one[:3], number))
    numbers = {name: n for n, name in enumerate(sorted(name for name, count in counts.items() if count >= LEAST_COUNT))}
    x, starts, right = table(words, numbers)
    of_word = np.repeat(np.arange(len(starts)), np.diff([*starts, len(right)]))

    def loss(weights: NDArray[Any]) -> tuple[float, NDArray[Any]]:
        scores = x @ weights
        likely = np.exp(scores - np.maximum.reduceat(scores, starts)[of_word])
        likely /= np.add.reduceat(likely, starts)[of_word]
        slope = x.T @ (likely - right) + weights
        return -float(right @ np.log(likely + 1e-12)) + float(weights @ weights) / 2, slope

    weights = minimize(loss, np.zeros(len(numbers)), jac=True, method="L-BFGS-B", options={"maxiter": 150}).x
    rounded = np.clip(np.rint(SCALE * weights), -127, 127).astype(int)
    return {name: int(rounded[n]) for name, n in numbers.items() if abs(weights[n]) >= LEAST_WEIGHT}


def found_in(word: str, phones: Sequence[str], vowels: Sequence[int], weights: dict[str, int]) -> int:
    """Place of the stressed phone; -1 without any."""
    choices = [number for number, place in enumerate(vowels) if phones[place] not in REDUCED]
    scores = [sum(weights.get(name, 0) for name in features(word, phones, vowels, number)) for number in choices]
    return vowels[choices[int(np.argmax(scores))]] if choices else -1


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read what :func:`design.live_tables.packed` wrote."""
    start = len(MAGIC) + 4
    stop = start + int.from_bytes(data[len(MAGIC) : start], "little")
    about = json.loads(data[start:stop])
    places = about.pop("arrays")
    return about, {
        name: np.frombuffer(data, one["kind"], int(np.prod(one["shape"])), stop + one["offset"]).reshape(one["shape"])
        for name, one in places.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Fits stresses of words-en.")
    parser.add_argument("dictionary", type=Path, metavar="CMUDICT")
    parser.add_argument("-o", "--output", type=Path, default=Path("design/words-en.bin"))
    given = parser.parse_args()
    words = dictionary(given.dictionary)
    np.random.default_rng(1).shuffle(words)  # type: ignore[arg-type]  # a list
    left_out, learned = words[: len(words) // LEFT_OUT], words[len(words) // LEFT_OUT :]
    weights = fit([one for one in learned if len(one.choices) > 1])
    right = [found_in(*one[:3], weights) == one.stressed for one in left_out]
    several = [known for known, one in zip(right, left_out, strict=True) if len(one.choices) > 1]
    print(
        f"{len(weights)} weights; of {len(right)} words left out, {100 * np.mean(right):.1f} % are stressed rightly,"
        f" of {len(several)} with a choice {100 * np.mean(several):.1f} %"
    )
    about, arrays = unpacked(given.output.read_bytes())
    arrays["accents"] = np.frombuffer("\n".join(weights).encode(), np.int8)
    arrays["accentWeights"] = np.array(list(weights.values()), np.int8)
    shape = {"reduced": REDUCED, "ends": ENDS, "beginnings": BEGINNINGS}
    given.output.write_bytes(packed(about | {"stress": shape}, arrays))


if __name__ == "__main__":
    main()
