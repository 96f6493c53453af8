"""Sound that is recorded beside positions."""

import struct

import numpy as np
import pytest

from fapengine.capture.articulography import parse_mview_sound
from fapengine.capture.c3d import BLOCK, format_c3d, parse_c3d, parse_c3d_sound
from fapengine.capture.marker_track import MarkerTrack, RecordedSound, synchrony
from fapengine.errors import DataError
from fapengine.files.recordings import load_recorded_sound
from fapengine.files.sound import load_sound
from tests.recordings import mview_file


def with_analog(track: MarkerTrack, analog: np.ndarray, *names: str) -> bytes:
    """A C3D file with analog samples, (T, samples a frame, channels), as floats."""
    data = format_c3d(track)
    frames, each, channels = analog.shape
    begin = BLOCK * (1 + data[BLOCK + 2])
    points = np.frombuffer(data[begin:], "<f4").reshape(frames, -1)
    head = bytearray(data[:begin])
    head[4:6], head[18:20] = struct.pack("<H", each * channels), struct.pack("<H", each)
    labels = b"".join(name.ljust(8).encode() for name in names)
    # the parameter USED of ANALOG makes room for LABELS: no channel count is needed beside the header's
    old = b"\x04\x03USED" + struct.pack("<h", 8) + b"\x02\x01\x01\0\0\0"
    assert old in head
    new = b"\x06\x03LABELS" + struct.pack("<hbBBB", 6 + len(labels), -1, 2, 8, len(names)) + labels + b"\0"
    used = head.replace(old, new)
    used = used[: begin - 1] if len(used) > begin else used
    return (
        bytes(used[:begin].ljust(begin, b"\0"))
        + np.hstack([points, analog.reshape(frames, -1)]).astype("<f4").tobytes()
    )


def test_an_analog_channel_is_sound(track, tmp_path):
    rng = np.random.default_rng(0)
    analog = rng.normal(0, 0.01, (20, 80, 2)) + 2.5  # 9600 Hz at 120 Hz, in volts with an offset
    data = with_analog(track, analog, "Force", "Mic 1")
    assert parse_c3d(data).positions.shape == (20, 6, 3)
    sound = parse_c3d_sound(data)
    assert sound is not None
    assert (sound.label, sound.rate_hz, len(sound.samples)) == ("Mic 1", 9600, 1600)
    expected = analog[..., 1].ravel() - np.median(analog[..., 1])
    assert np.corrcoef(sound.samples, expected)[0, 1] > 0.999
    assert 16000 < np.abs(sound.samples.astype(int)).max() <= 16384
    path = tmp_path / "take.c3d"
    path.write_bytes(data)
    samples, rate_hz = load_sound(path)
    assert (len(samples), rate_hz) == (1600, 9600)
    assert parse_c3d_sound(with_analog(track, analog, "Force", "Other")) is None  # two, and none is named
    assert parse_c3d_sound(with_analog(track, analog[:, :20, :1], "Force")) is None  # 2400 Hz
    assert parse_c3d_sound(format_c3d(track)) is None
    path.write_bytes(format_c3d(track))
    assert load_recorded_sound(path) is None
    with pytest.raises(DataError, match="holds no sound"):
        load_sound(path)


def test_mview_has_sound(track, tmp_path):
    sound = parse_mview_sound(mview_file(track))
    assert sound is not None
    assert (sound.label, sound.rate_hz, len(sound.samples)) == ("AUDIO", 16000, 16)
    (tmp_path / "take.mat").write_bytes(mview_file(track))
    assert load_recorded_sound(tmp_path / "take.mat") is not None
    with pytest.raises(DataError, match="4000 to 768000 Hz, got 100 Hz"):
        RecordedSound.of("slow", np.zeros(9), 100.0)


def recorded(delay_s: float, seconds: float = 12.0) -> tuple[RecordedSound, MarkerTrack]:
    """A mouth that opens and shuts in bursts, and noise as loud as it is fast, later by a delay."""
    rng = np.random.default_rng(3)
    times = np.arange(round(100 * seconds)) / 100
    speed = np.interp(
        times, np.arange(0, seconds + 0.2, 0.2), rng.uniform(0, 1, len(np.arange(0, seconds + 0.2, 0.2))) ** 3
    )
    places = np.zeros((len(times), 3, 3))
    places[:, 0, 1] = np.cumsum(speed * np.sign(np.sin(20 * times)))
    fine = np.arange(round(8000 * seconds)) / 8000
    noise = rng.normal(size=len(fine)) * np.interp(fine - delay_s, times, speed)
    return RecordedSound.of("mic", noise, 8000), MarkerTrack(positions_mm=places, labels=("a", "b", "c"), rate_hz=100.0)


@pytest.mark.parametrize("delay_s", [0.0, 0.2, -0.3])
def test_the_delay_between_sound_and_motion_is_found(delay_s):
    found = synchrony(*recorded(delay_s))
    assert found is not None
    assert found.delay_s == pytest.approx(delay_s, abs=0.02)
    assert found.is_doubtful == (delay_s != 0.0)


def test_sound_after_the_last_frame_does_not_count():
    sound, track = recorded(0.2)
    longer = np.concatenate([sound.samples, np.full(100 * sound.rate_hz, 2**14, np.int16)])
    assert synchrony(RecordedSound("longer", longer, sound.rate_hz), track) == synchrony(sound, track)


@pytest.mark.parametrize("scale", [5e-324, 1e-310, 1.0, 1e299])
def test_any_scale_gives_the_same_sound(scale):
    values = np.array([0.0, 1.0, -1.0, 0.0, 0.0]) * scale
    values[3:] = np.nan, -1.7e308
    assert RecordedSound.of("a", values, 16000.0).samples.tolist() == [0, 2**14, -(2**14), 0, 0]


def test_frames_without_any_marker_do_not_move():
    sound, track = recorded(0.2)
    hidden = track.positions_mm.copy()
    hidden[300:320] = np.nan
    found = synchrony(sound, MarkerTrack(positions_mm=hidden, labels=track.labels, rate_hz=track.rate_hz))
    assert found is not None
    assert found.delay_s == pytest.approx(0.2, abs=0.02)


def test_what_cannot_be_compared_has_no_delay():
    assert synchrony(*recorded(0.0, seconds=3.0)) is None
    sound, track = recorded(0.0)
    still = MarkerTrack(positions_mm=np.zeros_like(track.positions_mm), labels=track.labels, rate_hz=100.0)
    assert synchrony(sound, still) is None
