"""No command writes over what it reads, or over anything where it is told not to; what it replaces, it says."""

import json
import os
import resource
import shlex
import shutil
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fapengine.cli import main
from fapengine.cli.main import COMMANDS, app
from fapengine.files.pictures import save_png

TALK = ("mp4", "fap", "wav", "png")
"""Endings of what stands beside a film."""
NOBODY = 65534
VISEMES = "m 100\na 200\nb 100\n"


@dataclass(frozen=True)
class Job:
    """A command that writes."""

    line: str
    """INPUT stands for the file that is asked about, OTHER for another one, OUTPUT for the name to write."""
    output: str
    written: tuple[str, ...]
    """Names in the folder that it writes; the first stands for the others where one is enough."""


SOURCES = {"": "", "--audio": "OTHER.pho", **dict.fromkeys(("--background", "--head"), "OTHER.pho --audio OTHER.flac")}
JOBS = {
    **{
        f"say {option}": Job(f"say Hello. {option} INPUT -o OUTPUT", "talk.mp4", tuple(f"talk.{end}" for end in TALK))
        for option in ("--background", "--head", "--profile")
    },
    "say --into": Job("say Hello. --into INPUT -o OUTPUT", "talk.glb", ("talk.glb", "talk.fap", "talk.wav")),
    "say --shape-map": Job("say Hello. --into OTHER.glb --shape-map INPUT -o OUTPUT", "talk.glb", ("talk.glb",)),
    **{
        f"animate {option or 'source'}": Job(
            f"animate {SOURCES[option]} {option} INPUT -o OUTPUT", "talk.mp4",
            ("talk.mp4", "talk.fap", "talk.png") if option in ("", "--audio") else tuple(f"talk.{end}" for end in TALK),
        )
        for option in ("", "--audio", "--background", "--head")
    },
    "animate pictures": Job("animate INPUT -o OUTPUT", "talk", ("talk/frame_0003.png", "talk.fap", "talk.png")),
    "animate shapes": Job("animate INPUT --shapes rhubarb -o OUTPUT", "talk.json", ("talk.json",)),
    "animate --profile": Job("animate OTHER.pho --profile INPUT -o OUTPUT", "talk.mp4", ("talk.mp4", "talk.fap")),
    "animate --into": Job("animate OTHER.pho --into INPUT -o OUTPUT", "talk.glb", ("talk.glb", "talk.fap")),
    "animate --shape-map": Job(
        "animate OTHER.pho --into OTHER.vrm --shape-map INPUT -o OUTPUT", "talk.glb", ("talk.glb",)
    ),
    "animate --recognizer": Job(
        "animate OTHER.ogg --recognizer INPUT -o OUTPUT", "talk.mp4", ("talk.mp4", "talk.fap")
    ),
    "animate --transcript-file": Job(
        "animate OTHER.ogg --transcript-file INPUT -o OUTPUT", "talk.mp4", ("talk.mp4", "talk.fap")
    ),
    "align": Job("align INPUT -o OUTPUT", "talk.json", ("talk.json",)),
    "align --recognizer": Job("align OTHER.wav --recognizer INPUT -o OUTPUT", "talk.json", ("talk.json",)),
    "align --transcript-file": Job(
        "align OTHER.wav --transcript-file INPUT -o OUTPUT", "talk.TextGrid", ("talk.TextGrid",)
    ),
    **{
        f"render {option or 'track'}": Job(
            f"render {'OTHER.fap' if option else ''} {option} INPUT -o OUTPUT", output, (output,)
        )
        for option, output in (("", "a.mp4"), ("--audio", "a.mkv"), ("--head", "a.png"), ("--background", "a.gif"))
    },
    "render second": Job("render OTHER.fap INPUT -o OUTPUT", "a.webp", ("a.webp",)),
    "render pictures": Job("render INPUT -o OUTPUT", "f_%03d.png", ("f_002.png",)),
    "render folder": Job("render INPUT -o OUTPUT", "f", ("f/frame_0001.png",)),
    "encode": Job("encode INPUT -o OUTPUT", "a.fba", ("a.fba",)),
    "encode --audio": Job("encode OTHER.fap --audio INPUT -o OUTPUT", "a.mp4", ("a.mp4",)),
    "encode --epf": Job("encode OTHER.fap --epf INPUT -o OUTPUT", "a.fba", ("a.fba",)),
    "decode": Job("decode INPUT -o OUTPUT", "a.fap", ("a.fap",)),
    "decode --fit": Job("decode OTHER.fba --fit INPUT -o OUTPUT", "a.fap", ("a.fap",)),
    "convert": Job("convert INPUT -o OUTPUT", "a.csv", ("a.csv",)),
    "convert --into": Job("convert OTHER.fap --into INPUT -o OUTPUT", "a.glb", ("a.glb",)),
    "convert --shape-map": Job("convert OTHER.fap --into OTHER.glb --shape-map INPUT -o OUTPUT", "a.glb", ("a.glb",)),
    "batch": Job("batch INPUT -o OUTPUT", "c", ("c/index.csv", "c/journal.jsonl")),
    "batch --to profile": Job("batch INPUT -o OUTPUT --to profile", "c", ("c/index.csv", "c/journal.jsonl")),
    "batch --into": Job("batch OTHER.csv --into INPUT --to glb -o OUTPUT", "c", ("c/index.csv", "c/journal.jsonl")),
    "batch --shape-map": Job(
        "batch OTHER.csv --into OTHER.glb --shape-map INPUT --to glb -o OUTPUT", "c", ("c/index.html",)
    ),
    "convert shapes": Job("convert INPUT --shapes rhubarb -o OUTPUT", "a.xml", ("a.xml",)),
    "capture": Job("capture INPUT -o OUTPUT", "a.fap", ("a.fap",)),
    "capture --overlay": Job("capture INPUT -o OTHER.fap --overlay OUTPUT", "a.mp4", ("a.mp4",)),
    **{
        f"capture {option}": Job(
            f"capture OTHER.mp4 {option} INPUT -o OUTPUT --overlay OTHER.webm", "a.fap", ("a.fap",)
        )
        for option in ("--head", "--model")
    },
    "capture --overlay --head": Job(
        "capture OTHER.webm --head INPUT -o OTHER.fap --overlay OUTPUT", "a.mp4", ("a.mp4",)
    ),
    "drive": Job("drive INPUT --markers 3 -o OUTPUT", "a.npz", ("a.npz",)),
    "drive --take": Job("drive OTHER.npz --take INPUT --markers 3 -o OUTPUT", "a.npz", ("a.npz",)),
    "drive --film": Job("drive INPUT --markers 3 -o OTHER.npz --film OUTPUT", "a.mp4", ("a.mp4",)),
    "drive --background": Job("drive OTHER.c3d --background INPUT -o OTHER.npz --film OUTPUT", "a.gif", ("a.gif",)),
    "reduce": Job("reduce INPUT -o OUTPUT", "a.npz", ("a.npz",)),
    "reduce --back": Job("reduce INPUT -o OTHER.npz --back OUTPUT", "a.trc", ("a.trc",)),
    "inspect": Job("inspect INPUT --plot OUTPUT", "a.png", ("a.png",)),
    "inspect --sliders": Job("inspect INPUT --sliders OUTPUT", "a.html", ("a.html",)),
    "inspect --pose": Job("inspect INPUT --pose OUTPUT", "a.fap", ("a.fap",)),
    **{
        f"score {option or 'recording'}": Job(
            f"score {'OTHER.fap' if option else ''} {option} INPUT -o OUTPUT", "a.html", ("a.html",)
        )
        for option in (
            "", "--reference", "--phones", "--audio", "--transcript-file", "--recognizer", "--lips", "--upper",
            "--neutral",
        )
    },
    "score --junit": Job("score INPUT --junit OUTPUT", "a.xml", ("a.xml",)),
    "score --sarif": Job("score INPUT --sarif OUTPUT", "a.sarif", ("a.sarif",)),
    "fit": Job("fit INPUT -o OUTPUT", "p", ("p/profile.toml", "p/report.html", "p/takes/a.fap")),
    "head import": Job("head import INPUT -o OUTPUT", "head", ("head/head.toml", "head/head.npz", "head/head.png")),
    **{
        f"head import {option}": Job(f"head import OTHER.obj {option} INPUT -o OUTPUT", "head", ("head/head.toml",))
        for option in ("--points", "--shape-map")
    },
    "head export": Job("head export INPUT -o OUTPUT", "a.glb", ("a.glb",)),
    "head check": Job("head check INPUT -o OUTPUT", "a.png", ("a.png",)),
    "view": Job("view INPUT --screenshot OUTPUT", "a.png", ("a.png",)),
    "view --audio": Job("view OTHER.fap --audio INPUT --screenshot OUTPUT", "a.png", ("a.png",)),
    "view --head": Job("view OTHER.fap --head INPUT --screenshot OUTPUT", "a.png", ("a.png",)),
    "view --profile": Job("view --profile INPUT --screenshot OUTPUT", "a.png", ("a.png",)),
}  # fmt: skip
Make = Callable[[Path, Path], object]
NAMES: dict[str, Make] = {
    "its own name": lambda place, file: file.rename(place),
    "a symbolic link": lambda place, file: place.symlink_to(file),
    "a hard link": lambda place, file: place.hardlink_to(file),
}
CASES = [(command, name, how) for command, one in JOBS.items() for name in one.written for how in NAMES]


def run(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> tuple[object, str]:
    """Exit code and what was said on standard error."""
    monkeypatch.setattr(sys, "argv", ["fapengine", *words])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code, capsys.readouterr().err


def words_of(command: Job, folder: Path, read: Path) -> list[str]:
    words = {"INPUT": str(read), "OUTPUT": str(folder / command.output)}
    return [words.get(word, str(folder / word) if word.startswith("OTHER") else word) for word in command.line.split()]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("command", "name", "how"), CASES)
def test_no_output_falls_on_an_input(
    command: str,
    name: str,
    how: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder, mine = tmp_path / "out", tmp_path / "mine.png"
    (folder / name).parent.mkdir(parents=True)
    save_png(mine, np.zeros((2, 2, 3), np.uint8))
    NAMES[how](folder / name, mine)
    read = folder / name if how == "its own name" else mine
    if command == "fit":
        read = read.parent
    if how == "its own name":  # in a roundabout way
        monkeypatch.chdir(folder)
        read = Path(os.path.relpath(read.parent, folder)) / read.name
    before = contents(tmp_path)
    code, told = run(words_of(JOBS[command], folder, read), monkeypatch, capsys)
    assert (code, told.count("\n")) == (2, 1), told
    assert "is read, and would be written over" in told
    assert contents(tmp_path) == before


@pytest.mark.parametrize("command", JOBS)
def test_nothing_is_replaced_where_it_is_forbidden(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Inputs are not even there: it is refused before any work."""
    read = tmp_path / "read.png"
    save_png(read, np.zeros((2, 2, 3), np.uint8))
    for name in JOBS[command].written:
        there = tmp_path / name
        there.parent.mkdir(parents=True, exist_ok=True)
        there.write_bytes(b"an earlier file")
        code, told = run([*words_of(JOBS[command], tmp_path, read), "--no-overwrite"], monkeypatch, capsys)
        assert (code, told.count("\n")) == (2, 1), told
        assert "is there already, expected a new name" in told
        assert there.read_bytes() == b"an earlier file"
        there.unlink()


WRITTEN = {
    "--output",
    "--plot",
    "--screenshot",
    "--overlay",
    "--film",
    "--back",
    "--sliders",
    "--pose",
    "--junit",
    "--sarif",
}
NAMED = {"--head", "--profile", "--background"}
"""Options that name a file or something else."""
READ_LIVE = {("say", "--recognizer")}
"""Inputs of what writes nothing."""


def commands() -> dict[str, Any]:
    import typer

    group: Any = typer.main.get_command(app)
    alone = {name: group.get_command(None, name) for name in COMMANDS}
    return {name: command for name, command in alone.items() if name != "head"} | {
        f"head {name}": command for name, command in alone["head"].commands.items()
    }


def test_every_command_that_writes_is_here() -> None:
    """Those whose options name a file to write; each has --no-overwrite."""
    writing = set()
    for name, command in commands().items():
        flags = {flag for parameter in command.params for flag in parameter.opts}
        if flags & {"--output", "--plot", "--screenshot"}:
            writing.add(name)
            assert "--no-overwrite" in flags, name
    assert writing == {
        next(name for name in sorted(writing, key=len, reverse=True) if command.startswith(name)) for command in JOBS
    }


def test_every_option_that_names_an_input_is_here() -> None:
    """And every option that names an output."""
    lacking = []
    for command in {" ".join(one.line.split()[: 1 + one.line.startswith("head ")]) for one in JOBS.values()}:
        for parameter in commands()[command].params:
            flag = max(parameter.opts, key=len)
            is_path = parameter.type.name == "path" and not parameter.multiple and flag.startswith("--")
            if (is_path or flag in NAMED) and (command, flag) not in READ_LIVE:
                word = "OUTPUT" if flag in WRITTEN else "INPUT"
                words = f"-o {word}" if flag == "--output" else f"{flag} {word}"
                if not any(one.line.startswith(f"{command} ") and words in one.line for one in JOBS.values()):
                    lacking.append(f"{command} {flag}")
    assert not lacking


def packed(text: str) -> bytes:
    """A GLB without a binary chunk."""
    data = text.encode() + b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(data), len(data), 0x4E4F534A) + data


PICTURES = '{"asset": {"version": "2.0"}, "images": [{"uri": "b.png"}, {"uri": "the%20eye.png"}]}'
BUFFER = '{"asset": {"version": "2.0"}, "buffers": [{"uri": "talk.fap", "byteLength": 1}]}'
OBJ, PLY = "mtllib a.mtl\nv 0 0 0\n", "ply\ncomment TextureFile b.png\nend_header\n"
BESIDE: dict[str, tuple[str, str, dict[str, str | bytes]]] = {
    "buffer of --into": ("animate OTHER.pho --into in.gltf -o talk.glb", "talk.fap", {"in.gltf": BUFFER}),
    "image": ("inspect in.gltf --plot b.png", "b.png", {"in.gltf": PICTURES}),
    "image whose name is quoted": (
        "render a.fap --head in.gltf -o 'the eye.png'",
        "the eye.png",
        {"in.gltf": PICTURES},
    ),
    "image of a GLB": ("inspect in.glb --plot b.png", "b.png", {"in.glb": packed(PICTURES)}),
    "material": ("inspect in.obj --plot a.mtl", "a.mtl", {"in.obj": OBJ}),
    "its texture": ("head import in.obj -o .", "head.png", {"in.obj": OBJ, "a.mtl": "newmtl a\nmap_Kd head.png\n"}),
    "texture of PLY": ("inspect in.ply --plot b.png", "b.png", {"in.ply": PLY}),
    "card of an ear": ("align OTHER.wav --recognizer in.onnx -o in.json", "in.json", {"in.onnx": "no ear"}),
    "timings of a row": ("batch in.csv --to fba -o c", "c/a.fba", {"in.csv": "id,timings\na,c/a.fba\n"}),
    "timings, index of rows": ("batch in.csv --to fba -o c", "c/index.csv", {"in.csv": "id,timings\na,c/index.csv\n"}),
    "words": ("batch in*.wav --transcript-file c/{stem}.csv --to fap -o c", "c/index.csv", {"index.wav": "RIFF"}),
}
"""Words, the file that is read because another one names it, and the others."""


@pytest.mark.parametrize("case", BESIDE)
def test_no_output_falls_on_a_file_that_an_input_names(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words, read, files = BESIDE[case]
    monkeypatch.chdir(tmp_path)
    for name, content in {**files, read: "mine"}.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = contents(tmp_path)
    code, told = run(shlex.split(words), monkeypatch, capsys)
    assert (code, told.count("\n")) == (2, 1), told
    assert f"{Path(read).name}, which is read, and would be written over" in told
    assert contents(tmp_path) == before


def test_what_is_replaced_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.pho").write_text(VISEMES)
    words = ["animate", str(tmp_path / "a.pho"), "-o", str(tmp_path / "a.fap")]
    monkeypatch.setattr(sys, "argv", ["fapengine", *words])
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err == ""
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err == f"fapengine: replaced {tmp_path / 'a.fap'}\n"


def test_what_is_refused_later_replaces_nothing_and_says_nothing_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.fap", "b.html"):
        (tmp_path / name).write_bytes(b"no FAPs")
    code, told = run(["score", str(tmp_path / "a.fap"), "-o", str(tmp_path / "b.html")], monkeypatch, capsys)
    assert (code, told.count("\n")) in ((1, 1), (2, 1)), told
    assert "replace" not in told
    assert (tmp_path / "b.html").read_bytes() == b"no FAPs"


def test_an_own_recording_is_not_written_over_by_its_sound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The commonest names there are: animate talk.pho --audio talk.wav -o talk.fap."""
    from fapengine.files.sound import save_wav

    (tmp_path / "talk.pho").write_text(VISEMES)
    save_wav(tmp_path / "talk.wav", np.resize(np.array([900, -900], np.int16), 4000), 8000)
    before = (tmp_path / "talk.wav").read_bytes()
    words = ["animate", "talk.pho", "--audio", "talk.wav", "-o", "talk.fap", "--no-overwrite"]
    monkeypatch.chdir(tmp_path)
    assert run(words, monkeypatch, capsys) == (0, "")
    assert (tmp_path / "talk.wav").read_bytes() == before
    assert (tmp_path / "talk.fap").exists()


QUICK = {
    "animate": ("animate a.pho -o x.fap", "x.fap"),
    "animate shapes": ("animate a.pho --shapes rhubarb -o x.json", "x.json"),
    "encode": ("encode a.fap -o x.fba", "x.fba"),
    "decode": ("decode a.fba -o x.fap", "x.fap"),
    "convert": ("convert a.fap -o x.csv", "x.csv"),
    "inspect": ("inspect a.pho --plot x.png", "x.png"),
    "score": ("score a.fap --phones a.pho -o x.html", "x.html"),
    "render": ("render a.fap --size 64 -o x.png", "x.png"),
    "render film": ("render a.fap --size 64 -o x.mp4", "x.mp4"),
    "render pictures": ("render a.fap --size 64 -o x", "x/frame_0000.png"),
}
"""Commands that are quick on short timings, and a file that each writes; python -m design.faults has them all."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "a.pho").write_text(VISEMES)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in ("animate a.pho -o a.fap", "encode a.fap -o a.fba"):
            patch.setattr(sys, "argv", ["fapengine", *words.split()])
            with pytest.raises(SystemExit):
                main()
    return folder


@pytest.mark.parametrize("command", QUICK)
@pytest.mark.parametrize("trouble", ["full disk", "read only"])
def test_a_disk_that_takes_nothing_leaves_the_good_file(
    trouble: str,
    command: str,
    inputs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    line, name = QUICK[command]
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(b"an earlier file")
    before = contents(tmp_path)
    monkeypatch.chdir(tmp_path)
    with full_disk() if trouble == "full disk" else read_only(tmp_path, (tmp_path / name).parent):
        code, told = run(line.split(), monkeypatch, capsys)
    assert code == 3
    assert "cannot be written" in told
    assert "Traceback" not in told
    assert contents(tmp_path) == before


@pytest.mark.parametrize("command", QUICK)
def test_what_was_done_is_told_as_json(
    command: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    monkeypatch.setattr(sys, "argv", ["fapengine", *QUICK[command][0].split(), "--json"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    assert json.loads(capfd.readouterr().out)


@contextmanager
def full_disk() -> Iterator[None]:
    """No file may grow beyond 100 bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def read_only(*folders: Path) -> Iterator[None]:
    """Nothing can be made in these folders; for root, who may write anywhere, as another user."""
    for folder in folders:
        folder.chmod(0o555)
    for parent in folders[0].parents[:3]:  # pytest's own, which nobody else may enter
        if parent.name.startswith("pytest") or parent.name.startswith("test_"):
            parent.chmod(0o755)
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)
        for folder in folders:
            folder.chmod(0o755)
