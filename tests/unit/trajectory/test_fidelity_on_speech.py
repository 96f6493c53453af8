"""The default method on held-out sentences of speech, made and captured: docs/measurements.md, bench/fidelity.py."""

from pathlib import Path

import numpy as np
import pytest

from bench import fidelity
from design.speech_sample import load_statistics, make

PAPER = "phone medians at 30 %, natural cubic (paper 001)"
LIMITS = {"captured": (1.56, 1.95, 0.86), "made": (1.85, 2.3, 0.78)}
"""Lip error of the default, of the paper's method, mm; correlation of the opening."""


@pytest.fixture(params=["made", pytest.param("captured", marks=[pytest.mark.shared, pytest.mark.nightly])])
def speech(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    if request.param == "captured":
        return request.param, request.getfixturevalue("shared") / "data" / "speech_train.npz"
    np.savez(tmp_path / "made.npz", **make(load_statistics(), 80))
    return request.param, tmp_path / "made.npz"


def test_the_default_is_nearer_to_the_lips_than_the_paper_and_closes_them(speech: tuple[str, Path]) -> None:
    kind, path = speech
    corpus = fidelity.load(path)
    shuffled = np.random.default_rng(fidelity.SEED).permutation(len(corpus.clips))
    held_out = [corpus.clips[index] for index in shuffled[: len(shuffled) * 100 // 520]]
    training = [corpus.clips[index] for index in sorted(shuffled[len(held_out) :])]
    learned = fidelity.learn(training, corpus.rate_hz)
    figures = {}
    for name in (fidelity.DEFAULT, PAPER):
        times = [np.arange(len(clip.points)) / corpus.rate_hz for clip in held_out]
        move = fidelity.METHODS[name]
        points = [move(clip, learned.profile, at) for clip, at in zip(held_out, times, strict=True)]
        lips = [fidelity.to_lips(moved, learned.lift) for moved in points]
        figures[name] = fidelity.judge(corpus, held_out, lips)
    ours, paper = figures[fidelity.DEFAULT], figures[PAPER]
    lips_mm, paper_mm, opening_r = LIMITS[kind]
    assert ours["lips_mm"] < lips_mm
    assert 1.1 * ours["lips_mm"] < paper["lips_mm"] < paper_mm
    assert ours["opening_r"] > max(opening_r, paper["opening_r"])
    assert ours["closed"] == 1.0
