"""The whole chain on a session whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import DataError, UsageError
from fapengine.expressions import Expression
from fapengine.geometry.surface import Surface
from fapengine.laboratory import selection, space
from fapengine.laboratory.fit import STEPS, FitOptions, fit_session
from fapengine.laboratory.phones import TONGUE_ON_JAW
from fapengine.laboratory.prepare import prepare
from fapengine.laboratory.setup import HeldPhone, Moment, Pose, Scan, Setup
from fapengine.laboratory.space import captured_faps, contacts, count_closures
from fapengine.models.viseme_space import MARKERS
from fapengine.mpeg4 import fap
from fapengine.profiles import format_profile, parse_profile
from fapengine.speech.articulation import ARTICULATIONS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style

from .conftest import INNER_LIPS, SKULL, edited

HEAD = Setup(head=tuple(SKULL), language="en-GB", licence="none")
ORIGIN = {"source": "a test", "command": "pytest"}


@pytest.fixture(scope="module")
def run(standard, face, face_mm):
    def fit(session, setup=HEAD, options=None, **named):
        rng = np.random.default_rng(2)
        return fit_session(
            prepare(session, setup, face_mm, rng=rng), setup, profile_id="tried", origin=ORIGIN, standard=standard,
            face_fapu=face.fapu, options=options or FitOptions(), rng=rng, **named,
        )  # fmt: skip

    return fit


@pytest.fixture(scope="module")
def fitted(make, run):
    steps: list[str] = []
    made = make(14, noise_mm=0.1)
    found = run(made.session, on_step=steps.append)
    assert tuple(steps) == STEPS[1:]
    return found, made


def test_the_profile_moves_the_lips_as_the_true_one_does(fitted):
    found, made = fitted
    assert len(found.held_out) == 3
    markers = made.profile.space.points[:14]
    for name, study in found.phones.items():
        truth = made.profile.space.to_points_mm(made.profile.phones[name].targets[0])[:14]
        columns = [found.space.space.points.index(point) for point in markers]
        learned = found.space.space.to_points_mm(study.target.targets[0])[columns]
        assert np.linalg.norm(learned - truth, axis=1).mean() < 1.0, name
    assert found.phones["p"].target.contact == "lips"
    assert found.phones["v"].target.contact == "teeth"
    assert found.phones["aɪ"].target.fractions == (0.3, 0.8)
    assert found.phones["p"].target.origin.endswith("of p b m")


def test_it_is_a_profile_like_any_other(fitted):
    found, _ = fitted
    back = parse_profile(format_profile(found.profile))
    assert back.id == "tried"
    assert back.origin["takes"].startswith("14 takes")
    assert "modes carry" in back.origin["variance"]
    assert set(back.expressions) == set(found.borrowed)
    assert any("borrowed from profile 'grid_s1_en'" in text for text in found.warnings)


def test_the_errors_are_those_of_takes_that_were_held_out(fitted):
    found, _ = fitted
    assert found.prediction is not None
    assert found.prediction.whole.lips_mm.value < 0.5 * found.prediction.whole.mean_pose_mm.value
    assert found.prediction.whole.opening_r.value > 0.88  # lips of made takes do not prepare before they speak
    kept = found.space.space.mode_count
    assert 0.1 < found.space.error_mm[kept - 1] < 0.35  # 0.1 mm of noise in three coordinates, and the last modes
    assert (np.diff(found.space.error_mm) < 0).all()
    assert found.space.error_from_mean_mm[kept - 1] <= found.space.error_mm[kept - 1] + 0.005
    assert found.space.dimensions == 42  # noise fills them


def test_the_subset_beats_luck(fitted):
    found, _ = fitted
    study = found.selection
    assert study is not None
    plain, centred, swapped, full, mean, best = study.held_out_mm.values()
    assert centred < mean
    assert swapped <= plain * 1.02
    assert full < swapped < best < mean
    assert study.reason.startswith("the first whose error")
    assert study.curve.mean_mm[study.k - 1] <= 0.35 < study.curve.mean_mm[study.k - 2]


def test_captured_takes_play_back_as_faps(fitted):
    found, made = fitted
    take, truth = found.prepared.takes[0], made.truth_mm[0]
    track = captured_faps(take, found.prepared, found.profile)
    assert len(track) == len(truth)
    unit = found.profile.fapu.unit(fap.FapUnit.MNS)
    jaw = track.values[:, fap.column(3)] * unit
    down = -truth[:, list(found.prepared.points).index("2.1"), 1]
    assert np.abs(jaw - np.maximum(down, 0)).max() < 0.8
    yaw = track.values[:, fap.column(49)]
    assert np.ptp(yaw) * 1e-5 > 0.1  # the head was turned by 0.2 rad to and fro


def test_a_single_token_has_no_error_to_tell(make, run):
    session = make(6).session
    first = session.takes[0]
    at = next(index for index, phone in enumerate(first.phones) if phone.label in ("s", "f"))
    odd = (*first.phones[:at], replace(first.phones[at], label="ʒ"), *first.phones[at + 1 :])
    found = run(replace(session, takes=(replace(first, phones=odd), *session.takes[1:])))
    study = found.phones["ʒ"]
    assert study.tokens == 1
    assert study.like or (study.rare and np.isnan(study.error).all())
    assert any("ʒ (" in text and "too rare alone" in text for text in found.warnings)


def test_of_very_many_markers_some_are_studied(make, face_mm, monkeypatch):
    monkeypatch.setattr(selection, "MAX_MARKERS", 60)
    made = make(2, head=False, room=False)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(5), 60)
    labels = (*made.session.labels, *(f"v{n}" for n in range(60)))

    def dense(take):
        places = take.markers.positions_mm
        return replace(
            take.markers, positions_mm=np.concatenate([places, weights @ places[:, :5]], axis=1), labels=labels
        )

    prepared = prepare(edited(made.session, dense), HEAD, face_mm, rng=rng)
    study = selection.study_selection(prepared, prepared.takes, (), k=4, tolerance_mm=0.3, rng=rng)
    assert len(study.prepared.labels) == 60
    assert set(MARKERS) <= set(study.prepared.points)
    assert study.factor.r.shape == (60, 60)
    full = prepared.neutral_mm[[prepared.labels.index(name) for name in study.prepared.labels]]
    np.testing.assert_array_equal(full, study.prepared.neutral_mm)


def test_a_label_of_two_markers_cannot_be_named(make, run):
    session = make(6).session
    labels = tuple("LFHD#2" if name == "RFHD" else name for name in session.labels)
    with pytest.raises(DataError, match="'LFHD': is the label of two markers"):
        run(
            edited(session, lambda take: replace(take.markers, labels=labels)),
            replace(HEAD, head=("LFHD", "LBHD", "TOP")),
        )


def test_poses_are_measured_and_the_others_borrowed(make, run, standard):
    made = make(6)
    joy = standard.space.to_points_mm(standard.expressions[Expression.JOY].target)
    columns = [standard.space.points.index(name) for name in made.session.labels if name not in SKULL]

    def smile(take):
        positions = take.markers.positions_mm.copy()
        if take.name == "take2":
            plain = make(6, head=False, room=False).session.takes[2].markers.positions_mm[:1, : len(columns)]
            positions[:, : len(columns)] = plain + joy[columns]
            positions[:, len(columns) :] = np.array([*SKULL.values()], float)
        return replace(take.markers, positions_mm=positions)

    session = edited(make(6, head=False, room=False).session, smile)
    mute = tuple(replace(take, phones=() if take.name == "take2" else take.phones) for take in session.takes)
    setup = replace(HEAD, poses=(Pose(Expression.JOY, Moment("take2", 0.5, 1.0)),))
    found = run(replace(session, takes=mute), setup)
    assert Expression.JOY not in found.borrowed
    points = found.space.space.to_points_mm(found.profile.expressions[Expression.JOY].target)
    corner = found.space.space.points.index("8.3")
    np.testing.assert_allclose(points[corner], joy[standard.space.points.index("8.3")], atol=0.8)


def test_a_held_mouth_stands_for_a_phone_that_is_hardly_said(make, run, standard):
    rounded = standard.space.to_points_mm(standard.phones["u"].targets[0])
    made = make(6, head=False, room=False)
    columns = [standard.space.points.index(name) for name in made.session.labels if name not in SKULL]

    def hold(take):
        positions = take.markers.positions_mm.copy()
        if take.name == "take2":
            positions[:, : len(columns)] = (
                made.session.takes[2].markers.positions_mm[:1, : len(columns)] + rounded[columns]
            )
            positions[:, len(columns) :] = np.array([*SKULL.values()], float)
        return replace(take.markers, positions_mm=positions)

    session = edited(made.session, hold)
    mute = tuple(replace(take, phones=() if take.name == "take2" else take.phones) for take in session.takes)
    held = tuple(HeldPhone(name, Moment("take2", 0.5, 1.0)) for name in ("y", "ə"))
    found = run(replace(session, takes=mute), replace(HEAD, held_phones=held))
    assert found.phones["y"].target.origin.startswith("held pose")
    moved = found.space.space.to_points_mm(found.phones["y"].target.targets[0])
    corner = found.space.space.points.index("8.3")
    np.testing.assert_allclose(moved[corner], rounded[standard.space.points.index("8.3")], atol=0.8)
    assert found.phones["ə"].tokens < 8 or not found.phones["ə"].target.origin.startswith("held pose")


def test_scans_become_a_dense_face(make, run, face, face_mm, standard):
    made = make(6, head=False, room=False)
    skin = face.vertices_mm.astype(float)
    near = np.linalg.norm(skin[:, None, :2] - [0.0, -35.0], axis=-1)[:, 0] < 60
    front = near & (skin[:, 2] > 30)
    triangles = face.triangles[front[face.triangles].all(axis=1)]
    used, triangles = np.unique(triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    names = standard.space.points[:14]
    places = np.stack([face_mm[name] for name in names])
    scans = []
    for phone in ("p", "æ", "u", "s"):
        moved = standard.space.to_points_mm(standard.phones[phone].targets[0])[:14]
        weight = np.exp(-(np.linalg.norm(skin[used][:, None] - places[None], axis=-1) ** 2) / 400)
        vertices = skin[used] + weight @ moved / np.maximum(weight.sum(axis=1), 1.0)[:, None]
        marks = {name: tuple(place + shift) for name, place, shift in zip(names, places, moved, strict=True)}
        scans.append(Scan(phone, Surface(vertices, triangles), marks))
    found = run(made.session, replace(HEAD, scans=tuple(scans)))
    assert found.dense is not None
    assert [name for name, *_ in found.dense.fits] == ["p", "æ", "u", "s"]
    assert all(fit.landmark_rms_mm < 2.0 for _, fit, _ in found.dense.fits)
    assert found.dense.face.modes.modes_mm.shape[1] == len(used)
    assert not found.dense.warnings
    wide = [
        replace(
            scan,
            surface=Surface(scan.surface.vertices_mm * [1.4, 0.8, 1.2], triangles),
            landmarks={name: tuple(np.multiply(place, [1.4, 0.8, 1.2])) for name, place in scan.landmarks.items()},
        )
        for scan in scans
    ]
    with_another = run(made.session, replace(HEAD, scans=tuple(wide)))
    assert "are scans and markers of the same person?" in with_another.warnings[-1]
    for change, message in (
        (scans[:2], "needs at least 3 postures"),
        (
            [replace(scans[0], landmarks={"9.99": (0, 0, 0)}), *scans[1:]],
            "is neither a marker nor a recorded feature point",
        ),
        ([replace(scans[0], landmarks={}), *scans[1:]], "landmarks: needs at least .*, got 0"),
    ):
        with pytest.raises(DataError, match=message):
            run(made.session, replace(HEAD, scans=tuple(change)))


def test_fewer_points_are_stood_in_for_and_told(make, run):
    made = make(6)
    outer = [name for name in made.session.labels if not name.startswith("2.") or name in ("2.1", "2.10")]
    session = edited(made.session, lambda take: take.markers.select(outer))
    found = run(session)
    assert found.space.inferred == INNER_LIPS
    assert any("they move as in 'grid_s1_en'. Of" in text for text in found.warnings)
    learned = found.space.space  # the takes move as that profile does
    columns = [[*MARKERS, *INNER_LIPS].index(point) for point in learned.points]
    for truth in made.truth_mm:
        moved = learned.to_points_mm(learned.to_space(truth[:, columns[: learned.marker_count]]))
        assert np.abs(moved - truth[:, columns])[:, learned.marker_count :].mean() < 0.1
    few = [name for name in outer if name not in ("8.4", "5.1", "5.2", "5.3", "5.4")]
    found = run(edited(made.session, lambda take: take.markers.select(few)))
    assert not found.space.inferred
    assert any("2.6 was not recorded: it follows 8.5" in text for text in found.warnings)
    modes = dict(zip(found.space.space.points, np.moveaxis(found.space.space.modes_mm, 1, 0), strict=True))
    np.testing.assert_array_equal(modes["2.2"], modes["8.1"])
    np.testing.assert_array_equal(modes["8.4"], modes["8.3"] * [-1, 1, 1])
    np.testing.assert_array_equal(modes["2.5"], modes["2.4"] * [-1, 1, 1])
    lips = [name for name in outer if name[:2] in ("8.", "5.") or name in SKULL]
    with pytest.raises(DataError, match=r"2\.1: was not recorded, nor was 2\.10"):
        run(edited(made.session, lambda take: take.markers.select(lips)))


def test_captured_lips_close_where_the_outer_lips_are_nearest(make, run, monkeypatch):
    made = make(6, head=False, room=False)
    outer = [name for name in made.session.labels if not name.startswith("2.") or name in ("2.1", "2.10")]

    def thick(take):
        """Lips that are 4 mm thicker while they speak: the distance of the outer lips is no opening."""
        track = take.markers.select(outer)
        positions = track.positions_mm.copy()
        positions[25:-25, outer.index("8.2"), 1] -= 4
        return replace(track, positions_mm=positions)

    found = run(edited(made.session, thick))
    wanted, met = count_closures(found.prepared, found.profile)
    assert wanted > 10
    assert met >= 0.8 * wanted
    with monkeypatch.context() as patch:
        patch.setattr(space, "contacts", lambda take, prepared: [])
        assert count_closures(found.prepared, found.profile)[1] < 0.6 * met
    take = found.prepared.takes[0]
    silent = replace(take, phones=tuple(replace(phone, label="a") for phone in take.phones))
    assert contacts(take, found.prepared)
    assert not contacts(silent, found.prepared)
    with_contacts, without = (captured_faps(each, found.prepared, found.profile).values for each in (take, silent))
    changed = (with_contacts != without).any(axis=1)
    assert 0 < changed.mean() < 0.6  # the rest is as it was captured
    assert not (with_contacts != without)[:, fap.column(19) : fap.column(50)].any()


def test_the_tongue_of_phones_is_learned_beside_the_jaw(make, run, face_mm):
    made = make(6, head=False, room=False)
    raised_mm = {"t": (6.0, -1.0, 1.0), "u": (0.0, -3.0, 5.0)}
    truths = iter(made.truth_mm)

    def with_tongue(take):
        track, truth = take.markers, next(truths)
        times = np.arange(len(truth)) / track.rate_hz
        tongue = np.zeros((len(truth), 2, 3))
        for phone in take.phones:
            up, out, body = raised_mm.get(phone.label, (0.0, 0.0, 0.0))
            tongue[(times >= phone.start_s) & (times < phone.end_s)] = [[0, up, out], [0, body, 0]]
        chin = truth[:, list(MARKERS).index("2.1")]
        for index, (point, share) in enumerate(TONGUE_ON_JAW.items()):
            tongue[:, index] += face_mm[point] + share * chin
        return replace(track, positions_mm=np.concatenate([track.positions_mm, tongue], axis=1),
                       labels=(*track.labels, "TT", "TB"))  # fmt: skip

    setup = replace(HEAD, points={"TT": "6.1", "TB": "6.2"})
    found = run(edited(made.session, with_tongue), setup)
    learned = {name: phone.tongue_mm for name, phone in found.profile.phones.items()}
    for name in ("t", "u", "s"):
        np.testing.assert_allclose(learned[name], raised_mm.get(name, (0, 0, 0)), atol=0.3, err_msg=name)
    assert learned["aɪ"] is None  # the table's, letter by letter
    back = parse_profile(format_profile(found.profile))
    assert back.phones["t"].tongue_mm == learned["t"]
    take = found.prepared.takes[0]
    faps = captured_faps(take, found.prepared, back).values
    phone = next(phone for phone in take.phones if phone.label == "t")
    at = round((phone.start_s + phone.end_s) / 2 * found.prepared.rate_hz)
    unit_mm = back.fapu.unit(fap.spec(44).unit)
    assert faps[at, fap.column(44)] * unit_mm == pytest.approx(6.0, abs=0.3)
    without = replace(back, phones={**back.phones, "t": replace(back.phones["t"], tongue_mm=None)})
    said = PhoneTrack((Phone("t", 0.0, 0.3),))
    tips_mm = [
        plan(said, profile, rng=np.random.default_rng(0), style=Style.speech_only(), duration_s=0.3)
        .track.values[:, fap.column(44)]
        .max()
        * unit_mm
        for profile in (back, without)
    ]
    table_mm = ARTICULATIONS["t"].tip_up
    assert tips_mm[0] - tips_mm[1] == pytest.approx(learned["t"][0] - table_mm, abs=0.5)


def test_few_takes_flatter_and_say_so(make, run):
    found = run(make(3).session)
    assert found.held_out == ()
    assert found.prediction is None
    assert any("errors are those of the training data" in text for text in found.warnings)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"modes": 99}, DataError),
        ({"k": 40}, UsageError),
    ],
)
def test_choices_out_of_range_are_refused(make, run, options, error):
    with pytest.raises(error, match="must be 1 to"):
        run(make(6).session, options=FitOptions(**options))


@pytest.mark.parametrize("options", [{"variance": 1.0}, {"held_out": 0.6}])
def test_shares_out_of_range_are_refused(options):
    with pytest.raises(UsageError, match=next(iter(options))):
        FitOptions(**options)


def test_units_of_the_face_can_be_given(make, run):
    found = run(make(6).session, replace(HEAD, fapu_mm={"es0": 64.0}))
    assert found.profile.fapu.es0_mm == 64.0
    assert any("FAPU irisd0, ens0, mns0: these markers do not show them" in text for text in found.warnings)
    with pytest.raises(DataError, match="'es1', expected irisd0"):
        run(make(6).session, replace(HEAD, fapu_mm={"es1": 64.0}))
    with pytest.raises(DataError, match="es0_mm"):
        run(make(6).session, replace(HEAD, fapu_mm={"es0": -1.0}))


def test_phones_are_needed_and_strange_ones_told(make, run):
    session = make(6).session
    mute = tuple(replace(take, phones=tuple(p for p in take.phones if p.label == "_")) for take in session.takes)
    with pytest.raises(DataError, match="missing in all takes"):
        run(replace(session, takes=mute))
    phones = session.takes[0].phones
    odd = replace(session.takes[0], phones=(*phones[:-1], replace(phones[-1], label="%")))
    found = run(replace(session, takes=(odd, *session.takes[1:])))
    assert any("phone '%' is not IPA" in text for text in found.warnings)
    twice = replace(session.takes[0], phones=(*phones[:-1], replace(phones[-2], label="t")))
    with pytest.raises(DataError, match="take take0"):
        run(replace(session, takes=tuple(twice if take.name == "take0" else take for take in session.takes)))
