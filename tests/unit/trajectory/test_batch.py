"""Many sessions at once: each row is what a planner of its own would show, FAP for FAP."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.trajectory import hermite, stream
from fapengine.trajectory.batch import FIRST_HOLDS, FIRST_ROWS, KNOTS, BatchPlanner
from fapengine.trajectory.planner import Style
from fapengine.trajectory.stream import AHEAD_PHONES, KEYS_BEHIND, PLANNED_LETTERS, StreamPlan, jets_at
from fapengine.trajectory.targets import speech_keys
from tests.english import english
from tests.single_stream import SingleStream, jet_of_plan

LABELS = ["p", "b", "m", "f", "s", "aɪ", "ɑː", "i", "uː", "w", "ʃ", "n", "tʃ", "%", SILENCE]
TICK_S = 1 / 60
STYLES = [
    Style.speech_only(),
    Style.speech_only(articulation=1.7),
    Style.speech_only(articulation=0.4, method="paper"),
    Style(jaw=0.3, lips=1.5, loudness_db=-6.0),
]


def phones(labels: list[str], each_s: float, lead_s: float = 0.3) -> list[Phone]:
    times = lead_s + each_s * np.arange(len(labels) + 1)
    return [Phone(label, float(a), float(b)) for label, a, b in zip(labels, times[:-1], times[1:], strict=True)]


PHONES = st.builds(
    phones, st.lists(st.sampled_from(LABELS), min_size=1, max_size=12), st.floats(0.02, 0.2), st.just(0.0)
)
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("feed"), st.integers(0, 3), st.floats(-0.2, 0.6), PHONES),
        st.tuples(st.just("cancel"), st.integers(0, 3), st.floats(-0.1, 0.3), st.floats(0.05, 0.4)),
        st.tuples(st.just("open"), st.floats(-0.2, 0.1)),
        st.tuples(st.just("close"), st.integers(0, 3)),
        st.tuples(st.just("frames"), st.integers(1, 14)),
    ),
    min_size=4,
    max_size=24,
)


class Pair:
    """A bank, and a planner of its own for each of its sessions."""

    def __init__(self, style: Style, horizon_s: float) -> None:
        self.style, self.horizon_s = style, horizon_s
        self.bank = BatchPlanner(english(), style, horizon_s=horizon_s)
        self.planners: dict[int, tuple[float, SingleStream]] = {}
        self.now_s, self.shown = 5.0, 0

    def open(self, begins_s: float) -> None:
        self.planners[self.bank.open(begins_s)] = (
            begins_s,
            SingleStream(english(), self.style, self.horizon_s),
        )

    def pick(self, index: int) -> int | None:
        return sorted(self.planners)[index % len(self.planners)] if self.planners else None

    def frames(self, count: int) -> None:
        for _ in range(count):
            self.now_s += TICK_S
            found = self.bank.frames(self.now_s)
            assert sorted(self.bank.sessions.tolist()) == sorted(self.planners)
            for session, row in zip(self.bank.sessions.tolist(), found, strict=True):
                begins_s, planner = self.planners[session]
                np.testing.assert_array_equal(row, planner.frames([self.now_s - begins_s])[0])
                self.shown += bool(row.any())

    def do(self, event: tuple) -> None:
        kind, *rest = event
        if kind == "open":
            self.open(self.now_s + rest[0])
        elif kind == "frames":
            self.frames(rest[0])
        elif (session := self.pick(rest[0])) is not None:
            begins_s, planner = self.planners[session]
            if kind == "close":
                self.bank.close(session)
                del self.planners[session]
                return
            at_s = self.now_s - begins_s + rest[1]
            if kind == "cancel":
                self.bank.cancel(session, at_s, fade_s=rest[2])
                planner.cancel(at_s, fade_s=rest[2])
            else:
                shift = max(at_s, 0.0)
                fed = [Phone(one.label, one.start_s + shift, one.end_s + shift) for one in rest[2]]
                self.bank.feed(session, fed)
                planner.feed(fed)
            assert self.bank.counts(session) == planner.counts


@settings(max_examples=40)
@given(EVENTS, st.sampled_from([0.0, 0.0, 0.1]), st.sampled_from(STYLES))
def test_every_row_is_what_a_planner_of_its_own_shows(events, horizon_s, style):
    pair = Pair(style, horizon_s)
    pair.open(5.0)
    pair.open(4.9)
    for event in events:
        pair.do(event)
    pair.frames(40)


def test_long_texts_and_many_sessions_outgrow_the_first_room():
    """More knots than a window holds, more holds and more rows than there was room for."""
    pair = Pair(Style.speech_only(), 0.0)
    for _ in range(FIRST_ROWS + 3):
        pair.open(5.0)
    spoken = phones(["b", "ɑː", "m", "s", "p", "uː"] * 6, 0.05)
    assert len(spoken) > KNOTS
    for session, (_, planner) in pair.planners.items():
        mine = spoken[session % 3 :]
        pair.bank.feed(session, mine)
        planner.feed(mine)
    crowd = [Phone("m", 0.3 + 0.03 * n, 0.33 + 0.03 * n) for n in range(3 * FIRST_HOLDS)]
    pair.bank.feed(2, crowd)
    pair.planners[2][1].feed(crowd)
    pair.frames(150)
    assert pair.shown > 1500
    assert not pair.bank.frames(pair.now_s).any()  # all have come to rest


@pytest.mark.parametrize("seed", range(4))
def test_phones_that_come_one_by_one_far_ahead_are_shown_as_if_they_had_come_at_once(seed):
    rng = np.random.default_rng(seed)
    edges = np.cumsum([0.5, *rng.choice([0.02, 0.05, 0.08, 0.2], 30)]).tolist()
    labels, loud_db = rng.choice(LABELS, 30).tolist(), rng.choice([0.0, 0.0, 6.0], 30).tolist()
    said = [
        Phone(label, *times, loudness_db=db) for label, times, db in zip(labels, pairwise(edges), loud_db, strict=True)
    ]
    at_once, one_by_one = BatchPlanner(english()), BatchPlanner(english())
    at_once.feed(at_once.open(), said)
    session, fed = one_by_one.open(), 0
    for now_s in np.arange(0.0, edges[-1] + 0.3, TICK_S).tolist():
        while fed < len(said) and said[max(fed - AHEAD_PHONES - 1, 0)].start_s < now_s + 0.3:
            one_by_one.feed(session, said[fed : fed + 1])
            one_by_one.plan()
            fed += 1
        np.testing.assert_array_equal(one_by_one.frames(now_s), at_once.frames(now_s))
    assert fed == len(said)


def test_phones_that_come_one_by_one_far_ahead_are_planned_a_few_times_at_most(monkeypatch):
    """Each was planned with all that follow, 120 times, when each came."""
    asked: list[int] = []

    def counted(tracks, *args, **options):
        asked.extend(len(phones) for phones, _ in tracks)
        return speech_keys(tracks, *args, **options)

    monkeypatch.setattr(stream, "speech_keys", counted)
    bank, said = BatchPlanner(english()), phones(["m", "ɑː", "s", "t"] * 125, 0.1)
    session = bank.open()
    for phone in said:
        bank.frames(max(phone.start_s - 12.0, bank._now_s, 0.0))
        bank.feed(session, [phone])
        bank.plan()
    assert sum(asked) < 1.5 * len(said)


def test_phones_beyond_what_is_planned_ahead_are_dropped_as_they_come():
    bank, own = BatchPlanner(english()), SingleStream(english())
    session, said = bank.open(), phones(["m", "ɑː"] * 200, 0.1)
    bank.frames(0.0)
    own.frames([0.0])
    for phone in said:
        bank.feed(session, [phone])
        bank.plan()
    own.feed(said)
    assert list(bank.planned(session)) == list(own.phones)
    assert bank.counts(session).dropped == own.counts.dropped == len(said) - len(own.phones)
    assert sum(len(phone.label) for phone in own.phones) <= PLANNED_LETTERS


def test_rows_say_whose_they_are_when_sessions_close():
    bank = BatchPlanner(english())
    first, second, third = (bank.open() for _ in range(3))
    bank.feed(third, phones(["ɑː", "ɑː"], 0.2))
    counts = bank.counts(third)
    bank.close(first)
    assert bank.counts(third) is counts
    found = bank.frames(0.5)
    assert sorted(bank.sessions.tolist()) == [second, third]
    assert len(bank.sessions) == 2
    assert {int(session): bool(row.any()) for session, row in zip(bank.sessions, found, strict=True)} == {
        second: False,
        third: True,
    }
    assert bank.open() not in (first, second, third)
    bank.close(third)
    bank.close(second)
    assert len(bank.sessions) == 1
    assert BatchPlanner(english()).frames(0.0).shape == (0, fap.FAP_COUNT)


def test_a_fade_is_a_quintic_to_rest():
    rng = np.random.default_rng(3)
    left_over, length = rng.normal(size=(3, 4)), 0.15
    still = np.zeros(4)
    s = np.linspace(0, 1, 9)
    wanted = hermite.jet_of(hermite.quintic(length, tuple(left_over), (still, still, still)), s[:, None], length)[0]
    parts = hermite.fading(s, s)
    found = sum(part[:, None] * left * length**n for n, (part, left) in enumerate(zip(parts, left_over, strict=True)))
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_one_moment_of_a_plan_is_what_many_are():
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(0.02, 0.2, 7))
    (path,) = hermite.paths(times, rng.normal(0, 5, (7, 3)), np.zeros(7, np.intp), 1)
    plan = StreamPlan(times[2] - 0.01, path, 0.15, 0.1, rng.normal(0, 5, (3, 3)))
    moments = np.array([0.0, times[0], times[2], times[2] + 0.03, times[3] + 0.2, times[-1], times[-1] + 1.0])
    for found, many, since_s in (
        (hermite.jets_at([path] * len(moments), moments), path.jet, 0.0),
        (jets_at([plan] * len(moments), moments), partial(jet_of_plan, plan), plan.start_s),
    ):
        shown = moments >= since_s
        wanted = np.stack(many(moments[shown]), axis=1)
        np.testing.assert_allclose(found[shown], wanted, atol=1e-9 * np.abs(wanted).max())
    assert np.abs(hermite.jets_at([path], times[-1:] + 1.0)[0, 1:]).max() < 1e-9


def spoken(rng: np.random.Generator, labels: list[str]) -> list[Phone]:
    phones, at_s = [], rng.uniform(0, 1)
    for _ in range(rng.integers(0, 15)):
        at_s += rng.choice([0.0, 0.0, 0.0, 0.003, 0.05, 0.15, 0.5])
        end_s = at_s + rng.lognormal(-2.5, 0.7)
        loudness_db = float(rng.choice([0, 0, -6, 5]))
        phones.append(Phone(str(rng.choice(labels)), float(at_s), float(end_s), loudness_db=loudness_db))
        at_s = end_s
    return phones


def test_paths_that_are_laid_together_are_those_of_each_track_alone() -> None:
    rng, profile = np.random.default_rng(3), english()
    tracks = [spoken(rng, [*profile.phones, "ʁ", "ɑː", "ts", "1"]) for _ in range(60)]
    tracks.append([Phone("s", 0.0, 0.1), Phone("u", 0.1, 0.32), Phone("n", 0.32, 0.42)])  # long, and heard so: "soon"
    asked = [(phones, max(min(n % 6, len(phones) - KEYS_BEHIND), 0)) for n, phones in enumerate(tracks)]
    together = speech_keys(asked, profile)
    for (phones, first), path, said in zip(asked, together.paths(), together.said, strict=True):
        keys = speech_keys([(phones, 0)], profile)
        (alone,) = keys.paths()
        from_s = phones[first + KEYS_BEHIND - 1].end_s if first else 0.0
        times_s = np.linspace(from_s, 4.0, 200)
        for found, wanted in zip(path.jet(times_s), alone.jet(times_s), strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-7)
        assert said == keys.said[0][len(keys.said[0]) - len(said) :]
        assert first or said == keys.said[0]


def test_refuses():
    bank = BatchPlanner(english())
    session = bank.open()
    bank.frames(1.0)
    with pytest.raises(UsageError, match=r"time_s: must be rising times from 1 s, got 0\.5 s"):
        bank.frames(0.5)
    for wrong in (np.nan, np.inf):
        with pytest.raises(UsageError, match="time_s"):
            bank.frames(wrong)
    with pytest.raises(UsageError, match="begins_s: got nan"):
        bank.open(np.nan)
    with pytest.raises(UsageError, match="horizon_s: must be 0 or more, got -1"):
        BatchPlanner(english(), horizon_s=-1)
    with pytest.raises(UsageError, match="fade_s: must be a positive time, got 0"):
        bank.cancel(session, 1.0, fade_s=0)
    for wrong in (np.nan, np.inf):
        with pytest.raises(UsageError, match=f"at_s: got {wrong}, expected a time"):
            bank.cancel(session, wrong)
    bank.close(session)
    for call in (bank.close, bank.counts, lambda one: bank.feed(one, []), lambda one: bank.cancel(one, 1.0)):
        with pytest.raises(UsageError, match="session: got 0, expected one of 0 that are open"):
            call(session)


@pytest.mark.parametrize("horizon_s", [0.0, 0.5])
def test_phones_that_wait_are_planned_before_the_horizon_reaches_them(horizon_s):
    said = [Phone(label, 1 + 0.09 * n, 1.09 + 0.09 * n) for n, label in enumerate("loʊmɑpitusæbɪkʌv" * 3)]
    early, batch = (BatchPlanner(english(), horizon_s=horizon_s) for _ in range(2))
    for planner in (early, batch):
        planner.open()
    early.feed(0, said)
    for frame in range(150):
        batch.feed(0, said[2 * frame : 2 * frame + 2])
        np.testing.assert_array_equal(batch.frames(frame / 25), early.frames(frame / 25))


def test_nothing_waits_after_a_cancel():
    batch = BatchPlanner(english())
    batch.open()
    batch.feed(0, [Phone("a", 1.0 + n, 1.1 + n) for n in range(9)])
    batch.frames(0.0)
    assert batch.sure_s(0) > 3
    batch.cancel(0, 0.1)
    assert batch.sure_s(0) == -np.inf


def test_by_default_nothing_after_the_last_frame_is_settled() -> None:
    """A phone that begins 0.1 s after the last frame is shown as by a planner without a horizon."""
    bank, own = BatchPlanner(english()), SingleStream(english(), Style.speech_only(), 0.0)
    session = bank.open(0.0)
    bank.frames(1.0)
    own.frames([1.0])
    bank.feed(session, phones(["m", "ɑː"], 0.1, lead_s=1.1))
    own.feed(phones(["m", "ɑː"], 0.1, lead_s=1.1))
    shown = [(bank.frames(now_s)[0], own.frames([now_s])[0]) for now_s in (1.1, 1.2, 1.3)]
    assert any(row.any() for row, _ in shown)
    for row, expected in shown:
        np.testing.assert_array_equal(row, expected)
