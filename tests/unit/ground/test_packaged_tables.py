"""Tables that the package ships: what the generators write is what is shipped, and damage is found."""

from pathlib import Path

import numpy as np
import pytest

import fapengine
from design import data_files, learn_faces
from fapengine import _arrays
from fapengine._arrays import DIGESTS, read_table
from fapengine.errors import ResourceError
from fapengine.mesh.default_head.faces import STEP_MM, face_table
from fapengine.mesh.default_head.skin import skin_table

ROOT = Path(fapengine.__file__).parent
TABLES = [
    (folder, name)
    for folder in ("mesh/default_head", "retarget")
    for name in sorted(path.name for path in (ROOT / folder).glob("*.npz"))
]
PACKAGE = "fapengine.mesh.default_head"


@pytest.fixture
def copy(tmp_path, monkeypatch):
    for name in ("faces.npz", "skin.npz", DIGESTS):
        (tmp_path / name).write_bytes((ROOT / "mesh/default_head" / name).read_bytes())
    monkeypatch.setattr(_arrays, "files", lambda package: tmp_path)
    return tmp_path


def test_there_are_five() -> None:
    assert len(TABLES) == 5


@pytest.mark.parametrize(("folder", "name"), TABLES)
def test_the_writer_writes_the_shipped_bytes(folder, name, tmp_path):
    arrays = read_table("fapengine." + folder.replace("/", "."), name)
    data_files.save_table(tmp_path / name, arrays)
    assert (tmp_path / name).read_bytes() == (ROOT / folder / name).read_bytes()
    assert (tmp_path / DIGESTS).read_text() in (ROOT / folder / DIGESTS).read_text()


def test_the_faces_and_the_skin_are_written_as_they_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(learn_faces, "TABLES", tmp_path)
    faces, (angles, heights, moves) = face_table(), skin_table()
    learn_faces.write_table("faces.npz", np.rad2deg(faces.angles), faces.heights, mean=faces.mean, modes=faces.modes)
    learn_faces.write_table("skin.npz", np.rad2deg(angles), heights, moves=moves)
    for name in ("faces.npz", "skin.npz"):
        with np.load(tmp_path / name) as written:
            shipped = read_table(PACKAGE, name)
            np.testing.assert_allclose(written["angles_deg"], shipped["angles_deg"], rtol=1e-15)
            for key in written.files[1:]:
                np.testing.assert_array_equal(written[key], shipped[key])
                assert written[key].dtype == shipped[key].dtype
    assert np.abs(faces.mean).max() < 40  # mm
    assert STEP_MM == 0.01


def test_a_changed_byte_is_found(copy):
    data = bytearray((copy / "skin.npz").read_bytes())
    data[len(data) // 2] ^= 1
    (copy / "skin.npz").write_bytes(data)
    assert set(read_table(PACKAGE, "faces.npz")) == {"angles_deg", "heights_mm", "mean", "modes"}
    with pytest.raises(ResourceError, match=r"skin\.npz: its digest is not the one in SHA256SUMS"):
        read_table(PACKAGE, "skin.npz")


def test_a_table_without_a_digest_is_not_read(copy):
    (copy / DIGESTS).write_text("")
    with pytest.raises(ResourceError, match="digest"):
        read_table(PACKAGE, "skin.npz")


def test_a_missing_table_is_reported(copy):
    (copy / "skin.npz").unlink()
    with pytest.raises(ResourceError, match=r"skin\.npz: not found in fapengine\.mesh\.default_head"):
        read_table(PACKAGE, "skin.npz")
