"""Remarks on motion: wrong units, still faces, lips that never meet; in Python and on the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import fapengine
from fapengine.cli.main import app
from fapengine.errors import DataError
from fapengine.mpeg4.track import motion_remarks
from fapengine.retarget.blend_tracks import format_blend_csv

JAW, UPPER, LOWER = 2, 3, 4
WAVE = np.rint(200 * (1 - np.cos(np.linspace(0, 12 * np.pi, 90)))).astype(int)


def track(scale: float = 1.0, apart: int = 0) -> fapengine.FapTrack:
    values = np.zeros((90, 68), int)
    values[:, JAW], values[:, LOWER] = WAVE * scale, -WAVE * scale - apart
    return fapengine.FapTrack.from_values(values, rate_hz=30.0)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (track(), None),
        (
            track(0.01),
            "motion: the mouth moves by 4 FAPU at most (0.4 % of a distance of the face); is the unit right?",
        ),
        (track(0), "motion: no FAP moves in 90 frames"),
        (track(50), "motion: in 7"),
        (
            track(apart=300),
            "motion: the lips never meet in 3.0 s, and stay 29 % of the distance from mouth to nose apart",
        ),
        (track(apart=300)[:30], None),
    ],
)
def test_what_is_remarked(made: fapengine.FapTrack, said: str | None) -> None:
    remarks = motion_remarks(made)
    assert len(remarks) == (said is not None)
    assert said is None or remarks[0].startswith(said)


def test_planned_speech_has_no_remarks() -> None:
    phones = [fapengine.Phone("ma"[n % 2], 0.1 * n, 0.1 * n + 0.1) for n in range(30)]
    assert motion_remarks(fapengine.animate(fapengine.PhoneTrack.from_phones(phones)).track) == ()


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """ARKit's weights and the head's turns in per cent and degrees, as some programs export them."""
    header, *rows = format_blend_csv(track()).decode().splitlines()
    lines = []
    for row in rows:
        time, *cells = row.split(",")
        weights = [f"{100 * float(cell):.3f}" for cell in cells[:52]]
        lines.append(",".join([time, *weights, "10.0", "0.0", "0.0"]))
    path = tmp_path_factory.mktemp("table") / "a.csv"
    path.write_text("\n".join([header, *lines]))
    return path


def test_per_cent_and_degrees_are_read_and_that_is_said(table: Path) -> None:
    read = fapengine.load(table)
    assert [remark.partition(" up to")[0] for remark in read.remarks] == [
        "blend shapes: weights", "blend shapes: turns of the head",
    ]  # fmt: skip
    fapengine.save(track(), table.with_name("right.csv"))
    right = fapengine.load(table.with_name("right.csv"))
    assert right.remarks == ()
    assert np.abs(read.values[:, :47] - right.values[:, :47]).max() <= 2
    assert read.column("head_yaw")[0] == pytest.approx(np.deg2rad(10) * 1e5, rel=0.01)
    with pytest.raises(DataError, match="were read as per cent"):
        fapengine.load(table, strict=True)


def test_weights_that_are_no_per_cent_are_refused(table: Path) -> None:
    wrong = table.with_name("wrong.csv")
    wrong.write_text(table.read_text().replace(",0.000", ",4096"))
    with pytest.raises(DataError, match=r"got a weight of 4096, expected 0\.\.1"):
        fapengine.load(wrong)


def test_encode_and_batch_are_strict_too(tmp_path: Path) -> None:
    fapengine.save(track(0), tmp_path / "still.fap")
    words = ["encode", str(tmp_path / "still.fap"), "-o", str(tmp_path / "still.fba")]
    assert "no FAP moves" in CliRunner().invoke(app, words).stderr
    strict = CliRunner().invoke(app, [*words, "--strict"])
    assert "no FAP moves" in str(strict.exception)
    (tmp_path / "a.pho").write_text("m 900\na 900\n" * 6)
    (tmp_path / "rows.csv").write_text("id,timings\na,a.pho\n")
    words = ["batch", str(tmp_path / "rows.csv"), "--to", "fap", "--workers", "0", "-o", str(tmp_path / "out")]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert CliRunner().invoke(app, [*words, "--strict"]).exit_code == 2


@pytest.mark.parametrize("words", ["convert {} -o out.fap", "inspect {}", "render {} --size 64x64 -o out.png"])
def test_the_command_line_says_so_too(words: str, table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, [*words.format(table).split(), "--json"])
    assert done.exit_code == 0, done.output
    assert any("were read as per cent" in remark for remark in json.loads(done.stdout)["remarks"])
    strict = CliRunner().invoke(app, [*words.format(table).split(), "--strict"])
    assert isinstance(strict.exception, DataError)
    assert "were read as per cent" in str(strict.exception)
