"""``fapengine score``: files in, figures as words, JSON and a page."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import fapengine
from fapengine.cli.main import app
from fapengine.errors import DataError, UsageError
from fapengine.files.sound import save_wav


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "200"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def talk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with ``talk.fap``, ``.fba``, ``.csv``, ``.lab``, ``.wav``: My baby fell off five boats."""
    folder = tmp_path_factory.mktemp("talk")
    spoken = fapengine.speak("My baby fell off five boats. Bright moonbeams move over a harbour.", rate_hz=60.0)
    for name, shapes in (
        ("talk.fap", "arkit"),
        ("talk.fba", "arkit"),
        ("talk.csv", "arkit"),
        ("visemes.csv", "oculus"),
    ):
        spoken.save(folder / name, shapes=shapes)
    assert spoken.sound is not None
    save_wav(folder / "talk.wav", *spoken.sound)
    rows = [f"{phone.start_s * 1e7:.0f} {phone.end_s * 1e7:.0f} {phone.label}" for phone in spoken.phones.phones]
    (folder / "talk.lab").write_text("\n".join(rows).replace(" _", " sil") + "\n", encoding="utf-8")
    return folder


def test_everything_at_once(talk: Path, tmp_path: Path) -> None:
    said = run(
        "score", talk / "talk.fap", "--against", talk / "talk.fap", "--phones", talk / "talk.lab",
        "--audio", talk / "talk.wav", "-o", tmp_path / "score.html",
    )  # fmt: skip
    assert re.search(r"p b m that close +100 % \((\d+) of \1\)", said)
    assert re.search(r"LVE +0.00 mm²", said)
    assert "SLCC" in said
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 1
    assert "mean temporal misalignment" in page
    assert not re.search(r'(src|href)="(?!#)', page.replace("xlink:href", ""))


@pytest.mark.parametrize(("name", "opening_r"), [("talk.fba", 0.99), ("talk.csv", 0.97), ("visemes.csv", 0.85)])
def test_recordings_of_every_kind(talk: Path, name: str, opening_r: float) -> None:
    found = json.loads(run("score", talk / name, "--against", talk / "talk.fap", "--json"))
    assert found["truth"]["likeness"]["opening_r"] > opening_r
    assert abs(found["truth"]["timing"]["lag_ms"]) < 15
    assert found["phones"] is None


def test_the_plan_may_stand_for_a_truth(talk: Path) -> None:
    said = run("score", talk / "talk.fap", "--phones", talk / "talk.lab", "--plan")
    assert "own plan of the phones, not with a person" in said
    found = json.loads(run("score", talk / "talk.fap", "--phones", talk / "talk.lab", "--plan", "--json"))
    assert found["truth"]["likeness"]["opening_r"] > 0.98
    assert found["truth"]["behaviour"]["blinks"] == 0


def test_alone_it_says_that_nothing_was_compared(talk: Path) -> None:
    said = run("score", talk / "talk.fap")
    assert "No reference" in said
    assert "blinks a minute" in said


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("talk.fap", "--plan"), UsageError, "--plan: requires phones"),
        (("talk.fap", "-o", "score.pdf"), UsageError, "--output: got score.pdf"),
        (("talk.wav",), DataError, "talk.wav"),
        (("none.fap",), UsageError, "cannot be read"),
        (("talk.fap", "--against", "talk.lab"), DataError, "talk.lab"),
    ],
)
def test_bad_input_is_one_error(
    talk: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], error: type[Exception], message: str
) -> None:
    monkeypatch.chdir(talk)
    with pytest.raises(error, match=message):
        run("score", *arguments)


def test_timings_are_read_as_is_said(talk: Path) -> None:
    unnamed = talk / "timings.txt"
    unnamed.write_bytes((talk / "talk.lab").read_bytes())
    first = json.loads(run("score", talk / "talk.fap", "--phones", talk / "talk.lab", "--json"))
    again = json.loads(run("score", talk / "talk.fap", "--phones", unnamed, "--format", "htk", "--json"))
    assert again == first
    unnamed.write_text("what is this?\n", encoding="utf-8")
    with pytest.raises(DataError, match="choose one with --format NAME"):
        run("score", talk / "talk.fap", "--phones", unnamed)
    with pytest.raises(UsageError, match=r"--tier: requires --phones"):
        run("score", talk / "talk.fap", "--tier", "phones")
