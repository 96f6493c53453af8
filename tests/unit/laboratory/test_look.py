"""A recording is looked over before anybody says what its markers are."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fapengine.cli.main import app
from fapengine.errors import UnsupportedError
from fapengine.files.recordings import save_markers
from fapengine.laboratory.look import guess_head, look_over, session_lines

from .conftest import SKULL


@pytest.fixture(scope="module")
def track(make):
    """A speaking face whose head moves, with a gap of half a second in one marker."""
    whole = make(1, noise_mm=0.05).session.takes[0].markers
    places = np.array(whole.positions_mm)
    places[30:55, whole.labels.index("8.1")] = np.nan
    return replace(whole, positions_mm=places)


def test_the_skull_is_guessed_though_it_moves(track):
    assert guess_head(track) == tuple(SKULL)
    still = replace(track, positions_mm=np.tile(track.positions_mm[:1], (60, 1, 1)))
    other = replace(still, labels=tuple(f"m{n}" for n in range(len(track.labels))))
    assert guess_head(other) == ()  # nothing moves against anything


def test_a_joint_called_head_is_of_the_skull_though_a_hand_has_more(track):
    steps = np.arange(track.frame_count)[:, None, None]
    hand = np.random.default_rng(1).normal(0.0, 50.0, (1, 40, 3)) + steps * [300.0, 0.5, 0.1]
    labels = [f"Head{name}" if name in SKULL else name for name in track.labels]
    skeleton = replace(
        track, positions_mm=np.concatenate([hand, track.positions_mm], axis=1),
        labels=(*(f"Hand{n}" for n in range(40)), *labels),
    )  # fmt: skip
    assert guess_head(skeleton) == tuple(f"Head{name}" for name in SKULL)
    nameless = replace(skeleton, labels=tuple(name.replace("Head", "") for name in skeleton.labels))
    assert guess_head(nameless) == tuple(f"Hand{n}" for n in range(40))
    assert guess_head(replace(track, positions_mm=track.positions_mm[:9])) == ()


def test_gaps_rest_and_a_session_are_told(track):
    look = look_over(track)
    at = track.labels.index("8.1")
    assert look.gaps[at] == 1
    assert look.gaps.sum() == 1
    assert look.longest_s[at] == pytest.approx(0.5)
    assert look.seen[at] == pytest.approx(1 - 25 / track.frame_count)
    length = track.duration_s
    assert look.quiet_s[1] <= 0.55 or look.quiet_s[0] >= length - 0.6  # silence stands at both ends
    session = tomllib.loads("\n".join(session_lines(look, track, "t1")))
    assert session["head"] == list(SKULL)
    assert session["neutral"]["take"] == "t1"
    nameless = replace(track, labels=tuple(f"m{n}" for n in range(len(track.labels))))
    lines = session_lines(look_over(nameless), nameless, "t1")
    assert any(line.endswith('" = "8.1"') and line.startswith('# "m') for line in lines)


@pytest.mark.parametrize("ending", [".c3d", ".trc", ".csv", ".npz"])
def test_inspect_tells_of_recordings(track, ending, tmp_path, capsys):
    path = tmp_path / f"take{ending}"
    save_markers(path, track)
    app(["inspect", str(path), "--json", "--plot", str(tmp_path / "seen.png")], standalone_mode=False)
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames"] == track.frame_count
    assert facts["markers"]["8.1"]["gaps"] == 1
    assert facts["head"] == list(SKULL)
    drawn = np.asarray(Image.open(tmp_path / "seen.png"))
    assert drawn.shape[0] > 500
    assert drawn.shape[1] > 1000
    blue = drawn[:, drawn.shape[1] // 2 :, 0] < 140  # when markers are seen
    assert 0.1 < blue.mean() < 0.9
    app(["inspect", str(path)], standalone_mode=False)
    told = capsys.readouterr().out
    assert "# session.toml to start from" in told
    assert "8.1              seen in" in told


def test_body_animation_is_named(tmp_path):
    (tmp_path / "walk.bap").write_text("3.1 clap 30 59\n")
    with pytest.raises(UnsupportedError, match="body animation parameters"):
        app(["inspect", str(tmp_path / "walk.bap")], standalone_mode=False)
