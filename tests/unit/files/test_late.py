"""A library that is lacking is told before the work, not after it."""

import os
import subprocess
import sys
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


def test_onnxruntime_reports_to_nobody(tmp_path: Path) -> None:
    """Its telemetry is on by default, and leaves ``.ses`` in the folder for temporary files as it is imported."""
    code = "from fapengine._late import needed; needed('onnxruntime', 'onnxruntime', 'recognizer')"
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    subprocess.run([sys.executable, "-c", code], env={**environment, "TMPDIR": str(tmp_path)}, check=True)
    assert [path.name for path in tmp_path.iterdir()] == []
