"""Several faces in one picture."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.render.camera import preset
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import CrowdRenderer, FaceRenderer

TILE = (96, 128)


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


def poses(count: int) -> np.ndarray:
    faps = np.zeros((count, 68))
    faps[:, fap.column(3)] = np.arange(count) * 200
    faps[:, fap.column(23)] = faps[:, fap.column(24)] = np.linspace(-30_000, 30_000, count)
    return faps


def test_each_tile_is_what_the_face_is_alone(head: FaceMesh) -> None:
    """Without softening, which looks over the border, to the pixel; two meshes, two views."""
    other = replace(head, texture=None)
    meshes, cameras = [head, other, head], [preset("front"), preset("three-quarter"), preset("close")]
    faps = poses(3)
    with CrowdRenderer(meshes, RenderOptions(size=TILE, samples=1), columns=2) as crowd:
        crowd.cameras = cameras
        assert crowd.columns == 2
        assert crowd.size == (192, 256)
        assert len(crowd._models) == 2
        picture = crowd.draw(faps)
        for number, (mesh, camera) in enumerate(zip(meshes, cameras, strict=True)):
            x, y = crowd.corner(number)
            with FaceRenderer(
                mesh, RenderOptions(size=TILE, camera=camera, samples=1), context=crowd._context
            ) as renderer:
                alone = renderer.draw(faps[number])
            tile = picture[y : y + TILE[1], x : x + TILE[0]]
            assert (np.abs(tile.astype(int) - alone).max(axis=-1) <= 2).mean() > 0.995, number
    assert not picture[128:, 96:].any()  # the fourth tile has no face


def test_frames_of_a_crowd(head: FaceMesh) -> None:
    rows = np.stack([poses(2), poses(2)[::-1]])
    with CrowdRenderer(
        [head] * 2, RenderOptions(size=(64, 64), background="transparent", samples=0), columns=2
    ) as crowd:
        streamed = [picture.copy() for picture in crowd.frames(rows)]
        assert [picture.shape for picture in streamed] == [(64, 128, 4)] * 2
        assert np.array_equal(streamed[1], crowd.draw(rows[1]))
    assert streamed[0][2, 2, 3] == 0
    assert not np.array_equal(streamed[0], streamed[1])


def test_refuses(head: FaceMesh) -> None:
    with pytest.raises(UsageError, match="crowd: requires a mesh"):
        CrowdRenderer([])
    with pytest.raises(UsageError, match="got 3 columns, expected 1 to 2"):
        CrowdRenderer([head] * 2, columns=3)
    with pytest.raises(UsageError, match="got 10240x512"):
        CrowdRenderer([head] * 20, RenderOptions(samples=0), columns=20)
    with (
        CrowdRenderer([head] * 2, RenderOptions(size=(32, 32), samples=0)) as crowd,
        pytest.raises(UsageError, match=r"shape \(3, 68\), expected \(2"),
    ):
        crowd.draw(poses(3))
