"""A library that is lacking is told before the work, not after it."""

from pathlib import Path

import pytest

from fapengine import _late
from fapengine.errors import ResourceError
from fapengine.files.moving import check_moving


def test_a_film_is_refused_before_anything_is_spoken(monkeypatch: pytest.MonkeyPatch) -> None:
    check_moving(Path("a.mp4"), rate_hz=30.0, size=(64, 64), alpha=False)
    monkeypatch.setattr(_late, "find_spec", lambda name: None if name == "av" else object())
    with pytest.raises(
        ResourceError, match=r'films and pictures: av is not installed\. .* pip install "fapengine\[video\]"'
    ):
        check_moving(Path("a.mp4"), rate_hz=30.0, size=(64, 64), alpha=False)
