"""The engine: what faces do when they are told, as their FAPs show it."""

from dataclasses import astuple
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.engine.commands import (
    Append,
    Audio,
    Begin,
    Blink,
    Cancel,
    End,
    Express,
    Look,
    Pause,
    Resume,
    Seek,
    SetParameter,
    TurnHead,
    without_neutral,
)
from fapengine.engine.engine import Engine
from fapengine.engine.session import Limits
from fapengine.engine.utterance import TRANSITIONS, Step, StreamClock, Utterance, UtteranceState
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.ramps import MAX_WAITING, Ramp, Ramps
from fapengine.trajectory.style import Style
from tests.english import english

RATE_HZ = 50.0
STILL = Style.speech_only()
LIPS = [fap.column(4), fap.column(5)]
SENTENCE = ["m", "a", "p", "a", "l", "i", "f", "u", "b", "a", "s", "t", "o", "m", "i"]


def sentence(labels=SENTENCE, each_s=0.1, lead_s=0.3):
    return tuple(Phone(label, lead_s + n * each_s, lead_s + (n + 1) * each_s) for n, label in enumerate(labels))


def engine(style=STILL, seed=1, start_s=0.0, **limits):
    made = Engine(english(), rng=np.random.default_rng(seed), style=style, limits=Limits(**limits))
    made.open("anna", start_s)
    return made


def say(face, phones, number=1, now_s=0.0, tail_s=0.3, session="anna", **begin):
    face.apply(session, Begin(number, **begin), now_s)
    face.apply(session, Append(number, 0, phones), now_s)
    face.apply(session, End(number, len(phones), phones[-1].end_s + tail_s), now_s)


def frames(face, from_s, to_s, row=0):
    steps = range(round(from_s * RATE_HZ), round(to_s * RATE_HZ))
    return np.array([face.frame(n / RATE_HZ).faps[row] for n in steps])


def kinds(face):
    return [event.kind for event in face.events()]


def opening(faps):
    """How far the lips are apart, FAPU."""
    return -faps[..., LIPS].sum(axis=-1)


def test_speech_is_what_the_offline_plan_says():
    face = engine()
    say(face, sentence())
    seen = frames(face, 0.0, 2.0)
    track = PhoneTrack.from_phones(list(sentence()))
    planned = plan(track, english(), rng=np.random.default_rng(0), rate_hz=RATE_HZ, style=STILL, duration_s=2.0)
    assert np.abs(seen - planned.track.values).max() <= 1
    assert seen[:, LIPS].any()


@pytest.mark.parametrize("start_s", [0.0, 5000.0])
@pytest.mark.parametrize(("ahead_s", "most"), [(0.7, 40), (2.0, 8)])
def test_chunks_that_come_early_are_planned_together_and_show_the_same(monkeypatch, ahead_s, most, start_s):
    whole, chunks = engine(start_s=start_s), engine(start_s=start_s)
    phones = sentence(SENTENCE * 5, each_s=0.08)
    say(whole, phones, now_s=start_s)
    fed = []
    monkeypatch.setattr(
        chunks._batch,
        "feed",
        lambda *args, **named: fed.append(args) or type(chunks._batch).feed(chunks._batch, *args, **named),
    )
    chunks.apply("anna", Begin(1), start_s)
    sent = 0
    for n in range(330):
        now_s = start_s + n / RATE_HZ
        while sent < len(phones) and phones[sent].start_s < n / RATE_HZ + ahead_s:
            chunks.apply("anna", Append(1, sent, phones[sent : sent + 2]), now_s)
            sent += 2
        assert np.abs(chunks.frame(now_s).faps - whole.frame(now_s).faps).max() <= 1, now_s
    assert 3 < len(fed) <= most
    assert not chunks.counters("anna").late


def test_events_tell_when_it_speaks_and_state_follows():
    face = engine()
    assert face.state("anna") == "idle"
    say(face, sentence(), at_s=0.5, anchor="at")
    assert face.state("anna") == "waiting"
    frames(face, 0.0, 0.6)
    assert (kinds(face), face.state("anna")) == (["started"], "speaking")
    frames(face, 0.6, 3.0)
    assert (kinds(face), face.state("anna")) == (["finished"], "idle")
    assert face.utterance("anna", 1) is None


def test_utterances_queue_up_behind_each_other():
    face = engine()
    for number in (1, 2, 3):
        say(face, sentence(), number=number, tail_s=0.2)
    one_s = sentence()[-1].end_s + 0.2
    seen = frames(face, 0.0, 3 * one_s)
    steps = round(one_s * RATE_HZ)
    shared = slice(20, steps - 20)
    assert np.abs(seen[:steps][shared] - seen[steps : 2 * steps][shared]).max() <= 40  # frames fall elsewhere
    told = [(event.utterance, event.kind) for event in face.events()]
    assert told == [(1, "started"), (1, "finished"), (2, "started"), (2, "finished"), (3, "started")]


def test_a_queued_utterance_waits_until_the_end_of_the_one_before_is_told():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence()), 0.0)
    say(face, sentence(["o", "u"]), number=2)
    frames(face, 0.0, 1.0)
    assert not face.utterance("anna", 2).state.is_placed
    face.apply("anna", End(1, len(SENTENCE), 1.9), 1.0)
    assert face.utterance("anna", 2).zero_s == pytest.approx(1.9)


def test_repeats_change_nothing():
    once, often = engine(), engine()
    say(once, sentence())
    for now_s in (0.0, 0.02, 0.3):
        say(often, sentence())
        np.testing.assert_array_equal(frames(once, now_s, now_s + 0.02), frames(often, now_s, now_s + 0.02))
    np.testing.assert_array_equal(frames(once, 0.4, 3.0), frames(often, 0.4, 3.0))
    say(often, sentence(), now_s=3.0)  # over and known to be
    assert often.state("anna") == "idle"
    assert often.counters("anna").ignored == 3
    assert often.counters("anna").utterances == 1


def test_chunks_in_any_order_even_before_their_beginning():
    straight, mixed = engine(), engine()
    phones = sentence()
    say(straight, phones)
    mixed.apply("anna", Append(1, 6, phones[6:]), 0.0)
    mixed.apply("anna", End(1, len(phones), phones[-1].end_s + 0.3), 0.0)
    mixed.apply("anna", Append(1, 2, phones[2:8]), 0.0)
    assert (mixed.utterance("anna", 1).lost, mixed.utterance("anna", 1).size) == (2, len(phones))
    mixed.apply("anna", Begin(1), 0.0)
    mixed.apply("anna", Append(1, 0, phones[:2]), 0.0)
    assert mixed.utterance("anna", 1).lost == 0
    np.testing.assert_array_equal(frames(straight, 0.0, 2.2), frames(mixed, 0.0, 2.2))


def test_what_waits_for_its_sound_behind_others_is_not_given_up_meanwhile():
    one = engine(wait_s=1.0)
    say(one, sentence(), number=1)
    say(one, sentence(), number=2, anchor="audio")
    frames(one, 0.0, 2.0)  # the first lasts longer than the second would wait
    one.apply("anna", Pause(), 1.9)
    frames(one, 2.0, 4.0)
    one.apply("anna", Resume(), 4.0)
    frames(one, 4.0, 4.9)
    assert one.utterance("anna", 2) is not None
    assert "error" not in kinds(one)
    frames(one, 4.9, 6.0)
    assert kinds(one) == ["error"]


def test_word_of_another_sound_lets_all_go_on_where_they_were():
    one = engine()
    say(one, sentence(), number=1)
    frames(one, 0.0, 1.0)
    one.apply("anna", Pause(), 1.0)
    say(one, sentence(), number=2, now_s=2.0, anchor="audio")
    frames(one, 1.0, 3.0)
    one.apply("anna", Audio(2, 3.0, -1.0), 3.0)
    assert one.state("anna") == "speaking"
    assert one.utterance("anna", 1).position_s(3.0) == pytest.approx(1.0)
    assert one.utterance("anna", 2).position_s(3.0) == pytest.approx(-1.0)


def test_a_time_that_lies_too_far_ahead_is_refused():
    one = engine(queued_s=10.0)
    one.apply("anna", Begin(1, "at", 10.5), 0.0)
    assert one.utterance("anna", 1) is None
    assert one.counters("anna").refused == 1
    one.apply("anna", Begin(2, "at", 9.5), 0.0)
    assert one.utterance("anna", 2) is not None


def test_events_tell_where_the_utterance_was():
    one = engine()
    say(one, sentence())
    say(one, sentence(), number=2, anchor="audio")
    frames(one, 0.0, 1.0)
    one.apply("anna", Cancel(), 1.0)
    positions_s = {(event.utterance, event.kind): event.position_s for event in one.events()}
    assert positions_s == {
        (1, "started"): pytest.approx(0.0, abs=0.03),
        (1, "cancelled"): pytest.approx(1.0),
        (2, "cancelled"): 0.0,  # it had no place
    }


def test_what_is_wished_for_the_future_has_a_limit():
    ramps = Ramps(np.zeros(1))
    row = ramps.open()
    for number in reversed(range(2 * MAX_WAITING)):
        ramps.send(row, [Ramp(10.0 + number, 0, float(number), 0.5)])
    assert ramps.values(10.5)[0, row] == pytest.approx(0.0)
    assert ramps.values(15.6)[0, row] == pytest.approx(5.0)  # what is near is kept
    assert ramps.values(1e6)[0, row] == pytest.approx(MAX_WAITING - 1)


def test_cancel_closes_the_mouth_and_is_idempotent():
    face = engine()
    say(face, sentence(["a"] * 12))
    say(face, sentence(["a"] * 12), number=2)
    assert opening(frames(face, 0.0, 0.7)[-1]) > 100
    for _ in range(3):
        face.apply("anna", Cancel(fade_s=0.1), 0.7)
    assert kinds(face) == ["started", "cancelled", "cancelled"]
    assert not frames(face, 0.7, 2.0)[8:].any()
    assert face.counters("anna").cancelled == 2
    assert face.state("anna") == "idle"


def test_cancel_of_one_lets_the_next_begin():
    face = engine()
    say(face, sentence(["a"] * 12))
    say(face, sentence(["a"] * 12, lead_s=0.4), number=2)
    frames(face, 0.0, 0.7)
    face.apply("anna", Cancel(1, fade_s=0.1), 0.7)
    assert face.utterance("anna", 2).zero_s == pytest.approx(0.8)
    seen = opening(frames(face, 0.7, 3.0))
    assert seen[:8].min() < 0.3 * seen[0]
    assert seen[8:].max() > 100
    assert face.state("anna") == "idle"


def test_cancel_at_a_time_waits_for_it():
    face = engine()
    say(face, sentence(["a"] * 12))
    face.apply("anna", Cancel(at_s=0.9), 0.0)
    face.apply("anna", Cancel(at_s=0.9), 0.0)
    seen = opening(frames(face, 0.0, 2.0))
    assert seen[44] > 100
    assert not seen[58:].any()
    assert face.counters("anna").cancelled == 1


def test_pause_rests_and_resume_goes_on_where_it_was():
    face, other = engine(), engine()
    for each in (face, other):
        say(each, sentence(["a", "m"] * 8))
    frames(face, 0.0, 0.7)
    frames(other, 0.0, 3.0)
    face.apply("anna", Pause(), 0.7)
    assert face.state("anna") == "paused"
    assert not frames(face, 0.7, 2.0)[12:].any()
    face.apply("anna", Resume(), 2.0)
    assert face.utterance("anna", 1).position_s(2.0) == pytest.approx(0.7)
    seen = frames(face, 2.0, 3.6)
    again = engine()
    say(again, sentence(["a", "m"] * 8))
    smooth = frames(again, 0.0, 2.3)
    assert np.abs(seen[30:] - smooth[65:115]).max() <= 1  # behind the fade, and three phones on, the same
    assert face.counters("anna").late == 0


def test_seek_goes_elsewhere():
    face, other = engine(), engine()
    for each in (face, other):
        say(each, sentence(["a", "m"] * 8))
    frames(face, 0.0, 0.7)
    face.apply("anna", Seek(1, 1.1), 0.7)
    seen = frames(face, 0.7, 1.5)
    straight = frames(other, 0.0, 2.2)
    assert np.abs(seen[30:40] - straight[85:95]).max() <= 1
    assert not face.counters("anna").dropped


def test_an_utterance_waits_for_its_sound():
    face = engine()
    say(face, sentence(), anchor="audio")
    assert not frames(face, 0.0, 1.0).any()
    face.apply("anna", Audio(1, at_s=0.95, position_s=0.0), 1.0)
    assert face.utterance("anna", 1).position_s(1.0) == pytest.approx(0.05)
    assert frames(face, 1.0, 2.5).any()


def test_the_face_follows_a_sound_that_runs_slow_and_never_jumps():
    face, skew = engine(), 1.0 - 2e-3
    say(face, sentence(["a", "m"] * 60))
    errors = []
    for n in range(400):
        now_s = n / RATE_HZ
        if n % 10 == 0:
            face.apply("anna", Audio(1, now_s, skew * now_s), now_s)
        face.frame(now_s)
        errors.append(face.utterance("anna", 1).position_s(now_s) - skew * now_s)
    assert np.abs(errors).max() < 1e-3
    assert face.counters("anna").jumps == 0


def test_the_face_jumps_to_a_sound_that_is_far_off_and_stands_with_it():
    face = engine()
    say(face, sentence(["a", "m"] * 20))
    frames(face, 0.0, 0.5)
    face.apply("anna", Audio(1, 0.5, 0.9), 0.5)
    assert face.utterance("anna", 1).position_s(0.5) == pytest.approx(0.9)
    assert face.counters("anna").jumps == 1
    frames(face, 0.5, 1.0)
    face.apply("anna", Audio(1, 1.0, 1.4, rate=0.0), 1.0)
    assert face.state("anna") == "paused"
    assert not frames(face, 1.0, 2.0)[12:].any()
    face.apply("anna", Audio(1, 2.0, 1.4), 2.0)
    assert face.utterance("anna", 1).position_s(2.0) == pytest.approx(1.4)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("off_s", "jumps"), [(0.075, 0), (0.085, 1)])
def test_the_face_jumps_only_from_80_ms_on(off_s, jumps, sign):
    """As docs/osc.md promises; below that it slews, by 2 % at most."""
    face = engine()
    say(face, sentence(["a", "m"] * 20))
    frames(face, 0.0, 0.5)
    face.apply("anna", Audio(1, 0.5, 0.5 + sign * off_s), 0.5)
    assert face.counters("anna").jumps == jumps
    apart_s = face.utterance("anna", 1).position_s(0.5) - 0.5
    assert apart_s == pytest.approx(sign * off_s * jumps)
    frames(face, 0.5, 1.0)
    assert abs(face.utterance("anna", 1).position_s(1.0) - 1.0) == pytest.approx(off_s if jumps else 0.01, rel=0.1)


def test_rest_brings_all_gestures_to_rest_for_good():
    face = engine(Style())
    say(face, (Phone("a", 1.5, 1.9, stress=1),))
    face.rest("anna", 2.0, 0.5)
    seen = frames(face, 0.0, 12.0)
    assert seen[:95].any()
    assert not seen[102:].any()
    face.apply("anna", SetParameter("idle", 1.0), 12.0)
    assert not frames(face, 12.0, 15.0).any()
    with pytest.raises(UsageError, match="not open"):
        face.rest("zoe", 1.0, 0.0)


def test_a_revision_replaces_what_is_still_to_come():
    face = engine()
    say(face, sentence(["a"] * 12))
    frames(face, 0.0, 0.7)
    face.apply("anna", Append(1, 4, tuple(Phone("m", 0.7 + n / 10, 0.8 + n / 10) for n in range(4)), revision=1), 0.7)
    assert opening(frames(face, 0.7, 1.1))[5:].max() < 100
    face.apply("anna", End(1, 8, 1.1, revision=1), 1.1)
    face.apply("anna", Append(1, 4, sentence(["a"] * 12)[4:]), 1.1)
    assert face.counters("anna").ignored == 1
    frames(face, 1.1, 2.0)
    assert kinds(face)[-1] == "finished"


def test_a_partial_result_replaces_the_phones_from_its_first_on_also_one_that_is_said():
    def shown(*changes):
        face = engine()
        face.apply("anna", Begin(1), 0.0)
        face.apply("anna", Append(1, 0, (Phone("m", 0.3, 0.4), Phone("ɑ", 0.4, 0.5))), 0.0)
        seen = [frames(face, 0.0, 0.46)]
        for number, phones in enumerate(changes, start=1):
            face.apply("anna", Append(1, 1, phones, number, keeps_earlier=True), 0.45)
        face.apply("anna", End(1, 1 + len(changes[-1]), 1.2, len(changes)), 0.45)
        seen.append(frames(face, 0.46, 1.5))
        assert [event.kind for event in face.events()] == ["started", "finished"]
        return np.concatenate(seen), face.counters("anna")

    longer = (Phone("ɑ", 0.4, 0.7), Phone("b", 0.7, 0.8))
    once, counters = shown(longer)
    twice, _ = shown((Phone("i", 0.4, 0.6), Phone("s", 0.6, 0.9)), longer)
    assert (once == twice).all()
    assert opening(once[round(0.6 * RATE_HZ)]) > 100  # the vowel lasts
    assert opening(once[round(0.65 * RATE_HZ) :]).min() <= 10  # then b
    assert (counters.late, counters.lost) == (0, 0)


def said(rng, begins_s, count):
    """Phones of random labels and lengths, without gaps."""
    ends_s = begins_s + np.cumsum(rng.uniform(0.04, 0.16, count))
    labels = rng.choice(list("mapbilofsut"), count)
    return tuple(map(Phone, labels.tolist(), [begins_s, *ends_s[:-1].tolist()], ends_s.tolist()))


def partial_results(rng, phones):
    """Results of a recognizer: each has more of the phones, and others after them that the next one replaces."""
    known, last = 0, 6
    for revision in range(1, last):
        final = int(rng.integers(known, min(known + 4, len(phones))))
        tail = said(rng, phones[final].start_s, int(rng.integers(1, 4)))
        yield Append(1, known, (*phones[known:final], *tail), revision, keeps_earlier=True)
        known = final
    yield Append(1, known, phones[known:], last, keeps_earlier=True)


@pytest.mark.parametrize("seed", range(4))
def test_phones_that_changed_before_they_were_shown_leave_no_trace(seed):
    def shown(*commands):
        face = engine()
        for command in (Begin(1), *commands, End(1, len(phones), 2.5, commands[-1].revision)):
            face.apply("anna", command, 0.0)
        seen = frames(face, 0.0, 2.6)
        assert kinds(face) == ["started", "finished"]
        counters = face.counters("anna")
        assert (counters.late, counters.dropped, counters.concealed, counters.lost) == (0, 0, 0, 0)
        return seen

    phones = said(np.random.default_rng(seed), 0.3, 12)
    changed = shown(*partial_results(np.random.default_rng(seed), phones))
    assert np.array_equal(changed, shown(Append(1, 0, phones)))


def test_lips_do_not_jump_when_phones_change_again_and_again_while_they_are_said():
    steps = {True: 0, False: 0}
    for seed in range(5):
        rng = np.random.default_rng(seed)
        phones = said(rng, 0.3, 12)
        for changes in steps:
            face = engine()
            face.apply("anna", Begin(1), 0.0)
            results = list(partial_results(rng, phones)) if changes else [Append(1, 0, phones)]
            seen = []
            for step in range(250):
                now_s = step / 100
                if results and step % 8 == 0 and now_s > phones[results[0].first_index].start_s - 0.1:
                    face.apply("anna", results.pop(0), now_s)
                seen.append(face.frame(now_s).faps[0])
            assert not results
            steps[changes] = max(steps[changes], np.abs(np.diff(opening(np.array(seen)))).max())
    assert 0 < steps[True] < 1.2 * steps[False]


def test_a_revision_that_comes_late_is_counted_late():
    face = engine()
    say(face, sentence(["a"] * 12))
    frames(face, 0.0, 0.7)
    revised = (Phone("m", 0.5, 0.66), Phone("i", 0.66, 0.8), Phone("u", 0.8, 0.9))
    face.apply("anna", Append(1, 4, revised, revision=1), 0.7)
    frames(face, 0.7, 1.0)
    counters = face.counters("anna")
    assert (counters.late, counters.dropped) == (1, 1)
    assert kinds(face).count("late") == 1


def test_a_missing_phone_is_concealed_and_a_late_one_counted():
    face = engine()
    phones = sentence(["a", "o", "m", "a", "a"])
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, phones[:2]), 0.0)
    face.apply("anna", Append(1, 3, phones[3:]), 0.0)
    seen = opening(frames(face, 0.0, 0.6))
    assert seen[-4:].min() > 30  # o went on where m was missing
    assert kinds(face) == ["started", "concealed"]
    face.apply("anna", Append(1, 2, phones[2:3]), 0.59)
    frames(face, 0.6, 0.75)
    assert (kinds(face), face.counters("anna").late) == (["late"], 1)
    face.apply("anna", End(1, 5, 0.9), 0.75)
    frames(face, 0.75, 1.2)
    assert kinds(face) == ["finished"]
    assert face.counters("anna").lost == 0  # it came after all


def test_speech_that_stops_coming_is_an_underrun_and_ends_by_itself():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a"] * 4)), 0.0)
    seen = opening(frames(face, 0.0, 4.0))
    assert kinds(face) == ["started", "underrun", "finished"]
    assert not seen[60:].any()
    assert (face.counters("anna").underruns, face.counters("anna").unended) == (1, 1)
    face.apply("anna", Append(2, 0, sentence(["a"])), 4.0)  # its beginning never comes
    frames(face, 4.0, 40.0)
    assert kinds(face) == ["error"]


def test_speech_that_stops_after_a_revision_is_an_underrun_too():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a"] * 4)), 0.0)
    frames(face, 0.0, 0.5)
    face.apply("anna", Begin(1, revision=1), 0.5)  # what is said stays, and nothing follows
    frames(face, 0.5, 1.0)
    assert kinds(face) == ["started", "underrun"]


def test_phones_lost_for_good_are_counted():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a"] * 4)), 0.0)
    face.apply("anna", End(1, 6, 1.0), 0.0)
    frames(face, 0.0, 2.0)
    assert face.counters("anna").lost == 2


def test_expressions_come_hold_and_go_in_a_smooth_curve():
    face = engine()
    face.apply("anna", Express(Expression.JOY, 0.8, at_s=0.5, attack_s=0.3, hold_s=0.4, release_s=0.3), 0.0)
    seen = frames(face, 0.0, 2.0)
    smile = seen[:, fap.column(12)]
    assert not seen[:25].any()
    assert not seen[77:].any()
    assert smile[42:59].min() == smile.max() > 20
    moods = {Expression.JOY: 0.8}
    held = plan(
        PhoneTrack.from_phones([Phone("_", 0.0, 3.0)]),
        english(),
        rng=np.random.default_rng(0),
        expressions=moods,
        style=STILL,
    )
    assert np.abs(held.track.values[45] - seen[50]).max() <= 1


def test_an_expression_takes_over_from_where_the_last_one_is():
    face = engine()
    face.apply("anna", Express(Expression.ANGER, 1.0), 0.0)
    frames(face, 0.0, 0.2)
    face.apply("anna", Express(Expression.ANGER, 0.0, attack_s=0.4), 0.2)
    seen = frames(face, 0.2, 1.0)[:, fap.column(31)].astype(float)
    assert abs(seen[0]) > 5
    assert seen[-1] == 0
    assert np.abs(np.diff(seen, 2)).max() < 12


def test_an_expression_ends_the_hold_of_the_last_one():
    face = engine()
    face.apply("anna", Express(Expression.JOY, 0.8, hold_s=0.2), 0.0)
    face.apply("anna", Express(Expression.JOY, 0.8), 0.1)
    assert frames(face, 0.0, 4.0)[-1, fap.column(12)] > 20  # it holds until the next one


def test_looks_turns_and_blinks_reach_their_faps():
    face = engine()
    face.apply("anna", Look(0.2, -0.1), 0.0)
    face.apply("anna", TurnHead(pitch_rad=0.05, yaw_rad=-0.1, roll_rad=0.02, over_s=0.2), 0.0)
    face.apply("anna", Blink(), 0.0)
    seen = frames(face, 0.0, 0.6)
    rad = seen[-1] * AU_RAD
    for number, angle_rad in ((23, 0.2), (24, 0.2), (25, -0.1), (26, -0.1), (48, 0.05), (49, -0.1), (50, 0.02)):
        assert rad[fap.column(number)] == pytest.approx(angle_rad, abs=2e-5), number
    assert seen[:, fap.column(19)].max() > 900
    assert seen[-1, fap.column(19)] == -60  # the blink is over; lids follow the gaze
    assert seen[-1, fap.column(21)] == 20


def test_a_lively_face_blinks_sways_and_glances_and_each_is_its_own():
    face = engine(Style())
    face.open("bert", 0.0)
    seen = np.array([face.frame(n / RATE_HZ).faps for n in range(1500)])
    lids = seen[:, :, fap.column(19)]
    blinks = (np.diff((lids > 800).astype(int), axis=0) > 0).sum(axis=0)
    assert ((blinks >= 3) & (blinks <= 14)).all()
    for number in (48, 49, 50, 23, 25, 31):
        assert seen[:, :, fap.column(number)].std(axis=0).min() > 1, number
    assert np.abs(seen[:, 0] - seen[:, 1]).max() > 100
    assert np.abs(seen[0]).max() <= 1
    again = engine(Style())
    again.open("bert", 0.0)
    np.testing.assert_array_equal(seen[:200], [again.frame(n / RATE_HZ).faps for n in range(200)])


def test_stress_nods_and_raises_the_brows():
    face = engine(Style(blinks=False, head_motion=False, gaze=False, idle=False))
    say(face, (Phone("a", 0.5, 0.7, 1), Phone("n", 0.7, 0.9)))
    assert frames(face, 0.0, 2.0)[:, fap.column(31)].max() > 30


def test_manner_changes_a_session_smoothly_and_no_other():
    face = engine()
    face.open("bert", 0.0)
    for name in ("anna", "bert"):
        say(face, sentence(["a"] * 30), session=name)
    frames(face, 0.0, 0.8)
    face.apply("anna", SetParameter("jaw", 0.0), 0.8)
    face.apply("anna", SetParameter("lips", 0.0), 0.8)
    seen = np.array([face.frame(n / RATE_HZ).faps for n in range(40, 80)])
    assert not seen[-1, 0].any()
    assert opening(seen[-1, 1]) > 100
    assert np.abs(np.diff(seen[:, 0], axis=0)).max() < 95  # of 520 that the jaw is down
    assert face.style("anna").jaw == 0


def test_generators_are_switched():
    face = engine(Style())
    for setting in ("blinks", "head_motion", "gaze", "idle", "emphasis"):
        face.apply("anna", SetParameter(setting, 0), 0.0)
    assert not frames(face, 0.0, 8.0)[50:].any()


@pytest.mark.parametrize(
    "command",
    [
        Express(Expression.JOY, 3.0), Express(Expression.JOY, float("nan")), Express(Expression.NEUTRAL),
        Look(2.0, 0.0), TurnHead(pitch_rad=0.0, yaw_rad=float("nan"), roll_rad=0.0),
        SetParameter("colour", 1.0), SetParameter("jaw", 99.0),
        Append(1, -1, sentence()), Append(1, 19_990, sentence()), Append(1, 0, ()),
        Append(1, 0, (Phone("a", 0.0, 601.0),)), End(1, 10**6, 1.0), End(1, 1, inf),
    ],
)  # fmt: skip
def test_what_is_out_of_range_is_refused_and_counted(command):
    face = engine()
    face.apply("anna", command, 0.0)
    face.frame(0.0)
    assert face.counters("anna").refused == 1


@pytest.mark.parametrize("command", [Seek(7, 1.0), Audio(7, 0.0, 0.0)])
def test_commands_for_unknown_utterances_are_ignored_and_counted(command):
    face = engine()
    face.apply("anna", command, 0.0)
    assert face.counters("anna").ignored == 1


def test_limits_hold():
    face = engine(sessions=2, utterances=3)
    face.open("bert", 0.0)
    with pytest.raises(UsageError, match="limit of 2"):
        face.open("carl", 0.0)
    for number in range(5):
        say(face, sentence(), number=number)
    assert face.counters("anna").refused == 6
    for n in range(5):
        face.apply("anna", Cancel(at_s=10.0 + n), 0.0)
    assert face.counters("anna").refused == 8


def test_refuses():
    face = engine()
    with pytest.raises(UsageError, match="open already"):
        face.open("anna", 0.0)
    for act in (face.state, face.counters, face.style, lambda name: face.close(name, 0.0)):
        with pytest.raises(UsageError, match="not open"):
            act("zoe")
    with pytest.raises(UsageError, match="not open"):
        face.apply("zoe", Blink(), 0.0)
    with pytest.raises(UsageError, match="not open"):
        face.utterance("zoe", 1)
    face.frame(1.0)
    with pytest.raises(UsageError, match="rising"):
        face.frame(0.5)


def test_rows_stay_with_their_sessions_when_others_close():
    face = engine()
    for name in "bcd":
        face.open(name, 0.0)
    say(face, sentence(["a"] * 20), session="d")
    face.apply("c", Express(Expression.JOY), 0.0)
    frames(face, 0.0, 0.5)
    face.apply("anna", Begin(1), 0.5)
    face.close("anna", 0.55)
    assert "anna" not in face
    assert [(event.session, event.time_s) for event in face.events() if event.kind == "cancelled"] == [("anna", 0.55)]
    frame = face.frame(0.8)
    assert sorted(frame.sessions) == ["b", "c", "d"]
    shown = dict(zip(frame.sessions, frame.faps, strict=True))
    assert opening(shown["d"]) > 100
    assert shown["c"][fap.column(12)] > 20
    assert not shown["b"].any()
    assert len(face) == 3


def test_the_gestures_of_the_others_go_on_when_one_closes():
    faces = []
    for is_closed in (False, True):
        face = engine(Style())
        for name in "bcd":
            face.open(name, 0.0)
        frames(face, 0.0, 0.5)
        if is_closed:
            face.close("b", 0.5)
        frames(face, 0.5, 2.0)
        frame = face.frame(2.0)
        faces.append(dict(zip(frame.sessions, frame.faps.tolist(), strict=True)))
    assert faces[1] == {name: faces[0][name] for name in ("anna", "c", "d")}
    assert len({tuple(shown) for shown in faces[1].values()}) == 3


COMMANDS = st.one_of(
    st.builds(Begin, st.integers(0, 3), st.sampled_from(["now", "at", "audio"]), st.floats(0, 4), st.integers(0, 2)),
    st.builds(
        lambda number, first, labels, revision: Append(
            number,
            first,
            tuple(Phone(each, (first + n) / 10, (first + n + 1) / 10) for n, each in enumerate(labels)),
            revision,
        ),
        st.integers(0, 3),
        st.integers(0, 9),
        st.lists(st.sampled_from(["a", "m", "_", "f", "?"]), min_size=1, max_size=5),
        st.integers(0, 2),
    ),
    st.builds(End, st.integers(0, 3), st.integers(0, 12), st.floats(0, 1.5), st.integers(0, 2)),
    st.builds(Cancel, st.none() | st.integers(0, 3), st.none() | st.floats(0, 5), st.just(0.1)),
    st.just(Pause()),
    st.just(Resume()),
    st.builds(Seek, st.integers(0, 3), st.floats(-1, 3)),
    st.builds(Audio, st.integers(0, 3), st.floats(0, 5), st.floats(-1, 3), st.sampled_from([0.0, 1.0])),
    st.builds(Express, st.sampled_from(list(Expression)[1:]), st.floats(0, 2), st.none() | st.floats(0, 5)),
)


@given(st.lists(st.tuples(COMMANDS, st.integers(0, 12)), max_size=25))
@settings(max_examples=150, deadline=None)
def test_whatever_is_told_the_face_moves_smoothly_and_comes_to_rest(script):
    face, step = engine(), 0
    seen = [face.frame(0.0).faps[0]]
    for command, wait in script:
        face.apply("anna", command, step / RATE_HZ)
        for _ in range(wait):
            step += 1
            seen.append(face.frame(step / RATE_HZ).faps[0])
    face.apply("anna", Cancel(), step / RATE_HZ)
    for expression in list(Expression)[1:]:
        face.apply("anna", Express(expression, 0.0), step / RATE_HZ)
    for _ in range(40):
        step += 1
        seen.append(face.frame(step / RATE_HZ).faps[0])
    assert not seen[-1].any()
    assert face.state("anna") == "idle"
    assert np.abs(np.diff(np.array(seen)[:, LIPS], axis=0)).max() < 700  # no lip leaps across the mouth in a frame
    counters = face.counters("anna")
    assert counters.utterances == counters.finished + counters.unended + counters.cancelled
    assert min(astuple(counters)) >= 0


def test_many_clauses_at_once_are_planned_over_several_frames_and_in_time(monkeypatch):
    face, fed = engine(), []
    for n in range(40):
        face.open(f"s{n}", 0.0)
    feed = face._batch.feed
    monkeypatch.setattr(face._batch, "feed", lambda *args, **named: fed.append(args) or feed(*args, **named))
    for n in range(40):
        say(face, sentence(lead_s=0.8), session=f"s{n}")
    counts = []
    for n in range(90):
        before = len(fed)
        face.frame(n / RATE_HZ)
        counts.append(len(fed) - before)
    assert sum(counts) == 40
    assert 2 < max(counts) < 10
    assert not any(face.counters(f"s{n}").late for n in range(40))


NO_COMMANDS = [
    Begin(2, "at", nan),
    Begin(2, "at", -inf),
    End(1, -1, 1.0),
    End(1, 3, nan),
    Cancel(at_s=nan),
    Cancel(at_s=inf),
    Cancel(at_s=0.4, fade_s=0.0),
    Cancel(at_s=0.4, fade_s=-1.0),
    Cancel(fade_s=nan),
    Cancel(fade_s=1e9),
    Pause(fade_s=nan),
    Seek(1, nan),
    Seek(1, inf),
    Audio(1, at_s=0.2, position_s=2.6, rate=nan),
    Audio(1, at_s=0.2, position_s=2.6, rate=-1.0),
    Audio(1, at_s=-inf, position_s=0.0),
    Audio(1, at_s=0.2, position_s=inf),
    Express(Expression.JOY, at_s=inf),
    Express(Expression.JOY, attack_s=nan),
    TurnHead(roll_rad=nan, pitch_rad=0.0, yaw_rad=0.0),
]


@pytest.mark.parametrize("command", NO_COMMANDS, ids=repr)
def test_a_command_that_cannot_be_meant_is_refused_and_changes_nothing(command):
    told, untold = engine(), engine()
    for face in (told, untold):
        say(face, sentence())
    shown = [frames(face, 0.0, 0.3) for face in (told, untold)]
    told.apply("anna", command, 0.3)
    shown = [frames(face, 0.3, 1.5) for face in (told, untold)]
    assert np.array_equal(*shown)
    assert (told.counters("anna").refused, untold.counters("anna").refused) == (1, 0)


@pytest.mark.parametrize("part", ["advance", "flush", "draw", "plan_at"])
def test_a_session_that_fails_is_ended_alone(part, monkeypatch):
    face, alone = engine(Style()), engine(Style())
    face.open("bert", 0.0)
    shown = [frames(faces, 0.0, 0.1) for faces in (face, alone)]
    for faces in (face, alone):
        say(faces, sentence(), now_s=0.1)
    say(face, sentence(), session="bert", now_s=0.1)
    guilty = {"draw": face._gestures._generators[1], "plan_at": face._batch._planners[1]}.get(part, face._rows[1])
    face._gestures._due_s[1] = 0.0
    whole = getattr(type(guilty), part)

    def fail(self, *arguments):
        if self is guilty:
            raise OverflowError("too much")
        return whole(self, *arguments)

    monkeypatch.setattr(type(guilty), part, fail)
    shown += [frames(faces, 0.1, 1.0) for faces in (face, alone)]
    assert np.array_equal(*shown[:2])
    assert np.array_equal(*shown[2:])
    assert face.sessions == ("anna",)
    (fault,) = face.faults()
    assert (fault.session, str(fault.error), fault.counters.utterances) == ("bert", "too much", 1)
    assert face.faults() == []
    assert [event.kind for event in face.events() if event.session == "bert"][-1] == "error"
    face.open("bert", 1.0)
    say(face, sentence(), session="bert", now_s=1.0)
    assert opening(frames(face, 1.0, 2.0, row=1)).max() > 100


def test_a_frame_that_fails_for_no_session_s_fault_says_so(monkeypatch):
    face, calls = engine(), []

    def fail(*_):
        calls.append(1)
        raise OverflowError("too much")

    monkeypatch.setattr(type(face._batch), "frames", fail)
    with pytest.raises(OverflowError):
        face.frame(0.0)
    assert len(calls) == 1  # the same frame would fail again
    assert face.sessions == ("anna",)


@pytest.mark.parametrize(
    "told",
    [
        (Express(Expression.SURPRISE, 2.0, attack_s=0.01),),
        (Express(Expression.FEAR, 2.0, attack_s=0.01), Express(Expression.DISGUST, 2.0, attack_s=0.01, hold_s=0.1)),
        (SetParameter("jaw", 3.0), SetParameter("lips", 3.0), SetParameter("articulation", 3.0)),
        (SetParameter("jaw", 3.0), SetParameter("lips", 3.0), Pause(0.01)),
        (TurnHead(roll_rad=1, pitch_rad=1, yaw_rad=1, over_s=0.01), Seek(1, 1.6), Cancel(fade_s=0.01)),
    ],
)
def test_no_mouth_moves_faster_than_half_as_much_again_as_speech(told):
    face = engine()
    face.open("bert", 0.0)  # who says the same, and is told nothing
    for name in face.sessions:
        say(face, sentence(SENTENCE * 2, each_s=0.06), session=name)
    rows = []
    for number in range(120):
        for command in told if number == 45 else ():
            assert face.apply("anna", command, number / 60) == ""
        rows.append(face.frame(number / 60).faps.copy())
    steps = np.abs(np.diff(rows, axis=0))[:, :, fap.column(3) : fap.column(18) + 1].max(axis=(0, 2))
    assert steps[1] < 509  # speech alone, the fastest of 60 random texts
    assert steps[0] <= 1.5 * 509
    assert -min(row[0, LIPS].sum() for row in rows) >= -2


def test_what_a_caller_does_with_a_frame_changes_no_later_frame():
    rows = {}
    for is_overwritten in (False, True):
        face = engine()
        say(face, sentence())
        rows[is_overwritten] = []
        for number in range(60):
            faps = face.frame(number / 60).faps
            rows[is_overwritten].append(faps.copy())
            if is_overwritten:
                faps[:] = 4000
    np.testing.assert_array_equal(rows[True], rows[False])


def test_late_phones_are_reported_once_each_even_after_one_that_was_dropped():
    face = engine()
    phones = sentence(["a"] * 12)
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, phones[:3]), 0.0)
    reported = []
    for now_s, index in ((0.9, 3), (0.96, 6), (1.04, 7), (1.06, 8)):  # 3 is over when it comes; 6 and 7 have begun
        frames(face, reported[-1][0] + 1 / RATE_HZ if reported else 0.0, now_s)
        face.apply("anna", Append(1, index, phones[index : index + 1]), now_s)
        face.frame(now_s)
        reported.append((now_s, [event.count for event in face.events() if event.kind == "late"]))
    assert [counts for _, counts in reported] == [[1], [1], [1], []]
    counters = face.counters("anna")
    assert (counters.dropped, counters.late) == (1, 2)


def test_of_a_partial_result_only_phones_that_are_new_are_late():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a"] * 6)), 0.0)
    frames(face, 0.0, 0.8)
    replaced = tuple(Phone("o", 0.75 + n / 10, 0.85 + n / 10) for n in range(2))  # 4 and 5 are replaced
    face.apply("anna", Append(1, 4, (*replaced, Phone("i", 0.6, 0.9)), revision=1, keeps_earlier=True), 0.8)
    assert face.utterance("anna", 1).slack_s(0.8) == pytest.approx(-0.2)
    face.frame(0.8)
    assert [event.count for event in face.events() if event.kind == "late"] == [1]


def test_of_what_was_to_begin_earlier_the_phones_that_are_over_are_counted_as_dropped():
    dropped = {}
    for anchor in ("at", "now"):
        face = engine()
        face.frame(1.0)
        say(face, sentence(["a"] * 12), now_s=1.0, anchor=anchor, at_s=0.3)
        frames(face, 1.0, 1.1)
        dropped[anchor] = face.counters("anna").dropped
    assert dropped == {"at": 4, "now": 0}


def test_phones_wait_a_twentieth_of_a_second_for_the_rest_of_their_clause(monkeypatch):
    face, fed = engine(), []
    feed = face._batch.feed
    monkeypatch.setattr(face._batch, "feed", lambda *args, **named: fed.append(args) or feed(*args, **named))
    say(face, sentence(lead_s=2.0))
    counts = []
    for now_s in (0.0, 0.02, 0.04, 0.06):
        face.frame(now_s)
        counts.append(len(fed))
    assert counts == [0, 0, 0, 1]


def test_late_phones_of_two_utterances_in_one_frame_are_reported_to_each():
    face = engine()
    phones = sentence(["a"] * 12)
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, phones[:3]), 0.0)
    face.apply("anna", Begin(2, "at", 0.0), 0.0)
    frames(face, 0.0, 1.0)
    face.events()
    for number, part in ((1, phones[3:5]), (2, phones[3:4]), (1, phones[5:6])):
        face.apply("anna", Append(number, phones.index(part[0]), part), 1.0)
    face.frame(1.0)
    late = [(event.utterance, event.count) for event in face.events() if event.kind == "late"]
    assert late == [(1, 3), (2, 1)]


@pytest.mark.parametrize("seed", range(12))
def test_whatever_a_revision_takes_gaps_lie_between_phones(seed):
    chance, told = np.random.default_rng(seed), Utterance(1, StreamClock(0.0))
    for revision in range(1, 6):
        for index in chance.choice(12, 5, replace=False).tolist():
            start_s = chance.uniform(0.0, 1.0)  # indices say the order, whatever times say
            told.add(Append(1, index, (Phone("a", start_s, start_s + 0.1),)))
        if seed % 2 and (gap := told.gap()):
            told.bridge(gap[2])
        told.revise(Begin(1, revision=revision), chance.uniform(0.2, 0.9))
        assert told.known[:1] + told.known[-1:] == told.order[:1] + told.order[-1:]
        missing = sorted(set(range(told.order[0], told.size) if told.order else ()) - set(told.known))
        found = told.gap()
        assert (found is None) == (not missing)
        if found is not None:
            before, after, between = found
            assert missing[0] in between
            assert (before, after) == (told.phones[between.start - 1], told.phones[between.stop])
    while (gap := told.gap()) is not None:
        told.bridge(gap[2])
    assert told.known == sorted(set(told.known))


def test_a_concealed_gap_is_not_concealed_again_after_a_revision():
    face = engine()
    phones = sentence(["a"] * 12)
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, phones[:2]), 0.0)
    face.apply("anna", Append(1, 4, phones[4:8]), 0.0)  # 2 and 3 never come
    frames(face, 0.0, 1.0)
    assert face.counters("anna").concealed == 2
    face.apply("anna", Append(1, 7, phones[7:], revision=1), 1.0)
    face.apply("anna", End(1, 12, 1.6, revision=1), 1.0)
    frames(face, 1.0, 2.0)
    counters = face.counters("anna")
    assert (counters.concealed, counters.lost, kinds(face).count("concealed")) == (2, 0, 1)


def test_a_jump_leaves_what_is_queued_and_moves_only_what_follows():
    face = engine(Style(blinks=False, head_motion=False, gaze=False, idle=False))
    say(face, sentence(["a"] * 12))
    say(face, sentence(["o"] * 4), number=2)
    say(face, sentence(["i"] * 4), number=3, anchor="audio")
    frames(face, 0.0, 0.5)
    assert face.utterance("anna", 2).zero_s == pytest.approx(1.8)
    face.apply("anna", Audio(1, 0.5, 0.9), 0.5)
    assert face.utterance("anna", 1).position_s(0.5) == pytest.approx(0.9)
    assert face.utterance("anna", 2).zero_s == pytest.approx(1.4)  # behind the first, which is over 0.4 s sooner
    assert not face.utterance("anna", 3).state.is_placed
    frames(face, 0.5, 1.5)
    assert [(event.utterance, event.kind) for event in face.events()] == [
        (1, "started"),
        (1, "finished"),
        (2, "started"),
    ]
    assert face.faults() == []


def test_a_jump_of_one_sound_lets_another_that_overlaps_go_on():
    face, alone = engine(), engine()
    for each in (face, alone):
        say(each, sentence(["a", "m"] * 6))
    say(face, (Phone("_", 0.0, 3.0),), number=2, anchor="audio")
    for each in (face, alone):
        frames(each, 0.0, 0.5)
    face.apply("anna", Audio(2, 0.5, 0.0), 0.5)
    face.frame(0.5)
    alone.frame(0.5)
    face.apply("anna", Audio(2, 0.52, 1.0), 0.52)
    assert face.counters("anna").jumps == 1
    assert face.utterance("anna", 1).position_s(0.52) == pytest.approx(0.52)
    seen, expected = frames(face, 0.52, 1.3), frames(alone, 0.52, 1.3)
    assert np.abs(seen[15:] - expected[15:]).max() <= 1  # the same after the fade
    assert face.faults() == []


def test_stressed_phones_nod_once_though_their_sound_jumps():
    nods = []
    for jump in (False, True):
        face = engine(Style(blinks=False, head_motion=False, gaze=False, idle=False))
        heard = []
        original = face._gestures.hear
        face._gestures.hear = lambda row, phones, now_s, o=original, h=heard: (
            h.append(len(phones)),
            o(row, phones, now_s),
        )
        say(face, (Phone("a", 0.5, 0.7, 1), Phone("n", 0.7, 0.9)), anchor="audio")
        face.apply("anna", Audio(1, 0.0, 0.0), 0.0)
        before = sum(heard)
        if jump:
            face.apply("anna", Audio(1, 0.0, 0.2), 0.0)
        nods.append(sum(heard) - before)
    assert nods == [0, 2]  # each phone is given to the gestures once more, not twice


@pytest.mark.parametrize(("opened_s", "silence_s", "due_s"), [(0.0, 0.5, [2.3]), (50.0, 2.8, [2.3, 2.8])])
def test_an_utterance_without_an_end_is_looked_at_only_when_something_is_due(opened_s, silence_s, due_s, monkeypatch):
    face = Engine(english(), rng=np.random.default_rng(1), style=STILL, limits=Limits(silence_s=silence_s))
    face.open("anna", opened_s)
    face.apply("anna", Begin(1), opened_s)
    face.apply("anna", Append(1, 0, sentence(["a"] * 20)), opened_s)
    looks = []
    advance = type(face._rows[0]).advance
    monkeypatch.setattr(
        type(face._rows[0]), "advance", lambda self, now_s: (looks.append(now_s - opened_s), advance(self, now_s))
    )
    for n in range(160):
        face.frame(opened_s + n / RATE_HZ)
    assert kinds(face) == ["started", "underrun", "finished"]
    assert [round(look_s, 1) for look_s in looks if look_s > 0.1] == due_s


def test_an_utterance_that_waits_for_its_sound_is_looked_at_when_it_has_waited_long_enough(monkeypatch):
    face = engine(wait_s=1.5)
    say(face, sentence(), anchor="audio")
    looks = []
    advance = type(face._rows[0]).advance
    monkeypatch.setattr(type(face._rows[0]), "advance", lambda self, now_s: (looks.append(now_s), advance(self, now_s)))
    for n in range(160):
        face.frame(n / RATE_HZ)
    assert [look_s for look_s in looks if look_s > 0.1] == [pytest.approx(1.5, abs=1.5 / RATE_HZ)]


@pytest.mark.parametrize("count", [1, 4, 9])
def test_revised_speech_runs_dry_when_what_is_left_of_it_is_over(count):
    face = engine()
    for revision, phones in enumerate((sentence(), sentence(["o"] * count))):
        face.apply("anna", Begin(1), 0.0)
        face.apply("anna", Append(1, 0, phones, revision), 0.0)
    told = [n / RATE_HZ for n in range(100) if face.frame(n / RATE_HZ) is not None and "underrun" in kinds(face)]
    assert told == [pytest.approx(0.3 + 0.1 * count, abs=1.5 / RATE_HZ)]


@pytest.mark.parametrize("count", [3, 12])
def test_a_face_does_the_same_whenever_it_is_told(count):
    """What is told at a time, and taken back or stopped at a later one; a cancel may be told before its time."""

    def shown(offset_s, told_before):
        face = engine()
        frames(face, 0.0, offset_s)
        say(face, sentence(), now_s=offset_s)
        seen = [frames(face, offset_s, offset_s + 0.5)]
        face.apply("anna", Append(1, 0, sentence(["o"] * count), revision=1), offset_s + 0.5)
        if told_before:
            face.apply("anna", Cancel(at_s=offset_s + 0.8), offset_s + 0.5)
        seen += [frames(face, offset_s + 0.5, offset_s + 0.8)]
        if not told_before:
            face.apply("anna", Cancel(), offset_s + 0.8)
        return np.concatenate([*seen, frames(face, offset_s + 0.8, offset_s + 1.6)])

    first = shown(0.0, told_before=False)
    assert first.any()
    assert not first[-1].any()
    for offset_s, told_before in ((0.0, True), (2.0, False), (6.0, True)):
        assert np.abs(shown(offset_s, told_before) - first).max() <= 1, (offset_s, told_before)


def test_neutral_ends_every_expression():
    face = engine()
    for expression in (Expression.JOY, Expression.ANGER, Expression.SURPRISE):
        face.apply("anna", Express(expression, 0.8), 0.0)
    assert frames(face, 0.0, 1.0)[-1].any()
    for command in without_neutral(Express(Expression.NEUTRAL, 0.7)):
        face.apply("anna", command, 1.0)
    assert not frames(face, 1.0, 2.0)[-1].any()


@pytest.mark.parametrize("state", list(UtteranceState))
def test_every_transition_is_in_the_table_and_nothing_leaves_over(state):
    for step in Step:
        utterance = Utterance(1, StreamClock(0.0), state)
        if step in TRANSITIONS[state]:
            utterance.step(step)
            assert utterance.state is TRANSITIONS[state][step]
        else:
            with pytest.raises(RuntimeError, match=f"cannot {step.value} while {state.value}"):
                utterance.step(step)
    assert (Step.CLOSE in TRANSITIONS[state]) == (state is not UtteranceState.OVER)


def test_limits_themselves_are_allowed():
    face = engine(phones=4, queued_s=10.0)
    face.apply("anna", Begin(1, "at", 10.0), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a"] * 4)), 0.0)
    assert face.counters("anna").refused == 0
    assert len(face.utterance("anna", 1).phones) == 4
    face.apply("anna", Append(1, 1, sentence(["a"] * 4)), 0.0)
    assert face.counters("anna").refused == 1


def test_an_utterance_of_no_stated_duration_ends_with_its_last_phone():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a", "m"])), 0.0)
    face.apply("anna", End(1, 2, 0.0), 0.0)
    assert face.utterance("anna", 1).end_s == pytest.approx(0.5)
    frames(face, 0.0, 0.6)
    assert kinds(face) == ["started", "finished"]


def test_a_phone_that_replaces_the_last_planned_one_is_planned_at_once():
    face = engine()
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, sentence(["a"] * 8, lead_s=1.0)), 0.0)
    frames(face, 0.0, 1.2)
    face.apply("anna", Append(1, 7, (Phone("m", 1.7, 1.8),), revision=1), 1.2)
    face.frame(1.2)
    assert face._batch.planned(face._rows[0].number)[-1].label == "m"


def test_a_machine_without_room_opens_no_further_face():
    face = engine()
    face.room = 0
    with pytest.raises(UsageError, match="one more than this machine can show in time"):
        face.open("ben", 0.0)
    face.room = 1
    face.open("ben", 0.0)
    assert face.room == 0


def test_only_jaw_and_lips_start_the_limit_of_speed_and_the_whole_mouth_obeys_it():
    face = engine()
    face.frame(0.0)
    now_s, most = 0.01, 450.0
    wanted = np.zeros((1, 68), np.int32)
    lids, tongue, lips = [fap.column(19), fap.column(20)], fap.column(43), fap.column(18)
    wanted[0, [*lids, tongue]] = 1000
    shown = wanted.copy()
    face._slow_down(shown, now_s)
    assert (shown == wanted).all()  # lids and tongue may be fast
    wanted[0, lips] = 900
    shown = wanted.copy()
    face._slow_down(shown, now_s)
    assert shown[0, lips] == most
    assert shown[0, tongue] == 1000 * most / 900
    assert (shown[0, lids] == 1000).all()


def test_sixty_four_utterances_that_are_over_are_known_and_no_more():
    face = engine()
    for number in range(1, 66):
        say(face, sentence(["a"]), number=number, now_s=number * 1.0)
        frames(face, number * 1.0, number + 1.0)
    face.events()
    for number in (2, 1):
        face.apply("anna", Begin(number), 66.0)
    assert face.counters("anna").ignored == 1
    assert face.utterance("anna", 1) is not None
    assert face.utterance("anna", 2) is None


def test_an_announcement_that_comes_twice_changes_nothing():
    seen = {}
    for is_repeated in (False, True):
        face = engine(Style())
        say(face, sentence())
        first = frames(face, 0.0, 0.6)
        if is_repeated:
            face.apply("anna", Begin(1), 0.6)
        seen[is_repeated] = np.concatenate([first, frames(face, 0.6, 3.0)])
    np.testing.assert_array_equal(seen[True], seen[False])


def test_a_revision_asks_for_nothing_that_was_shown_already():
    face, fed = engine(), []
    say(face, sentence(["a"] * 12))
    frames(face, 0.0, 0.7)
    feed = face._batch.feed
    face._batch.feed = lambda number, phones, *rest, **named: fed.extend(phones) or feed(number, phones, *rest, **named)
    face.apply("anna", Append(1, 4, (Phone("m", 0.7, 0.8),), revision=1), 0.7)
    frames(face, 0.7, 0.9)
    assert fed
    assert min(phone.start_s for phone in fed) >= 0.69
