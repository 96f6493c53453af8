"""Mistakes made on purpose are noticed; ``python design/mutations.py`` makes them all, these tests the quickest few.

* zero run: the arithmetic coder stuffs a one after 22 zeros: without it every other decoder reads another stream
* proof of an I plane: noise is not taken for a stream: eight planes must decode behind an I plane of unknown shape
* frames held back: no frame decoded out of damage is shown
* marker bits: a marker bit stands before every fourth sent bound
* time code: a time code sets the clock at its plane, and time goes on from there
* chin on the jaw: FAP 18 moves the chin against the jaw: what the jaw carries is taken off
* margin of rest: the face is neutral 120 ms after the last phone
* shortest pause: a pause of a tenth of a second or longer passes through rest
* length of a closure: lips that touch stay together for 40 ms
* quintic: value, velocity and acceleration are continuous along the path
* eyes counter the head: the gaze rests where it was while the head turns (vestibulo-ocular reflex)
* phones ahead: phones that come five phones early give the offline path
* jump to the sound: sound that is 80 ms off is jumped to
* late phones: the sender is told how many phones came late
* repeats of what is over: a datagram that comes twice does not start an utterance again
* end of a gap: phones that are missing are concealed up to the next one
* sound outranks the clock: while a sender tells where its sound is, the clocks do not move the face
* repeated begin: a begin that comes twice is counted and changes nothing
* padding: an OSC string ends with at least one NUL
* offset of a clock: the offset is the mean of both ways
* late time tags: tags far behind are believed at the third
* when to ask again: a sender is told ten times of an utterance that was never begun
* number of a frame: frames are numbered without gaps: a receiver counts what was lost
* turn to the left: a head that turns left turns left in VMC too
* escapes of SLIP: any bytes go through a stream
* numbers ahead: no receiver takes the last frame of a killed server for a late one
* taking turns: a flood from one sender keeps nobody else waiting
* scaled pauses: VOICEVOX multiplies pauses by pauseLengthScale
* overlap of labels: labels that overlap by more than is rounded away are refused
* inside of a skin: feature points lie on the outside of a skin that has an inside
* ridge: blendshapes reach the pose that FAPs ask for
"""

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from design.mutations import MUTATIONS, ROOT, Mutation, clone, judge

BY_NAME = {mutation.name: mutation for mutation in MUTATIONS}


def test_the_list_above_is_the_list_that_is_run() -> None:
    assert len(BY_NAME) == len(MUTATIONS) >= 20
    written = [line.removeprefix("* ") for line in str(__doc__).splitlines() if line.startswith("* ")]
    assert written == [f"{mutation.name}: {mutation.why}" for mutation in MUTATIONS]
    rooms = {"codec", "trajectory", "engine", "wire"}
    assert all(any(mutation.file.startswith(f"fapengine/{room}") for mutation in MUTATIONS) for room in rooms)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=BY_NAME)
def test_each_can_be_made_and_its_tests_are_there(mutation: Mutation) -> None:
    assert (ROOT / mutation.file).read_text().count(mutation.old) == 1
    assert mutation.new != mutation.old
    for test in mutation.tests:
        path, _, name = test.partition("::")
        assert (ROOT / path).exists(), test
        assert not name or name in functions(ROOT / path), test


def functions(path: Path) -> set[str]:
    return {node.name for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)}


@pytest.fixture(scope="module")
def copy() -> Iterator[Path]:
    with clone() as folder:
        assert not (folder.parent / "shared").exists()
        yield folder


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["padding", "offset of a clock"])
def test_the_quickest_are_noticed(copy: Path, name: str) -> None:
    assert judge(copy, BY_NAME[name]) == "killed"


def test_what_is_not_noticed_is_told(copy: Path) -> None:
    padding = BY_NAME["padding"]
    assert judge(copy, replace(padding, tests=("tests/unit/wire/test_protocol_clock.py",))) == "survived"
    assert judge(copy, replace(padding, tests=("tests/no_such_test.py",))) == "broken"
    assert judge(copy, replace(padding, old="no such text")) == "broken"
    assert (copy / padding.file).read_bytes() == (ROOT / padding.file).read_bytes()
