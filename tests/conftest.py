"""Fixtures and hypothesis profiles for every test."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"

settings.register_profile(
    "ci", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("thorough", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measurement data beside the checkout; tests that use it carry the marker ``shared``."""
    if not SHARED.is_dir():
        pytest.skip(f"measurement data not found at {SHARED}")
    return SHARED
