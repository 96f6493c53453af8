"""Packed meshes are kept on disk: the same ones, bounded, and never in the way."""

import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from fapengine import _cache
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render import packed
from fapengine.render.packed import packed_mesh
from fapengine.render.packing import PackedMesh, pack


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FAPENGINE_CACHE", str(tmp_path))
    return tmp_path / "built-heads"


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head(HeadStyle(), level="coarse")


def textured(head: FaceMesh) -> FaceMesh:
    """As an imported head: no folds, and a texture with a hole."""
    texture = np.full((8, 8, 4), 200, np.uint8)
    texture[:2, :2, 3] = 0
    return replace(head, folds=None, texture=texture)


def from_disk(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> PackedMesh:
    """Read it where nothing can be packed."""
    with monkeypatch.context() as patch:
        patch.setattr(packed, "pack", lambda mesh: pytest.fail("was packed again"))
        return packed_mesh(head)


def assert_same(one: PackedMesh, other: PackedMesh) -> None:
    for field in fields(PackedMesh):
        mine, its = getattr(one, field.name), getattr(other, field.name)
        if field.name == "parts":
            assert list(mine) == list(its)
            assert all(np.array_equal(mine[name], its[name]) for name in its)
        else:
            assert np.array_equal(mine, its), field.name


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != _cache.TAG)


def test_a_mesh_from_disk_is_the_mesh_that_was_packed(
    folder: Path, head: FaceMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    for mesh in (head, textured(head), replace(head, texture=None)):
        packed_mesh(mesh)
        assert_same(from_disk(mesh, monkeypatch), pack(mesh))
    assert len(names(folder)) == 3


def test_what_differs_in_anything_is_another_mesh(head: FaceMesh) -> None:
    longer = replace(head, basis=replace(head.basis, entry_mm=head.basis.entry_mm * 1.01))
    others = [head, longer, replace(head, albedo=head.albedo * 0.9), replace(head, folds=None)]
    assert len({packed._digest(mesh) for mesh in others}) == 4


def test_another_program_packs_again(folder: Path, head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    packed_mesh(head)
    with monkeypatch.context() as patch:
        patch.setattr(packed, "_program", lambda: "a later program")
        packed_mesh(head)
        assert len(names(folder)) == 2
        from_disk(head, monkeypatch)
    from_disk(head, monkeypatch)


@pytest.mark.parametrize(
    "spoil", [lambda data: data[:-100], lambda data: b"", lambda data: data[:5000] + b"x" * 100 + data[5100:]]
)
def test_a_damaged_file_is_written_again(spoil, folder: Path, head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    packed_mesh(head)
    (kept,) = folder.glob("packed-*")
    kept.write_bytes(spoil(kept.read_bytes()))
    assert_same(packed_mesh(head), pack(head))
    assert_same(from_disk(head, monkeypatch), pack(head))


def test_a_file_with_other_arrays_is_written_again(
    folder: Path, head: FaceMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed_mesh(head)
    (kept,) = folder.glob("packed-*")
    np.savez(kept, vertices=np.zeros(3))
    assert_same(packed_mesh(head), pack(head))
    from_disk(head, monkeypatch)


def test_the_oldest_go_and_nothing_of_the_user(folder: Path, head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_cache, "MAX_KEPT", 2)
    meshes = [replace(head, iris_albedo=np.full(3, share)) for share in (0.1, 0.2, 0.3)]
    packed_mesh(meshes[0])
    (folder / "mine.npz").write_bytes(b"mine")
    left = folder / f"packed-{'a' * 32}.npz.0123abcd"
    left.write_bytes(b"left by a crash")
    os.utime(left, (0, 0))
    for age, mesh in enumerate(meshes[:2]):
        packed_mesh(mesh)
        for path in folder.iterdir():
            if path.stat().st_mtime > 10:
                os.utime(path, (1 + age, 1 + age))
    from_disk(meshes[0], monkeypatch)  # so it is newer than the second
    packed_mesh(meshes[2])
    assert "mine.npz" in names(folder)
    assert len(names(folder)) == 3
    for mesh in (meshes[0], meshes[2]):
        from_disk(mesh, monkeypatch)


def test_a_folder_of_somebody_else_is_left_alone(folder: Path, head: FaceMesh) -> None:
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    assert_same(packed_mesh(head), pack(head))
    assert names(folder) == ["notes.txt"]


def test_a_failed_write_leaves_nothing(folder: Path, head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file, **_: object) -> None:
        file.write(b"half")
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez", full)
    assert_same(packed_mesh(head), pack(head))
    assert names(folder) == []


def test_off_keeps_nothing(head: FaceMesh, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAPENGINE_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    packed_mesh(head)
    assert list(tmp_path.iterdir()) == []
