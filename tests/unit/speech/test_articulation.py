"""The table of what lips and tongue do: complete, in the order of the facts, and inside what a stream can carry."""

import hashlib
import itertools

import numpy as np
import pytest

from fapengine._arrays import read_rows
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.track import to_codable
from fapengine.speech import articulation, ipa
from fapengine.speech.articulation import ARTICULATIONS, AXES, SIBILANTS
from fapengine.trajectory.phonetics import HALF_GAIN, WIDTH, layer_faps
from tests.english import english

CONTRAST_MM = 4.0
"""What can be read: the least difference of protrusion between a round sound and one that is not."""
ROUND, SPREAD = "uyowʃʒɥʏøʊɹ", "iɪeɛsz"


def test_every_letter_has_one_row() -> None:
    written = [letter for letters, *_ in read_rows("fapengine.speech", "articulation.csv") for letter in letters]
    assert len(written) == len(set(written)), [letter for letter in written if written.count(letter) > 1]
    assert set(written) == set(ipa.SOUNDS)
    assert len(written) >= 100


@pytest.mark.parametrize("letter", ARTICULATIONS)
def test_rows_have_a_source_and_an_uncertainty_and_are_in_range(letter: str) -> None:
    row = ARTICULATIONS[letter]
    assert row.source
    assert 1 <= row.sure_mm <= 5
    assert -1 <= row.round <= 1
    assert all(0 <= share <= 1 for share in row.insists)
    assert len(row.values) == len(row.insists) == len(AXES)
    assert -12 <= row.tip_out <= 11
    assert -5 <= row.tip_up <= 10
    assert -5 <= row.body_up <= 10
    assert -1 <= row.push <= 10


def test_round_sounds_come_forward_and_the_others_do_not() -> None:
    for one, other in itertools.product(ROUND, SPREAD):
        assert ARTICULATIONS[one].push - ARTICULATIONS[other].push >= CONTRAST_MM, (one, other)
        assert ARTICULATIONS[one].round > 0 > ARTICULATIONS[other].round, (one, other)
    assert ARTICULATIONS["u"].round > ARTICULATIONS["ʃ"].round  # round and open
    assert all(ARTICULATIONS[letter].round <= 0 for letter in "ɕʑjɲ")


def test_vowels_are_round_where_the_chart_says_so() -> None:
    for letter, sound in ipa.SOUNDS.items():
        if sound.vowel and sound.rounding in (0.0, 1.0):
            assert (ARTICULATIONS[letter].push > 3) == (sound.rounding == 1.0), letter


def test_the_tongue_is_where_the_sound_is_made() -> None:
    assert all(ARTICULATIONS[letter].tip_out > 5 for letter in "θð")
    assert all(ARTICULATIONS[letter].tip_out <= 0 for letter in ARTICULATIONS if letter not in "θð")
    assert min(ARTICULATIONS[letter].tip_up for letter in "tdnl") > max(ARTICULATIONS[x].tip_up for x in "szθðiaukɡŋ")
    assert min(ARTICULATIONS[letter].body_up for letter in "kɡŋj") > max(ARTICULATIONS[x].body_up for x in "eɛatdnszθ")


@pytest.mark.parametrize("size", [0.75, 1.0, 1.5])
def test_no_row_leaves_the_range_of_the_standard(size: float) -> None:
    """On faces smaller and larger than the recorded one, and with the largest lips of a style."""
    fapu = Fapu(irisd0_mm=10 * size, es0_mm=60 * size, ens0_mm=48 * size, mns0_mm=21 * size, mw0_mm=50 * size)
    profile = english()
    rows = np.array([row.values for row in ARTICULATIONS.values()])
    faps = np.pad(rows, ((0, 0), (0, WIDTH - len(AXES))), constant_values=1.0) * (1 + HALF_GAIN) @ layer_faps(profile)
    faps *= profile.fapu.mns0_mm / fapu.mns0_mm
    np.testing.assert_array_equal(to_codable(faps), np.rint(faps).astype(np.int32))
    assert np.abs(faps).max() > 100


def test_sibilants_are_fricatives_of_the_teeth() -> None:
    assert set(ipa.SOUNDS) >= SIBILANTS
    assert all(ipa.SOUNDS[letter].manner == 0.3 and 0.1 < ipa.SOUNDS[letter].place < 0.4 for letter in SIBILANTS)


@pytest.mark.parametrize(
    ("letter", "stands_in"), [("ʏ", "u"), ("y", "u"), ("ɻ", "ɹ"), ("ɕ", "s"), ("ʑ", "z"), ("ɥ", "w"), ("ʂ", "ʃ"),
                              ("ø", "ɔ"), ("ɯ", "i"), ("ʊ", "u"), ("e", "ɪ"), ("ɲ", "j"), ("ʎ", "l"), ("ɭ", "l")]
)  # fmt: skip
def test_what_stands_in_keeps_the_lips(letter: str, stands_in: str) -> None:
    assert ipa.nearest(letter, tuple(name for name in english().phones if len(name) == 1)) == stands_in


def test_no_letter_changes_its_rounding() -> None:
    known = tuple(name for name in english().phones if len(name) == 1)
    for letter in ipa.SOUNDS:
        other = ipa.nearest(letter, known)
        assert ipa.is_rounded(letter) == ipa.is_rounded(other), (letter, other)
        assert ipa.SOUNDS[letter].vowel == ipa.SOUNDS[other].vowel, (letter, other)


def test_tables_change_only_on_purpose() -> None:
    """Values from sources: a digest, because no law connects them."""
    rows = [(letter, *each.values, *each.insists, each.sure_mm) for letter, each in sorted(ARTICULATIONS.items())]
    tables = [rows, sorted(articulation.OPENINGS.items()), sorted(articulation.OPENINGS_ALONE.items())]
    tables.append([repr(each) for each in sorted(ipa.SOUNDS.items())])
    assert hashlib.sha256(repr(tables).encode()).hexdigest()[:16] == "3a5913581a85cdd9"


def cheapest(changes: np.ndarray, lost: float, around: float) -> float:
    """Least cost of pairing two sequences, of all ways."""
    rows, columns = changes.shape
    chosen = itertools.combinations
    return min(
        cost(changes, list(zip(mine, other, strict=True)), lost, around)
        for count in range(min(rows, columns) + 1)
        for mine in chosen(range(rows), count)
        for other in chosen(range(columns), count)
    )


def cost(changes: np.ndarray, pairs: list[tuple[int, int]], lost: float, around: float) -> float:
    rows, columns = changes.shape
    inside = range(pairs[0][1], pairs[-1][1] + 1) if pairs else range(0)
    alone = len(inside) - len(pairs) + rows - len(pairs)
    return float(sum(changes[pair] for pair in pairs) + lost * alone + around * (columns - len(inside)))


@pytest.mark.parametrize("around", [0.0, 0.3, 0.8])
def test_phones_are_paired_at_the_least_cost(around: float) -> None:
    rng = np.random.default_rng(2)
    for rows, columns in itertools.product(range(1, 5), range(1, 5)):
        changes = rng.uniform(0.0, 1.5, (rows, columns)).round(2)
        pairs = ipa.counterparts(changes.tolist(), 0.8, around)
        assert pairs == sorted(set(pairs))
        assert cost(changes, pairs, 0.8, around) == pytest.approx(cheapest(changes, 0.8, around))
