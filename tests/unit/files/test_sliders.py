"""The page of sliders holds the profile's own space, looks and names, and nothing from outside."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import UsageError
from fapengine.files.motion import load_fap
from fapengine.files.profiles import load_profile
from fapengine.files.report.sliders import sliders_page
from fapengine.mpeg4.track import to_codable
from fapengine.trajectory.faps import displacements_to_faps


def data_of(html: str) -> dict:
    return json.loads(re.search(r'id="data">(.*?)</script>', html, re.S)[1])


def test_the_page_moves_points_as_the_space_does(tmp_path: Path) -> None:
    path = tmp_path / "components.html"
    done = CliRunner().invoke(app, ["inspect", "grid_s1_en", "--sliders", str(path)], catch_exceptions=False)
    assert done.exit_code == 0
    html = path.read_text()
    data, profile = data_of(html), load_profile("grid_s1_en")
    space = profile.space
    assert html.count('type="range"') == space.mode_count == 8
    assert html.count("<circle") == 2 * len(data["points"])
    assert not re.search(r"(src|href)=.?https?:", html)
    for look, weights in (("u", profile.phones["u"].targets[0]), ("rest", np.zeros(8))):
        np.testing.assert_allclose(data["looks"][look], weights, atol=1e-3)
        moved = np.tensordot(data["looks"][look], data["modes"], 1)
        columns = [space.points.index(name) for name in data["points"]]
        np.testing.assert_allclose(moved, space.to_points_mm(weights)[columns], atol=0.02)
    outer = [data["points"][index] for index in data["outer"]]
    assert outer == ["8.4", "8.6", "8.1", "8.5", "8.3", "8.7", "8.2", "8.8"]


def test_names_cannot_break_the_page() -> None:
    profile = load_profile("grid_s1_en")
    html = sliders_page(profile, ["</script><b>"] * 8, {"8.1": (0.0, -30.0, 90.0), "8.2": (0.0, -40.0, 90.0)}).decode()
    assert "</script><b>" not in html
    assert data_of(html)["points"] == ["8.1", "8.2"]


def test_only_a_profile_has_components(tmp_path: Path) -> None:
    (tmp_path / "a.fap").write_text("2.1 a 25 1\n" + "0 " * 68 + "\n0\n")
    with pytest.raises(UsageError, match="is not a profile"):
        CliRunner().invoke(
            app, ["inspect", str(tmp_path / "a.fap"), "--sliders", str(tmp_path / "a.html")], catch_exceptions=False
        )


def test_weights_of_the_page_become_a_face(tmp_path: Path) -> None:
    """The weights of a phone give the FAPs of its median; another number of them is refused."""
    profile = load_profile("grid_s1_en")
    target = profile.phones["u"].targets[0]
    text, path = " ".join(f"{weight:.3f}" for weight in target), tmp_path / "u.fap"
    CliRunner().invoke(app, ["inspect", "grid_s1_en", "--weights", text, "--pose", str(path)], catch_exceptions=False)
    space = profile.space
    expected = to_codable(displacements_to_faps(space.to_points_mm(target[None]), space.points, profile.fapu))
    np.testing.assert_allclose(load_fap(path).values, expected, atol=1.0)
    for words in (["--weights", "1 2", "--pose", str(path)], ["--weights", text]):
        with pytest.raises(UsageError, match="--weights"):
            app(["inspect", "grid_s1_en", *words], standalone_mode=False)
