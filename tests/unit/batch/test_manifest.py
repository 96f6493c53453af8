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
