# SPDX-License-Identifier: Apache-2.0
# Blender's side of speed.cycles: blender -b --factory-startup -P cycles.py -- FOLDER
# FOLDER contains scene.glb and view.json; writes fringes_K.png and seconds.json. Direct light only.
import json
import math
import sys
import time

import bpy
import numpy
from mathutils import Matrix

folder = sys.argv[sys.argv.index("--") + 1]
view = json.load(open(folder + "/view.json"))

numpy.bool = bool  # Blender 3.4's glTF importer uses a name that Debian's numpy no longer has
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=folder + "/scene.glb")
for mesh in bpy.data.meshes:
    mesh.materials.clear()  # the default material: plain diffuse

scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.device = "CPU"
scene.cycles.samples = view["samples"]
scene.cycles.use_adaptive_sampling = False
scene.cycles.use_denoising = False
scene.cycles.max_bounces = 0
scene.render.threads_mode = "FIXED"
scene.render.threads = view["threads"]
scene.render.use_persistent_data = True  # the BVH is built once for all patterns
scene.render.resolution_x, scene.render.resolution_y = view["size"]
scene.render.resolution_percentage = 100
scene.render.image_settings.color_mode = "BW"
scene.view_settings.view_transform = "Standard"

# In Blender, cameras and lights look along -z with y up.
looks = Matrix.Diagonal((1, -1, -1, 1))


def place(name, data, world_from_device):
    item = bpy.data.objects.new(name, data)
    item.matrix_world = Matrix(world_from_device) @ looks
    scene.collection.objects.link(item)
    return item


camera = bpy.data.cameras.new("camera")
camera.sensor_fit = "HORIZONTAL"
camera.sensor_width = 36
camera.lens = 36 * view["camera"]["fx"] / view["size"][0]
camera.clip_start = 0.01
scene.camera = place("camera", camera, view["camera"]["world_from_device"])

# A lamp whose strength depends on the direction: 1/2 + 1/2 cos(2 pi u / p + shift), u = fx x / z.
lamp = bpy.data.lights.new("projector", "POINT")
lamp.energy = 100
lamp.shadow_soft_size = 0
lamp.use_nodes = True
nodes, links = lamp.node_tree.nodes, lamp.node_tree.links
emission = next(n for n in nodes if n.type == "EMISSION")
direction = nodes.new("ShaderNodeTexCoord")
parts = nodes.new("ShaderNodeSeparateXYZ")
links.new(direction.outputs["Normal"], parts.inputs[0])


def calculate(operation, a, b):
    node = nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, (a, b)):
        if isinstance(value, (int, float)):
            socket.default_value = value
        elif value is not None:
            links.new(value, socket)
    return node.outputs[0]


slope = calculate("DIVIDE", parts.outputs[0], parts.outputs[2])
phase = calculate("MULTIPLY", slope, 2 * math.pi * view["projector"]["fx"] / view["period_px"])
shifted = calculate("ADD", phase, 0.0)
links.new(calculate("MULTIPLY_ADD", calculate("COSINE", shifted, None), 0.5), emission.inputs["Strength"])
for node in nodes:
    if node.type == "MATH" and node.operation == "MULTIPLY_ADD":
        node.inputs[2].default_value = 0.5
shift = next(n for n in nodes if n.type == "MATH" and n.operation == "ADD").inputs[1]
place("projector", lamp, view["projector"]["world_from_device"])

seconds = []
for k in range(-1, view["images"]):  # the first one is a warm-up
    shift.default_value = 2 * math.pi * (k - 1) / 3
    scene.render.filepath = "%s/fringes_%d.png" % (folder, max(k, 0))
    start = time.monotonic()
    bpy.ops.render.render(write_still=False)
    if k >= 0:
        seconds.append(time.monotonic() - start)
bpy.ops.render.render(write_still=True)
json.dump(seconds, open(folder + "/seconds.json", "w"))
