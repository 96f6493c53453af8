"""Machines that fail, on virtual time: who moves, how long mouths stay open, that nobody is shown twice."""

import numpy as np
import pytest

from design import many_machines
from design.many_machines import FENCE_S, GUARD_S, LOST_S, TTL_S, simulate


def test_only_sessions_of_failed_machines_move_and_none_is_shown_twice() -> None:
    result = simulate(10_000, machines=50, hours=24.0)
    assert min(result.failures.values()) >= 3
    assert (result.misplaced, result.doubled) == (0, 0)
    assert max(result.moved) < 10_000 / 10
    limits_s = {"process": GUARD_S + 1e-6, "power": TTL_S + 2.0, "cut off": FENCE_S + 0.01}
    for kind, rest_s in result.rest_s.items():
        assert np.concatenate(rest_s).max() <= limits_s[kind]
        assert np.concatenate(result.resume_s[kind]).min() >= LOST_S
        assert np.concatenate(result.resume_s[kind]).max() < TTL_S + 2.0


def test_a_machine_that_trusts_its_lease_for_too_long_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(many_machines, "FENCE_S", TTL_S + 0.1)
    assert simulate(1000, machines=50, hours=24.0).doubled > 0
