"""``fapengine reduce``: a motion as a few poses, and back at another rate within the bound."""

import json

import numpy as np
import pytest

from fapengine import lab
from fapengine.capture.marker_track import MarkerTrack
from fapengine.cli.main import app
from fapengine.errors import DataError, UsageError
from fapengine.files.recordings import load_markers, save_markers


@pytest.fixture
def take(tmp_path):
    time = np.arange(200) / 100
    rest = np.random.default_rng(0).uniform(-60, 60, (5, 3))
    moved = np.stack([3 * np.sin(3 * time), 5 * np.sin(5 * time) ** 2, 0 * time], axis=1)
    track = MarkerTrack(
        positions_mm=rest + moved[:, None] * np.linspace(0.2, 1, 5)[:, None], labels=tuple("ABCDE"), rate_hz=100.0
    )
    save_markers(tmp_path / "take.npz", track)
    return tmp_path / "take.npz"


def test_a_take_is_reduced_and_comes_back_at_half_the_rate(take, capsys):
    via, back = take.with_name("via.npz"), take.with_name("back.npz")
    words = ["reduce", take, "--max-error", "0.5mm", "-o", via, "--back", back, "--fps", "50", "--json"]
    app([str(word) for word in words], standalone_mode=False)
    curve = json.loads(capsys.readouterr().out)
    assert curve[0]["tolerance_mm"] == 0.5
    assert all(row["max_mm"] <= row["tolerance_mm"] for row in curve)
    with np.load(via) as arrays:
        assert len(arrays["times_s"]) == curve[0]["point_count"] < 40
        assert arrays["via_mm"].shape == (len(arrays["times_s"]), 5, 3)
        assert arrays["share"][-1] < arrays["share"][0] < arrays["share"][1]  # of 2 mm, 0.5 mm, 0.25 mm
    old, new = load_markers(take).markers, load_markers(back).markers
    assert new.rate_hz == 50.0
    away = np.linalg.norm(new.positions_mm - old.positions_mm[::2][: new.frame_count], axis=-1)
    assert away.max() <= 0.5


def test_what_cannot_be_reduced_is_told(take, tmp_path):
    def refused(kind, message, *words):
        with pytest.raises(kind, match=message):
            app(["reduce", *map(str, words)], standalone_mode=False)

    refused(UsageError, "must be millimetres", take, "--max-error", "little", "-o", tmp_path / "via.npz")
    for bound in ("0", "nan", "inf", "101mm"):
        refused(
            UsageError, "--max-error: must be 0.001 to 100 mm", take, "--max-error", bound, "-o", tmp_path / "via.npz"
        )
    refused(UsageError, r"ends with \.npz", take, "-o", tmp_path / "via.csv")
    track = load_markers(take).markers
    places = np.array(track.positions_mm)
    places[5:9, 2] = np.nan
    save_markers(take, MarkerTrack(positions_mm=places, labels=track.labels, rate_hz=track.rate_hz))
    refused(DataError, "got gaps, most in marker C", take, "-o", tmp_path / "via.npz")


def test_via_points_are_a_recording_for_every_reader(take, capsys):
    via, back = take.with_name("via.npz"), take.with_name("back.trc")

    def run(*words):
        app([*map(str, words)], standalone_mode=False)
        return capsys.readouterr().out

    run("reduce", take, "--max-error", "0.5mm", "-o", via)
    told = run("inspect", via)
    assert "200 frames at 100 Hz" in told
    assert "via points" in told
    recorded = load_markers(take).markers
    for read in (load_markers(via).markers, lab.read(via).takes[0].markers):
        assert read.rate_hz == 100.0
        assert np.linalg.norm(read.positions_mm - recorded.positions_mm, axis=-1).max() <= 0.5
    assert lab.read(via, rate_hz=25.0).takes[0].markers.frame_count == 50
    run("convert", via, "-o", back)
    np.testing.assert_allclose(load_markers(back).markers.positions_mm, read.positions_mm, atol=0.01)
    with np.load(via) as arrays:
        kept = {name: arrays[name] for name in arrays.files}
    for wrong, message in (
        ({"rate_hz": None}, "rate"), ({"times_s": kept["times_s"][::-1]}, "strictly rising"),
        ({"times_s": kept["times_s"] * 1e-9}, "strictly rising"), ({"times_s": kept["times_s"] * 1e9}, "too far apart"),
        ({"times_s": kept["times_s"] - 9.0}, "the last is at -7"),
        ({"times_s": kept["times_s"][1:]}, "a time each"), ({"times_s": kept["labels"]}, "a time each"),
        ({"via_mm": kept["via_mm"] * np.nan}, "finite"),
        ({"via_mm": kept["via_mm"][:2], "times_s": np.arange(2.0)}, "at least 3"),
    ):  # fmt: skip
        changed = {name: value for name, value in (kept | wrong).items() if value is not None}
        np.savez(via, **changed)
        with pytest.raises(DataError, match=message):
            load_markers(via)
