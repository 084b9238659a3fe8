"""Three scenes made by script, for Cycles and fanal side by side."""

import math

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

SIZE = (160, 120)


def begin(samples, bounces=6):
    """An empty scene with Cycles set to compute what fanal computes: nothing clamped, filtered or left out."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    cycles = scene.cycles
    cycles.samples, cycles.seed = samples, 1
    cycles.use_denoising = cycles.use_adaptive_sampling = cycles.use_light_tree = False
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = cycles.light_sampling_threshold = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.volume_bounces, cycles.transparent_max_bounces = bounces, 64
    # No roulette but at the very end.
    cycles.min_light_bounces = cycles.min_transparent_bounces = bounces
    scene.view_settings.view_transform = "Raw"
    return scene


def link(object):
    bpy.context.scene.collection.objects.link(object)
    return object


def material(name, kind="ShaderNodeBsdfPrincipled", **values):
    """A material of one shader with these inputs; returns it, its tree and the shader node."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    output, shader = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new(kind)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    if "Distribution" in values:
        shader.distribution = values.pop("Distribution")
    for key, value in values.items():
        socket = shader.inputs[key.replace("_", " ")]
        socket.default_value = (*value, 1.0) if socket.type == "RGBA" else value
    return made, tree, shader


def image(name, pixels, color=True):
    """A packed PNG of `pixels` (rows from the top, columns, 3), in sRGB if it is a colour's."""
    height, width, _ = pixels.shape
    made = bpy.data.images.new(name, width, height)
    made.colorspace_settings.name = "sRGB" if color else "Non-Color"
    whole = np.concatenate([pixels[::-1], np.ones((height, width, 1))], axis=2).astype(np.float32)
    made.pixels.foreach_set(whole.ravel())
    made.file_format = "PNG"
    made.pack()
    return made


def textured(tree, shader, socket, picture, **settings):
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = picture
    for key, value in settings.items():
        setattr(node, key, value)
    tree.links.new(node.outputs["Color"], shader.inputs[socket])
    return node


def normal_mapped(tree, shader, picture, strength=1.0):
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.inputs["Strength"].default_value = strength
    textured(tree, node, "Color", picture)
    tree.links.new(node.outputs["Normal"], shader.inputs["Normal"])


def mapped(tree, node, **inputs):
    """A Mapping of UV coordinates before a texture node."""
    mapping, coordinates = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    for key, value in inputs.items():
        mapping.inputs[key].default_value = value
    tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])


def camera(name, location, target, lens=35.0, **settings):
    data = bpy.data.cameras.new(name)
    data.lens = lens
    for key, value in settings.items():
        setattr(data, key, value)
    made = link(bpy.data.objects.new(name, data))
    ahead = Vector(target) - Vector(location)
    made.matrix_world = Matrix.Translation(location) @ ahead.to_track_quat("-Z", "Y").to_matrix().to_4x4()
    return made


def light(kind, name, location, energy, target=None, **settings):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    for key, value in settings.items():
        setattr(data, key, value)
    made = link(bpy.data.objects.new(name, data))
    made.location = location
    if target is not None:
        made.rotation_euler = (Vector(target) - Vector(location)).to_track_quat("-Z", "Y").to_euler()
    # Lamps of Blender are hidden from cameras at first; what fanal has are surfaces.
    made.visible_camera = True
    return made


def box(name, location, size, made, rotation=(0, 0, 0)):
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=location, rotation=rotation)
    object = bpy.context.object
    object.name, object.scale = name, size
    object.data.materials.append(made)
    return object


def ball(name, location, radius, made, smooth=True):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, location=location, segments=48, ring_count=24)
    object = bpy.context.object
    object.name = name
    if smooth:
        bpy.ops.object.shade_smooth()
    object.data.materials.append(made)
    return object


def plane(name, location, size, made, rotation=(0, 0, 0)):
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=location, rotation=rotation)
    object = bpy.context.object
    object.name, object.scale = name, (*size, 1.0)
    object.data.materials.append(made)
    return object


def bricks(size=64):
    """A picture of a wall: bright and dark bricks, no two sides alike."""
    y, x = np.mgrid[0:size, 0:size] / size
    row = np.floor(y * 8)
    joint = (((x * 4 + 0.5 * (row % 2)) % 1.0) < 0.08) | ((y * 8) % 1.0 < 0.12)
    shade = 0.35 + 0.3 * x + 0.2 * np.sin(row * 3.1 + np.floor(x * 4 + 0.5 * (row % 2)) * 1.7)
    color = np.stack([shade, 0.6 * shade, 0.45 * shade * (0.4 + y)], axis=2)
    return np.where(joint[:, :, None], 0.75, color)


def bumps(size=64):
    """A normal map of waves, slanted so that it has no symmetry."""
    y, x = np.mgrid[0:size, 0:size] / size
    u, v = x, 1.0 - y
    slope = 0.35 * np.cos(2 * math.pi * (3 * u + 2 * v))
    normal = np.stack([-3 * slope / 3, -2 * slope / 3, np.ones_like(u)], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return normal * 0.5 + 0.5


def sky(width=128, height=64):
    """Radiance all around: a gradient and a few coloured patches, no two directions alike; rows from the top."""
    y, x = np.mgrid[0:height, 0:width]
    elevation = 1.0 - 2.0 * (y + 0.5) / height
    around = (x + 0.5) / width
    out = np.stack([0.25 + 0.1 * elevation, 0.3 + 0.15 * elevation, 0.4 + 0.3 * elevation], axis=2)
    out[elevation < 0] *= 0.4
    for u, e, color in [(0.1, 0.5, (3, 1, 0.5)), (0.45, 0.3, (0.4, 2.5, 0.6)), (0.8, 0.7, (0.5, 0.8, 4.0))]:
        near = np.exp(-(((around - u) / 0.04) ** 2 + ((elevation - e) / 0.1) ** 2))
        out += near[:, :, None] * np.array(color)
    return out


def room(samples):
    """A room with an area light and a soft point light: textured, tiled and mapped furniture, a window pane and a ball of glass."""
    scene = begin(samples)
    white, _, _ = material("white", "ShaderNodeBsdfDiffuse", Color=(0.75, 0.73, 0.7))
    red, _, _ = material("red", "ShaderNodeBsdfDiffuse", Color=(0.6, 0.12, 0.1))
    plane("floor", (0, 0, 0), (4, 4), white)
    plane("ceiling", (0, 0, 3), (4, 4), white, (math.pi, 0, 0))
    plane("left", (-2, 0, 1.5), (3, 4), red, (0, math.pi / 2, 0))
    plane("right", (2, 0, 1.5), (3, 4), white, (0, -math.pi / 2, 0))
    wall, tree, shader = material("wall", Roughness=0.6)
    mapped(tree, textured(tree, shader, "Base Color", image("bricks", bricks(256))), Scale=(2.0, 1.5, 1.0), Rotation=(0, 0, 0.3))
    plane("back", (0, 2, 1.5), (4, 3), wall, (math.pi / 2, 0, 0))
    wood, tree, shader = material("wood", Roughness=0.4)
    textured(tree, shader, "Base Color", image("planks", bricks(256)[:, ::-1].copy()))
    normal_mapped(tree, shader, image("waves", bumps(), color=False))
    box("table", (0.6, 0.4, 0.4), (1.2, 0.9, 0.8), wood, (0, 0, 0.4))
    box("shelf", (-1.3, 1.2, 0.7), (-0.8, 0.6, 1.4), wood, (0, 0, -0.2))
    glass, _, _ = material("glass", "ShaderNodeBsdfGlass", Roughness=0.0, IOR=1.5, Color=(0.95, 1.0, 0.97))
    ball("glass ball", (0.55, 0.3, 1.12), 0.32, glass)
    satin, _, _ = material("satin", Base_Color=(0.2, 0.35, 0.7), Roughness=0.3)
    ball("blue ball", (-0.6, -0.4, 0.4), 0.4, satin)
    gold, _, _ = material("gold", Base_Color=(0.9, 0.6, 0.25), Roughness=0.25, Metallic=1.0)
    ball("gold ball", (-1.3, 1.2, 1.65), 0.25, gold)
    light("AREA", "lamp", (0.3, 0.2, 2.95), 40.0, shape="RECTANGLE", size=1.2, size_y=0.8)
    light("POINT", "bulb", (-1.4, -0.6, 1.9), 12.0, shadow_soft_size=0.12, color=(1.0, 0.75, 0.5))
    scene.camera = camera("eye", (0.2, -4.6, 1.5), (0, 0, 1.35), lens=30.0)
    return scene


def outdoors(samples):
    """Instances, some mirrored, on a plane under the sun and a picture of the sky, which is turned."""
    scene = begin(samples)
    ground, tree, shader = material("ground", Roughness=0.8, Specular_IOR_Level=0.3)
    mapped(tree, textured(tree, shader, "Base Color", image("ground", bricks(256))), Scale=(6, 6, 1))
    plane("ground", (0, 0, 0), (30, 30), ground)
    # An arrow has neither symmetry; half of the instances are mirrored.
    arrow = bpy.data.meshes.new("arrow")
    arrow.from_pydata([(0, 0, 0), (0.3, 0, 0), (0.3, 0.2, 0.9), (0.6, 0.1, 0.9), (0.1, 0.1, 1.6), (-0.25, 0.1, 0.9), (0, 0.2, 0.9),
                       (0.15, 0.4, 0)], [], [(0, 1, 2, 6), (1, 7, 2), (7, 0, 6), (7, 6, 2), (6, 2, 3, 4, 5), (5, 4, 3, 2, 6), (0, 7, 1)])
    leaf, _, _ = material("leaf", "ShaderNodeBsdfDiffuse", Color=(0.2, 0.5, 0.15))
    arrow.materials.append(leaf)
    group = bpy.data.collections.new("trees")
    group.objects.link(bpy.data.objects.new("tree", arrow))
    stone, _, _ = material("stone", Base_Color=(0.5, 0.45, 0.4), Roughness=0.7)
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.25, subdivisions=2, location=(0.6, -0.4, 0.2))
    rock = bpy.context.object
    rock.data.materials.append(stone)
    scene.collection.objects.unlink(rock)
    group.objects.link(rock)
    for i, (x, y, turn, scale) in enumerate([(-2, 1, 0, (1, 1, 1)), (0, 2, 1.2, (-1, 1, 1.3)), (2, 0.5, 2.5, (1.4, 1.2, -1)),
                                             (-1, -1, 4, (0.8, 0.8, 0.8)), (1.2, -1.2, 5, (-0.9, 0.9, 0.9))]):
        empty = link(bpy.data.objects.new(f"place {i}", None))
        empty.instance_type, empty.instance_collection = "COLLECTION", group
        empty.matrix_world = Matrix.LocRotScale(Vector((x, y, 1.9 if scale[2] < 0 else 0)), Euler((0, 0, turn)), Vector(scale))
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.extrude, curve.size = "F", 0.1, 1.2
    curve.materials.append(stone)
    letter = link(bpy.data.objects.new("letter", curve))
    letter.location, letter.rotation_euler = (-0.6, -2.2, 0.02), (math.pi / 2, 0, 0.2)
    light("SUN", "sun", (0, 0, 5), 2.5, target=(3, 2, 0), angle=math.radians(2.0), color=(1.0, 0.9, 0.8))
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    tree = world.node_tree
    picture = bpy.data.images.new("sky", 128, 64, float_buffer=True)
    picture.pixels.foreach_set(np.concatenate([sky()[::-1], np.ones((64, 128, 1))], axis=2).astype(np.float32).ravel())
    environment = tree.nodes.new("ShaderNodeTexEnvironment")
    environment.image = picture
    mapping, coordinates = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value = (0.15, 0.1, 0.9)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], environment.inputs["Vector"])
    background = tree.nodes["Background"]
    background.inputs["Strength"].default_value = 1.3
    tree.links.new(environment.outputs["Color"], background.inputs["Color"])
    scene.world = world
    scene.camera = camera("eye", (1.5, -8, 3), (0, 0, 0.9), lens=32.0)
    return scene


def product(samples):
    """A product shot: metals, a coat, frosted glass and a mask under spots, with a lens in focus and a shifted picture."""
    scene = begin(samples)
    paper, _, _ = material("paper", "ShaderNodeBsdfDiffuse", Color=(0.8, 0.8, 0.8))
    plane("table", (0, 0, 0), (8, 8), paper)
    plane("back", (0, 3, 2), (8, 4), paper, (math.pi / 2, 0, 0))
    steel, _, _ = material("steel", "ShaderNodeBsdfMetallic", Roughness=0.3, Distribution="GGX", Base_Color=(0.6, 0.62, 0.65),
                           Edge_Tint=(1, 1, 1))
    ball("steel", (-1.2, 0.3, 0.6), 0.6, steel)
    mirror, _, _ = material("mirror", "ShaderNodeBsdfAnisotropic", Roughness=0.35, Distribution="GGX", Color=(0.85, 0.75, 0.5))
    box("mirror", (1.6, 1.0, 0.6), (0.5, 0.5, 1.2), mirror, (0, 0, 0.5))
    coated, _, _ = material("lacquer", Base_Color=(0.5, 0.05, 0.04), Roughness=0.8, Coat_Weight=1.0, Coat_Roughness=0.15,
                            Specular_IOR_Level=0.0)
    ball("lacquer", (0.3, -0.3, 0.5), 0.5, coated)
    frosted, _, _ = material("frosted", "ShaderNodeBsdfGlass", Roughness=0.35, IOR=1.4, Distribution="GGX", Color=(0.9, 0.95, 1.0))
    box("frosted", (1.2, -0.7, 0.34), (0.6, 0.3, 0.6), frosted, (0, 0, -0.3))
    leaf, tree, shader = material("leaf", Base_Color=(0.3, 0.5, 0.2), Roughness=0.5)
    y, x = np.mgrid[0:32, 0:32] / 32.0
    hole = np.repeat(((x - 0.4) ** 2 + (y - 0.3) ** 2 > 0.06)[:, :, None].astype(float), 3, axis=2)
    textured(tree, shader, "Alpha", image("hole", hole, color=False), interpolation="Closest")
    plane("leaf", (-0.4, 1.2, 0.9), (1.2, 1.2), leaf, (math.pi / 2, 0, -0.3))
    light("SPOT", "key", (-2.5, -3, 4), 900.0, target=(-0.3, 0.2, 0.4), spot_size=math.radians(38), spot_blend=0.0,
          shadow_soft_size=0.0)
    light("SPOT", "rim", (3, 1.5, 3.5), 400.0, target=(0.3, 0, 0.4), spot_size=math.radians(60), spot_blend=0.4,
          shadow_soft_size=0.0, color=(0.6, 0.7, 1.0))
    light("AREA", "fill", (2.5, -4, 3), 60.0, target=(0, 0, 0.5), shape="DISK", size=1.5)
    eye = camera("eye", (0, -6, 2.2), (0, 0, 0.6), lens=50.0, shift_x=0.08, shift_y=-0.12)
    eye.data.dof.use_dof = True
    eye.data.dof.aperture_fstop, eye.data.dof.focus_distance = 0.5, 6.0
    scene.camera = eye
    return scene


ALL = {"room": room, "outdoors": outdoors, "product": product}
