"""Draw a head with weights of shapes in Blender: ``blender -b -P show_blender.py -- head.glb poses.json``."""

import json
import sys
from pathlib import Path

import bpy
import numpy

numpy.bool = bool  # Debian's add-on asks for it, and Debian's NumPy has it no more
avatar, poses = map(Path, sys.argv[-2:])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=str(avatar))
scene = bpy.context.scene
eyes = numpy.mean([bone.head_local for bone in bpy.data.armatures[0].bones if bone.name.endswith("Eye")], axis=0)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.location = (eyes[0] + 0.08, eyes[1] - 0.75, eyes[2] - 0.04)
camera.rotation_euler = (numpy.pi / 2, 0.0, 0.1)
camera.data.lens = 60
light = bpy.data.objects.new("light", bpy.data.lights.new("light", "SUN"))
light.data.energy = 2.5
light.rotation_euler = (0.9, 0.0, 0.3)
for one in (camera, light):
    scene.collection.objects.link(one)
scene.camera = camera
scene.world = bpy.data.worlds.new("world")
scene.world.color = (0.6, 0.6, 0.6)
scene.render.engine = "CYCLES"
scene.cycles.samples, scene.cycles.use_denoising = 8, False
scene.render.resolution_x = scene.render.resolution_y = 480
for pose in json.loads(poses.read_text()):
    for one in bpy.data.objects:
        if one.type == "MESH" and one.data.shape_keys:
            for block in one.data.shape_keys.key_blocks:
                block.value = pose["weights"].get(block.name, 0.0)
    scene.render.filepath = str(avatar.parent / f"blender-{pose['name']}.png")
    bpy.ops.render.render(write_still=True)
