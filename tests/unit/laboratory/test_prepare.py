"""Head, axes, neutral pose and gaps: what was recorded comes back as what the face did."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.capture.marker_track import MarkerTrack, Session
from fapengine.errors import DataError
from fapengine.laboratory.prepare import prepare
from fapengine.laboratory.setup import Moment, Setup

from .conftest import SKULL, edited

HEAD = Setup(head=tuple(SKULL))


def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize(("head", "room"), [(False, False), (True, False), (False, True), (True, True)])
def test_no_rigid_motion_of_head_or_room_reaches_the_model(make, face_mm, head, room):
    made = make(head=head, room=room)
    found = prepare(made.session, HEAD, face_mm, rng=rng())
    for take, truth in zip(found.takes, made.truth_mm, strict=True):
        np.testing.assert_allclose(take.moved_mm, truth, atol=1e-6)
    assert found.warnings == ()
    assert found.gaps is None
    assert found.scale == pytest.approx(1.0)


def test_the_heads_motion_is_kept_and_puts_the_face_back(make, face_mm):
    made = make(2)
    found = prepare(made.session, HEAD, face_mm, rng=rng())
    for take, truth, recorded in zip(found.takes, made.truth_mm, made.session.takes, strict=True):
        again = take.head.apply(found.neutral_mm + take.moved_mm)
        room = recorded.markers.positions_mm[:, : truth.shape[1]]
        distance = np.linalg.norm(again - again[0], axis=-1)  # what a rigid change of axes leaves
        np.testing.assert_allclose(distance, np.linalg.norm(room - room[0], axis=-1), atol=1e-6)


def test_marker_and_take_order_do_not_matter(make, face_mm):
    made = make(4)
    order = np.random.default_rng(1).permutation(len(made.session.labels))
    names = [made.session.labels[index] for index in order]
    shuffled = Session("S01", tuple(replace(t, markers=t.markers.select(names)) for t in made.session.takes[::-1]))
    one, other = (prepare(session, HEAD, face_mm, rng=rng()) for session in (made.session, shuffled))
    for take, back in zip(one.takes, other.takes[::-1], strict=True):
        columns = [other.labels.index(name) for name in one.labels]
        np.testing.assert_allclose(take.moved_mm, back.moved_mm[:, columns], atol=1e-6)


def hide(session, share, seed=5, columns=slice(None)):
    chance = np.random.default_rng(seed)

    def gaps(take):
        positions = take.markers.positions_mm.copy()
        hidden = np.repeat(chance.random((len(positions) // 5 + 1, positions.shape[1])) < share, 5, axis=0)
        hidden = hidden[: len(positions)]
        hidden[:, [i for i in range(hidden.shape[1]) if i not in range(hidden.shape[1])[columns]]] = False
        positions[hidden] = np.nan
        return replace(take.markers, positions_mm=positions)

    return edited(session, gaps)


def test_gaps_in_motion_of_low_rank_come_back(make, face_mm):
    made = make()
    found = prepare(hide(made.session, 0.08, columns=slice(0, 22)), HEAD, face_mm, rng=rng())
    assert found.gaps is not None
    assert 0.85 < found.gaps.seen.mean() < 0.97
    error = np.concatenate([a.moved_mm - b for a, b in zip(found.takes, made.truth_mm, strict=True)])
    assert np.abs(error).max() < 0.05  # a tenth of the best capture's noise; the motion has eight dimensions


def test_a_head_that_is_hidden_for_a_while_hides_the_face(make, face_mm):
    made = make(3)

    def gap(take):
        positions = take.markers.positions_mm.copy()
        positions[40:50, -3:] = np.nan
        return replace(take.markers, positions_mm=positions)

    found = prepare(edited(made.session, gap), HEAD, face_mm, rng=rng())
    assert "take take0: head unknown in 10 of" in found.warnings[0]
    assert np.isfinite(np.concatenate([take.moved_mm for take in found.takes])).all()
    np.testing.assert_allclose(found.takes[0].moved_mm[:40], made.truth_mm[0][:40], atol=1e-6)


def test_a_band_that_slips_is_told_and_distrusted(make, face_mm):
    made = make(3)

    def slip(take):
        positions = take.markers.positions_mm.copy()
        if take.name == "take1":
            positions[:, -1] += [6.0, 0.0, 0.0]
        return replace(take.markers, positions_mm=positions)

    found = prepare(edited(made.session, slip), HEAD, face_mm, rng=rng())
    assert any("take1: head marker TOP slips, and gets less weight" in text for text in found.warnings)
    assert np.abs(found.takes[1].moved_mm - made.truth_mm[1]).max() < 0.6


def test_without_skull_markers_a_turning_face_is_told(make, face_mm):
    still = prepare(make(2, skull=False, head=False).session, Setup(), face_mm, rng=rng())
    assert not any("turns sideways" in text for text in still.warnings)
    found = prepare(make(2, skull=False).session, Setup(), face_mm, rng=rng())
    assert any("turns sideways" in text and "head = [...]" in text for text in found.warnings)


def mirrored(take):
    return replace(take.markers, positions_mm=take.markers.positions_mm * [-1.0, 1.0, 1.0])


def single(take):
    return replace(take.markers, positions_mm=take.markers.positions_mm[:1])


def never(label):
    def change(take):
        positions = take.markers.positions_mm.copy()
        positions[:, take.markers.labels.index(label)] = np.nan
        return replace(take.markers, positions_mm=positions)

    return change


def renamed(take):
    names = tuple(f"m{index}" if name not in SKULL else name for index, name in enumerate(take.markers.labels))
    return replace(take.markers, labels=names)


def headless(take):
    positions = take.markers.positions_mm.copy()
    positions[::2, -3:] = np.nan
    positions[1::2, -5:-3] = np.nan
    return replace(take.markers, positions_mm=positions)


@pytest.mark.parametrize(
    ("change", "setup", "message"),
    [
        (mirrored, HEAD, "left and right are exchanged"),
        (single, HEAD, "needs at least 50 frames in all, got 2"),
        (never("8.3"), HEAD, "'8.3': no frame shows it"),
        (renamed, HEAD, "0 among the markers"),
        (headless, HEAD, "no frame shows all of LFHD"),
        (None, replace(HEAD, head=("LFHD", "NOPE", "TOP")), "'NOPE': unknown marker"),
        (None, replace(HEAD, head=("LFHD", "TOP")), "needs at least 3"),
        (None, replace(HEAD, points={"XX": "8.1"}), "'XX': unknown marker"),
        (None, replace(HEAD, points={"8.2": "8.1"}), "two markers have this name"),
        (None, replace(HEAD, neutral=Moment("rest", 0.0, 1.0)), "'rest': unknown take"),
        (None, replace(HEAD, neutral=Moment("take0", 0.5, 99.0)), "must be within its"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(make, face_mm, change, setup, message):
    session = make(2).session
    with pytest.raises(DataError, match=message) as caught:
        prepare(edited(session, change) if change else session, setup, face_mm, rng=rng())
    assert caught.value.where


def test_a_neutral_pose_is_needed(make, face_mm):
    session = make(2).session
    mute = replace(session, takes=tuple(replace(take, phones=()) for take in session.takes))
    with pytest.raises(DataError, match="the phone timings have no silence, and"):
        prepare(mute, HEAD, face_mm, rng=rng())
    named = prepare(mute, replace(HEAD, neutral=Moment("take0", 0.0, 0.3)), face_mm, rng=rng())
    assert np.abs(named.takes[0].moved_mm[:10]).max() < 1e-6
    shy = Session(
        "S01",
        tuple(replace(t, markers=replace(t.markers, positions_mm=hide_early(t.markers))) for t in session.takes),
    )
    with pytest.raises(DataError, match=r"no frame shows 8\.1"):
        prepare(shy, replace(HEAD, neutral=Moment("take0", 0.0, 0.3)), face_mm, rng=rng())


def hide_early(track: MarkerTrack) -> np.ndarray:
    positions = track.positions_mm.copy()
    positions[:30, 0] = np.nan
    return positions


def test_an_unnamed_marker_that_is_never_seen_is_left_out(make, face_mm):
    made = make(2)

    def extra(take):
        ghost = np.full((take.markers.frame_count, 1, 3), np.nan)
        positions = np.concatenate([take.markers.positions_mm, ghost], axis=1)
        return replace(take.markers, positions_mm=positions, labels=(*take.markers.labels, "ghost"))

    found = prepare(edited(made.session, extra), HEAD, face_mm, rng=rng())
    assert found.warnings == ("marker ghost: no frame shows it, left out",)
    assert "ghost" not in found.labels
