"""The shipped profile, and what a profile may not be."""

import hashlib
import io
from dataclasses import replace

import numpy as np
import pytest

from fapengine._resources import profile_files, profile_ids
from fapengine.errors import ProfileError, UsageError
from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.profiles import TOML_NAME, Examples, Profile, format_profile, parse_profile

FILES = profile_files("grid_s1_en")


def edited(old: str, new: str, *, count: int = 1) -> dict[str, bytes]:
    text = FILES[TOML_NAME].decode()
    assert old in text
    return FILES | {TOML_NAME: text.replace(old, new, count).encode()}


@pytest.fixture(scope="module")
def profile() -> Profile:
    return parse_profile(FILES)


def test_every_shipped_profile_parses() -> None:
    assert len(profile_ids()) >= 1
    for name in profile_ids():
        assert parse_profile(profile_files(name)).id == name


def test_it_says_where_its_numbers_come_from(profile: Profile) -> None:
    assert "GRID" in profile.origin["source"]
    assert "Cooke" in profile.origin["attribution"]
    assert "design.fit_profile" in profile.origin["command"]


def test_modes_are_orthonormal_over_the_markers(profile: Profile) -> None:
    modes = profile.space.modes_mm[:, : profile.space.marker_count].reshape(profile.space.mode_count, -1)
    assert modes @ modes.T == pytest.approx(np.eye(profile.space.mode_count), abs=1e-5)


def opening_mm(profile: Profile, phone: str) -> float:
    points = profile.space.to_points_mm(profile.phones[phone].targets[0])
    upper, lower = (points[profile.space.points.index(name), 1] for name in ("2.2", "2.3"))
    return float(upper - lower)


def test_what_is_written_reads_back(profile: Profile) -> None:
    back = parse_profile(format_profile(profile))
    assert (back.id, back.language, back.licence, back.fapu) == (
        profile.id,
        profile.language,
        profile.licence,
        profile.fapu,
    )
    assert dict(back.origin) == dict(profile.origin)
    assert back.space.points == profile.space.points
    assert back.space.modes_mm == pytest.approx(profile.space.modes_mm, abs=1e-6)
    assert list(back.phones) == list(profile.phones)
    for name, phone in profile.phones.items():
        assert back.phones[name].targets == pytest.approx(phone.targets, abs=1e-3)
        assert (back.phones[name].fractions, back.phones[name].contact) == (phone.fractions, phone.contact)
    assert back.context is not None
    assert back.context.features == profile.context.features
    assert back.context.coefficients == pytest.approx(profile.context.coefficients, rel=1e-3, abs=1e-3)
    assert back.context.examples.letters == profile.context.examples.letters
    assert back.context.examples.lengths == pytest.approx(profile.context.examples.lengths, abs=1e-3)
    assert back.context.examples.adds == pytest.approx(profile.context.examples.adds, rel=1e-3, abs=1e-3)
    assert parse_profile(format_profile(replace(profile, context=None))).context is None
    alone = replace(profile, context=replace(profile.context, examples=Examples()))
    assert parse_profile(format_profile(alone)).context.examples.adds.shape == (
        0,
        *profile.context.coefficients.shape[1:],
    )
    for expression, face in profile.expressions.items():
        assert back.expressions[expression].fap == pytest.approx(face.fap, abs=0.051)
        assert back.expressions[expression].target == pytest.approx(face.target, abs=1e-3)


def test_odd_words_survive_and_a_birthplace_is_needed(profile: Profile) -> None:
    odd = 'say "aː" \\ and\n\x7f that'
    back = parse_profile(format_profile(replace(profile, origin={"source": odd, "command": "none"})))
    assert back.origin["source"] == odd
    with pytest.raises(UsageError, match="'command' among them"):
        format_profile(replace(profile, origin={"source": "here"}))


def test_phones_look_as_they_sound(profile: Profile) -> None:
    assert opening_mm(profile, "aɪ") > 2 * opening_mm(profile, "m")
    assert opening_mm(profile, "æ") > opening_mm(profile, "i")
    assert {name for name, phone in profile.phones.items() if phone.contact == "lips"} == {"p", "b", "m"}
    assert {name for name, phone in profile.phones.items() if phone.contact == "teeth"} == {"f", "v"}


def width_mm(profile: Profile, target: np.ndarray) -> float:
    points = profile.space.to_points_mm(target)
    left, right = (points[profile.space.points.index(name), 0] for name in ("8.3", "8.4"))
    return float(left - right)


def test_w_is_narrow_and_joy_is_wide(profile: Profile) -> None:
    assert width_mm(profile, profile.phones["w"].targets[0]) < width_mm(profile, profile.phones["i"].targets[0])
    assert width_mm(profile, profile.expressions[Expression.JOY].target) > 3


def test_expressions_do_what_the_standard_says(profile: Profile) -> None:
    def beyond(expression: Expression, name: str) -> float:
        return float(profile.expressions[expression].fap[fap.column(fap.by_name(name).number)])

    assert len(profile.expressions) == 6
    assert beyond(Expression.SURPRISE, "raise_l_m_eyebrow") > 50
    assert beyond(Expression.SURPRISE, "close_t_l_eyelid") < -100
    assert beyond(Expression.ANGER, "raise_l_i_eyebrow") < 0
    assert beyond(Expression.ANGER, "squeeze_l_eyebrow") > 0
    assert beyond(Expression.SADNESS, "raise_l_i_eyebrow") > 0
    assert beyond(Expression.SADNESS, "close_t_l_eyelid") > 0
    assert beyond(Expression.JOY, "lift_l_cheek") + beyond(Expression.JOY, "close_b_l_eyelid") > 0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema = 1", "schema = 2", "schema: got 2"),
        ("schema = 1", "", "'schema' is missing"),
        ("schema = 1", "schema = true", "got True, expected a whole number"),
        ("schema = 1", "schema = 1\nspeed = 3", "'speed' is unknown"),
        ('id = "grid_s1_en"', "id = 5", "got 5, expected a string"),
        ('source = "520', 'sauce = "520', "'source' is missing"),
        ('command = "python', "command = 3 #", "got 3, expected a string"),
        ("es0 = ", "es0 = -", "es0_mm"),
        ("es0 = ", "es1 = 5.0\nes0 = ", "'es1' is unknown"),
        ('sha256 = "', 'sha256 = "0', "sha256 of modes.npz"),
        ('file = "modes.npz"', 'file = "none.npz"', "'none.npz' is missing"),
        ("count = 8", "count = 9", r"expected \(9, 22, 3\)"),
        ("markers = 14", "markers = 99", "marker_count"),
        ('points = ["8.1"', 'points = ["1.1"', "expected feature points"),
        ('ipa = "p"', 'ipa = "pː"', "bare IPA"),
        ('ipa = "p"', 'ipa = "b"', "once"),
        ("fractions = [0.3]", "fractions = [1.3]", r"rising 0 to 1"),
        ("fractions = [0.3]", "fractions = []", r"rising 0 to 1"),
        ("fractions = [0.3]", 'fractions = ["x"]', "got 'x', expected a number"),
        ('contact = "lips"', 'contact = "nose"', "got 'nose', expected one of none, lips, teeth"),
        ("targets = [[", "targets = [[1.0, ", "targets: got shape"),
        ('name = "joy"', 'name = "glee"', "six expressions"),
        ("fap = { ", "fap = { open_jar = 3, ", "open_jar"),
        ("[fapu_mm]", "[fapu]", "'fapu_mm' is missing"),
        ("[[phone]]", "[phone", "is not TOML"),
    ],
)
def test_refuses(old: str, new: str, message: str) -> None:
    with pytest.raises(ProfileError, match=message) as caught:
        parse_profile(edited(old, new))
    assert caught.value.where.startswith(TOML_NAME)


def test_refuses_files_that_are_missing_or_damaged() -> None:
    with pytest.raises(ProfileError, match="among them"):
        parse_profile({})
    with pytest.raises(ProfileError, match="is not TOML"):
        parse_profile(FILES | {TOML_NAME: b"\xff"})
    for arrays in (b"no archive", b""):
        damaged = edited(hashlib.sha256(FILES["modes.npz"]).hexdigest(), hashlib.sha256(arrays).hexdigest())
        with pytest.raises(ProfileError, match="modes"):
            parse_profile(damaged | {"modes.npz": arrays})
    strange = bytearray(FILES["modes.npz"])  # of a way to pack that Python lacks
    for start in (strange.index(b"PK\x03\x04") + 8, strange.index(b"PK\x01\x02") + 10):
        strange[start] = 3
    damaged = edited(hashlib.sha256(FILES["modes.npz"]).hexdigest(), hashlib.sha256(strange).hexdigest())
    with pytest.raises(ProfileError, match="compression method"):
        parse_profile(damaged | {"modes.npz": bytes(strange)})
    buffer = io.BytesIO()
    np.savez(buffer, other=np.zeros(3))
    damaged = edited(hashlib.sha256(FILES["modes.npz"]).hexdigest(), hashlib.sha256(buffer.getvalue()).hexdigest())
    with pytest.raises(ProfileError, match="modes_mm"):
        parse_profile(damaged | {"modes.npz": buffer.getvalue()})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fractions = [0.2, 0.7]", "fractions = [0.7, 0.2]", "rising"),
        ("fractions = [0.2, 0.7]", "fractions = [0.2]", "coefficients"),
        ('file = "context.npz"', 'file = "no.npz"', "'no.npz' is missing"),
    ],
)
def test_a_context_that_does_not_fit_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ProfileError, match=message):
        parse_profile(edited(old, new))


def test_a_damaged_context_is_refused() -> None:
    data = FILES["context.npz"]
    for damaged in (data[: len(data) // 2], b"", data[:3000] + b"\0" * 500 + data[3500:]):
        files = edited(hashlib.sha256(data).hexdigest(), hashlib.sha256(damaged).hexdigest())
        with pytest.raises(ProfileError, match=r"context\.npz"):
            parse_profile(files | {"context.npz": damaged})


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("features", np.array("bias"), "coefficients"),
        ("coefficients", np.zeros(1, [("a", float)]), "dtype"),
        ("example_letters", np.array(["___bbɪn"]), "eight letters"),
        ("example_letters", np.array(["___bbɪn?"]), "eight letters"),
        ("example_letters", np.array("abc"), "eight letters"),
        ("example_lengths", np.zeros((1, 2)), "lengths"),
        ("example_adds", np.zeros((1, 2, 7)), "adds"),
        ("example_adds", np.full((1, 2, 8), np.nan), "adds"),
    ],
)
def test_arrays_of_a_context_that_do_not_fit_are_refused(name: str, wrong: np.ndarray, message: str) -> None:
    with np.load(io.BytesIO(FILES["context.npz"])) as arrays:
        changed = {key: value[:1] if key.startswith("example_") else value for key, value in arrays.items()}
    buffer = io.BytesIO()
    np.savez(buffer, **(changed | {name: wrong}))
    files = edited(hashlib.sha256(FILES["context.npz"]).hexdigest(), hashlib.sha256(buffer.getvalue()).hexdigest())
    with pytest.raises(ProfileError, match=message):
        parse_profile(files | {"context.npz": buffer.getvalue()})


def test_no_phones_is_no_profile() -> None:
    text = FILES[TOML_NAME].decode()
    head, tail = text.split("[[phone]]", 1)[0], "[[expression]]" + text.split("[[expression]]", 1)[1]
    with pytest.raises(ProfileError, match="'phone' is missing"):
        parse_profile(FILES | {TOML_NAME: (head + tail).encode()})
    with pytest.raises(ProfileError, match="got 3, expected a table"):
        parse_profile(FILES | {TOML_NAME: ("phone = [3]\n" + head + tail).encode()})
    with pytest.raises(ProfileError, match="contains no phone"):
        parse_profile(FILES | {TOML_NAME: ("phone = []\n" + head + tail).encode()})
