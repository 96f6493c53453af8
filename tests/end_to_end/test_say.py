"""The main job, as a user runs it: a sentence in, files out, and what they hold."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fapengine.cli import main
from fapengine.files.motion import load_fap
from fapengine.files.pictures import load_picture
from fapengine.files.sound import load_sound
from fapengine.mesh.default_head.head import build_head
from fapengine.render.camera import preset
from fapengine.voices.espeak import EspeakVoice
from tests.processes import start
from tests.projection import project
from tests.videos import Video, load_video

SENTENCE = "Bright sunshine shimmers on the ocean."
LEAD_S = 0.3


def run(*arguments: str, code: int = 0, stdin: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fapengine", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, input=stdin)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done


def told(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and error text of the program, in this process: starting one for each takes long."""
    monkeypatch.setattr(sys, "argv", ["fapengine", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code, capsys.readouterr().err  # type: ignore[return-value]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the README's command leaves, once for all tests."""
    out = tmp_path_factory.mktemp("demo")
    run("say", SENTENCE, "--expression", "joy:0.4", "-o", str(out / "demo.mp4"))
    return out


@pytest.fixture(scope="module")
def video(folder: Path) -> Video:
    return load_video(folder / "demo.mp4")


def test_all_four_files_are_there(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == {"demo.mp4", "demo.fap", "demo.wav", "demo.png"}


def test_video_is_as_long_as_the_sound(folder: Path, video: Video) -> None:
    samples, rate_hz = load_sound(folder / "demo.wav")
    assert video.frames.shape[1:] == (512, 512, 3)
    assert video.rate_hz == pytest.approx(30.0)
    assert video.duration_s == pytest.approx(len(samples) / rate_hz, abs=1 / 30)
    assert video.sound_duration_s == pytest.approx(len(samples) / rate_hz, abs=1 / 30)
    assert len(video.frames) == len(load_fap(folder / "demo.fap"))


def dark_pixels(video: Video, time_s: float) -> int:
    """Pixels with less green than lips between nose and chin of the decoded picture, less those of a shut mouth."""
    head, camera = build_head(), preset("front")
    corner, chin, nose = (project(camera, head.point_mm(name), (512, 512)) for name in ("8.3", "2.1", "9.15"))
    half = int(corner[0] - 256) + 6
    mouth = np.s_[int(nose[1]) + 8 : int(chin[1]) - 6, 256 - half : 256 + half, 1]
    now, shut = (int((video.frames[number][mouth] < 80).sum()) for number in (round(time_s * video.rate_hz), 0))
    return now - shut


def test_the_mouth_is_open_on_ai_and_closed_on_m_in_pixels(video: Video) -> None:
    phones = EspeakVoice().speak(SENTENCE).phones.phones
    at = {phone.label: LEAD_S + phone.start_s + 0.4 * phone.duration_s for phone in reversed(phones)}
    assert dark_pixels(video, at["aɪ"]) > 240
    assert dark_pixels(video, at["m"]) < 150  # 98: shadow between lips that a smile has made longer


def test_sound_and_face_are_in_sync(folder: Path, video: Video) -> None:
    """The lips leave each other within 100 ms of the first sound."""
    samples, rate_hz = load_sound(folder / "demo.wav")
    sounding = np.flatnonzero(np.abs(samples) > 800)[0] / rate_hz
    opening = [dark_pixels(video, number / video.rate_hz) > 60 for number in range(len(video.frames))]
    assert abs(opening.index(True) / video.rate_hz - sounding) < 0.15


def test_faces_move_and_rest_at_the_ends(video: Video) -> None:
    change = np.abs(np.diff(video.frames[:, ::4, ::4].astype(int), axis=0)).mean(axis=(1, 2, 3))
    assert change.max() > 0.5
    first, last = video.frames[0].astype(int), video.frames[-1].astype(int)
    assert np.abs(first - last).mean() < 4


def test_contact_sheet_is_a_picture_with_many_faces(folder: Path) -> None:
    sheet = load_picture(folder / "demo.png")
    assert sheet.shape[1] > 1000
    assert sheet.shape[0] > 700


def test_json_says_what_was_done(tmp_path: Path) -> None:
    done = run("say", "-", "-o", str(tmp_path / "a.fap"), "--json", stdin="Hello there.")
    said = json.loads(done.stdout)
    assert said["files"]["FAPs"].endswith("a.fap")
    assert said["unknown_phones"] == []
    assert said["frames"] == round(said["duration_s"] * 30)
    assert not (tmp_path / "a.mp4").exists()


def test_animate_a_textgrid_with_its_sound(tmp_path: Path, folder: Path) -> None:
    tier = (
        '"ooTextFile"\n"TextGrid"\n0\n1\n<exists>\n1\n"IntervalTier"\n"phones"\n0\n1\n2\n0.1\n0.4\n"M"\n0.4\n1\n"AY1"\n'
    )
    (tmp_path / "talk.TextGrid").write_text(tier)
    out = tmp_path / "talk.webm"
    run("animate", str(tmp_path / "talk.TextGrid"), "-a", str(folder / "demo.wav"), "-o", str(out), "--size", "128")
    video = load_video(out)
    assert video.frames.shape[1:] == (128, 128, 3)
    samples, rate_hz = load_sound(folder / "demo.wav")
    assert video.duration_s == pytest.approx(len(samples) / rate_hz, abs=1 / 30)


def test_animate_without_sound(tmp_path: Path) -> None:
    (tmp_path / "talk.pho").write_text("_ 100\nm 100\naI 300\nQQQ 100\n_ 200\n")
    done = run("animate", str(tmp_path / "talk.pho"), "-o", str(tmp_path / "talk.fap"))
    assert len(load_fap(tmp_path / "talk.fap")) == 24
    assert "FAPs" in done.stdout


def test_a_stream_renders_as_its_faps_do(tmp_path: Path, folder: Path, video: Video) -> None:
    stream, out, still = tmp_path / "demo.fba", tmp_path / "again.mp4", tmp_path / "still.png"
    run("encode", str(folder / "demo.fap"), "--fit-ranges", "-o", str(stream))
    run("render", str(stream), "-a", str(folder / "demo.wav"), "-o", str(out))
    again = load_video(out)
    assert len(again.frames) == len(video.frames)
    assert again.sound_duration_s == pytest.approx(video.sound_duration_s, abs=0.03)
    assert np.abs(again.frames.astype(int) - video.frames).mean() < 2  # q 1 and two passes of H.264
    run("render", str(folder / "demo.fap"), "--at", "1.0", "-o", str(still))
    assert np.abs(load_picture(still).astype(int) - video.frames[30]).mean() < 4


def test_what_cannot_be_rendered_is_told(
    tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(["render", str(folder / "demo.png")], monkeypatch, capsys)[0] == 1
    late = ["render", str(folder / "demo.fap"), "--at", "99", "-o", str(tmp_path / "late.png")]
    code, text = told(late, monkeypatch, capsys)
    assert code == 2
    assert "lasts" in text


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["say", "Hello", "-o", "x.avi"], 2, ".mp4"),
        (["say", "Hello", "--expression", "glee:1"], 2, "joy, sadness"),
        (["say", "Hello", "--expression", "joy:much"], 2, "joy:0.4"),
        (["say", "Hello", "--voice", "klingon9"], 2, "language code"),
        (["say", "Hello", "--size", "big"], 2, "512x512"),
        (["say", "Hello", "--size", "511x512", "-o", "x.mp4"], 2, "even"),
        (["say", "Hello", "--camera", "under"], 2, "front"),
        (["say", "..."], 2, "nothing to speak"),
        (["say", "Hello", "--wpm", "5"], 2, "80 to 449"),
        (["say", "Hello", "--profile", "nobody"], 2, "grid_s1_en"),
        (["animate", "none.TextGrid"], 2, "cannot be read"),
        (["render", "none.fap", "-o", "x.avi"], 2, ".png"),
        (["render", "none.fap"], 2, "cannot be read"),
        (["say", "Hello", "-o", "/dev/null/x.fap"], 3, "cannot be written"),
    ],
)
def test_errors_are_one_line_with_the_right_code(
    arguments: list[str],
    code: int,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "-o" not in arguments:
        arguments = [*arguments, "-o", str(tmp_path / ("x.mp4" if arguments[0] == "render" else "x.fap"))]
    found, text = told(arguments, monkeypatch, capsys)
    assert found == code
    assert message in text
    assert len(text.strip().splitlines()) == 1


def test_an_error_of_the_installed_program_is_one_line_too(tmp_path: Path) -> None:
    text = run("say", "Hello", "--camera", "under", "-o", str(tmp_path / "x.fap"), code=2).stderr
    assert "front" in text
    assert len(text.strip().splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_film_that_is_stopped_leaves_the_earlier_one(number: signal.Signals, folder: Path, tmp_path: Path) -> None:
    film = tmp_path / "film.mp4"
    film.write_bytes(b"an earlier film")
    command = [sys.executable, "-m", "fapengine", "render", str(folder / "demo.fap"), "-o", str(film)]
    with start(command, stderr=subprocess.PIPE, text=True) as drawing:
        until_s = time.monotonic() + 300
        while len(list(tmp_path.iterdir())) < 2:  # until the new one is begun
            assert drawing.poll() is None
            assert time.monotonic() < until_s
            time.sleep(0.01)
        drawing.send_signal(number)
        text = drawing.communicate(timeout=300)[1]
    assert drawing.returncode == (-number if number == signal.SIGKILL else 128 + number), text
    assert "Traceback" not in text
    assert film.read_bytes() == b"an earlier film"
    assert number == signal.SIGKILL or list(tmp_path.iterdir()) == [film]


def test_bad_data_exits_with_1(tmp_path: Path) -> None:
    (tmp_path / "bad.TextGrid").write_text('"ooTextFile"\n"TextGrid"\n')
    done = run("animate", str(tmp_path / "bad.TextGrid"), code=1)
    assert "bad.TextGrid" in done.stderr


def test_doctor_tells_what_works() -> None:
    findings = {line["part"]: line for line in json.loads(run("doctor", "--json").stdout)}
    assert {"Python", "profile", "OpenGL", "window", "voices", "video", "sound", "live server"} <= set(findings)
    assert findings["OpenGL"]["works"]
    assert findings["voices"]["works"]
    assert all(line["works"] or line["fix"] for line in findings.values())
    assert "OpenGL" in run("doctor").stdout


def test_help_is_quick_and_teaches() -> None:
    """How quick, bench/say.py tells; here: nothing is loaded that takes long."""
    text = run("--help").stdout
    code = (
        "import sys; from fapengine.cli import main; print(*{'numpy', 'scipy', 'PIL', 'moderngl'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout == "\n"
    assert all(command in text for command in ("say", "animate", "doctor"))
    assert 'fapengine say "Hello there." --live' in run("say", "--help").stdout
