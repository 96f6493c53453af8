"""The public interface at work: say, animate, save, load and draw, as a program that imports fapengine would."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fapengine
from fapengine.files.motion import as_visemes
from fapengine.files.sound import load_sound
from fapengine.voices.protocol import Speech
from tests.videos import load_video

SMALL = (64, 64)
HEAD = "default:level=coarse"
PHONES = [fapengine.Phone("_", 0.0, 0.1), fapengine.Phone("m", 0.1, 0.2), fapengine.Phone("a", 0.2, 0.4)]


class Beep:
    """A voice of one's own: anything with ``speak``."""

    def speak(self, text: str) -> Speech:
        samples = np.zeros(6400, np.int16)
        return Speech(samples=samples, sample_rate_hz=16_000, phones=fapengine.PhoneTrack.from_phones(PHONES))


@pytest.fixture(scope="module")
def mama() -> fapengine.Performance:
    return fapengine.speak("Mama.", voice=Beep(), expressions={"joy": 0.4}, rate_hz=12.5)


def test_three_lines(tmp_path: Path) -> None:
    hello = fapengine.speak("Hello there.", expressions={"joy": 0.4})
    made = hello.save(tmp_path / "new" / "hello.mp4", size=SMALL, head=HEAD)
    video = load_video(made)
    assert video.frames.shape == (len(hello.track), 64, 64, 3)
    assert video.sound_duration_s == pytest.approx(hello.duration_s, abs=0.05)


def test_a_performance_is_phones_motion_and_sound(mama: fapengine.Performance) -> None:
    assert mama.duration_s == pytest.approx(0.3 + 0.4 + 0.5)
    assert len(mama.track) == round(12.5 * mama.duration_s)
    assert [phone.label for phone in mama.phones.phones if not phone.is_silence] == ["m", "a"]
    assert mama.text == "Mama."
    again = fapengine.speak("Mama.", voice=Beep(), expressions=["joy:0.4"], rate_hz=12.5)
    assert again.track.equals(mama.track)
    other = fapengine.speak("Mama.", voice=Beep(), rate_hz=12.5, style=fapengine.Style.speech_only(), seed=2)
    assert not other.track.equals(mama.track)


@pytest.mark.parametrize(
    "name", ["a.fap", "a.fba", "a.csv", "a.wav", "a.gif", "a.webp", "a.png", "f_%02d.png", "shots"]
)
def test_it_is_saved_as_the_name_asks(mama: fapengine.Performance, name: str, tmp_path: Path) -> None:
    made = mama.save(str(tmp_path / name), size=SMALL, head=HEAD)
    assert made == tmp_path / name
    if made.suffix in (".fap", ".fba"):
        loaded = fapengine.load(made).values
        half_a_step = 0 if made.suffix == ".fap" else 85  # of the head's turns, AU; smaller for all others
        assert np.abs(loaded - mama.track.values).max() <= half_a_step
    elif made.suffix == ".csv":
        assert len(made.read_text().splitlines()[0].split(",")) == 1 + 52 + 3
    elif made.suffix == ".wav":
        assert load_sound(made)[1] == 16_000
    elif name in ("a.gif", "a.webp", "a.png"):
        with Image.open(made) as image:
            assert image.size == SMALL
            assert getattr(image, "n_frames", 1) == (1 if name == "a.png" else len(mama.track))
    else:
        pictures = sorted((tmp_path / "shots" if name == "shots" else tmp_path).glob("*.png"))
        assert len(pictures) == len(mama.track)


def test_shapes_and_bit_rates_are_chosen(mama: fapengine.Performance, tmp_path: Path) -> None:
    header = mama.save(tmp_path / "a.csv", shapes="oculus").read_text().splitlines()[0]
    assert "PP" in header
    coarse = mama.save(tmp_path / "coarse.fba", kbit_s=1.0).stat().st_size
    fine = mama.save(tmp_path / "fine.fba", encoding=fapengine.EncoderOptions(quant=1)).stat().st_size
    assert coarse < fine


def test_a_stream_loaded_twice_is_the_same(mama: fapengine.Performance, tmp_path: Path) -> None:
    fapengine.save(mama.track, tmp_path / "a.fba", kbit_s=4)
    first = fapengine.load(tmp_path / "a.fba")
    assert first.equals(fapengine.load(str(tmp_path / "a.fba")))
    assert first.rate_hz == 12.5


@pytest.mark.parametrize("given", ["path", "text", "track"])
def test_timings_are_animated(given: str, tmp_path: Path) -> None:
    path = tmp_path / "talk.pho"
    path.write_text("_ 100\nm 100\na 200\n")
    sound = fapengine.speak("Mama.", voice=Beep()).save(tmp_path / "talk.wav")
    timings = {"path": path, "text": str(path), "track": fapengine.PhoneTrack.from_phones(PHONES)}[given]
    talk = fapengine.animate(timings, sound=str(sound), rate_hz=25.0)
    assert talk.duration_s == pytest.approx(1.2)
    assert len(talk.track) == 30
    silent = fapengine.animate(timings, rate_hz=25.0)
    assert silent.sound is None
    assert silent.duration_s == pytest.approx(0.4)


def test_words_are_pronounced(tmp_path: Path) -> None:
    (tmp_path / "talk.align").write_text("0 10000 sil\n10000 30000 bin\n")
    talk = fapengine.animate(tmp_path / "talk.align", voice="en-gb", rate_hz=25.0)
    assert {phone.word for phone in talk.phones.phones if not phone.is_silence} == {"bin"}
    assert len(talk.phones.phones) > 2


def test_frames_are_pictures(mama: fapengine.Performance) -> None:
    drawing = fapengine.RenderOptions.parse(background="none", camera="profile")
    pictures = list(fapengine.frames(mama.track, head=fapengine.load_head(HEAD), drawing=drawing, size=(96, 64)))
    assert len(pictures) == len(mama.track)
    assert {picture.shape for picture in pictures} == {(64, 96, 4)}
    assert pictures[0][2, 2, 3] == 0


def test_frames_that_a_track_skips_show_the_one_before() -> None:
    from dataclasses import replace

    pose = fapengine.FapTrack.from_values([[0] * 68, [0] * 2 + [400] + [0] * 65], rate_hz=10.0)
    skipping = replace(pose, frame_numbers=np.array([4, 7]))
    pictures = list(fapengine.frames(skipping, head=HEAD, size=SMALL))
    assert len(pictures) == 4
    assert np.array_equal(pictures[0], pictures[2])
    assert not np.array_equal(pictures[2], pictures[3])


def test_a_picture_is_of_the_time_that_is_asked_for_or_of_the_widest_jaw(tmp_path: Path) -> None:
    rest, wide = [0] * 68, [0] * 2 + [400] + [0] * 65
    track = fapengine.FapTrack.from_values([rest, wide, rest], rate_hz=10.0)
    shots = [
        fapengine.save(track, tmp_path / f"{n}.png", at_s=at_s, head=HEAD, size=SMALL).read_bytes()
        for n, at_s in enumerate((0.0, 0.09, 0.1, None))
    ]
    assert shots[0] == shots[1] != shots[2] == shots[3]
    with pytest.raises(fapengine.UsageError, match=r"at_s: got 0.5 s, the track lasts 0.20 s"):
        fapengine.save(track, tmp_path / "a.png", at_s=0.5)


def test_a_pose_names_its_faps() -> None:
    assert fapengine.FapTrack.pose(open_jaw=300).values[0].nonzero()[0].tolist() == [2]
    with pytest.raises(fapengine.UsageError, match="unknown name 'open_mouth'"):
        fapengine.FapTrack.pose(open_mouth=1)


def test_heads_have_many_names() -> None:
    young = fapengine.load_head(fapengine.HeadStyle(age=0.0))
    assert np.array_equal(young.vertices_mm, fapengine.load_head("default:age=0.0").vertices_mm)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m, p: m.save(p / "a.avi"), r"path: got .*a\.avi, expected a name that ends with \.fap, \.fba"),
        (lambda m, p: fapengine.load(p / "a.mp4"), r"path: got .*a\.mp4, expected a name that ends with \.fap, \.fba"),
        (lambda m, p: fapengine.load(p / "none.fap"), r"none\.fap: cannot be read"),
        (lambda m, p: fapengine.save(m.track, p / "a.wav"), "sound: missing"),
        (lambda m, p: m.save(p / "a.mp4", size=(63, 64)), "size: got 63x64, expected even sides"),
        (lambda m, p: m.save(p / "a.csv", shapes="lips"), "shapes: got 'lips'"),
        (lambda m, p: m.save(p / "a.fba", kbit_s=1, encoding=fapengine.EncoderOptions()), "kbit_s and encoding"),
        (lambda m, p: fapengine.load_head(p / "none"), r"head: got .*none"),
        (lambda m, p: fapengine.speak("Hi.", voice=Beep(), expressions={"glee": 1}), "expressions: got 'glee'"),
        (lambda m, p: fapengine.speak("Hi.", voice=Beep(), profile="nobody"), "nobody"),
        (lambda m, p: fapengine.speak("Hi.", voice="klingon9"), "voice: got 'klingon9'"),
        (lambda m, p: fapengine.animate(p / "none.TextGrid"), "cannot be read"),
    ],
)  # fmt: skip
def test_wrong_calls_are_usage_errors(mama: fapengine.Performance, call: object, message: str, tmp_path: Path) -> None:
    with pytest.raises(fapengine.UsageError, match=message):
        call(mama, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.fap", "a.fba", "a.csv", "a.wav", "a.png", "a.mp4", "a.gif", "shots"])
def test_a_path_that_cannot_be_written(mama: fapengine.Performance, name: str) -> None:
    with pytest.raises(fapengine.ResourceError, match=re.escape(f"/dev/null/{name}")):
        mama.save(f"/dev/null/{name}", size=SMALL, head=HEAD)


def test_weights_are_arrays_with_names(mama: fapengine.Performance, tmp_path: Path) -> None:
    values, names, times_s = fapengine.weights(mama.track)
    assert values.shape == (len(mama.track), 52) == (len(times_s), len(names))
    table = np.loadtxt(mama.save(tmp_path / "a.csv"), delimiter=",", skiprows=1)
    assert np.allclose(table[:, 1:53], values, atol=1e-5)
    assert "jawOpen" in names
    with pytest.raises(fapengine.UsageError, match="shapes: got 'lips'"):
        fapengine.weights(mama.track, "lips")


def test_weights_show_visemes_as_the_table_does(mama: fapengine.Performance, tmp_path: Path) -> None:
    visemes = as_visemes(mama.track)
    table = np.loadtxt(fapengine.save(visemes, tmp_path / "a.csv"), delimiter=",", skiprows=1)
    values = fapengine.weights(visemes).values
    assert values.any()
    assert np.allclose(table[:, 1:53], values, atol=1e-5)


def test_weights_become_a_table_of_pandas(mama: fapengine.Performance) -> None:
    pytest.importorskip("pandas")
    table = fapengine.weights(mama.track, "oculus").to_frame()
    assert table.shape == (len(mama.track), 15)
    assert table.index.name == "time_s"


def test_what_is_printed_is_a_line(mama: fapengine.Performance) -> None:
    assert repr(mama).startswith("Performance('Mama.', FapTrack(15 frames, 1.20 s at 12.5 Hz")
    assert "\n" not in repr(mama)
