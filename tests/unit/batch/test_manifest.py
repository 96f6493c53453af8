"""Manifests: every mistake at once, with its line."""

from pathlib import Path

import pytest

from fapengine.app.manner import manner_of
from fapengine.batch.corpus import parse_manifest, rows_of_pattern
from fapengine.batch.rows import Options, Row
from fapengine.errors import DataError, UsageError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.pho").write_text("_ 100\na 200\n")
    (tmp_path / "a.wav").write_bytes(b"RIFF")
    return tmp_path


def rows(text: str, folder: Path, kind: str = "fap") -> tuple[Row, ...]:
    return parse_manifest(text.encode(), "corpus.csv", folder, kind, Options())


def test_a_table(folder: Path) -> None:
    text = 'id,text,timings,audio,expression,fps,without\none,"Hello, you.",,,joy:0.4; anger:0.1,25,\n'
    text += "x/two,,a.pho,a.wav,,,all\n"
    one, two = rows(text, folder)
    assert (one.id, one.text, one.options.fps, one.line) == ("one", "Hello, you.", 25.0, 2)
    assert one.options.expression == ("joy:0.4", "anger:0.1")
    assert (two.timings, two.audio, two.text) == (folder / "a.pho", folder / "a.wav", None)
    assert two.output(Path("out"), "fap") == Path("out/x/two.fap")
    assert manner_of(two.options).style.blinks is False


def test_lines_of_json_say_the_same(folder: Path) -> None:
    table = rows("id,text,expression,seed,ssml\na,Hi.,joy:0.4,3,true\n", folder)
    lines = rows(
        '{"id": "a", "text": "Hi.", "expression": ["joy:0.4"], "seed": 3, "ssml": true, "fps": null}\n', folder
    )
    assert [(row.id, row.text, row.options) for row in table] == [(row.id, row.text, row.options) for row in lines]


def test_all_mistakes_are_told_at_once(folder: Path) -> None:
    text = (
        "id,text,timings,fps,seed,expression,profile\n"
        "good,Hello.,,,,,\n"
        "../up,Hello.,,,,,\n"
        "none,,,,,,\n"
        "gone,,b.pho,,,,\n"
        "fast,Hello.,,many,,,\n"
        "happy,Hello.,,,,glee:1,\n"
        "GOOD,Hello.,,,,,\n"
        "both,Hello.,a.pho,,,,\n"
    )
    with pytest.raises(DataError) as raised:
        rows(text, folder)
    told = raised.value.message.splitlines()
    assert told[0] == "corpus.csv: 7 invalid rows:"
    expected = (
        "line 3: id: got '../up'", "line 4: row: text, timings and audio are missing",
        "line 5: timings: got b.pho, expected an existing file",
        "line 6: fps: ", "line 7: expressions: got 'glee'", "line 8: id: got 'GOOD' again, as in line 2",
        "line 9: text: cannot be combined with timings",
    )  # fmt: skip
    for line, begins in zip(told[1:], expected, strict=True):
        assert line.startswith(begins)


def test_everything_that_can_be_known_is_told_before_any_work(folder: Path) -> None:
    text = (
        "id,text,timings,audio,voice,profile,language,format,alphabet,columns,shapes,head\n"
        "voice,Hello.,,,klingon9,,,,,,,\n"
        "own,Hello.,,,no.such:Voice,,,,,,,\n"
        "profile,Hello.,,,,nobody,,,,,,\n"
        "language,,a.pho,,,,martian,,,,,\n"
        "transcript,Hello.,,a.wav,,,martian,,,,,\n"
        "format,,a.pho,,,,,nothing,,,,\n"
        "alphabet,,a.pho,,,,,,greek,,,\n"
        "columns,,a.pho,,,,,,,begin=a,,\n"
        "shapes,Hello.,,,,,,,,,foo,\n"
        "sound,,,b.wav,,,,,,,,\n"
        "cells,Hello.,,,,,,,,,,,,\n"
        "head,Hello.,,,,,,,,,,nobody\n"
    )
    with pytest.raises(DataError) as raised:
        rows(text, folder, "png")
    told = raised.value.message.splitlines()
    expected = (
        "voice: got 'klingon9'", "voice: no.such:Voice cannot be imported", "profile: ", "voice: got 'martian'",
        "voice: got 'martian'", "format: unknown value 'nothing'", "alphabet: unknown value 'greek'", "columns: ",
        "shapes: got 'foo'", "audio: got b.wav", "got 14 cells, expected 12", "head: ",
    )  # fmt: skip
    for number, (line, begins) in enumerate(zip(told[1:], expected, strict=True), start=2):
        assert line.startswith(f"line {number}: {begins}"), line


def test_bad_rows_can_be_left_out(folder: Path) -> None:
    bad: dict[str, str] = {}
    text = "id,text\ngood,Hello.\n../up,Hello.\nmore,Hello.,Hello.\n"
    (good,) = parse_manifest(text.encode(), "corpus.csv", folder, "fap", Options(), bad)
    assert good.id == "good"
    assert list(bad) == ["line 3", "line 4"]
    with pytest.raises(DataError, match="contains no valid rows"):
        parse_manifest(b"id,text\n..,Hello.\n", "corpus.csv", folder, "fap", Options(), bad)


def test_all_transcripts_that_are_missing_are_told(folder: Path) -> None:
    for name in ("b.wav", "c.wav"):
        (folder / name).write_bytes(b"RIFF")
    paths = [folder / name for name in ("b.wav", "c.wav")]
    with pytest.raises(DataError, match=r"2 invalid rows:\nb\.wav: .*\nc\.wav: "):
        rows_of_pattern(paths, str(folder / "{stem}.txt"), "fap", Options())


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("id,txt\na,b\n", "unknown 'txt'"),
        ("text\nHello.\n", "expected id"),
        ("id,text\n", "contains no rows"),
        ("id,text\na,Hello, you.\n", "got 3 cells, expected 2"),
        ('id,text\na,"Hello\n', "is not a table"),
        ('{"id": 1,\n', "is not JSON"),
        ('{"id": "a", "text": "Hi.", "colour": 1}\n', "colour: got an unknown column"),
    ],
)
def test_what_is_no_manifest(folder: Path, text: str, told: str) -> None:
    with pytest.raises(DataError, match=told):
        rows(text, folder)


def test_options_are_checked_for_what_rows_become(folder: Path) -> None:
    assert rows("id,text,size\na,Hi.,33x33\n", folder, "fap")
    with pytest.raises(DataError, match="even sides"):
        rows("id,text,size\na,Hi.,33x33\n", folder, "mp4")
    with pytest.raises(DataError, match="into: missing"):
        rows("id,text\na,Hi.\n", folder, "glb")


def test_a_pattern_s_files_are_named_by_their_stems(folder: Path) -> None:
    (folder / "a.txt").write_text("Hello.\n")
    recording, timings = folder / "a.wav", folder / "a.pho"
    (row,) = rows_of_pattern([recording], str(folder / "{stem}.txt"), "fap", Options())
    assert (row.id, row.audio, row.text) == ("a", recording, "Hello.")
    assert rows_of_pattern([timings], None, "fap", Options())[0].timings == timings
    with pytest.raises(UsageError, match="two files called a"):
        rows_of_pattern([recording, timings], None, "fap", Options())
