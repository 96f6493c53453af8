"""Sound of any kind in: what comes out right, and what is refused."""

import re
import struct
import wave
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.files.sound import MAX_RATE_HZ, inspect_sound, load_sound, stream_sound

RATE_HZ = 48_000
TIMES_S = np.arange(RATE_HZ) / RATE_HZ
LEFT = 12_000 * np.sin(2 * np.pi * 500 * TIMES_S)
STEREO = np.stack([LEFT, np.zeros(RATE_HZ)], axis=1).astype(np.int16)
"""A tone in the first channel, silence in the second."""
CODECS = {
    ".wav": "pcm_s16le", ".flac": "flac", ".mp3": "libmp3lame", ".ogg": "libopus", ".opus": "libopus", ".m4a": "aac",
    ".mkv": "aac", ".webm": "libopus", ".mp4": "aac", ".w64": "pcm_s16le", ".caf": "pcm_s16le", ".aiff": "pcm_s16be",
}  # fmt: skip

OGG = (".ogg", ".opus")


def encoded(path: Path) -> Path:
    options = {"page_duration": "50000"} if path.suffix in OGG else {}  # 0.05 s; FFmpeg's default is a second
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream(CODECS[path.suffix], rate=RATE_HZ, layout="stereo")
        resampler = av.AudioResampler(
            format=stream.format, layout="stereo", rate=RATE_HZ, frame_size=stream.frame_size or None
        )
        frame = av.AudioFrame.from_ndarray(STEREO.reshape(1, -1), format="s16", layout="stereo")
        frame.sample_rate, frame.pts = RATE_HZ, 0
        for piece in (*resampler.resample(frame), *resampler.resample(None)):
            container.mux(stream.encode(piece))
        container.mux(stream.encode(None))
    return path


def wav(path: Path, frames: bytes, *, rate_hz: int = 16_000, width: int = 2, channels: int = 1) -> Path:
    with wave.open(str(path), "wb") as out:
        out.setnchannels(channels)
        out.setsampwidth(width)
        out.setframerate(rate_hz)
        out.writeframes(frames)
    return path


def tone(count: int = 16_000, period: float = 40.0) -> NDArray[np.float64]:
    return np.sin(np.arange(count) * 2 * np.pi / period)


@pytest.mark.parametrize("suffix", CODECS)
def test_every_kind_of_file_and_each_of_its_channels(tmp_path: Path, suffix: str) -> None:
    path = encoded(tmp_path / f"talk{suffix}")
    info = inspect_sound(path)
    assert (info.sample_rate_hz, info.channels) == (RATE_HZ, 2)
    assert info.duration_s == pytest.approx(1.0, abs=0.05)
    both, rate_hz = load_sound(path, rate_hz=16_000)
    first, _ = load_sound(path, rate_hz=16_000, channel=1)
    second, _ = load_sound(path, rate_hz=16_000, channel=2)
    assert rate_hz == 16_000
    assert len(both) == pytest.approx(16_000, abs=200)  # a codec may pad
    middle = slice(4000, 12_000)
    assert np.abs(first[middle]).max() == pytest.approx(12_000, rel=0.25)  # AAC is free to be off by as much
    assert np.abs(second[middle]).max() < 600
    assert np.abs(both[middle]).max() == pytest.approx(6000, rel=0.25)


def test_channel_that_is_not_there(tmp_path: Path) -> None:
    path = encoded(tmp_path / "talk.wav")
    for channel in (0, 3):
        with pytest.raises(UsageError, match=rf"channel: got {channel}, expected 1 to 2"):
            load_sound(path, channel=channel)


@pytest.mark.parametrize(
    ("width", "spell"),
    [
        (1, lambda x: (128 + 127 * x).astype(np.uint8).tobytes()),
        (2, lambda x: (32_767 * x).astype("<i2").tobytes()),
        (3, lambda x: (2**31 * 0.9999 * x).astype("<i4").view(np.uint8).reshape(-1, 4)[:, 1:].tobytes()),
        (4, lambda x: (2**31 * 0.9999 * x).astype("<i4").tobytes()),
    ],
)
def test_every_depth_has_the_same_values(
    tmp_path: Path, width: int, spell: Callable[[NDArray[np.float64]], bytes]
) -> None:
    samples, _ = load_sound(wav(tmp_path / "a.wav", spell(tone()), width=width))
    assert np.abs(samples - 32_767 * tone()).max() <= (512 if width == 1 else 4)  # two steps of 8 bits


def test_many_channels_and_high_rates(tmp_path: Path) -> None:
    many = np.repeat((9000 * tone()).astype("<i2")[:, None], 32, axis=1)
    samples, _ = load_sound(wav(tmp_path / "many.wav", many.tobytes(), channels=32))
    assert np.array_equal(samples, many[:, 0])
    fast = wav(tmp_path / "fast.wav", (9000 * tone(192_000, 384.0)).astype("<i2").tobytes(), rate_hz=192_000)
    samples, rate_hz = load_sound(fast)
    assert (rate_hz, len(samples)) == (MAX_RATE_HZ, 48_000)
    assert np.abs(samples[100:-100] - 9000 * tone(48_000, 96.0)[100:-100]).max() < 60


def test_pieces_are_the_whole(tmp_path: Path) -> None:
    path = encoded(tmp_path / "talk.flac")
    whole, _ = load_sound(path, rate_hz=16_000)
    pieces = list(stream_sound(path, rate_hz=16_000))
    assert len(pieces) > 5
    assert np.array_equal(np.concatenate(pieces), whole)


def test_one_sample_is_a_sound_and_none_is_not(tmp_path: Path) -> None:
    samples, _ = load_sound(wav(tmp_path / "one.wav", b"\1\1"))
    assert samples.tolist() == [257]
    with pytest.raises(DataError, match="holds no sound"):
        load_sound(wav(tmp_path / "none.wav", b""))


@pytest.mark.parametrize("suffix", CODECS)
def test_a_tag_in_front_changes_nothing(tmp_path: Path, suffix: str) -> None:
    path = encoded(tmp_path / f"talk{suffix}")
    samples, rate_hz = load_sound(path)
    body = b"TIT2" + struct.pack(">I", 100_000) + bytes(2) + b"\0" + b"A" * 99_999
    size = bytes(len(body) >> shift & 127 for shift in (21, 14, 7, 0))
    path.write_bytes(b"ID3\x03\0\0" + size + body + path.read_bytes())
    tagged, tagged_hz = load_sound(path)
    assert tagged_hz == rate_hz
    assert np.array_equal(tagged, samples)


@pytest.mark.parametrize("suffix", [".wav", ".flac", ".mp3", ".mkv", ".w64", ".caf", *OGG])
def test_a_file_that_was_cut_off_says_so(tmp_path: Path, suffix: str, caplog: pytest.LogCaptureFixture) -> None:
    path = encoded(tmp_path / f"talk{suffix}")
    whole = len(load_sound(path)[0])
    assert not caplog.messages
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    part = len(load_sound(path)[0])
    assert 0.2 * whole < part < 0.7 * whole
    stated = "" if suffix in OGG else r" of the 1\.0[0-3] s that it states"
    said = re.escape(f"{path}: has {part / RATE_HZ:.2f} s") + f"{stated}: damaged or cut off"
    assert len(caplog.messages) == 1
    assert re.fullmatch(said, caplog.messages[0])


def test_an_m4a_that_was_cut_off_says_so(tmp_path: Path) -> None:
    """Its index stands behind the sound; without it nothing can be read."""
    path = encoded(tmp_path / "talk.m4a")
    data = path.read_bytes()
    for size in (data.index(b"moov"), data.index(b"trak")):
        path.write_bytes(data[:size])
        with pytest.raises(TruncatedError, match=r"talk\.m4a: its index, moov, is not complete: cut off"):
            load_sound(path)


def test_an_mp3_without_a_count_is_not_said_to_be_cut_off(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = encoded(tmp_path / "talk.mp3")
    data = path.read_bytes()
    mark = next(mark for mark in (b"Xing", b"Info") if mark in data)
    path.write_bytes(data.replace(mark, b"none")[: len(data) * 6 // 10])
    load_sound(path)
    assert not caplog.messages


@pytest.mark.parametrize(
    ("where", "lie", "outcome"),
    [
        (slice(40, 44), struct.pack("<I", 0xFFFFFFFF), "right"),  # length of the data
        (slice(24, 28), struct.pack("<I", 0xFFFFFFF0), "refused"),  # rate
        (slice(24, 28), struct.pack("<I", 1), "refused"),
        (slice(20, 22), struct.pack("<H", 0x7777), "refused"),  # codec
        (slice(22, 24), struct.pack("<H", 0), "refused"),  # channels
    ],
)
def test_lying_headers(tmp_path: Path, where: slice, lie: bytes, outcome: str) -> None:
    path = wav(tmp_path / "lie.wav", (9000 * tone()).astype("<i2").tobytes())
    data = bytearray(path.read_bytes())
    data[where] = lie
    path.write_bytes(data)
    if outcome == "right":
        assert len(load_sound(path)[0]) == 16_000
    else:
        with pytest.raises(DataError, match=r"lie\.wav"):
            load_sound(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("list.wav", "ffconcat version 1.0\nfile 'secret.wav'\n"),
        ("session.wav", "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=audio 5004 RTP/AVP 0\n"),
        ("playlist.wav", "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\nsecret.wav\n#EXT-X-ENDLIST\n"),
    ],
)
def test_a_file_that_names_others_opens_none(
    tmp_path: Path, name: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    wav(tmp_path / "secret.wav", (9000 * tone()).astype("<i2").tobytes())
    monkeypatch.chdir(tmp_path)  # a list may name files beside it
    (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match="cannot be decoded as sound"):
        load_sound(Path(name))


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("sound")
    return {suffix: encoded(folder / f"talk{suffix}").read_bytes() for suffix in (".wav", ".mp3", ".m4a", ".ogg")}


@given(data=st.data())
def test_damaged_files_are_read_or_refused(
    originals: dict[str, bytes], tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    suffix = data.draw(st.sampled_from(sorted(originals)))
    whole = bytearray(originals[suffix])
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=20)):
        whole[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.getbasetemp() / f"damaged{suffix}"
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    try:
        samples, _ = load_sound(path)
    except DataError as refused:
        message = str(refused)
        assert str(path) in message
    else:
        assert samples.dtype == np.int16


def silence(path: Path, seconds: int) -> Path:
    """A FLAC file of silence of few bytes."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(
            "flac", rate=8000, layout="mono", options={"compression_level": "0", "frame_size": "65535"}
        )
        for start in range(0, seconds, 10):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 80_000), np.int16), format="s16", layout="mono")
            frame.sample_rate, frame.pts = 8000, start * 8000
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def test_a_small_file_of_long_silence_is_refused_unless_it_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(load_sound(silence(tmp_path / "short.flac", 300))[0]) == 300 * 8000
    long = silence(tmp_path / "long.flac", 320)
    assert long.stat().st_size < 30_000
    with pytest.raises(DataError, match=r"got more than 300 s of sound in \d+ bytes, .*FAPENGINE_LONG=1 reads it"):
        load_sound(long)
    monkeypatch.setenv("FAPENGINE_LONG", "1")
    assert len(load_sound(long)[0]) == 320 * 8000


def test_sound_is_read_a_minute_beyond_its_timings(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = silence(tmp_path / "long.flac", 100)
    assert len(load_sound(path, spoken_s=40.0)[0]) == 100 * 8000
    assert not caplog.messages
    assert len(load_sound(path, spoken_s=1.0)[0]) == 61 * 8000
    assert caplog.messages == [f"{path}: only the first 61 s were read, as the speech ends at 1.00 s"]


@pytest.mark.parametrize("suffix", ["wav", "mp3", "mp4"])
def test_an_empty_file_is_said_to_be_empty(tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]) -> None:
    """PyAV prints a traceback of its own for an empty .mp3."""
    (tmp_path / f"none.{suffix}").touch()
    with pytest.raises(DataError, match="the file is empty"):
        load_sound(tmp_path / f"none.{suffix}")
    assert capfd.readouterr() == ("", "")
