"""Our own heads are kept on disk: the same ones, bounded, and never in the way."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.files.heads import built
from fapengine.files.heads.built import load_built
from fapengine.files.heads.load import load_head_for_calls
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh, Folds

BALD = HeadStyle(hair=False)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("FAPENGINE_CACHE", str(tmp_path))
    load_built.cache_clear()
    yield tmp_path / "heads"
    load_built.cache_clear()


def from_disk(style: HeadStyle, monkeypatch: pytest.MonkeyPatch) -> FaceMesh:
    """Load it where nothing can be built."""
    load_built.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(built, "_build", lambda style, level: pytest.fail("was built again"))
        return load_built(style, "coarse")


def test_a_head_from_disk_is_the_head_that_was_built(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = build_head(BALD, level="coarse")
    assert load_built(BALD, "coarse") is made  # nothing was kept yet
    kept = from_disk(BALD, monkeypatch)
    assert kept is not made
    assert [path.parent.name for path in folder.rglob("head.toml")] == [path.name for path in folder.iterdir()]
    for field in fields(FaceMesh):
        if field.name not in ("basis", "folds"):
            assert np.array_equal(getattr(kept, field.name), getattr(made, field.name)), field.name
    assert made.folds is not None
    for field in fields(Folds):
        assert np.array_equal(getattr(kept.folds, field.name), getattr(made.folds, field.name)), field.name
    for field in fields(DeformationBasis):
        assert np.array_equal(getattr(kept.basis, field.name), getattr(made.basis, field.name)), field.name


def test_another_look_or_program_is_another_head(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    digests = {built._digest(style, level) for style in (BALD, HeadStyle()) for level in ("coarse", "normal")}
    assert len(digests) == 4
    monkeypatch.setattr(built, "SCHEMA", 99)
    assert built._digest(BALD, "coarse") not in digests


def test_all_code_that_makes_a_head_is_in_its_name() -> None:
    """Else an old head would be taken after a change of that code."""
    program = "import sys, fapengine.mesh.default_head.head; print(*(n for n in sys.modules if n[:10] == 'fapengine.'))"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    rooms = {name.split(".")[1] for name in loaded}
    assert rooms - {"_arrays", "errors"} == set(built.MADE_BY)  # those two check and refuse, they make nothing


def test_a_damaged_head_is_built_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_built(BALD, "coarse")
    (arrays,) = folder.rglob("head.npz")
    arrays.write_bytes(arrays.read_bytes()[:-100])
    load_built.cache_clear()
    assert load_built(BALD, "coarse") is build_head(BALD, level="coarse")
    assert from_disk(BALD, monkeypatch).feature_points  # and was kept again


def test_a_folder_that_cannot_be_written_costs_nothing_but_time(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("FAPENGINE_CACHE", str(tmp_path / "file"))
    assert load_built(BALD, "coarse") is build_head(BALD, level="coarse")


def test_off_keeps_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAPENGINE_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    load_built(BALD, "coarse")
    assert list(tmp_path.iterdir()) == []


def test_the_oldest_go(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(built, "MAX_KEPT", 2)
    ages = (0.1, 0.2, 0.3)
    for age in ages:
        load_built(HeadStyle(hair=False, age=age), "coarse")
    assert len(list(folder.iterdir())) == 2
    for age in ages[1:]:
        from_disk(HeadStyle(hair=False, age=age), monkeypatch)


def test_a_level_that_is_none_is_refused(folder: Path) -> None:
    with pytest.raises(UsageError, match=r"level: got 'huge', expected one of coarse, calls, normal"):
        load_built(BALD, "huge")
    assert not folder.exists()


@pytest.mark.parametrize(
    ("name", "side_px", "level"),
    [
        ("woman", 512, "calls"),
        ("woman,glasses", 640, "calls"),
        ("woman", 641, "normal"),
        ("random:7,level=normal", 512, "normal"),
        ("woman:level=fine", 720, "fine"),
    ],
)
def test_calls_have_their_level_unless_another_is_named(
    name: str, side_px: int, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr("fapengine.files.heads.load.load_built", lambda style, level: asked.append(level))
    load_head_for_calls(name, (side_px, 360))
    assert asked == [level]
