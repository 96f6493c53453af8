"""What say and animate write: by the name's kind, and what stands beside it."""

import json
import wave
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from _pytest.mark import ParameterSet
from PIL import Image
from typer.testing import CliRunner

import fapengine
from fapengine.app.manner import Manner
from fapengine.app.outputs import (
    OTHER_NAMES,
    OUTPUT_KINDS,
    RHUBARB,
    TIMED_SETS,
    WEIGHT_SETS,
    SaveOptions,
    check_output,
    find_kind,
)
from fapengine.app.performance import perform
from fapengine.app.report import Report
from fapengine.app.scene_files import USD, Into
from fapengine.app.talk import outputs_of, write_talk
from fapengine.cli import options as options_module
from fapengine.cli.main import app
from fapengine.cli.options import DrawingOptions
from fapengine.codec.encoder import EncoderOptions
from fapengine.errors import UsageError
from fapengine.files.gltf.clip import SETS
from fapengine.files.moving import FOLDER_PATTERN, FORMATS
from fapengine.files.outputs import check_outputs, refuse_foreign
from fapengine.files.sound import load_sound, save_wav
from fapengine.render.drawing import RenderOptions
from fapengine.retarget.blend_tracks import SHAPE_SETS
from fapengine.speech.formats.visemes import VISEME_SETS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.voices.protocol import Speech


def command(*words: object) -> None:
    done = CliRunner().invoke(app, [str(word) for word in words])
    if done.exception is not None:
        raise done.exception


PHONES = PhoneTrack.from_phones(
    [Phone("_", 0.0, 0.1), Phone("m", 0.1, 0.2), Phone("a", 0.2, 0.4), Phone("_", 0.4, 0.5)]
)
RATE_HZ, FRAMES = 12.5, 6


def written(out: Path, background: str = "studio") -> Report:
    report = Report()
    sound = np.zeros(8000, np.int16), 16_000
    performance = perform(PHONES, sound, Manner(rate_hz=RATE_HZ), text="ma")
    write_talk(
        performance, out, SaveOptions(drawing=RenderOptions.parse(size="64", background=background), report=report)
    )
    assert all(path.exists() for path, _ in report.files if "%" not in path.name)
    return report


@pytest.mark.parametrize("name", ["a.webp", "a.gif", "a"])
def test_animations_and_folders(tmp_path: Path, name: str) -> None:
    report = written(tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {name, "a.fap", "a.wav", "a.png"}
    assert (tmp_path / name, "pictures") in report.files
    if name == "a":
        assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [f"frame_{n:04d}.png" for n in range(FRAMES)]
    else:
        with Image.open(tmp_path / name) as image:
            assert image.n_frames >= FRAMES - 1  # pictures that are alike may be joined


def test_a_talking_head_over_nothing(tmp_path: Path) -> None:
    written(tmp_path / "clear_%02d.png", background="none")
    with Image.open(tmp_path / "clear_03.png") as image:
        alpha = np.asarray(image)[..., 3]
    assert alpha[2, 2] == 0
    assert alpha[40, 32] == 255
    assert (tmp_path.parent / f"{tmp_path.name}.wav").exists()  # beside the folder of the pictures


def test_refuses_before_any_work(tmp_path: Path) -> None:
    for name, rate_hz, drawing, message in (
        ("a.mp4", 30.0, {"background": "none"}, "has no alpha"),
        ("a.gif", 60.0, {}, "GIF: got 60 Hz"),
        ("a.avi", 30.0, {}, r"a\.avi, expected a name that ends with \.fap, .* or a folder"),
        ("a.mp4", 30.0, {"background": "pink"}, "background: got 'pink'"),
        ("a.mp4", 30.0, {"camera": "91,91"}, "pitch"),
        ("a.mp4", 30.0, {"antialias": "hard"}, "edges: got 'hard', expected one of fine, soft"),
    ):
        with pytest.raises(UsageError, match=message):
            check_output(tmp_path / name, SaveOptions(drawing=DrawingOptions(**drawing).value()), rate_hz=rate_hz)
    check_output(tmp_path / "a.fap", SaveOptions(), rate_hz=60.0)


@pytest.mark.parametrize("path", ["", "."])
def test_images_do_not_fill_the_current_folder(path: str) -> None:
    with pytest.raises(UsageError, match=r"path: got \., expected the name of a file or folder"):
        find_kind(Path(path))


def test_a_users_own_recording_stays_as_it_is(tmp_path: Path) -> None:
    recording = tmp_path / "a.wav"
    recording.write_bytes(b"stereo, 24 bits")
    performance = perform(PHONES, (np.zeros(8000, np.int16), 16_000), Manner(rate_hz=RATE_HZ))
    report = Report()
    write_talk(performance, tmp_path / "a.fap", SaveOptions(report=report), inputs=[recording])
    assert recording.read_bytes() == b"stereo, 24 bits"
    assert (recording, "sound, as it was") in report.files
    link = tmp_path / "b.wav"
    link.symlink_to(recording)  # another name of it
    write_talk(performance, tmp_path / "b.fap", SaveOptions(), inputs=[recording])
    assert recording.read_bytes() == b"stereo, 24 bits"
    write_talk(performance, tmp_path / "a.fap", SaveOptions())
    assert recording.read_bytes() != b"stereo, 24 bits"  # what is nobody's is written over


def test_a_single_picture_is_among_the_files_that_are_told(tmp_path: Path) -> None:
    report = Report()
    performance = perform(PHONES, None, Manner(rate_hz=RATE_HZ))
    options = SaveOptions(report=report, drawing=RenderOptions(size=(32, 32)), head="default:level=coarse")
    write_talk(performance, tmp_path / "a.png", options)
    assert [path for path, _ in report.files] == [tmp_path / "a.png"]


def test_a_video_is_not_written_over_itself(tmp_path: Path) -> None:
    video = tmp_path / "talk.mp4"
    video.write_bytes(b"video")
    with pytest.raises(UsageError, match=r"talk\.mp4, which is read, and would be written over"):
        check_outputs(outputs_of(video, sound=True, inputs=[video])[0], [video])
    assert check_outputs(outputs_of(tmp_path / "face.mp4", sound=True)[0], [video]) == ()


@pytest.mark.parametrize("ending", [".wav", ".fap", ".png"])
def test_files_of_others_beside_an_output_are_not_replaced(tmp_path: Path, ending: str) -> None:
    (own := tmp_path / f"a{ending}").write_bytes(b"RIFF\0\0\0\0WAVE of mine" if ending == ".wav" else b"")
    with pytest.raises(UsageError, match=rf"path: .*a\{ending} would be replaced, and is not of fapengine"):
        refuse_foreign(outputs_of(tmp_path / "a.gif", sound=True)[1])
    own.unlink()
    written(tmp_path / "a.gif")
    assert own.is_file()
    beside = outputs_of(tmp_path / "a.gif", sound=True)[1]
    assert own in beside
    refuse_foreign(beside)  # an earlier run wrote it


def test_a_written_sound_is_a_whole_riff_file(tmp_path: Path) -> None:
    save_wav(tmp_path / "a.wav", np.arange(5, dtype=np.int16), 8000)
    data = (tmp_path / "a.wav").read_bytes()
    assert int.from_bytes(data[4:8], "little") == len(data) - 8
    with wave.open(str(tmp_path / "a.wav")) as file:
        assert (file.getnframes(), file.getframerate(), file.getnchannels(), file.getsampwidth()) == (5, 8000, 1, 2)
    assert load_sound(tmp_path / "a.wav")[0].tolist() == [0, 1, 2, 3, 4]


def test_every_ending_is_one_row_and_its_files_have_rows_too() -> None:
    endings = [row.ending for row in OUTPUT_KINDS]
    assert len(set(endings)) == len(endings) == 23
    assert set(FORMATS) == {row.ending for row in OUTPUT_KINDS if row.is_image} - {"", FOLDER_PATTERN}
    assert {name for row in OUTPUT_KINDS for name in row.beside} <= set(endings)
    assert tuple(SHAPE_SETS) == WEIGHT_SETS
    assert (*VISEME_SETS, RHUBARB) == TIMED_SETS
    assert set(find_kind(Path("a.vrma")).shapes) == {None, *SETS}


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (
            "a.mp4",
            {"shapes": "rhubarb"},
            r"path: got a\.mp4, expected a name that ends with .*\.json, .* shapes=rhubarb",
        ),
        ("a.mp4", {"shapes": "oculus"}, r"path: got a\.mp4, expected a name that ends with \.csv, .* shapes=oculus"),
        ("a.json", {}, r"shapes: got none for a\.json, expected shapes=mpeg4 or shapes=oculus"),
        ("a.json", {"shapes": "arkit"}, r"shapes: got arkit for a\.json, expected shapes=mpeg4 or"),
        *((f"a{row.ending}", {"shapes": "foo"}, "shapes: got 'foo', expected one of arkit") for row in OUTPUT_KINDS),
        ("a.mp4", {"encoding": EncoderOptions()}, r"encoding: got one, or kbit_s, for a\.mp4"),
        ("a.glb", {"into": Into(Path("rnd.fba"))}, r"into: got rnd\.fba, expected an avatar"),
    ],
)
def test_options_that_a_kind_does_not_have(name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        check_output(Path(name), SaveOptions(**options), rate_hz=30.0)


class Still:
    """A voice that needs no program."""

    def speak(self, text: str) -> Speech:
        return Speech(samples=np.arange(8000, dtype=np.int16), sample_rate_hz=16_000, phones=PHONES)


VOICE = f"{__name__}:Still"


def cases() -> list[ParameterSet]:
    """Every ending with every set of shapes that it accepts, and the options that it needs."""
    found = []
    for row in OUTPUT_KINDS:
        if row.ending in USD or row.ending in ("", FOLDER_PATTERN):
            continue  # of one writer with .glb and .png, slower
        into = {"into": "default:level=coarse"} if row.takes_avatar else {}
        slow = [pytest.mark.nightly] if row.takes_avatar or (row.is_drawn and row.ending != ".png") else []
        for shapes in (*row.shapes, *(other for other, name in OTHER_NAMES.items() if name in row.shapes)):
            given = into | ({"shapes": shapes} if shapes else {})
            found.append(pytest.param(f"a{row.ending}", given, marks=slow, id=f"{row.ending} {shapes or ''}"))
    return found


def options_of(given: dict[str, str]) -> list[str]:
    return [word for name, value in given.items() for word in (f"--{name}", value)]


@pytest.mark.parametrize(("name", "given"), cases())
def test_every_command_and_python_write_the_same_bytes(name: str, given: dict[str, str], tmp_path: Path) -> None:
    save_wav(tmp_path / "in.wav", np.arange(8000, dtype=np.int16), 16_000)
    (tmp_path / "in.pho").write_text("_ 100\nm 100\na 200\n_ 100\n")
    row, sized = find_kind(Path(name)), {}
    if row.is_drawn:
        sized = {"size": "64x64", "head": "default:level=coarse"}
    drawn: dict[str, Any] = {"size": (64, 64), "head": sized["head"]} if sized else {}
    spoken = fapengine.animate(tmp_path / "in.pho", sound=tmp_path / "in.wav", rate_hz=25.0)
    said = fapengine.speak("Ma.", voice=Still(), rate_hz=25.0)
    expected = spoken.save(tmp_path / "python" / name, **given, **drawn).read_bytes()
    expected_said = said.save(tmp_path / "said" / name, **given, **drawn).read_bytes()

    options = [*options_of(given | sized), "--fps", "25", "--camera", "front"]
    command("animate", tmp_path / "in.pho", "-a", tmp_path / "in.wav", "-o", tmp_path / name, *options)
    command("say", "Ma.", "--voice", VOICE, "-o", tmp_path / "cli" / name, *options)
    for cells, wanted in (
        ({"timings": "in.pho", "audio": "in.wav"}, expected),
        ({"text": "Ma.", "voice": VOICE}, expected_said),
    ):
        (tmp_path / "rows.jsonl").write_text(json.dumps({"id": "a", "fps": 25, **cells, **given, **sized}))
        out = tmp_path / f"batch of {next(iter(cells))}"
        command("batch", tmp_path / "rows.jsonl", "--to", name[2:], "--workers", "0", "-o", out)
        assert (out / name).read_bytes() == wanted

    def naming(data: bytes, recording: Path) -> bytes:
        """The command line names the recording."""
        data = data.replace(b'"soundFile": ""', f'"soundFile": "{recording.resolve()}"'.encode())
        return data.replace(b"<soundFile></", f"<soundFile>{recording.resolve()}</".encode())

    assert (tmp_path / name).read_bytes() == naming(expected, tmp_path / "in.wav")
    assert (tmp_path / "cli" / name).read_bytes() == naming(expected_said, tmp_path / "cli" / "a.wav")
    if name != "a.wav" and not row.is_image:
        spoken.save(tmp_path / "in.fap")
        command("convert", tmp_path / "in.fap", "-o", tmp_path / "converted" / name, *options_of(given))
        fapengine.save(spoken.track, tmp_path / "saved" / name, **given)
        if "into" not in given and name != "a.vrma":  # which have the name of the file
            assert (tmp_path / "converted" / name).read_bytes() == (tmp_path / "saved" / name).read_bytes()


def test_help_lists_every_ending() -> None:
    (output,) = [meta for meta in get_args(options_module.Output) if hasattr(meta, "help")]
    assert not [row.ending for row in OUTPUT_KINDS if row.ending not in output.help]


@pytest.mark.parametrize(("name", "has_copy"), [("b.csv", True), ("b.json", False)])
def test_visemes_name_the_recording_and_weights_get_a_copy(name: str, has_copy: bool, tmp_path: Path) -> None:
    save_wav(tmp_path / "in.wav", np.arange(8000, dtype=np.int16), 16_000)
    (tmp_path / "in.pho").write_text("_ 100\nm 100\na 200\n")
    shapes = [] if has_copy else ["--shapes", "azure"]
    command("animate", tmp_path / "in.pho", "-a", tmp_path / "in.wav", "-o", tmp_path / name, *shapes)
    assert (tmp_path / "b.wav").exists() == has_copy


def test_the_help_says_what_is_written_beside() -> None:
    """The sentence of ``say --help`` against the table."""
    for row in OUTPUT_KINDS:
        expected = [".wav"] if not (row.is_drawn and not row.is_image) and row.ending != ".wav" else []
        expected += [".fap"] if row.is_image or row.write is find_kind(Path("a.vrma")).write else []
        expected += [".png"] if row.is_image else []
        assert sorted(row.beside) == sorted(expected), row.ending
