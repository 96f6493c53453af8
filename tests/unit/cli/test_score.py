"""``fapengine score``: files in, figures as words, JSON and a page."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import fapengine
from fapengine.errors import DataError, UsageError
from fapengine.files.sound import save_wav
from fapengine.files.timings import load_timings
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ARKIT_NAMES
from tests.command import run
from tests.unit.files.glb import Builder


def rig() -> bytes:
    """An avatar of three vertices, with ARKit's shapes."""
    builder = Builder()
    corners = builder.accessor(np.eye(3))
    item = {"attributes": {"POSITION": corners}, "targets": [{"POSITION": corners}] * len(ARKIT_NAMES)}
    builder.node(mesh=builder.row("meshes", {"primitives": [item], "extras": {"targetNames": list(ARKIT_NAMES)}}))
    return builder.glb()


@pytest.fixture(scope="module")
def talk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with ``talk.fap``, ``.fba``, ``.csv``, ``.lab``, ``.wav`` ...: My baby fell off five boats."""
    folder = tmp_path_factory.mktemp("talk")
    spoken = fapengine.speak("My baby fell off five boats. Bright moonbeams move over a harbour.", rate_hz=60.0)
    shapes = {"talk.csv": "arkit", "visemes.csv": "oculus", "presets.vrma": "vrm1", "arkit.vrma": "arkit"}
    for name in ("talk.fap", "talk.fba", *shapes):
        spoken.save(folder / name, shapes=shapes.get(name))
    (folder / "rig.glb").write_bytes(rig())
    spoken.save(folder / "avatar.glb", into=folder / "rig.glb")
    fapengine.save(spoken.track * 0, folder / "dead.csv")
    fapengine.save(FapTrack.from_values(np.roll(spoken.track.values, 9, axis=0), rate_hz=60.0), folder / "late.csv")
    assert spoken.sound is not None
    save_wav(folder / "talk.wav", *spoken.sound)
    rows = [f"{phone.start_s * 1e7:.0f} {phone.end_s * 1e7:.0f} {phone.label}" for phone in spoken.phones.phones]
    (folder / "talk.lab").write_text("\n".join(rows).replace(" _", " sil") + "\n", encoding="utf-8")
    return folder


def test_everything_at_once(talk: Path, tmp_path: Path) -> None:
    said = run(
        "score", talk / "talk.fap", "--reference", talk / "talk.fap", "--phones", talk / "talk.lab",
        "--audio", talk / "talk.wav", "-o", tmp_path / "score.html",
    )  # fmt: skip
    assert re.search(r"p b m that close +100 % \((\d+) of \1\)", said)
    assert re.search(r"LVE +0.00 mm²", said)
    assert "SLCC" in said
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 1
    assert '<p class="verdict good"><b>passes: opens ' in page
    assert "mean temporal misalignment" in page
    assert not re.search(r'(src|href)="(?!#)', page.replace("xlink:href", ""))


@pytest.mark.parametrize(
    ("name", "opening_r"),
    [
        ("talk.fba", 0.99), ("talk.csv", 0.97), ("visemes.csv", 0.85), ("presets.vrma", 0.97), ("arkit.vrma", 0.99),
        ("avatar.glb", 0.99),
    ],
)  # fmt: skip
def test_recordings_of_every_kind(talk: Path, name: str, opening_r: float) -> None:
    found = json.loads(run("score", talk / name, "--reference", talk / "talk.fap", "--json"))
    assert found["truth"]["likeness"]["opening_r"] > opening_r
    assert abs(found["truth"]["timing"]["lag_ms"]) < 15
    assert found["phones"] is None


def test_the_plan_may_stand_for_a_truth(talk: Path) -> None:
    said = run("score", talk / "talk.fap", "--phones", talk / "talk.lab", "--plan")
    assert "own plan of the phones, not with a person" in said
    found = json.loads(run("score", talk / "talk.fap", "--phones", talk / "talk.lab", "--plan", "--json"))
    assert found["truth"]["likeness"]["opening_r"] > 0.95  # it varies
    assert found["truth"]["behaviour"]["blinks"] == 0


def test_alone_it_says_that_nothing_was_compared(talk: Path) -> None:
    said = run("score", talk / "talk.fap")
    assert "No reference" in said
    assert "blinks a minute" in said


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("talk.fap", "--plan"), UsageError, "--plan: requires phones"),
        ((), UsageError, "made: missing"),
        (("talk.fap", "--transcript", "hello"), UsageError, "--transcript: requires audio"),
        (("talk.fap", "--fail-under", "closures=95"), UsageError, "--fail-under: closures requires phones or audio or"),
        (("talk.fap", "--phones", "talk.lab", "--fail-under", "r=0.5"), UsageError, "--fail-under: r requires against"),
        (("talk.fap", "--fail-under", "closed=95"), UsageError, "--fail-under: got 'closed=95', expected NAME=VALUE"),
        (("talk.fap", "--lips", "talk.lab"), UsageError, "lips, upper, neutral: require meshes"),
        (("talk.fap", "talk.csv", "-o", "set.html"), UsageError, "--output: got set.html, expected .*csv, for a set"),
        (("talk.fap", "-o", "score.pdf"), UsageError, "--output: got score.pdf"),
        (("talk.wav",), DataError, "talk.wav"),
        (("none.fap",), UsageError, "cannot be read"),
        (("talk.fap", "--reference", "talk.lab"), DataError, "talk.lab"),
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


def test_the_verdict_comes_first_and_check_makes_it_the_exit_code(talk: Path) -> None:
    phones = ("--phones", talk / "talk.lab")
    assert run("score", talk / "talk.csv", *phones, "--check").startswith("passes: opens ")
    assert run("score", talk / "dead.csv", *phones).startswith("fails: opens 0 mm")
    assert run("score", talk / "dead.csv", *phones, "--check", code=1).startswith("fails: opens 0 mm")
    assert run("score", talk / "dead.csv", "--check", code=1).startswith("fails: opens 0 mm")
    assert run("score", talk / "late.csv", *phones, "--check", code=1).startswith("fails: lag 1")
    assert run("score", talk / "late.csv", *phones, "--fail-under", "lag=200ms,closures=10").startswith("passes:")
    assert run("score", talk / "talk.csv", *phones, "--fail-under", "opens=50mm", code=1).startswith("fails: opens 1")
    found = json.loads(run("score", talk / "late.csv", *phones, "--check", "--json", code=1))
    assert [fault["check"] for fault in found["verdict"]["faults"]] == ["lag", "closures"]
    assert found["verdict"]["faults"][1]["times_s"] == found["phones"]["closures"]["missed_s"]


@pytest.mark.parametrize(
    "known", [(), ("--transcript", "My baby fell off five boats. Bright moonbeams move over a harbour.")]
)
def test_sound_or_text_stand_for_phones(talk: Path, known: tuple[str, ...]) -> None:
    said = run("score", talk / "talk.csv", "--audio", talk / "talk.wav", *known, "--check")
    assert said.startswith("passes:")
    assert ("Phones aligned with the transcript" if known else "Phones recognized in the sound") in said
    found = json.loads(
        run("score", talk / "late.csv", "--audio", talk / "talk.wav", *known, "--check", "--json", code=1)
    )
    assert found["verdict"]["faults"][0]["check"] == "lag"
    assert found["phones"]["closures"]["wanted"] >= 5
    assert found["is_heard"] != bool(known)


def test_junit_and_sarif_have_the_faults_and_their_times(talk: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.csv").write_text("what is this?", encoding="utf-8")
    made = (talk / "talk.csv", talk / "late.csv", tmp_path / "broken.csv")
    options = ("--phones", talk / "talk.lab", "--junit", tmp_path / "a.xml", "--sarif", tmp_path / "a.sarif")
    said = run("score", *made, *options, "--check", code=1)
    assert said.startswith("fails: 2 of 3 recordings")
    top = ElementTree.parse(tmp_path / "a.xml").getroot()
    assert dict(top.attrib) | {"time": ""} == {
        "name": "fapengine score", "tests": "9", "failures": "2", "errors": "1", "skipped": "0", "time": "",
    }  # fmt: skip
    cases = {(each.get("classname"), each.get("name")): each for each in top.iter("testcase")}
    late = cases[str(talk / "late.csv"), "closures"].find("failure")
    assert late is not None
    assert late.text is not None
    times = re.findall(r"^at (\d+\.\d+) s$", late.text, re.MULTILINE)
    assert len(times) >= 2
    assert cases[str(tmp_path / "broken.csv"), "file"].find("error") is not None
    (found,) = json.loads((tmp_path / "a.sarif").read_text(encoding="utf-8"))["runs"]
    rules = [rule["id"] for rule in found["tool"]["driver"]["rules"]]
    assert [result["ruleId"] for result in found["results"]] == ["lag", *["closures"] * len(times), "file"]
    assert all(rules[result["ruleIndex"]] == result["ruleId"] for result in found["results"])
    lines = [result["locations"][0]["physicalLocation"]["region"]["startLine"] for result in found["results"]]
    assert lines == [1, *(2 + round(60 * float(time)) for time in times), 1]  # a line per frame, after the header


def test_two_systems_are_compared(talk: Path, tmp_path: Path) -> None:
    for system, source in (("ours", "talk.csv"), ("theirs", "late.csv")):
        (tmp_path / system).mkdir()
        for name in ("a.csv", "b.csv", "c.csv"):
            (tmp_path / system / name).write_bytes((talk / source).read_bytes())
    (tmp_path / "timings").mkdir()
    for name in ("a.lab", "b.lab", "c.lab"):
        (tmp_path / "timings" / name).write_bytes((talk / "talk.lab").read_bytes())
    for extra in ("ours/README", "ours/a.wav", "timings/a.wav"):  # often lie beside
        (tmp_path / extra).write_bytes(b"something else")
    systems = (tmp_path / "ours", tmp_path / "theirs")
    phones = ("--phones", tmp_path / "timings")
    said = run("score", *systems, *phones, "-o", tmp_path / "set.csv")
    assert "fails: 3 of 6 recordings" in said
    assert re.search(r"ours less theirs.*\n +opens.*\n +lag +-1[45]\d.* ms, p = 0.25, n = 3", said)
    rows = (tmp_path / "set.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("id,system,made,verdict,opens_mm,lag_ms,closures_percent,")
    assert [row.split(",")[:2] for row in rows[1:]] == [[u, s] for s in ("ours", "theirs") for u in "abc"]
    table = "made,phones,system,id\n" + "".join(
        f"{system}/{name}.csv,timings/{name}.lab,{system},{name}\n" for system in ("ours", "theirs") for name in "abc"
    )
    (tmp_path / "table.csv").write_text(table, encoding="utf-8")
    by_table = json.loads(run("score", tmp_path / "table.csv", "--json"))
    assert by_table["summary"] == json.loads(run("score", *systems, *phones, "--json"))["summary"]
    assert by_table["verdict"] == {"passes": False, "failed": 3, "recordings": 6}
    (tmp_path / "table.csv").write_text("made\nours/a.csv\ntheirs/a.csv\n", encoding="utf-8")
    same_name = json.loads(run("score", tmp_path / "table.csv", "--json"))
    assert same_name["summary"]["systems"][""]["opens"]["count"] == 2
    with_folder = json.loads(run("score", tmp_path / "table.csv", *phones, "--json"))
    assert [each["phones"] is None for each in with_folder["recordings"]] == [False, False]
    assert run("score", tmp_path / "ours" / "a.csv", *phones).startswith("passes: 1 recordings")
    same = json.loads(run("score", tmp_path / "ours" / "a.csv", tmp_path / "theirs" / "a.csv", *phones, "--json"))
    assert [each["id"] for each in same["recordings"]] == [str(folder / "a.csv") for folder in systems]
    assert same["summary"]["systems"][""]["opens"]["count"] == 2
    (tmp_path / "timings" / "c.lab").unlink()
    with pytest.raises(UsageError, match=r"--phones: got none in .*timings, expected one file c\.\*"):
        run("score", *systems, *phones)
    for text, message in (
        ("made,sound\na.csv,b\n", "line 2.*|column 'sound'"), ("made,offset\na.csv,soon\n", "offset: expected"),
        ("made,id\n,x\n", "made: missing"), ("made\n", "contains no recordings"),
        ("made,phones\nours/a.csv,timings/none.lab\n", "phones: file not found: .*none.lab.*line 2"),
        ("made,id\nours/a.csv,x\ntheirs/a.csv,x\n", "id: got 'x' twice"),
    ):  # fmt: skip
        (tmp_path / "table.csv").write_text(text, encoding="utf-8")
        with pytest.raises(DataError, match=message):
            run("score", tmp_path / "table.csv")


def test_meshes_have_the_errors_of_papers(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rest = rng.normal(size=(5, 3))
    true = rest + rng.normal(size=(7, 5, 3))
    made = true + np.array([0.0, 0.0, 2.0])
    np.save(tmp_path / "made.npy", made.reshape(7, 15).astype(np.float32))
    np.savez(tmp_path / "true.npz", vertices=true)
    np.save(tmp_path / "rest.npy", rest)
    (tmp_path / "lips.txt").write_text("0, 1\n2", encoding="utf-8")
    np.save(tmp_path / "upper.npy", np.array([False, False, False, True, True]))
    arguments = (
        "score", tmp_path / "made.npy", "--reference", tmp_path / "true.npz", "--lips", tmp_path / "lips.txt",
        "--upper", tmp_path / "upper.npy", "--neutral", tmp_path / "rest.npy",
    )  # fmt: skip
    found = json.loads(run(*arguments, "--json"))
    assert (found["lve_squared"], found["lve"], found["mve"]) == pytest.approx((4.0, 2.0, 2.0))
    assert run(*arguments, "--fail-under", "lve=3.9", code=1).startswith("fails: lve 4 unit2")
    assert "lve                            4 unit2                lip vertex error, squared" in run(*arguments)
    for name, frames in (("ours", made), ("truth", true)):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "a.npy", frames)
    folders = ("score", tmp_path / "ours", "--reference", tmp_path / "truth")
    assert run(*folders, "--fail-under", "mve=1.9", code=1).startswith("fails: 1 of 1 recordings")
    meshes = tmp_path / "true"
    meshes.mkdir()
    for number, frame in enumerate(true):
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in frame] + ["f 1 2 3", "f 3 4 5"]
        (meshes / f"{number}.obj").write_text("\n".join(lines), encoding="utf-8")
    folder = json.loads(run("score", tmp_path / "made.npy", "--reference", meshes, "--json"))
    assert folder["mve"] == pytest.approx(2.0)
    assert folder["lve"] is None
    for extra, message in (
        (("--phones", tmp_path / "lips.txt"), "cannot be used with meshes"),
        (("--fail-under", "fdd=1"), "fdd requires upper"),
    ):
        with pytest.raises(UsageError, match=message):
            run(*arguments[:4], *extra)
    with pytest.raises(UsageError, match="reference: missing"):
        run("score", tmp_path / "made.npy")
    (tmp_path / "lips.txt").write_text("0 one", encoding="utf-8")
    with pytest.raises(DataError, match=r"lips\.txt: indices: got invalid literal"):
        run(*arguments)
    (tmp_path / "made.npy").write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"made\.npy: NPY: damaged"):
        run(*arguments[:4])
    np.savez(tmp_path / "two.npz", one=true, other=true)
    with pytest.raises(DataError, match=r"two\.npz: NPZ: got arrays \['one', 'other'\]"):
        run("score", tmp_path / "two.npz", "--reference", tmp_path / "true.npz")


def test_people_are_asked_and_their_answers_analysed(talk: Path, tmp_path: Path) -> None:
    for system, name in (("ours", "hello.webm"), ("theirs", "hello.mp4"), ("theirs", "bye.mp4")):
        (tmp_path / system).mkdir(exist_ok=True)
        (tmp_path / system / name).write_bytes(b"a film")
        for ending in (".fap", ".png", ".wav"):  # which `say` writes beside it
            (tmp_path / system / name).with_suffix(ending).write_bytes(b"beside it")
    folders = (tmp_path / "ours", tmp_path / "theirs")
    said = run("score", "--listen", *folders, "-o", tmp_path / "page")
    assert "1 pairs and 2 attention checks" in said
    assert "left out, as one system lacks them: bye" in said
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert page.count("<script") == 2
    assert not re.search(r'(src|href)="', page)  # nothing but the films is beside it
    first = json.loads(page.split('id="config">')[1].split("</script>")[0])
    assert (first["systems"], first["seed"], first["checks"]) == (["ours", "theirs"], 1, 2)
    assert sorted(first["items"][0]["clips"]) == sorted(
        f"clips/{p.name}" for p in (tmp_path / "page" / "clips").iterdir()
    )
    header = ",".join(first["columns"])
    rows = [f"{who},1,{n},hello,ours,theirs,left,2.0,2" for who in ("x", "y") for n in range(3)]
    checks = ["x,1,4,hello,still,moving,right,1,2", "y,1,4,hello,still,moving,left,1,2"]
    (tmp_path / "answers.csv").write_text("\n".join([header, *rows, *checks]), encoding="utf-8")
    told = run("score", "--answers", tmp_path / "answers.csv")
    assert told.startswith("ours preferred to theirs: 100.0 % (3 of 3), 95 % interval 29.2 to 100.0 % (binomial)")
    assert "left out for failed attention checks: 1\n  y: passed 0 %" in told
    found = json.loads(run("score", "--answers", tmp_path / "answers.csv", "--json"))
    assert (found["chosen"], found["excluded"]) == (3, {"y": 0.0})
    (tmp_path / "ours" / "bye.fap").write_bytes((talk / "talk.fap").read_bytes())
    for arguments, message in (
        ((*folders, "-o", tmp_path / "other"), r"audio: got no sound for bye.fap, expected a folder with bye.wav"),
        ((folders[0], "-o", tmp_path / "other"), "--listen: expected two folders and an output folder"),
        ((folders[0], folders[0], "-o", tmp_path / "other"), "got two folders called ours"),
        ((folders[0], talk, "-o", tmp_path / "other"), "got no file of one name"),
        ((folders[0], tmp_path / "none", "-o", tmp_path / "other"), "expected a folder of films"),
    ):
        with pytest.raises(UsageError, match=message):
            run("score", "--listen", *arguments)
    assert not (tmp_path / "other").exists()
    with pytest.raises(UsageError, match="--answers: cannot be combined"):
        run("score", talk / "talk.fap", "--answers", tmp_path / "answers.csv")


def test_timed_words_are_pronounced_in_the_language_that_is_named(talk: Path, tmp_path: Path) -> None:
    rows = [{"word": word, "start": 0.5 * n, "end": 0.5 * n + 0.5} for n, word in enumerate(("beaux", "peu", "vous"))]
    words = tmp_path / "words.json"
    words.write_text(json.dumps({"segments": [{"words": rows}]}), encoding="utf-8")
    arguments = ("score", talk / "talk.fap", "--phones", words, "--json")
    wanted = json.loads(run(*arguments, "--voice", "fr"))["phones"]
    assert json.loads(run(*arguments, "--language", "fr"))["phones"] == wanted
    found = fapengine.score(talk / "talk.fap", phones=load_timings(words), language="fr")
    assert json.loads(json.dumps(found.as_dict()))["phones"] == wanted


def test_remarks_on_the_file_are_passed_on(talk: Path) -> None:
    assert "motion: no FAP moves" in run("score", talk / "dead.csv")
    assert json.loads(run("score", talk / "dead.csv", "--json"))["remarks"]
