"""``animate`` of a recording and ``align``, from the command line to files."""

import io
import json
import wave
from pathlib import Path

import numpy as np
import pytest

import fapengine
from fapengine.app.hearing import Recognition, hear
from fapengine.cli._hearing import RecognitionOptions
from fapengine.cli.main import app
from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
from fapengine.files.motion import load_fap
from fapengine.files.sound import load_sound, save_wav
from fapengine.recognition.protocol import RATE_HZ
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Voice
from tests.unit.recognition.speech import BABY, FAPU_MM, POPPIES, closures, met, no_speech, spoken
from tests.videos import load_video


def run(*arguments: object) -> int:
    code: int = app([str(argument) for argument in arguments], standalone_mode=False) or 0
    return code


@pytest.fixture(scope="module")
def talk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("talk") / "talk.wav"
    save_wav(path, spoken("slt", BABY).samples, RATE_HZ)
    return path


def test_a_language_without_a_transcript_is_remarked(talk: Path) -> None:
    assert hear(talk, Recognition(language="de")).notes == ("language: 'de' is used only with a transcript",)


@pytest.mark.parametrize("words", [BABY, None])
def test_the_mouth_is_shut_on_the_m_of_the_sound(talk: Path, tmp_path: Path, words: str | None) -> None:
    options = ["--transcript", words] if words else []
    run("animate", talk, *options, "-o", tmp_path / "face.mp4", "--size", "64x64", "--fps", 25, "--without", "all")
    video = load_video(tmp_path / "face.mp4")
    speech = spoken("slt", BABY)
    assert video.sound_duration_s == pytest.approx(len(speech.samples) / RATE_HZ, abs=0.1)
    values = load_fap(tmp_path / "face.fap").values
    opening_mm = -(values[:, 3] + values[:, 4]) * FAPU_MM
    truth = closures(speech.phones)
    shut = [opening_mm[max(round(at_s * 25) - 1, 0) : round(at_s * 25) + 2].min() < 1.0 for at_s in truth]
    assert sum(shut) >= (len(truth) if words else 0.6 * len(truth))
    assert opening_mm.max() > 6.0


def test_music_moves_nothing(tmp_path: Path) -> None:
    save_wav(tmp_path / "music.wav", no_speech()["music"], RATE_HZ)
    still = fapengine.Style.speech_only()
    track = fapengine.animate(tmp_path / "music.wav", style=still).track
    assert np.abs(track.values[:, 2:]).max() * FAPU_MM < 1.0


def test_align_writes_what_animate_reads(talk: Path, tmp_path: Path) -> None:
    (tmp_path / "talk.txt").write_text(BABY)
    run("align", talk, "--transcript-file", tmp_path / "talk.txt", "-o", tmp_path / "talk.TextGrid")
    heard = fapengine.animate(tmp_path / "talk.TextGrid", sound=talk)
    truth = closures(spoken("slt", BABY).phones)
    assert met(truth, closures(heard.phones)) == len(truth)
    assert {phone.word for phone in heard.phones.phones} >= {"My", "bumped", "bowl"}
    run("align", talk, "--transcript", BABY, "-o", tmp_path / "a.json")
    rows = json.loads((tmp_path / "a.json").read_text())["phones"]
    assert {"phone", "start", "end", "word", "confidence", "loudness_db", "pitch_hz"} == set(rows[0])


def test_words_that_are_pronounced_are_told(talk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("align", talk, "--transcript", "My bayby brother bumped the big blue bowl", "-o", tmp_path / "a.ctm", "--json")
    told = json.loads(capsys.readouterr().out)
    assert told["heard"] == ["not in the dictionary, pronounced by espeak-ng: bayby"]
    assert told["mismatches"] == []
    assert told["phones"] > 20


def test_without_espeak_words_are_pronounced_as_those_that_are_spelled_like_them(
    talk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(self: VoiceChoice, most_s: float = 0.0) -> Voice:
        raise ResourceError("voice: espeak-ng is not installed")

    monkeypatch.setattr(VoiceChoice, "load", absent)
    text = "My bayby brother bumped the big blue bowl"
    run("align", talk, "--transcript", text, "-o", tmp_path / "a.TextGrid", "--json")
    by = "similar words of the dictionary (espeak-ng is not installed)"
    assert json.loads(capsys.readouterr().out)["heard"] == [f"not in the dictionary, pronounced by {by}: bayby"]
    phones = fapengine.animate(tmp_path / "a.TextGrid", sound=talk).phones
    truth = closures(spoken("slt", BABY).phones)
    assert met(truth, closures(phones)) == len(truth)
    with pytest.raises(ResourceError, match="espeak-ng is not installed"):  # the dictionary is English
        fapengine.animate(talk, transcript=text, language="de")


def test_one_channel_of_two_speakers(tmp_path: Path) -> None:
    mine, yours = spoken("rms", BABY).samples, no_speech()["music"]
    both = np.zeros((max(len(mine), len(yours)), 2), "<i2")
    both[: len(mine), 1], both[: len(yours), 0] = mine, yours
    with wave.open(str(tmp_path / "two.wav"), "wb") as out:
        out.setnchannels(2)
        out.setsampwidth(2)
        out.setframerate(RATE_HZ)
        out.writeframes(both.tobytes())
    heard = fapengine.animate(tmp_path / "two.wav", channel=2, transcript=BABY)
    truth = closures(spoken("rms", BABY).phones)
    assert met(truth, closures(heard.phones)) == len(truth)
    assert all(phone.is_silence for phone in fapengine.animate(tmp_path / "two.wav", channel=1).phones.phones)


def test_two_speakers_in_two_channels_are_two_tracks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    speakers = [spoken("rms", BABY), spoken("rms", POPPIES)]
    both = np.zeros((max(len(speaker.samples) for speaker in speakers), 2), "<i2")
    for channel, speaker in enumerate(speakers):
        both[: len(speaker.samples), channel] = speaker.samples
    with wave.open(str(tmp_path / "two.wav"), "wb") as out:
        out.setparams((2, 2, RATE_HZ, 0, "NONE", ""))
        out.writeframes(both.tobytes())
    run("align", tmp_path / "two.wav", "--channel", "each", "-o", tmp_path / "two.TextGrid", "--json")
    told = json.loads(capsys.readouterr().out)
    assert [Path(each["file"]).name for each in told] == ["two-1.TextGrid", "two-2.TextGrid"]
    assert not (tmp_path / "two.TextGrid").exists()
    for number, speaker in enumerate(speakers, start=1):
        truth = closures(speaker.phones)
        heard = fapengine.animate(tmp_path / f"two-{number}.TextGrid").phones
        assert met(truth, closures(heard)) >= 0.8 * len(truth)
    run("animate", tmp_path / "two.wav", "--channel", "each", "-o", tmp_path / "two.fap", "--without", "all")
    motions = [load_fap(tmp_path / f"two-{number}.fap").values for number in (1, 2)]
    sounds = [load_sound(tmp_path / f"two-{number}.wav")[0] for number in (1, 2)]
    assert motions[0].shape == motions[1].shape
    assert np.abs(motions[0] - motions[1]).max() > 100
    for channel, sound in enumerate(sounds):
        np.testing.assert_array_equal(sound, both[:, channel])


@pytest.mark.parametrize(("width", "rate_hz", "channels"), [(1, RATE_HZ, 1), (2, 192_000, 1), (3, RATE_HZ, 32)])
def test_a_face_hears_any_form_of_sound(tmp_path: Path, width: int, rate_hz: int, channels: int) -> None:
    samples = np.repeat(spoken("rms", BABY).samples, rate_hz // RATE_HZ)
    spelled = {
        1: lambda: (samples // 256 + 128).astype(np.uint8)[:, None],
        2: lambda: samples.astype("<i2")[:, None].view(np.uint8),
        3: lambda: (samples.astype("<i4") * 256).view(np.uint8).reshape(-1, 4)[:, :3],
    }[width]()
    with wave.open(str(tmp_path / "odd.wav"), "wb") as out:
        out.setparams((channels, width, rate_hz, 0, "NONE", ""))
        out.writeframes(np.tile(spelled, (1, channels)).tobytes())
    truth = closures(spoken("rms", BABY).phones)
    heard = fapengine.animate(tmp_path / "odd.wav", transcript=BABY, style=fapengine.Style.speech_only())
    assert met(truth, closures(heard.phones)) == len(truth)


def test_one_sample_is_a_face_at_rest(tmp_path: Path) -> None:
    save_wav(tmp_path / "one.wav", np.array([999], np.int16), RATE_HZ)
    run("animate", tmp_path / "one.wav", "-o", tmp_path / "one.fap", "--without", "all")
    assert not load_fap(tmp_path / "one.fap").values.any()


def test_a_transcript_may_come_from_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"My baby.")))
    assert RecognitionOptions(Path("-")).value().transcript == "My baby."


def test_a_transcript_of_subtitles_is_their_text(tmp_path: Path) -> None:
    (tmp_path / "a.srt").write_text(
        "1\n00:00:00,000 --> 00:00:01,000\n<i>My baby</i>\nfell off.\n\n2\n00:00:01,000 --> 00:00:02,000\n42 boats\n"
    )
    assert RecognitionOptions(tmp_path / "a.srt").value().transcript == "My baby\nfell off.\n42 boats"
    rolling = (
        "WEBVTT\n\n00:00.000 --> 00:01.000\nMy<00:00:00.500><c> baby</c>\n\n00:01.000 --> 00:02.000\nMy baby\nfell\n"
    )
    (tmp_path / "a.vtt").write_text(rolling)
    assert RecognitionOptions(tmp_path / "a.vtt").value().transcript == "My baby\nfell"
    (tmp_path / "a.txt").write_text("From 10:30 --> 11:00\n")
    assert RecognitionOptions(tmp_path / "a.txt").value().transcript == "From 10:30 --> 11:00\n"


def test_refusals(talk: Path, tmp_path: Path) -> None:
    pho = tmp_path / "talk.pho"
    pho.write_text("m 80\na 120\n")
    empty = tmp_path / "empty.wav"
    empty.write_bytes(b"")
    cases: list[tuple[list[object], type[FapEngineError], str]] = [
        (["animate", talk, "--audio", talk], UsageError, "--audio: cannot be used with a recording"),
        (["animate", talk, "--voice", "de"], UsageError, "--voice: cannot be used with a recording"),
        (["animate", pho, "--transcript", "x"], UsageError, "--transcript: cannot be used with phone timings"),
        (["align", talk, "--transcript", "x", "--transcript-file", pho], UsageError, "use only one"),
        (["align", talk, "-o", tmp_path / "a.srt"], UsageError, r"--output: .*'\.srt'"),
        (["align", talk, "--channel", 2], UsageError, r"--channel: got 2, expected 1 to 1"),
        (
            ["align", talk, "--channel", "left"],
            UsageError,
            "--channel: must be a number from 1, or each",
        ),
        (["align", talk, "--channel", "0"], UsageError, r"--channel: got 0, expected 1 to 1"),
        (
            ["align", talk, "--channel", "each", "--transcript", "x"],
            UsageError,
            "--channel: each cannot be combined with a transcript",
        ),
        (["animate", pho, "--channel", "each"], UsageError, "--channel: each works with recordings only"),
        (["align", empty, "-o", tmp_path / "a.pho"], DataError, "the file is empty"),
        (["align", talk, "--transcript", "?!"], UsageError, "--transcript: .* expected words"),
        (
            ["align", talk, "--transcript", "The weather forecast for tomorrow is probably wrong."],
            DataError,
            r"\); --trust-transcript aligns them unchecked; the language is en-us, --language CODE is another",
        ),
        (["align", talk, "--transcript", "ja", "--language", "xx"], UsageError, "--language: got 'xx', expected a"),
        (["animate", talk, "--head", "nobody", "-o", tmp_path / "a.fap"], UsageError, "--head: got 'nobody', expected"),
        (["align", talk, "--trust-transcript"], UsageError, "--trust-transcript: requires a transcript"),
        (["animate", pho, "--trust-transcript"], UsageError, "--trust-transcript: cannot be used with phone timings"),
    ]
    for arguments, kind, message in cases:
        with pytest.raises(kind, match=message):
            run(*arguments)
    with pytest.raises(UsageError, match="cannot be used with a recording"):
        fapengine.animate(talk, sound=talk)
    with pytest.raises(UsageError, match="transcript: cannot be used with phone timings"):
        fapengine.animate(pho, transcript="mama")


def test_a_recording_is_never_written_over(talk: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.wav"
    own.write_bytes(talk.read_bytes())
    before = own.stat().st_mtime_ns
    run("animate", own, "-o", tmp_path / "own.fap")
    assert own.stat().st_mtime_ns == before
    assert own.read_bytes() == talk.read_bytes()
