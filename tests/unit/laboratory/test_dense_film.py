"""The commands on a dense face: a head of it, films of takes, glTF with its modes."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fapengine.app.dense_film import drive, sparse_mesh
from fapengine.errors import DataError, ProfileError, UsageError
from fapengine.files.gltf.document import JSON_CHUNK, parse_gltf, split_glb
from fapengine.files.heads import import_file
from fapengine.files.heads.dense import load_dense
from fapengine.files.heads.load import load_head, load_head_info, load_head_of_modes
from fapengine.files.motion import save_fap
from fapengine.files.pictures import load_picture
from fapengine.files.recordings import save_markers
from fapengine.laboratory.dense_face import make_dense_head
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import PEOPLE
from fapengine.models.adapted_head import Nearness
from fapengine.mpeg4.track import FapTrack
from tests.command import run
from tests.videos import load_video

from .dense_made import MOVING, SKULL, MadeFace, make_face

SMALL = ("--size", "96x96")
LABELS = ("_", "m", "i", "p", "u", "s", "i", "m", "t", "_")


@pytest.fixture(scope="module")
def profile(made, tmp_path_factory) -> Path:
    return made.write(tmp_path_factory.mktemp("lab") / "s03")


@pytest.fixture(scope="module")
def take(made, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("takes") / "take.npz"
    save_markers(path, made.take(0.3, gaps=False)[0])
    return path


@pytest.fixture(scope="module")
def head(profile) -> Path:
    folder = profile.parent / "head"
    told = run("head", "import", profile, "-o", folder)
    assert "modes, moved by" in told
    return folder


def session_of(face: MadeFace, folder: Path) -> Path:
    """A session as a laboratory has it: takes with phones beside them, and scans in held postures."""
    (folder / "scans").mkdir(parents=True)
    marks = {name: int(np.flatnonzero(face.used == face.head.feature_points[name])[0]) for name in face.labels}
    toml = [f'subject = "S05"\nlanguage = "en-GB"\nhead = {json.dumps(list(SKULL))}\nlicence = "CC0-1.0"']
    rng = np.random.default_rng(4)
    held = np.concatenate([np.zeros((1, len(MOVING))), rng.uniform(-1, 1, (4, len(MOVING)))])
    for number, amounts in enumerate(held):
        vertices = face.faces_mm(amounts[None])[0]
        trimesh.Trimesh(vertices, face.dense.triangles, process=False).export(folder / "scans" / f"{number}.ply")
        places = ", ".join(f'"{name}" = {np.round(vertices[at], 4).tolist()}' for name, at in marks.items())
        toml.append(f"[[scan]]\nfile = 'scans/{number}.ply'\nlandmarks = {{ {places} }}")
    for number in range(5):
        track, _ = face.take(2.0, gaps=False, seed=number)
        track = replace(track, positions_mm=track.positions_mm + rng.normal(0, 0.05, track.positions_mm.shape))
        save_markers(folder / f"take{number}.npz", track)
        rows = "\n".join(f"{n * 0.2:.1f} {n * 0.2 + 0.2:.1f} {label}" for n, label in enumerate(LABELS))
        (folder / f"take{number}.lab").write_text(rows)
    (folder / "session.toml").write_text("\n".join(toml))
    return folder


def test_fit_puts_our_own_head_on_to_the_dense_face(tmp_path, monkeypatch):
    other = make_face(build_head(PEOPLE["man"], level="coarse"))
    session, profile = session_of(other, tmp_path / "S05"), tmp_path / "s05"
    told = json.loads(run("fit", session, "-o", profile, "--adapt", "--no-report", "--json"))
    front, left_out = told["adapted"]["front_mm"], told["adapted"]["left_out_mm"]
    assert front[1] < 0.1 * front[0]
    assert left_out[1] < left_out[0]
    adapted, dense = load_head(str(profile)), load_head_of_modes(str(profile))[0]
    assert len(adapted.vertices_mm) > len(dense.vertices_mm)  # our whole head for FAPs, the dense face for takes
    assert set(adapted.feature_points) > set(dense.feature_points)  # eyes, teeth, tongue
    assert load_head_info(str(profile)).source == "fapengine's head on the dense face of S05"
    face, _ = load_dense(profile)
    made = replace(make_dense_head(face, build_head())[0], mesh=adapted)
    monkeypatch.setattr(import_file, "adapt_dense_face", lambda face, points: (made, Nearness((1.0, 0.5), None, 0)))
    assert "0.50 mm after; too few" in run("head", "import", profile, "--adapt", "-o", tmp_path / "ours")
    np.testing.assert_array_equal(load_head(str(tmp_path / "ours")).vertices_mm, adapted.vertices_mm)
    with pytest.raises(UsageError, match="no other names"):
        run("head", "import", profile, "--adapt", "--shape-map", tmp_path / "names.toml", "-o", tmp_path / "ours")
    shutil.rmtree(session / "scans")
    for path in (*session.glob("take3.*"), *session.glob("take4.*")):  # what follows needs fewer
        path.unlink()
    text = (session / "session.toml").read_text()
    (session / "session.toml").write_text(text[: text.index("[[scan]]")])
    with pytest.raises(DataError, match="no dense face; it needs 3"):
        run("fit", session, "-o", profile, "--adapt", "--no-report")
    assert (profile / "head").exists()  # what failed changes nothing
    run("fit", session, "-o", profile, "--no-report")
    assert not (profile / "head").exists()  # what is not made again is not there


def test_a_profiles_dense_face_becomes_a_head(made, profile, head):
    mesh, rig = load_head_of_modes(str(head))
    assert len(mesh.vertices_mm) == len(made.used)
    assert mesh.texture is not None
    assert mesh.texture.shape == (8, 8, 4)
    again, other = load_head_of_modes(str(profile))
    np.testing.assert_array_equal(again.vertices_mm, mesh.vertices_mm)
    np.testing.assert_array_equal(other.modes_mm, rig.modes_mm)
    assert load_head(str(profile)).feature_points == mesh.feature_points
    assert 'licence = "ours"' in (head / "head.toml").read_text()


def test_a_take_becomes_a_film(made, head, take, tmp_path):
    run("render", take, "--head", head, "-o", tmp_path / "film.mp4", *SMALL)
    film = load_video(tmp_path / "film.mp4")
    assert len(film.frames) == 15
    run("render", take, "--head", head, "-o", tmp_path / "slow.mp4", "--fps", "25", *SMALL)
    assert len(load_video(tmp_path / "slow.mp4").frames) == 8
    pictures = {}
    for way in (("--no-head-motion",), (), ("--reconstruction", "modes"), ("--no-head-motion", "--at", "0.2")):
        run("render", take, "--head", head, "-o", tmp_path / "one.png", "--at", "0.28", *way, *SMALL)
        pictures[way] = load_picture(tmp_path / "one.png").astype(int)
    still, turned, by_modes, before = pictures.values()
    assert np.abs(still - turned).mean() > 1  # the head has moved
    assert np.abs(by_modes - turned).mean() < 0.2  # two ways to one face
    assert np.abs(before - still)[60:85, 30:65].mean() > 0.3  # so has the mouth
    run("render", take, take, "--head", head, "--contact-sheet", "2", "-o", tmp_path / "sheet.png", *SMALL)


def test_the_markers_are_shown_beside_the_face(head, take, tmp_path):
    words = ("render", take, "--head", head, "-o", tmp_path / "one.png", "--at", "0.28", "--no-head-motion", *SMALL)
    run(*words)
    alone = load_picture(tmp_path / "one.png")
    run(*words, "--with-markers")
    both = load_picture(tmp_path / "one.png")
    assert both.shape == (96, 192, 3)
    np.testing.assert_allclose(both[:, 96:].astype(int), alone, atol=1)
    rig = load_head_of_modes(str(head))[1]
    driven = drive(take, rig)
    mesh, weights = sparse_mesh(rig, driven)
    places = rig.scale * driven.markers_mm @ rig.axes.T + rig.origin_mm
    for frame, row in enumerate(weights):
        shown = mesh.vertices_mm + mesh.basis.displacement(row)
        np.testing.assert_allclose(shown[: places.shape[1]], places[frame], atol=1e-3)
    assert {"8.1", "8.2"} <= set(rig.driver.labels)
    rims = [rig.driver.labels.index(point) for point in ("8.1", "8.2")]
    facets = mesh.triangles[(mesh.triangles < places.shape[1]).all(axis=1)]
    assert len(facets) > 20
    assert not np.isin(facets, rims[0])[np.isin(facets, rims[1]).any(axis=1)].any()  # none bridges the mouth


def test_a_take_goes_into_gltf_as_weights_of_the_modes(made, head, take, tmp_path):
    run("head", "export", head, "-o", tmp_path / "head.glb")
    told = run("convert", take, "--into", head, "-o", tmp_path / "take.glb")
    rig = load_head_of_modes(str(head))[1]
    modes = {name: row for name, row in zip(rig.names, rig.modes_mm, strict=True) if np.abs(row).max() > 0.02}
    assert len(modes) >= 9
    assert f"15 frames at 50 Hz; moves {len(modes)} modes and the head" in told
    for name, animations in (("head.glb", 0), ("take.glb", 1)):
        data = (tmp_path / name).read_bytes()
        rows = json.loads(next(content for kind, content in split_glb(data) if kind == JSON_CHUNK))
        assert len(rows.get("animations", [])) == animations
        titles = rows["meshes"][0]["extras"]["targetNames"]
        assert set(modes) < set(titles)
        assert {"jawOpen", "viseme_aa"} < set(titles)
    animation = rows["animations"][0]
    channels = {row["target"]["path"]: row["sampler"] for row in animation["channels"]}
    assert set(channels) == {"weights", "rotation", "translation"}
    sampler = animation["samplers"][channels["weights"]]
    weights = parse_gltf(data, lambda uri: b"").accessor(sampler["output"]).reshape(15, len(titles))
    driven = rig.driver.follow(made.take(0.3, gaps=False)[0])
    columns = [titles.index(name) for name in modes]
    np.testing.assert_allclose(weights[:, columns], driven.weights[:, : len(modes)], atol=1e-3)
    assert not np.delete(weights, columns, axis=1).any()


def test_what_cannot_be_is_told(made, profile, head, take, tmp_path):
    save_fap(tmp_path / "a.fap", FapTrack.from_values(np.zeros((3, 68), int), rate_hz=25.0))
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "profile.toml").write_text("")
    old = made.write(tmp_path / "old")
    (old / "dense.toml").unlink()
    (old / "profile.toml").write_text("")
    torn = made.write(tmp_path / "torn")
    (torn / "dense.npz").write_bytes(b"PK")
    out = tmp_path / "out.png"
    for words, kind, message in (
        (("render", take, "-o", out), UsageError, "has no modes that a recording could move"),
        (("render", take, tmp_path / "a.fap", "--head", head, "-o", out), UsageError, "use marker recordings only"),
        (("render", take, "--head", head, "--reconstruction", "both", "-o", out), UsageError, "use estimator or modes"),
        (("render", take, "--head", tmp_path / "bare", "-o", out), UsageError, "has no dense face"),
        (("render", take, "--head", old, "-o", out), UsageError, "fit it again"),
        (("render", take, "--head", torn, "-o", out), ProfileError, "sha256 of dense.npz"),
        (("convert", take, "--into", head, "-o", tmp_path / "a.vrm"), UsageError, "expected .glb and a dense face"),
        (("convert", take, "-o", tmp_path / "a.fap"), UsageError, "expected .glb and a dense face"),
        (
            ("head", "import", profile, "--shape-map", take, "-o", tmp_path / "h"),
            UsageError,
            "cannot be used with a profile",
        ),
    ):
        with pytest.raises(kind, match=message):
            run(*words)
    track, _ = made.take(0.3)
    save_markers(tmp_path / "bald.npz", track.select(made.labels))
    with pytest.raises(DataError, match=r"bald\.npz.*skull|skull.*bald\.npz"):
        run("render", tmp_path / "bald.npz", "--head", head, "-o", out)
