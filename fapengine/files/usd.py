"""A head as USD, with its motion: UsdSkel blend shapes, joints and an animation, written by usd-core.

A part of the head is a mesh with the shapes that move it. The animation contains the weights of all shapes and the
rotations of the joints; as in the GLB, the shapes alone move the whole face. Colours, including those of textures, are
stored at the vertices.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine._late import Late
from fapengine.files.paths import replacing
from fapengine.files.provenance import mark
from fapengine.mesh.colours import linear_rgb
from fapengine.retarget.ict_notice import ICT_NOTICE, copyright_line
from fapengine.retarget.puppet import DOUBLE_SIDED, JOINTS, Part, Puppet
from fapengine.retarget.rig_weights import rig_weights

Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt = (
    Late(f"pxr.{name}", "usd-core", "USD") for name in ("Gf", "Sdf", "Usd", "UsdGeom", "UsdSkel", "Vt")
)


ROOT = "/Head"


def save_usd(
    path: Path,
    puppet: Puppet,
    *,
    licence: str,
    source: str,
    faps: Array | None = None,
    turns: Mapping[str, Array] | None = None,
    rate_hz: float = 30.0,
) -> int:
    """Write a head, optionally with motion.

    Parameters
    ----------
    path : Path
        Ends with .usda, .usdc or .usd.
    puppet : Puppet
    licence, source : str
        Origin, for the layer's ``customLayerData``.
    faps : (T, 68) float64, FAPU, optional
        Frames, T >= 1, without gaps.
    turns : mapping of str to (T, 3, 3) float64
        Rotations by the name of a joint, in head space; with ``faps``.
    rate_hz : float
        Frame rate: one time code per frame.

    Returns
    -------
    int
        Number of shapes whose weight is not always 0.

    Raises
    ------
    ResourceError
        If usd-core is not installed, or the file cannot be written.
    """
    stage = Usd.Stage.CreateInMemory()
    stage.SetDefaultPrim(UsdSkel.Root.Define(stage, ROOT).GetPrim())
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.GetRootLayer().customLayerData = {
        "copyright": copyright_line(source, licence), "license": licence, "notice": ICT_NOTICE,
        **mark(),
    }  # fmt: skip
    skeleton = _add_skeleton(stage, puppet)
    for part in puppet.parts:
        _add_mesh(stage, part, skeleton)
    moved = 0
    if faps is not None:
        names = list(dict.fromkeys(name for part in puppet.parts for name in part.shapes))
        weights = rig_weights([names], faps, None, looks=False, rate_hz=rate_hz)[0]
        moved = sum(bool(row.any()) for row in weights.values())
        _add_animation(stage, puppet, skeleton, names, weights, turns or {}, len(faps))
        stage.SetTimeCodesPerSecond(rate_hz)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(len(faps) - 1)
    with replacing(path) as new:
        stage.GetRootLayer().Export(str(new))
    return moved


def _joint_paths(puppet: Puppet) -> list[str]:
    paths: dict[str, str] = {}
    for joint in puppet.skeleton:
        paths[joint.name] = joint.name if joint.parent is None else f"{paths[joint.parent]}/{joint.name}"
    return list(paths.values())


def _matrices(places: Iterable[Sequence[float]]) -> Any:
    return Vt.Matrix4dArray([Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*place)) for place in places])


def _vectors(values: NDArray[np.floating]) -> Any:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


def _add_skeleton(stage: Any, puppet: Puppet) -> Any:
    skeleton = UsdSkel.Skeleton.Define(stage, f"{ROOT}/Skeleton")
    skeleton.CreateJointsAttr(_joint_paths(puppet))
    skeleton.CreateBindTransformsAttr(_matrices(puppet.joints.tolist()))
    skeleton.CreateRestTransformsAttr(_matrices(joint.place for joint in puppet.skeleton))
    return skeleton


def _add_mesh(stage: Any, part: Part, skeleton: Any) -> None:
    path = f"{ROOT}/{part.name}"
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(_vectors(part.vertices))
    mesh.CreateNormalsAttr(_vectors(part.normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(part.triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(part.triangles.ravel().astype(np.int32)))
    mesh.CreateExtentAttr(_vectors(np.stack([part.vertices.min(axis=0), part.vertices.max(axis=0)])))
    mesh.CreateDoubleSidedAttr(part.name in DOUBLE_SIDED)
    mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(_vectors(_painted(part)))
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    order, weights = part.influences()
    binding.CreateJointIndicesPrimvar(False, 4).Set(Vt.IntArray.FromNumpy(order.ravel().astype(np.int32)))
    binding.CreateJointWeightsPrimvar(False, 4).Set(Vt.FloatArray.FromNumpy(weights.ravel().astype(np.float32)))
    targets = []
    for name, shape in part.shapes.items():
        moved = np.flatnonzero(shape.moves.any(axis=1) | shape.turns.any(axis=1))
        target = UsdSkel.BlendShape.Define(stage, f"{path}/{name}")
        target.CreateOffsetsAttr(_vectors(shape.moves[moved]))
        target.CreateNormalOffsetsAttr(_vectors(shape.turns[moved]))
        target.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(moved.astype(np.int32)))
        targets.append(target.GetPath())
    if targets:
        binding.CreateBlendShapesAttr(list(part.shapes))
        binding.CreateBlendShapeTargetsRel().SetTargets(targets)


def _painted(part: Part) -> Array:
    """(V, 3): linear RGB of the vertices, multiplied by the texture if there is one."""
    colours = part.colours.astype(np.float64)
    if part.texture is None:
        return colours
    height, width = part.texture.shape[:2]
    column = np.clip((part.uv[:, 0] * width).astype(int), 0, width - 1)
    row = np.clip((part.uv[:, 1] * height).astype(int), 0, height - 1)
    texel = part.texture[row, column, :3] / 255.0
    return colours * linear_rgb(texel)


def _add_animation(
    stage: Any,
    puppet: Puppet,
    skeleton: Any,
    names: Sequence[str],
    weights: Mapping[str, Array],
    turns: Mapping[str, Array],
    count: int,
) -> None:
    animation = UsdSkel.Animation.Define(stage, f"{ROOT}/Animation")
    rows = np.stack([weights.get(name, np.zeros(count)) for name in names], axis=1)
    animation.CreateBlendShapesAttr(list(names))
    shown = animation.CreateBlendShapeWeightsAttr()
    for frame, row in enumerate(rows):
        shown.Set(Vt.FloatArray.FromNumpy(row.astype(np.float32)), frame)
    animation.CreateJointsAttr(_joint_paths(puppet))
    animation.CreateTranslationsAttr(_vectors(np.array([joint.place for joint in puppet.skeleton])))
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * len(JOINTS)))
    rotations = animation.CreateRotationsAttr()
    for frame in range(count):
        rotations.Set(Vt.QuatfArray([_quaternion(turns, name, frame) for name in JOINTS]), frame)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])


def _quaternion(turns: Mapping[str, Array], name: str, frame: int) -> Any:
    if name not in turns:
        return Gf.Quatf(1.0)
    matrix = Gf.Matrix3d(*(float(value) for value in turns[name][frame].T.ravel()))  # USD multiplies row vectors
    return Gf.Quatf(matrix.ExtractRotation().GetQuat())
