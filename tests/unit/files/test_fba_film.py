"""A voice and a face stream in one MP4 file: what is read back is what was written, to the byte."""

from pathlib import Path

import av
import numpy as np
import pytest

from fapengine.codec.decoder import decode
from fapengine.codec.elementary import LEVELS, access_units, level_of, visual_headers
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.errors import DataError
from fapengine.files.fba import load_fba, read_fba_film, write_fba_film
from fapengine.files.moving import write_moving
from fapengine.mpeg4.track import FapTrack

RATE_HZ = 25.0


def moving_face(frames: int = 50, amplitude: float = 200.0) -> FapTrack:
    values = np.zeros((frames, 68), np.int64)
    values[:, 2:18] = np.round(amplitude * np.sin(np.arange(frames)[:, None] / 5 + np.arange(16)))
    return FapTrack.from_values(values, rate_hz=RATE_HZ)


def stream_of(track: FapTrack, **choices: object) -> bytes:
    return encode(track, EncoderOptions(plane_start_codes="all", intra_every=20, **choices))  # type: ignore[arg-type]


def test_voice_and_face_come_back_from_one_file(tmp_path: Path) -> None:
    track, path = moving_face(), tmp_path / "talk.mp4"
    stream = stream_of(track)
    tone = (8000 * np.sin(np.arange(32000) / 10)).astype(np.int16)
    write_fba_film(path, access_units(stream), rate_hz=RATE_HZ, profile=0x61, sound=(tone, 16000))
    assert read_fba_film(path) == visual_headers(0x61) + stream
    assert np.array_equal(load_fba(path).track.values, decode(stream).track.values)
    with av.open(str(path)) as film:
        face, voice = film.streams.video[0], film.streams.audio[0]
        times = [float(packet.pts * packet.time_base) for packet in film.demux(face) if packet.size]
        assert times == pytest.approx(np.arange(50) / RATE_HZ)
        assert voice.codec.name == "aac"
        assert float(voice.duration * voice.time_base) == pytest.approx(2.0, abs=0.1)
    at = path.read_bytes().find(b"esds")
    assert path.read_bytes()[at:].find(bytes([0x20, 0x11])) in range(30)  # object type and stream type: visual


def test_skipped_frames_keep_their_time(tmp_path: Path) -> None:
    whole = moving_face(12)
    kept = [0, 1, 4, 5, 11]
    track = FapTrack(values=whole.values[kept], mask=whole.mask[kept], visemes=whole.visemes[kept],
                     expressions=whole.expressions[kept], frame_numbers=np.array(kept), rate_hz=RATE_HZ)  # fmt: skip
    path = tmp_path / "talk.mp4"
    write_fba_film(path, access_units(stream_of(track)), rate_hz=RATE_HZ, profile=0x61)
    assert load_fba(path).track.frame_numbers.tolist() == kept
    with av.open(str(path)) as film:
        times = [float(packet.pts * packet.time_base) for packet in film.demux(film.streams.video[0]) if packet.size]
    assert times == pytest.approx([frame / RATE_HZ for frame in kept])


def test_planes_that_share_bytes_cannot_be_cut() -> None:
    with pytest.raises(DataError, match="planes share bytes"):
        access_units(encode(moving_face()))


def test_a_film_of_pictures_is_no_face_stream(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    write_moving(path, [np.zeros((32, 32, 3), np.uint8)] * 3, rate_hz=RATE_HZ)
    assert read_fba_film(path) is None
    with pytest.raises(DataError, match="without a face stream"):
        load_fba(path)


def test_a_damaged_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "talk.mp4"
    write_fba_film(path, access_units(stream_of(moving_face())), rate_hz=RATE_HZ, profile=0x61)
    data = path.read_bytes()
    for end in (9, 40, len(data) // 2):
        path.write_bytes(data[:end])
        with pytest.raises(DataError):
            load_fba(path)


def test_levels_are_told_by_the_busiest_second() -> None:
    noise = np.random.default_rng(3).integers(-150, 150, (75, 68))
    noise[:, :2] = 0
    for rate_hz, expected in ((25.0, 1), (50.0, 2), (72.0, None)):
        level = level_of(decode(encode(FapTrack.from_values(noise, rate_hz=rate_hz))))
        assert (None if level is None else level.number) == expected, rate_hz
    assert level_of(decode(encode(FapTrack.from_values(noise[:1], rate_hz=100.0)))) is None
    assert [level.profile for level in LEVELS] == [0x61, 0x62]
