"""Motion that comes and goes as blend shapes."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.files.motion import load_fap, save_fap
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES, shape_rows
from fapengine.retarget.blend_tracks import format_blend_csv, parse_blend_track
from tests.command import run


def weights(frames: int = 4) -> np.ndarray:
    table = np.zeros((frames, 52))
    table[:, ARKIT_NAMES.index("jawOpen")] = np.linspace(0, 0.6, frames)
    table[:, ARKIT_NAMES.index("mouthSmileLeft")] = 0.5
    return table


def azure(table: np.ndarray, first: int = 0, roll: float = 0.1) -> dict:
    rows = [[*row, roll, 0.0, 0.0] for row in table.tolist()]
    return {"FrameIndex": first, "BlendShapes": rows}


def test_azure_frames_become_faps() -> None:
    table = weights(6)
    whole = parse_blend_track(json.dumps(azure(table)).encode())
    assert whole.rate_hz == 60.0
    expected = np.rint(arkit_map().to_faps(table))
    expected[:, fap.column(3)] = np.maximum(expected[:, fap.column(3)], 0)  # a jaw does not close beyond shut
    columns = [fap.column(number) for number in (3, 4, 5, 12, 51, 52, 59)]
    np.testing.assert_allclose(whole.values[:, columns], expected[:, columns], atol=1)
    assert (whole.values[:, fap.column(50)] == 10_000).all()  # 0.1 rad
    chunks = "\n".join(json.dumps(azure(part, at)) for at, part in ((3, table[3:]), (0, table[:3])))
    np.testing.assert_array_equal(parse_blend_track(chunks.encode()).values, whole.values)


def test_a_lost_chunk_shows_what_was_there_before() -> None:
    table = weights(9)
    events = [azure(table[:3]), azure(table[6:], 6)]
    values = parse_blend_track(json.dumps(events).encode()).values
    assert len(values) == 9
    np.testing.assert_array_equal(values[3:6], np.tile(values[2], (3, 1)))


def test_a_table_goes_there_and_back() -> None:
    faps = arkit_map().to_faps(weights(5))
    faps[:, fap.column(49)] = 12_000
    faps[:, fap.column(3)] = np.maximum(faps[:, fap.column(3)], 0)
    track = FapTrack.from_values(np.rint(faps).astype(int), rate_hz=25.0)
    back = parse_blend_track(format_blend_csv(track))
    assert back.rate_hz == 25.0
    columns = [fap.column(number) for number in (3, 5, 12, 49, 52)]
    np.testing.assert_allclose(back.values[:, columns], track.values[:, columns], atol=12)


@pytest.mark.parametrize(
    "spell", [str.upper, lambda n: n.replace("Left", "_L").replace("Right", "_R"), lambda n: f" {n} "]
)
def test_names_in_any_spelling_and_order(spell) -> None:
    names = list(ARKIT_NAMES)[::-1]
    row = ["0.7" if name == "jawOpen" else "0" for name in names]
    text = "Timecode," + ",".join(map(spell, names)) + "\n10:00:00:00," + ",".join(row) + "\n"
    values = parse_blend_track(text.encode()).values
    assert values[0, fap.column(3)] == pytest.approx(0.7 * shape_rows(["jawOpen"])[0, fap.column(3)], abs=1)


def test_a_matrix_of_audio2face_is_read() -> None:
    names = [*ARKIT_NAMES, "other"]
    rows = [[0.7 if name == "jawOpen" else 0.0 for name in names], [0.0] * len(names)]
    export = {"exportFps": 24.0, "numPoses": 53, "numFrames": 2, "facsNames": names, "weightMat": rows}
    track = parse_blend_track(json.dumps(export).encode())
    assert (len(track), track.rate_hz) == (2, 24.0)
    assert track.values[0, fap.column(3)] == pytest.approx(0.7 * shape_rows(["jawOpen"])[0, fap.column(3)], abs=1)
    for wrong, message in (
        ({"weightMat": [[0.5]]}, r"weightMat of shape \(1, 1\) for 53 names"),
        ({"facsNames": None}, "expected facsNames"),
        ({"exportFps": 0}, "at 0 frames per second"),
        ({"weightMat": [[float("nan")] * 53]}, "not finite"),
        ({"facsNames": ["other"] * 53}, "at facsNames"),
        ({"weightMat": []}, "weightMat of shape"),
    ):
        with pytest.raises(DataError, match=message):
            parse_blend_track(json.dumps(export | wrong).encode())


HEADER = "time," + ",".join(ARKIT_NAMES)
ROW = ",".join(["0"] * 52)


def _timecodes(rate_hz: int, count: int, first: int = 0, step: int = 1) -> list[str]:
    """Timecodes of Live Link Face that count frames at a rate, every so many of them."""
    ticks = range(first, first + count * step, step)
    return [
        f"{t // rate_hz // 3600 % 24:02}:{t // rate_hz // 60 % 60:02}:{t // rate_hz % 60:02}:{t % rate_hz:02}.125"
        for t in ticks
    ]


@pytest.mark.parametrize(
    ("codes", "rate_hz"),
    [
        (_timecodes(30, 90), 30.0),
        (_timecodes(24, 60), 24.0),
        (_timecodes(60, 90), 60.0),
        (_timecodes(60, 90, step=2), 30.0),
        (_timecodes(30, 60, first=86_400 * 30 - 20), 30.0),  # over midnight
        (_timecodes(30, 20), 60.0),  # within one second: nobody knows what FF counts
        (["00:00:00:00", "00:00:02:999"], 60.0),
        (["soon", "later"], 60.0),
        (["00:00:03:00", "00:00:01:00"], 60.0),
    ],
)
def test_the_rate_is_that_of_the_timecodes(codes: list[str], rate_hz: float) -> None:
    text = "\n".join([HEADER.replace("time,", "Timecode,"), *(f"{code},{ROW}" for code in codes)])
    assert parse_blend_track(text.encode()).rate_hz == pytest.approx(rate_hz, rel=1e-3)


def test_names_may_be_listed_once() -> None:
    """As in the face files of the BEAT corpus, which have no tongue."""
    names = [name for name in ARKIT_NAMES if name != "tongueOut"][::-1]
    frames = [
        {"weights": [0.7 if name == "jawOpen" else 0.0 for name in names], "time": n / 60, "rotation": []}
        for n in range(1, 4)
    ]
    track = parse_blend_track(json.dumps({"names": names, "frames": frames}).encode())
    assert (len(track), track.rate_hz) == (3, 60.0)
    assert track.values[0, fap.column(3)] == pytest.approx(0.7 * shape_rows(["jawOpen"])[0, fap.column(3)], abs=1)
    frames[1]["weights"] = [0.0]
    with pytest.raises(DataError, match=r"weights: got 1, expected 51, one per name \(at frame 2\)"):
        parse_blend_track(json.dumps({"names": names, "frames": frames}).encode())


@pytest.mark.parametrize(
    ("column", "times", "rate_hz"),
    [
        ("time_s", (0.0, 0.04, 0.08), 25.0), ("timestamp_ms", (0, 40, 80), 25.0), ("timestampMs", (0, 40, 80), 25.0),
        ("timestamp", (0, 40, 80), 25.0), ("timestamp", (9.0, 9.04, 9.08), 25.0), ("frame", (0, 1, 2), 60.0),
    ],
)  # fmt: skip
def test_the_rate_is_that_of_the_times(column: str, times: tuple[float, ...], rate_hz: float) -> None:
    text = "\n".join([HEADER.replace("time,", f"{column},"), *(f"{time},{ROW}" for time in times)])
    track = parse_blend_track(text.encode())
    assert track.rate_hz == pytest.approx(rate_hz)
    guessed = ("blend shapes: no times say the rate; read at 60 frames per second",)
    assert track.remarks == (guessed if column == "frame" else ())
    excel = parse_blend_track(text.replace(",", ";").replace(".", ",").encode())
    assert excel.equals(track)


def test_lost_frames_are_filled_so_that_the_others_keep_their_times() -> None:
    """A phone that is hot sends 30 frames a second instead of 60, and loses some."""
    ticks = [*range(120), *range(120, 400, 2), *range(410, 500)]
    jaw = [f"{tick % 100 / 200:.3f}," for tick in ticks]
    codes = _timecodes(60, 500)
    rows = [f"{codes[tick]}," + ("0," * 17 + opened + "0," * 33 + "0") for tick, opened in zip(ticks, jaw, strict=True)]
    track = parse_blend_track("\n".join([HEADER.replace("time,", "Timecode,"), *rows]).encode())
    assert HEADER.split(",")[18] == "jawOpen"
    assert (len(track), track.rate_hz) == (500, 60.0)
    assert "up to 0.2 s apart; filled at 60 frames" in track.remarks[0]
    opened = np.array([tick % 100 / 200 for tick in range(500)]) * shape_rows(["jawOpen"])[0, fap.column(3)]
    assert track.values[ticks, fap.column(3)] == pytest.approx(opened[ticks], abs=1)
    assert track.values[405, fap.column(3)] == pytest.approx((opened[398] + opened[410]) / 2, rel=0.3)
    scores = [{"timestampMs": 1000 * tick / 60, "scores": dict.fromkeys(ARKIT_NAMES, 0.5)} for tick in ticks]
    assert len(parse_blend_track(json.dumps(scores).encode())) == 500


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", DataError, "got 0 names of arkit"),
        (
            "\n".join([HEADER.replace("time,", "Timecode,"), *(f"00:00:{n:02}:00.000,{ROW}" for n in range(20))]),
            DataError,
            "got whole seconds",
        ),
        ("\n".join([HEADER, *(f"{n / 1e4},{ROW}" for n in range(20)), f"9,{ROW}"]), DataError, "expected most of"),
        ("time,jawOpen\n0,1\n", DataError, "got 1 names of arkit"),
        (HEADER + "\n", TruncatedError, "no frame"),
        (f"{HEADER}\n0,{ROW[:-1]}x\n", DataError, "got 'x', expected a number .at line 2, column 53"),
        (f"{HEADER}\n0,1\n", DataError, "got 'nothing', expected a number"),
        (f"{HEADER}\n0,{ROW[:-1]}nan\n", DataError, "not finite .at line 2, TongueOut"),
        (f"{HEADER}\nzero,{ROW}\n1,{ROW}\n", DataError, "time: is not a number"),
        (f"{HEADER}\n1,{ROW}\n1,{ROW}\n", DataError, "rising times"),
        (f"{HEADER}\n0,{ROW}\n1e-9,{ROW}\n", DataError, "must be 1 to 1000"),
        (
            json.dumps([{"time": at, "scores": dict.fromkeys(ARKIT_NAMES, 0)} for at in (0.0, float("nan"), 1.0)]),
            DataError,
            "time: got one that is not finite",
        ),
        (f"{HEADER}\n0,{ROW}\n1e-320,{ROW}\n", DataError, "must be 1 to 1000"),
        ("{", DataError, "neither JSON nor JSON lines"),
        ("[" * 100_000, DataError, "nested|neither"),
        ("[]", TruncatedError, "no frame"),
        ('{"FrameIndex": 0}', DataError, "expected FrameIndex .* .at event 1"),
        ('{"FrameIndex": -1, "BlendShapes": [[0]]}', DataError, "FrameIndex -1"),
        ('{"FrameIndex": 0, "BlendShapes": [[0, 1]]}', DataError, "a frame of 2 values"),
        ('{"FrameIndex": 0, "BlendShapes": [' + json.dumps([None] * 55) + "]}", DataError, "not finite|not a number"),
        ('{"FrameIndex": 0, "BlendShapes": [' + json.dumps(["x"] * 55) + "]}", DataError, "not a number"),
        (json.dumps([azure(weights(1)), azure(weights(1), 9_000_000)]), DataError, "got frames 0 to 9000000"),
    ],
)
def test_what_is_no_track_is_refused(text: str, error: type[DataError], message: str) -> None:
    with pytest.raises(error, match=message):
        parse_blend_track(text.encode())


def test_bytes_that_are_no_text_are_refused() -> None:
    with pytest.raises(DataError, match="not UTF-8 text"):
        parse_blend_track(b"\xff\xfe\x00")


GOOD = (
    json.dumps([azure(weights(2)), azure(weights(2), 2)]).encode(),
    f"{HEADER}\n0,{ROW}\n0.04,{ROW}\n".encode(),
    *(format_blend_csv(FapTrack.from_values(np.zeros((2, 68), int), rate_hz=25.0), key) for key in ("oculus", "vrm0")),
)


@given(st.sampled_from(GOOD), st.data())
def test_every_spoiled_file_is_a_value_or_a_data_error(good: bytes, data: st.DataObject) -> None:
    spoiled = bytearray(good)
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(spoiled) - 1))
        spoiled[at : at + data.draw(st.integers(0, 20))] = data.draw(st.binary(max_size=6))
        if not spoiled:
            break
    with contextlib.suppress(DataError):
        assert len(parse_blend_track(bytes(spoiled))) > 0


def test_convert_and_render(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(azure(weights(4))))
    assert "4 frames at 60 Hz" in run("convert", tmp_path / "a.json", "-o", tmp_path / "a.fap")
    run("convert", tmp_path / "a.fap", "-o", tmp_path / "a.csv")
    run("convert", tmp_path / "a.csv", "-o", tmp_path / "b.fap")
    one, other = load_fap(tmp_path / "a.fap"), load_fap(tmp_path / "b.fap")
    np.testing.assert_allclose(one.values[:, fap.column(3)], other.values[:, fap.column(3)], rtol=0.1, atol=12)
    for name in ("a.json", "a.csv", "a.fap"):
        run("render", tmp_path / name, "--size", "64x64", "--at", "0.04", "-o", tmp_path / f"{name}.png")
    save_fap(tmp_path / "c.fap", FapTrack.from_values(np.zeros((2, 68), int), rate_hz=25.0))
    run("encode", tmp_path / "c.fap", "-o", tmp_path / "c.fba")
    run("convert", tmp_path / "c.fba", "-o", tmp_path / "c.csv")
    with pytest.raises(UsageError, match=r"got .*, expected a name that ends with \.fap, "):
        run("convert", tmp_path / "c.fba", "-o", tmp_path / "c.doc")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(DataError, match=r"bad\.json"):
        run("convert", tmp_path / "bad.json", "-o", tmp_path / "c.fap")
