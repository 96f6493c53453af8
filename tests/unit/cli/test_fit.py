"""``fapengine fit`` and ``inspect`` of what it wrote, through the command line."""

import base64
import csv
import hashlib
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import fapengine
from fapengine import lab
from fapengine.app import fit
from fapengine.batch.corpus import Corpus, parse_manifest
from fapengine.batch.rows import Options, Row
from fapengine.batch.work import Digests, key_of
from fapengine.capture.marker_track import MarkerTrack
from fapengine.cli.main import app
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.motion import load_fap
from fapengine.files.profiles import load_profile
from fapengine.files.recordings import save_markers
from fapengine.files.report import page
from fapengine.files.sessions import load_session
from fapengine.mesh.default_head.head import build_head
from fapengine.models.viseme_space import MARKERS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.targets import weights_of
from tests.command import ran as run

SKULL = {"LFHD": (55, 90, 70), "RFHD": (-55, 90, 70), "LBHD": (70, 70, -40), "RBHD": (-70, 70, -40)}
SPOKEN = ["p", "b", "m", "f", "t", "s", "i", "u", "l"]
TOML = 'subject = "S07"\nhead = ["LFHD", "RFHD", "LBHD", "RBHD"]\nlanguage = "en-GB"\nlicence = "CC0-1.0"\n'
ENDINGS = (".c3d", ".trc", ".csv", ".tsv", ".npz")
TAKES = 8


def textgrid(phones: PhoneTrack) -> str:
    rows = "".join(f'{p.start_s}\n{p.end_s}\n"{"" if p.is_silence else p.label}"\n' for p in phones.phones)
    end = phones.duration_s
    return (
        f'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n{end}\n<exists>\n1\n'
        f'"IntervalTier"\n"phones"\n0\n{end}\n'
        f"{len(phones.phones)}\n{rows}"
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    return record(tmp_path_factory.mktemp("lab") / "S07")


def record(folder: Path) -> Path:
    """A folder as a laboratory has it: takes in five formats, TextGrids beside them, session.toml."""
    folder.mkdir()
    profile, head, rng = load_profile("grid_s1_en"), build_head(), np.random.default_rng(8)
    columns = [profile.space.points.index(name) for name in MARKERS]
    neutral = np.stack([head.point_mm(name) for name in MARKERS]).astype(float)
    for index in range(TAKES):
        phones, now = [Phone("_", 0.0, 0.4)], 0.4
        for label in rng.permutation(SPOKEN):
            length = float(rng.uniform(0.08, 0.18))
            phones.append(Phone(str(label), now, now + length))
            now += length
        track = PhoneTrack((*phones, Phone("_", now, now + 0.4)))
        times = np.arange(round(track.duration_s * 100)) / 100
        moved = neutral + profile.space.to_points_mm(weights_of(track, profile, times, context=False))[:, columns]
        points = np.concatenate([moved, np.tile(np.array([*SKULL.values()], float), (len(times), 1, 1))], axis=1)
        points += rng.normal(0, 0.1, points.shape)
        points[20:25, 3] = np.nan
        take = MarkerTrack(positions_mm=points, labels=(*MARKERS, *SKULL), rate_hz=100.0)
        save_markers(folder / f"take{index:02}{ENDINGS[index % 5]}", take, long=index == 2)
        (folder / f"take{index:02}.TextGrid").write_text(textgrid(track))
    (folder / "session.toml").write_text(TOML)
    return folder


@pytest.fixture(scope="module")
def fitted(recorded, tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("profiles") / "s07"
    told = json.loads(run("fit", recorded, "-o", out, "--faps", "--json").stdout)
    return out, told


def test_a_session_becomes_a_profile_with_its_evidence(fitted):
    out, told = fitted
    profile = load_profile(out)
    assert (profile.id, profile.language, profile.licence) == ("s07", "en-GB", "CC0-1.0")
    assert profile.origin["source"] == "session S07"
    assert profile.origin["command"] == "fapengine fit S07 -o s07 --seed 1"
    assert set(told["phones"]) == set(SPOKEN)
    assert (told["takes"], told["held_out_takes"], told["markers"]) == (TAKES, 2, 14)
    assert told["lips_mm"] < 1.0
    assert told["opening_r"] > 0.9
    silent = [text for text in told["warnings"] if "units are not stated" in text]
    assert [text.split(":")[0] for text in silent] == ["take take02"]  # the long table; the other files say mm


def test_the_report_holds_every_picture_and_nothing_from_outside(fitted):
    out, _ = fitted
    page = (out / "report.html").read_text()
    # markers, gaps, subset, regions, space, components, phones, a take, sentence, via points twice
    assert page.count("<svg") == 11
    for heading in (
        "Gaps",
        "Which markers matter",
        "Viseme space",
        "Phones",
        "From phones back to motion",
        "A sentence with expressions",
        "Via points",
        "Faces",
    ):
        assert f">{heading}</h2>" in page
    assert "video tracker" not in page
    assert "3 standard deviations of each component" in page
    (drawn,) = re.findall(r'alt="The mean of all takes[^"]*" src="data:image/png;base64,([^"]+)"', page)
    assert Image.open(io.BytesIO(base64.b64decode(drawn))).size > (600, 400)
    assert re.search(r"joy moves component \d \(.*sadness moves component \d \(", page)
    assert "<script" not in page
    assert 'src="http' not in page


def test_the_record_names_every_input_and_the_held_out_takes(recorded, fitted):
    out, told = fitted
    record = load_profile(out).record
    assert record is not None
    assert (record.version, record.seed) == (fapengine.__version__, 1)
    assert len(record.held_out) == told["held_out_takes"]
    assert record.inputs == {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(recorded.iterdir())
    }


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))


def test_tables_are_long_and_agree_with_the_profile(fitted):
    out, told = fitted
    tables = {path.stem: rows_of(path) for path in (out / "tables").glob("*.csv")}
    profile = load_profile(out)
    weights = [float(row["weight_mm"]) for row in tables["phones"] if (row["phone"], row["fraction"]) == ("p", "0.3")]
    np.testing.assert_allclose(weights, profile.phones["p"].targets[0], atol=1e-3)
    scores = {(row["take"], row["measure"]): row for row in tables["held_out"]}
    assert len(scores) == 4 * (told["held_out_takes"] + 1)
    assert float(scores["all", "lips_mm"]["value"]) == pytest.approx(told["lips_mm"], abs=5e-4)
    for row in scores.values():
        assert float(row["low"]) <= float(row["value"]) <= float(row["high"])
    count = told["modes"]
    assert {row["k"] for row in tables["component_errors"] if row["take"] == "all"} == {str(k + 1) for k in range(42)}
    assert len(tables["loadings"]) == 14 * count
    assert {row["expression"] for row in tables["sentence"]} == {"none", "joy", "sadness"}
    takes = rows_of(out / "weights" / "take00.csv")
    assert [*takes[0]] == ["time_s", *(f"component_{k + 1}" for k in range(count))]
    assert len(takes) == int(tables["takes"][0]["frames"])


def test_python_fits_as_the_command_does(recorded, fitted):
    out, _ = fitted
    found = lab.fit(lab.read(recorded), name="s07")
    for name, table in lab.tables_of(found).items():
        assert table.to_csv() == (out / "tables" / f"{name}.csv").read_bytes(), name
    assert found.profile.record == load_profile(out).record


def test_captured_takes_are_written_as_faps(fitted):
    out, _ = fitted
    takes = sorted((out / "takes").glob("*.fap"))
    assert len(takes) == TAKES
    assert load_fap(takes[0]).rate_hz == 100.0


def test_the_profile_is_inspected_and_speaks(fitted, tmp_path):
    out, _ = fitted
    text = run("inspect", out).stdout
    assert "jaw opening" in text
    assert "lips" in text
    told = json.loads(run("inspect", out, "--json").stdout)
    assert told["id"] == "s07"
    assert len(told["phones"]) == len(SPOKEN)
    run("inspect", out, "--plot", tmp_path / "faces.png")
    assert (tmp_path / "faces.png").stat().st_size > 50_000
    assert json.loads(run("inspect", "grid_s1_en", "--json").stdout)["format"] == "profile"


def test_a_second_fit_is_the_same_and_may_replace_the_first(recorded, fitted, tmp_path):
    out, _ = fitted
    again = tmp_path / "s07"
    text = run("fit", recorded, "-o", again, "--no-report", "--subset", "4", "--modes", "5").output
    assert "4 markers drive the others" in text
    assert not (again / "report.html").exists()
    run("fit", recorded, "-o", again)
    assert (again / "profile.toml").read_bytes() == (out / "profile.toml").read_bytes()
    for path in sorted(out.rglob("*")):
        if path.is_file() and path.suffix != ".fap":
            assert (again / path.relative_to(out)).read_bytes() == path.read_bytes(), path


def test_what_is_no_profile_is_not_overwritten(recorded, tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("x")
    for target in (tmp_path / "letters", tmp_path / "letters" / "dear.txt"):
        with pytest.raises(UsageError, match="is not a profile"):
            run("fit", recorded, "-o", target)


def test_without_a_renderer_the_report_says_so(monkeypatch):
    def fails(*_):
        raise ResourceError("no OpenGL")

    monkeypatch.setattr("fapengine.app.fit_faces.draw_faces", fails)
    assert fit._faces(None, None) == "no OpenGL"
    assert "Not drawn: no OpenGL." in "".join(page._faces("no OpenGL"))


def test_without_matplotlib_nothing_is_written(recorded, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    monkeypatch.setattr(fit, "load_session", lambda *_, **__: pytest.fail("it began to work"))
    with pytest.raises(ResourceError, match=r'pip install -e "\.\[lab\]"\); fit works without it by --no-report'):
        run("fit", recorded, "-o", tmp_path / "p")
    assert not (tmp_path / "p").exists()


def copy(recorded: Path, folder: Path, toml: str = TOML, keep: int = 2) -> Path:
    folder.mkdir()
    for path in sorted(recorded.iterdir())[: 2 * keep + 1]:
        if path.name != "session.toml":
            (folder / path.name).write_bytes(path.read_bytes())
    (folder / "session.toml").write_text(toml)
    return folder


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        (TOML + "speed = 3\n", "'speed' is unknown"),
        (TOML + "[points]\nLFHD = '99.9'\n", "expected a feature point such as 8.2"),
        (TOML + "[neutral]\ntake = 'take00'\n", "'start_s' is missing"),
        (
            TOML + "[[pose]]\nexpression = 'glee'\ntake = 'take00'\nstart_s = 0\nend_s = 1\n",
            "one of the six expressions",
        ),
        (TOML + "[[pose]]\nexpression = 'joy'\ntake = 'none'\nstart_s = 0\nend_s = 1\n", "'none': unknown take"),
        (TOML + "[fapu_mm]\nes0 = 'wide'\n", "got 'wide', expected a number"),
        (TOML + "[landmarks]\nwidth_px = 640.0\nheight_px = 1\neye_corners_mm = 90\n", "got no rate_hz"),
        (TOML + "rate_hz = 25\n[landmarks]\nwidth_px = 640.0\n", "'height_px' is missing"),
        (
            TOML + "rate_hz = 25\n[landmarks]\nwidth_px = 0\nheight_px = 1\neye_corners_mm = 90\n",
            "width_px: must be positive, got 0",
        ),
        ("head = [3]\n", "got 3, expected a string"),
        ("head = \n", "is not TOML"),
        (TOML + "[[scan]]\nfile = 'none.ply'\nlandmarks = {}\n", "none.ply: cannot be read"),
        (TOML + 2 * "[[scan]]\nfile = 'a.ply'\nlandmarks = {}\nreference = true\n", "expected one reference"),
        (TOML + "points = 3\n", "got 3, expected a table"),
        (TOML + "[[pose]]\n[[pose]]\n", "'take' is missing"),
        (TOML + "[[pose]]\ntake = 'take00'\nstart_s = 0\nend_s = 1\n", "expected an expression or a phone"),
        (TOML + "[[pose]]\nphone = '7'\ntake = 'take00'\nstart_s = 0\nend_s = 1\n", "got '7', expected a phone in IPA"),
    ],
)
def test_session_toml_is_read_strictly(recorded, tmp_path, toml, message):
    folder = copy(recorded, tmp_path / "S", toml)
    with pytest.raises((DataError, UsageError), match=message):
        run("fit", folder, "-o", tmp_path / "p")


def test_a_session_is_inspected(recorded):
    told = json.loads(run("inspect", recorded, "--json").stdout)
    assert (told["format"], told["subject"], len(told["takes"])) == ("session", "S07", TAKES)
    assert told["takes"]["take00"]["phones"] == len(SPOKEN) + 2  # silence at both ends
    assert told["takes"]["take00"]["seen"] < 1.0
    assert f"session S07: {TAKES} takes of 18 markers at 100 Hz" in run("inspect", recorded).stdout


def test_folders_that_are_no_session(tmp_path):
    with pytest.raises(UsageError, match="not a folder"):
        load_session(tmp_path / "none")
    with pytest.raises(UsageError, match="contains none of"):
        load_session(tmp_path)


def test_a_take_with_other_markers_is_named(recorded, tmp_path):
    folder = copy(recorded, tmp_path / "S")
    odd = MarkerTrack(positions_mm=np.ones((200, 3, 3)) * [[[1], [40], [90]]], labels=("a", "b", "c"), rate_hz=100.0)
    save_markers(folder / "zz.c3d", odd)
    with pytest.raises(DataError, match="take zz"):
        load_session(folder)


def test_phones_behind_the_recording_are_told(recorded, tmp_path):
    folder = copy(recorded, tmp_path / "S")
    long = PhoneTrack((Phone("_", 0.0, 0.4), Phone("a", 0.4, 50.0), Phone("p", 50.0, 51.0)))
    (folder / "take00.TextGrid").write_text(textgrid(long))
    loaded = load_session(folder)
    assert any("2 phones end after the recording" in text for text in loaded.warnings)


def test_scans_in_their_folder_are_no_takes(recorded, tmp_path):
    scans = (
        f"[[scan]]\nfile = 'scans/{name}.obj'\nlandmarks = {{ '8.1' = [0, 1, 2] }}\n{reference}"
        for name, reference in (("a", ""), ("b", "reference = true\n"), ("c", ""))
    )
    folder = copy(recorded, tmp_path / "S", TOML + "".join(scans))
    (folder / "scans").mkdir()
    for name in "abc":
        (folder / "scans" / f"{name}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    loaded = load_session(folder)
    assert len(loaded.session.takes) == 2
    assert loaded.setup.scans[0].landmarks == {"8.1": (0.0, 1.0, 2.0)}
    assert [scan.name for scan in loaded.setup.scans] == ["scans/b.obj", "scans/a.obj", "scans/c.obj"]


def test_many_subjects_are_what_fit_makes_of_each_and_a_bad_one_is_a_row(tmp_path: Path, recorded: Path) -> None:
    sessions, single, many = tmp_path / "sessions", tmp_path / "single", tmp_path / "many"
    sessions.mkdir()
    for name in ("anna", "bad"):
        copy(recorded, sessions / name, keep=5)
    for path in (sessions / "bad").glob("*.TextGrid"):
        path.write_text("nothing of the kind")
    pattern = str(sessions / "*")
    run("fit", sessions / "anna", "-o", single / "anna", "--no-report")
    manifest = tmp_path / "subjects.csv"
    manifest.write_text("id,session,report\nanna,sessions/anna,false\nbad,sessions/bad,false\n")
    result = CliRunner().invoke(app, ["batch", str(manifest), "-o", str(many), "--to", "profile", "--workers", "0"])
    assert result.exit_code == 2, result.output
    assert "2 rows: 1 done, 1 failed" in result.output
    assert "bad" in (many / "index.csv").read_text()
    written = _files(single / "anna")
    assert written == _files(many / "anna")
    for name in written:
        assert (single / "anna" / name).read_bytes() == (many / "anna" / name).read_bytes()
    before = (many / "anna" / "profile.toml").stat().st_mtime_ns
    again = CliRunner().invoke(app, ["batch", str(manifest), "-o", str(many), "--to", "profile", "--workers", "0"])
    assert again.exit_code == 2  # it is left as it is, and so is what failed
    assert (many / "anna" / "profile.toml").stat().st_mtime_ns == before
    assert [row.id for row in Corpus(manifest=pattern, kind="profile").rows()] == ["anna", "bad"]
    (sessions / "bad" / "new.txt").write_text("x")
    assert key_of(*_row_and_kind(sessions / "bad")) != key_of(*_row_and_kind(sessions / "anna"))


def _files(folder: Path) -> list[Path]:
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def _row_and_kind(session: Path) -> tuple[Row, str, Digests]:
    return Row(id="one", session=session), "profile", Digests()


@pytest.mark.parametrize(
    ("table", "kind", "told"),
    [
        ("id,session\na,gone\n", "profile", "expected an existing folder"),
        ("id,session,text\na,.,Hello.\n", "profile", "combined with text, timings or audio"),
        ("id,text\na,Hello.\n", "profile", "needs a folder of recordings"),
        ("id,session\na,.\n", "fap", "only a profile"),
        ("id,session,held_out\na,.,0.9\n", "profile", "held"),
    ],
)
def test_a_table_of_subjects_is_checked_before_anything(tmp_path: Path, table: str, kind: str, told: str) -> None:
    with pytest.raises(DataError, match=told):
        parse_manifest(table.encode(), "subjects.csv", tmp_path, kind, Options())
