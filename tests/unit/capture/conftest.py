import numpy as np
import pytest

from fapengine.capture.marker_track import MarkerTrack


@pytest.fixture
def track() -> MarkerTrack:
    """Six markers of a mouth, 20 frames, one of them hidden for a while."""
    rng = np.random.default_rng(4)
    places = np.array([[0, 10, 90], [0, -12, 88], [25, 0, 75], [-25, 0, 75], [0, -45, 80], [0, 60, 95]], float)
    positions = places + rng.normal(0, 1.0, (20, 6, 3)).round(3)
    positions[5:9, 2] = np.nan
    return MarkerTrack(positions_mm=positions, labels=("8.1", "8.2", "8.3", "8.4", "2.1", "NOSE"), rate_hz=120.0)
