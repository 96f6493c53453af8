"""One peer of the renderer, in its own process: draws the same moving mesh and times itself.

    python bench/render_peers.py NAME FOLDER

``FOLDER/mesh.npz`` holds ``positions`` (T, V, 3) mm, ``normals`` (T, V, 3), ``colours`` (V, 3) sRGB 0..255,
``triangles`` and ``size``. The first line written is ``ready``; then each line read, a number of frames, is answered
with the seconds that they took. ``FOLDER/NAME.npy`` is a picture, to see that the head is there. Every peer gets moved
vertices and turned normals ready-made (it does not have to deform) and hands over an array of one picture a frame.
This file imports nothing of the product, so that any interpreter can run it.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np

DISTANCE_MM, FIELD_DEG = 900.0, 18.5
TARGET_MM = (0.0, 10.0, 30.0)
EYE_MM = (0.0, 10.0, 930.0)


def pyvista(data, smooth=False):
    import pyvista as pv
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    triangles = np.concatenate([np.full((len(data["triangles"]), 1), 3), data["triangles"]], axis=1)
    mesh = pv.PolyData(data["positions"][0], triangles.ravel())
    mesh.point_data["colours"] = data["colours"]
    normals = pv.convert_array(data["normals"][0].copy(), name="normals")
    mesh.GetPointData().SetNormals(normals)
    width, height = map(int, data["size"])
    plotter = pv.Plotter(off_screen=True, window_size=(width, height))
    actor = plotter.add_mesh(mesh, scalars="colours", rgb=True)
    actor.prop.interpolation = "phong"
    plotter.camera_position = [EYE_MM, TARGET_MM, (0, 1, 0)]
    plotter.camera.view_angle = FIELD_DEG
    if smooth:
        plotter.enable_anti_aliasing("fxaa")
    else:
        plotter.disable_anti_aliasing()
    plotter.show(auto_close=False, interactive=False)
    pixels = vtk.vtkUnsignedCharArray()

    def draw(points, turned):
        mesh.points = points
        vtk_to_numpy(normals)[:] = turned
        normals.Modified()
        plotter.render_window.Render()
        plotter.render_window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        return vtk_to_numpy(pixels).reshape(height, width, 3)[::-1]

    return draw


def pygfx(data, **smoothing):
    import pygfx as gfx
    from rendercanvas.offscreen import RenderCanvas

    width, height = map(int, data["size"])
    canvas = RenderCanvas(size=(width, height), pixel_ratio=1, update_mode="manual", max_fps=10000)
    renderer = gfx.WgpuRenderer(canvas, **smoothing)
    colours = np.concatenate([data["colours"] / 255, np.ones((len(data["colours"]), 1))], axis=1).astype("f4")
    geometry = gfx.Geometry(
        positions=data["positions"][0].copy(),
        normals=data["normals"][0].copy(),
        colors=colours,
        indices=data["triangles"],
    )
    scene = gfx.Scene()
    scene.add(gfx.Mesh(geometry, gfx.MeshPhongMaterial(color_mode="vertex")), gfx.AmbientLight(intensity=0.3))
    camera = gfx.PerspectiveCamera(FIELD_DEG, width / height, depth_range=(100, 3000))
    camera.local.position = EYE_MM
    camera.look_at(TARGET_MM)
    light = gfx.DirectionalLight(intensity=1.2)
    light.local.position = (-420, 520, 745)
    scene.add(light)
    canvas.request_draw(lambda: renderer.render(scene, camera))

    def draw(points, turned):
        geometry.positions.data[:], geometry.normals.data[:] = points, turned
        geometry.positions.update_full()
        geometry.normals.update_full()
        return np.asarray(canvas.draw())[..., :3]

    return draw


def vispy(data):
    os.environ["EGL_PLATFORM"] = "surfaceless"
    from vispy import app, scene

    app.use_app("egl")
    width, height = map(int, data["size"])
    canvas = scene.SceneCanvas(size=(width, height), show=False, bgcolor="grey")
    view = canvas.central_widget.add_view()
    colours = np.concatenate([data["colours"] / 255, np.ones((len(data["colours"]), 1))], axis=1).astype("f4")

    def turned(points):  # vispy's own camera looks along y, with z up
        return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=-1) - (0, -TARGET_MM[2], TARGET_MM[1])

    visual = scene.visuals.Mesh(
        turned(data["positions"][0]), data["triangles"], vertex_colors=colours, shading="smooth", parent=view.scene
    )
    view.camera = scene.cameras.TurntableCamera(fov=FIELD_DEG, elevation=0, azimuth=0)
    view.camera.set_range(x=(-150, 150), y=(-150, 150), z=(-150, 150))
    view.camera.center, view.camera.distance = (0, 0, 0), DISTANCE_MM
    view.camera.depth_value = 30  # its buffer is too shallow for the usual million

    def draw(points, _):  # it makes its own normals
        visual.set_data(turned(points), data["triangles"], vertex_colors=colours)
        return canvas.render()[..., :3]

    return draw


def pyrender(data):
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    np.infty = np.inf  # noqa: NPY201  pyrender 0.1.45 is older than numpy 2
    import pyrender as pr

    width, height = map(int, data["size"])
    scene = pr.Scene(bg_color=(0.5, 0.5, 0.5), ambient_light=(0.3, 0.3, 0.3))
    pose = np.eye(4)
    pose[:3, 3] = EYE_MM
    view = pr.PerspectiveCamera(yfov=np.deg2rad(FIELD_DEG), aspectRatio=width / height, znear=100, zfar=3000)
    scene.add(view, pose=pose)
    scene.add(pr.DirectionalLight(intensity=4.0), pose=pose)
    renderer = pr.OffscreenRenderer(width, height)
    colours = np.concatenate([data["colours"] / 255, np.ones((len(data["colours"]), 1))], axis=1).astype("f4")
    shown = []

    def draw(points, turned):
        if shown:
            scene.remove_node(shown.pop())
        primitive = pr.Primitive(points, turned, color_0=colours, indices=data["triangles"])
        shown.append(scene.add(pr.Mesh([primitive])))
        return renderer.render(scene)[0]

    return draw


PEERS = {
    "PyVista": lambda data: pyvista(data, smooth=True),
    "PyVista, bare": pyvista,
    "pygfx": lambda data: pygfx(data, pixel_scale=1, ppaa="fxaa"),
    "pygfx, default settings": pygfx,
    "pygfx, bare": lambda data: pygfx(data, pixel_scale=1, ppaa="none"),
    "vispy, bare": vispy,
    "pyrender": pyrender,
}
"""Bare: without anti-aliasing. PyVista and pygfx have a softening pass like ours; pyrender always multisamples."""


def main() -> None:
    name, folder = sys.argv[1], Path(sys.argv[2])
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what the peer prints is no answer
    with np.load(folder / "mesh.npz") as file:
        data = {key: file[key] for key in file.files}
    draw = PEERS[name](data)
    frames = list(zip(data["positions"], data["normals"], strict=True))
    for frame in frames:
        picture = draw(*frame)
    np.save(folder / f"{name}.npy", picture)
    answers.write("ready\n")
    for line in sys.stdin:
        started = time.perf_counter()
        for frame in range(int(line)):
            draw(*frames[frame % len(frames)])
        answers.write(f"{time.perf_counter() - started}\n")


if __name__ == "__main__":
    main()
