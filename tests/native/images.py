"""Thirty images that both renderers draw: people and imported heads, poses, cameras, sizes, backgrounds."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine.files.heads.load import load_head, load_head_for_calls
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.import_head import import_head
from fapengine.mpeg4 import fap
from fapengine.render.camera import preset
from fapengine.render.drawing import Background, RenderOptions, Shading
from fapengine.retarget.rig_weights import choose_blendshapes
from tests.unit.mesh.rigs import own_rig

ALIKE = 2
"""Levels of 255 by which a pixel of one renderer may differ from the other's."""
MIN_ALIKE = 0.999
"""Share of the pixels of an image that are alike."""


@dataclass(frozen=True, kw_only=True)
class Image:
    """One of them."""

    head: str
    pose: str = "rest"
    camera: str = "front"
    size: tuple[int, int] = (512, 512)
    background: Background = "studio"
    samples: int = 0
    shading: Shading = "auto"
    scale: float = 1.0

    @property
    def drawing(self) -> RenderOptions:
        return RenderOptions(
            size=self.size, camera=preset(self.camera), background=self.background, samples=self.samples,
            shading=self.shading, scale=self.scale,
        )  # fmt: skip

    @property
    def name(self) -> str:
        background = self.background if isinstance(self.background, str) else "picture"
        background = background if not isinstance(self.background, tuple) else "colour"
        how = (self.head, self.pose, self.camera, f"{self.size[0]}x{self.size[1]}", background)
        more = (f"shading {self.shading}",) * (self.shading != "auto") + ("stairs",) * (self.samples == 1)
        return ", ".join((*how, *more, *(f"scale {self.scale:g}",) * (self.scale < 1)))


def faps_of(pose: str) -> NDArray[np.float64]:
    """(68,) FAPU."""
    values = np.zeros(fap.FAP_COUNT)
    named = {
        "blink": {19: 1024, 20: 1024, 21: 200, 22: 200},
        "half shut": {19: 500, 20: 420},
        "open": {3: 900, 51: 300, 52: -250, 16: 200},
        "joy": {12: 250, 13: 250, 6: 150, 7: 150, 31: 120, 32: 120, 41: 180, 42: 180},
        "aside": {23: 30000, 24: 30000, 25: 12000, 26: 12000, 29: 200, 30: 200},
        "turned": {48: 12000, 49: -25000, 50: 9000, 3: 300},
        "wide": {19: -300, 20: -300, 31: 250, 32: 250, 35: 200, 36: 200},
    }
    if pose.startswith("random"):
        rng = np.random.default_rng(int(pose.removeprefix("random")))
        values[2:] = rng.uniform(-150, 150, fap.FAP_COUNT - 2) * (rng.random(fap.FAP_COUNT - 2) < 0.4)
        return values
    for number, value in named.get(pose, {}).items():
        values[fap.column(number)] = value
    return values


def picture(height: int, width: int, seed: int) -> NDArray[np.uint8]:
    """(height, width, 3): colours that change smoothly, and a few edges."""
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(x / (9 + seed + 3 * k)) + np.cos(y / (11 + 2 * k)) for k in range(3)]
    made = 120 + 50 * np.stack(waves, axis=-1)
    made[height // 3 : height // 2, width // 4 : width // 2] = (230, 190, 60)
    return np.clip(made, 0, 255).astype(np.uint8)


def with_texture(mesh: FaceMesh, holes: bool) -> FaceMesh:
    """A head with a texture laid over it from the front, with holes in it or without."""
    low, high = mesh.vertices_mm.min(axis=0), mesh.vertices_mm.max(axis=0)
    uv = ((mesh.vertices_mm - low) / (high - low))[:, :2] * 0.98 + 0.01
    texture = picture(400, 300, 2)
    if holes:
        alpha = np.full((400, 300, 1), 255, np.uint8)
        alpha[::16] = alpha[1::16] = alpha[2::16] = 0
        texture = np.concatenate([texture, alpha], axis=2)
    material = np.where(mesh.material == Material.EYE, Material.BALL, mesh.material).astype(np.uint8)
    return replace(mesh, uv=uv, texture=texture, material=material, folds=None)


@cache
def imported_head() -> FaceMesh:
    rig, standard = own_rig(), build_head(HeadStyle(charm=0))
    used = set(np.unique(standard.triangles).tolist())
    points = {name: index for name, index in standard.feature_points.items() if index in used}
    choice = choose_blendshapes(rig.blendshapes)
    return import_head(rig, choice.blended, points, standard, choice.own_faps).mesh


@cache
def head_of(name: str, side: int) -> FaceMesh:
    if name.startswith("imported"):
        return with_texture(imported_head(), "holes" in name) if "textured" in name else imported_head()
    return load_head_for_calls(name, (side, side)) if side <= 512 else load_head(name)


def images() -> Iterator[Image]:
    scene = picture(300, 400, 1)
    yield Image(head="default")
    yield Image(head="default", pose="random1")
    yield Image(head="default", pose="blink", camera="close", size=(256, 256))
    yield Image(head="default", pose="open", camera="mouth", size=(256, 256))
    yield Image(head="default", pose="aside", camera="eyes", size=(320, 240))
    yield Image(head="default", pose="turned", camera="three-quarter", size=(333, 257))
    yield Image(head="default", pose="joy", size=(128, 160), background="transparent")
    yield Image(head="default", pose="wide", camera="profile", background=(240, 232, 216))
    yield Image(head="default", pose="half shut", background=scene, size=(384, 384))
    yield Image(head="default", pose="joy", samples=1)
    yield Image(head="default", pose="random2", shading="pixels")
    yield Image(head="default", pose="random3", scale=0.6)
    yield Image(head="default", size=(1024, 1024), camera="close")
    yield Image(head="woman")
    yield Image(head="woman", pose="joy", camera="three-quarter-right", size=(384, 384))
    yield Image(head="woman", pose="random4", shading="vertices", background="transparent")
    yield Image(head="woman,glasses", pose="aside")
    yield Image(head="man,beard=1", pose="open")
    yield Image(head="man,beard=1", pose="turned", camera="low", size=(256, 256))
    yield Image(head="child", pose="wide", size=(320, 320))
    yield Image(head="older", pose="joy", camera="close")
    yield Image(head="older", pose="random5", camera="high", size=(384, 256))
    yield Image(head="random:7", pose="random6")
    yield Image(head="random:12", pose="blink", camera="profile-right", size=(256, 320))
    yield Image(head="imported")
    yield Image(head="imported", pose="open", camera="three-quarter", size=(256, 256))
    yield Image(head="imported textured", pose="joy")
    yield Image(head="imported textured", pose="aside", camera="eyes", size=(256, 256))
    yield Image(head="imported textured, holes", pose="open", shading="vertices")
    yield Image(head="imported textured, holes", camera="three-quarter", size=(320, 320), background=scene)


def alike(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Share of the pixels whose components all differ by at most :data:`ALIKE`."""
    return float((np.abs(one.astype(int) - other).max(axis=-1) <= ALIKE).mean())
