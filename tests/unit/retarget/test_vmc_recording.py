"""A VMC stream as ``oscdump`` prints it."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fapengine
from fapengine.errors import DataError, TruncatedError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.blend_tracks import is_vmc_recording, parse_vmc_recording
from fapengine.wire.vmc import head_and_eyes

NTP_S = 0xEEADA2A5
HEAD = [fap.column(number) for number in (48, 49, 50)]


def recording(track: FapTrack, *, sender_time: bool = True, rate_hz: float = 30.0) -> str:
    """Spell frames as oscdump 0.31 does; arrivals jitter by up to 4 ms."""
    weights = arkit_map().approximate_weights(track.values.astype(float))
    jitter_s = np.random.default_rng(1).uniform(0, 0.004, len(track))
    lines = []
    for n, (row, faps) in enumerate(zip(weights, track.values, strict=True)):
        arrived = int((n / rate_hz + jitter_s[n]) * 2**32)
        time = f"{NTP_S + (arrived >> 32):08x}.{arrived & 0xFFFFFFFF:08x}"
        lines.append(f"{time} /VMC/Ext/OK i 1")
        lines += [f"{time} /VMC/Ext/T f {n / rate_hz:f}"] * sender_time
        pose = head_and_eyes(faps)[0][1]
        lines.append(f'{time} /VMC/Ext/Bone/Pos sfffffff "Head" 0.0 0.0 0.0 {" ".join(f"{v:.6f}" for v in pose)}')
        lines += [
            f'{time} /VMC/Ext/Blend/Val sf "{name}" {value:.6f}'
            for name, value in zip(ARKIT_NAMES, row, strict=True)
            if n == 0 or value > 0.001 or weights[n - 1, ARKIT_NAMES.index(name)] > 0.001
        ]
        lines.append(f"{time} /VMC/Ext/Blend/Apply ")
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def spoken() -> FapTrack:
    return fapengine.speak("My baby fell off a boat.", rate_hz=30.0).track


@pytest.mark.parametrize(("sender_time", "apart"), [(True, 3.0), (False, 60.0)])
def test_a_recording_gives_the_motion_back(spoken: FapTrack, sender_time: bool, apart: float) -> None:
    read = parse_vmc_recording(recording(spoken, sender_time=sender_time).encode())
    assert read.rate_hz == 30.0
    assert abs(len(read) - len(spoken)) <= 1
    weights = arkit_map().approximate_weights(spoken.values.astype(float))
    wanted, count = arkit_map().to_faps(weights), min(len(read), len(spoken))
    mouth = [fap.column(number) for number in range(4, 14)]
    assert np.abs(read.values[:count, mouth] - wanted[:count, mouth]).max() < apart
    assert np.abs(read.values[:count, HEAD] - spoken.values[:count, HEAD]).max() < 400  # AU: 0.23 degrees


def test_load_finds_it_by_its_content(spoken: FapTrack, tmp_path: Path) -> None:
    (tmp_path / "face.osc").write_text(recording(spoken))
    assert len(fapengine.load(tmp_path / "face.osc")) == len(spoken)
    assert not is_vmc_recording(b"Time,JawOpen\n")


FRAME = '{0} /VMC/Ext/Blend/Val sf "A" 0.5\n{0} /VMC/Ext/Blend/Apply \n'


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("eeada2a5.00000000 /VMC/Ext/OK i 1\n", TruncatedError, "got 0 frames"),
        (FRAME.format("eeada2a5.00000000") * 2, DataError, "times must rise"),
        (FRAME.format("eeada2a5.00000000") + FRAME.format("eeada2a6.00000000"), DataError, "expected at least 8"),
        (
            "".join(
                map(FRAME.format, ("00000000.00000000", "00000000.10000000", "00000000.20000000", "eeada2a6.00000000"))
            ),
            DataError,
            "got times over 4[.0-9e+]* s in 4 frames at 16 Hz",
        ),
        (FRAME.format("eeada2a5.00000000") + "nonsense\n", DataError, "line 3"),
        ('eeada2a5.00000000 /VMC/Ext/Blend/Val sf "A" much\n', DataError, "'much'"),
        ('eeada2a5.00000000 /VMC/Ext/Bone/Pos sfffffff "Head" 0 0 0 0 0 0 9\n', DataError, "unit quaternion"),
    ],
)
def test_what_is_no_recording_is_refused(text: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        parse_vmc_recording(text.encode())


@given(st.binary(max_size=80), st.integers(0, 400))
def test_for_all_bytes_it_is_a_track_or_a_data_error(noise: bytes, at: int) -> None:
    text = recording(FapTrack.from_values(np.zeros((4, 68), int), rate_hz=30.0)).encode()
    with contextlib.suppress(DataError):
        parse_vmc_recording(text[:at] + noise + text[at + len(noise) :])
