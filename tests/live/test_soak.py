"""Some seconds of what ``make soak`` does for thirty minutes: nothing grows, nothing is left undone."""

from dataclasses import replace

import pytest

from bench.live_soak import Sample, soak, troubles


@pytest.mark.parametrize(("seconds", "sessions"), [(15.0, 12), pytest.param(40.0, 12, marks=pytest.mark.nightly)])
def test_nothing_grows_and_every_utterance_ends(seconds: float, sessions: int) -> None:
    samples = soak(seconds, sessions, seed=1)
    assert troubles(samples) == []
    assert samples[-1].utterances > 2 * sessions
    assert samples[-1].frames > 100


def test_what_grows_is_told() -> None:
    good = Sample(
        time_s=0.0, memory_mb=200.0, files=20, sessions=20, streams=0, waiting=0, frames=1, skipped=0, utterances=5,
        over=5, faults=0,
    )  # fmt: skip
    end = replace(good, sessions=0)
    assert troubles([good] * 20 + [end]) == []
    for field, value, what in (
        ("memory_mb", 210.0, "memory grew by 10.0 MB"), ("files", 30, "open files grew by 10"),
        ("waiting", 500, "the queue of packets grew"),
    ):  # fmt: skip
        grown = replace(good, **{field: value})
        assert any(what in one for one in troubles([good] * 17 + [grown] * 3 + [end])), field
    for field, value, what in (
        ("sessions", 1, "sessions: 1 at the end"), ("streams", 2, "streams: 2"), ("waiting", 3, "waiting: 3"),
        ("faults", 4, "faults: 4"), ("over", 3, "2 of 5 utterances are not over"), ("files", 21, "21 files are open"),
    ):  # fmt: skip
        assert any(what in one for one in troubles([good] * 20 + [replace(end, **{field: value})])), field
