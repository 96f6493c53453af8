import pytest

from tests import patient
from tests.patient import PatientClock


@pytest.mark.parametrize("booted_s", [1.0, 700.0, 40_000.123456, 3e6, 3e7])
def test_a_step_that_was_allowed_is_reached(booted_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a machine that is far behind, time ends at each limit, whose rounding must not lie before the step."""
    walls = iter(booted_s + 5.0 * step for step in range(10**6))
    monkeypatch.setattr(patient.time, "monotonic", lambda: next(walls))
    clock = PatientClock()
    begun_s = clock()
    clock._limits_s["face"] = begun_s
    for step in range(1, 300):
        clock.allow("face", 0.02)
        assert clock() >= begun_s + step * 0.02
