"""The judge of bench/intelligible, from end to end on a few made sentences; how well it reads is the bench's matter."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench import fidelity, intelligible, measures
from bench.judge import Example, Judge, decode, frame_labels, make_grammar
from bench.new_words import deal_words, only_words
from design.speech_sample import load_statistics, make


@pytest.fixture(scope="module")
def speech(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("speech") / "made.npz"
    np.savez(path, **make(load_statistics(), 24))
    return path


def changed(speech: Path, folder: Path, **arrays: object) -> Path:
    """The same file with some arrays replaced, or left out where they are None."""
    data = dict(np.load(speech)) | arrays
    path = folder / "changed.npz"
    np.savez(path, **{name: array for name, array in data.items() if array is not None})
    return path


def example(clip: fidelity.Clip) -> Example:
    return Example(measures.seen(clip.points, fidelity.NAMES), clip.phones, clip.words)


def test_words_are_found_again_where_every_frames_phone_is_known(speech: Path) -> None:
    corpus = fidelity.load(speech)
    examples = [example(clip) for clip in corpus.clips]
    grammar = make_grammar(examples, corpus.rate_hz)
    right = []
    for one in examples:
        sure = np.full((len(one.motion), len(grammar.labels)), -8.0)
        sure[np.arange(len(sure)), frame_labels(one, grammar.labels, corpus.rate_hz)] = 0.0
        words = decode(grammar, sure)
        assert len(words) == 6
        right += [word == said.text for word, said in zip(words, one.words, strict=True)]
    assert np.mean(right) > 0.97  # a phone of less than a frame may be missed


def test_every_word_is_left_out_once_and_the_other_words_stay(speech: Path) -> None:
    corpus = fidelity.load(speech)
    four = [clip for clip in corpus.clips if any(word.text == "four" for word in clip.words)]
    folds = deal_words(corpus.clips)
    said = {word.text for clip in corpus.clips for word in clip.words}
    assert sorted(word for fold in folds for word in fold) == sorted(said)
    assert folds == deal_words(corpus.clips)
    clips = [*four, *corpus.clips[:4]]
    learned = fidelity.learn(clips, corpus.rate_hz)
    without = fidelity.learn_phones(learned, clips, without=frozenset({"four"}))
    assert "ɔ" in learned.profile.phones
    assert "ɔ" not in without.phones, "no other word has it"
    shown = only_words(four[0], frozenset({"four"}), corpus.rate_hz)
    assert shown is not None
    assert [phone.label for phone in shown.phones.phones if not phone.is_silence] == ["f", "ɔ", "ɹ"]
    assert 0 < shown.spoken.sum() < four[0].spoken.sum()


SMALL = """
import sys
from bench import fidelity, intelligible, judge, measures, new_words

measures.EPOCHS, judge.BLOCKS, judge.CHANNELS, new_words.FOLDS = 1, (1,), 8, 2
measures.COMPARED = {name: measures.COMPARED[name] for name in ("captured", "default")}
command = {"intelligible": intelligible, "fidelity": fidelity}[sys.argv[1]]
sys.exit(command.main(["--train", sys.argv[2], "--test", sys.argv[2], "--json"]))
"""
"""The smallest of judges. It has a process of its own: JAX starts threads, and a test beside it could not fork."""


@pytest.mark.nightly
def test_both_commands_print_the_same_figures(speech: Path, tmp_path: Path) -> None:
    found = []
    for command in ("intelligible", "fidelity"):
        done = subprocess.run(
            [sys.executable, "-c", SMALL, command, str(speech)],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[3])},
            capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout))
    assert found[0] == found[1]
    assert len(list(tmp_path.glob("fapengine/judge-*.npz"))) == 1  # the second takes the first one's judge
    captured, default = (found[0]["methods"][name] for name in ("captured", "default"))
    assert captured["lips_xy_mm"] < 0.1 < default["lips_xy_mm"] < default["lips_xy_mm_new"]
    assert default["closed"] == default["closed_new"] == 1.0
    for row in (captured, default):
        assert 0.0 <= row["word_error_known"] <= 1.0
        assert 0.0 <= row["word_error_new"] <= 1.0


def test_a_judge_tells_what_it_was_shown(speech: Path) -> None:
    """Without its network: the grammar goes with frames of any length, and one word too many is no crash."""
    corpus = fidelity.load(speech)
    examples = [example(clip) for clip in corpus.clips[:5]]
    grammar = make_grammar(examples, corpus.rate_hz)
    flat = np.full((40, len(grammar.labels)), -3.0)
    assert len(decode(grammar, flat)) == 6
    assert isinstance(Judge(np.zeros(36), np.ones(36), {}, grammar, 25.0).grammar.words, tuple)


CASES = {
    "words": ({"word": None}, "has no words, expected word, word_clip"),
    "phones": ({"phone": None}, "'phone' is missing, expected an .npz as design/make_speech_data.py writes it"),
    "rate": ({"fps": np.float32(50)}, "got 50 frames/s, expected 25 as in --train"),
    "lengths": ({"n_frames": np.full(24, 80, np.int32)}, "expected an .npz as design/make_speech_data.py writes it"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_file_that_is_not_one_is_told_of_in_one_line(speech: Path, tmp_path: Path, case: str) -> None:
    arrays, told = CASES[case]
    path = changed(speech, tmp_path, **arrays)
    with pytest.raises(SystemExit) as error:
        intelligible.main(["--train", str(speech), "--test", str(path)])
    message = str(error.value)
    assert message.startswith(f"error: {path}: ")
    assert told in message
    assert "\n" not in message


def test_a_file_that_is_no_archive_is_told_of_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "notes.npz"
    path.write_text("no numbers")
    with pytest.raises(SystemExit, match=f"error: {path}: .*expected an .npz"):
        fidelity.load(path)
