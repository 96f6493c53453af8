"""Our own heads are kept on disk: the same ones, bounded, and never in the way."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import fapengine
from fapengine import _cache
from fapengine.errors import ResourceError, UsageError
from fapengine.files.heads import built
from fapengine.files.heads.built import load_built
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.load import load_head_for_calls
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh, Folds

BALD = HeadStyle(hair=False)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("FAPENGINE_CACHE", str(tmp_path))
    load_built.cache_clear()
    _cache._report.cache_clear()
    yield tmp_path / "built-heads"
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
    assert sorted(path.name for path in folder.iterdir()) == sorted([built._digest(BALD, "coarse"), "CACHEDIR.TAG"])
    assert (folder / "CACHEDIR.TAG").read_bytes().startswith(b"Signature: 8a477f597d28d172789f06886806bc55")
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
    with monkeypatch.context() as patch:
        patch.setattr(built, "SCHEMA", 99)
        assert built._digest(BALD, "coarse") in digests  # this process still runs what it found first
        built._program.cache_clear()
        assert built._digest(BALD, "coarse") not in digests
    built._program.cache_clear()


def test_all_code_that_makes_a_head_is_in_its_name() -> None:
    """Else an old head would be taken after a change of that code."""
    program = "import sys, fapengine.mesh.default_head.head; print(*(n for n in sys.modules if n[:10] == 'fapengine.'))"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    rooms = {name.split(".")[1] for name in loaded}
    assert rooms - {"_arrays", "_strict_toml", "errors"} == set(
        _cache.MADE_BY
    )  # those check and refuse, they make nothing
    files = [file for room in _cache.MADE_BY for file in Path(fapengine.__path__[0], room).rglob("*") if file.is_file()]
    assert {file.suffix for file in files} - {".pyc", ""} == set(_cache.MADE_OF)


def test_a_damaged_head_is_built_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_built(BALD, "coarse")
    (arrays,) = folder.rglob("head.npz")
    arrays.write_bytes(arrays.read_bytes()[:-100])
    load_built.cache_clear()
    assert load_built(BALD, "coarse") is build_head(BALD, level="coarse")
    assert from_disk(BALD, monkeypatch).feature_points  # and was kept again


def of_another_user(place: Path) -> None:
    if os.getuid():
        pytest.skip("only root can give a folder away")
    (place / "built-heads").mkdir()
    os.chown(place / "built-heads", 65534, 65534)


def of_the_user(place: Path) -> None:
    (place / "built-heads").mkdir()
    (place / "built-heads" / "notes.txt").write_text("mine")


def looped(place: Path) -> None:
    (place / "built-heads").symlink_to("built-heads")


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (of_another_user, "belongs to another user"),
        (of_the_user, "was not made by fapengine"),
        (looped, "File exists"),
        (lambda place: (place / "built-heads").write_bytes(b""), "File exists"),
    ],
)
def test_a_cache_that_cannot_be_used_is_reported_once_and_costs_only_time(
    spoil: Callable[[Path], None], reason: str, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    spoil(folder.parent)
    before = {path: path.lstat().st_mtime_ns for path in folder.parent.rglob("*")}
    for _ in range(2):
        assert load_built(BALD, "coarse") is build_head(BALD, level="coarse")
        load_built.cache_clear()
    (told,) = caplog.messages
    assert told.startswith("FAPENGINE_CACHE: built heads are not kept: ")
    assert reason in told
    assert {path: path.lstat().st_mtime_ns for path in folder.parent.rglob("*")} == before


def test_a_full_disk_is_reported(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object, **__: object) -> None:
        raise ResourceError("head.npz: cannot be written (No space left on device)")

    monkeypatch.setattr(built, "save_head", full)
    assert load_built(BALD, "coarse") is build_head(BALD, level="coarse")
    assert "No space left on device" in caplog.text


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def cheap_builds(monkeypatch: pytest.MonkeyPatch) -> None:
    def save(kept: Path, head: object, info: HeadInfo, *, compressed: bool) -> None:
        kept.mkdir()
        (kept / "head.toml").write_text(f'schema = 2\nsource = "{info.source}"\n')
        (kept / "head.npz").write_bytes(bytes(100))

    monkeypatch.setattr(built, "_build", lambda style, level: build_head(BALD, level="coarse"))
    monkeypatch.setattr(built, "save_head", save)


def test_a_hundred_builds_leave_all_other_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders of the user in the named folder, and whatever somebody put beside our heads."""
    cheap_builds(monkeypatch)
    monkeypatch.setattr(_cache, "MAX_KEPT", 3)
    load_built(BALD, "coarse")
    ours = 'source = "fapengine"\n'
    others = {
        "heads/mine/head.toml": ours, "notes.txt": "mine", "fapengine/__init__.py": "",
        "built-heads/notes.txt": "mine", "built-heads/anna/head.toml": ours,
        f"built-heads/{'a' * 32}/head.toml": 'source = "anna"\n', f"built-heads/{'b' * 32}/photo.jpg": "mine",
        f"built-heads/{'c' * 32}/head.toml": ours, f"built-heads/{'c' * 32}/photo.jpg": "mine",
        f"built-heads/{'D' * 32}/head.toml": ours, f"built-heads/{'e' * 33}/head.toml": ours,
        f"built-heads/{'f' * 32}": "a file",
    }  # fmt: skip
    for name, text in others.items():
        path = folder.parent / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    kept = folder.parent / "elsewhere"
    (kept / "heads").mkdir(parents=True)
    (kept / "heads" / "head.toml").write_text(ours)
    (folder / ("1" * 32)).symlink_to(kept / "heads")
    for path in folder.iterdir():
        os.utime(path, (1, 1), follow_symlinks=False)
    first = built._digest(BALD, "coarse")
    before = {path: data for path, data in contents(folder.parent).items() if first not in path.parts}
    for seed in range(100):
        load_built(HeadStyle(hair=False, age=seed / 100), "coarse")
    after = contents(folder.parent)
    assert {path: after.get(path) for path in before} == before
    new = {path.parent for path in after.keys() - before.keys()}
    assert 0 < len(new) <= 3


def test_off_keeps_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAPENGINE_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    load_built(BALD, "coarse")
    assert list(tmp_path.iterdir()) == []


def test_the_oldest_go(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_cache, "MAX_KEPT", 2)
    ages = (0.1, 0.2, 0.3)
    for age in ages:
        load_built(HeadStyle(hair=False, age=age), "coarse")
    assert len(list(folder.glob("*/head.toml"))) == 2
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
