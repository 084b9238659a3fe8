"""What the exported folder holds, and what fanal shows of it. FANAL names the program; Cycles is not asked."""

import json
import math
import os
import subprocess
import sys
import tempfile
import unittest

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.dirname(HERE)]

import scenes  # noqa: E402
from compare import read  # noqa: E402
from fanal_blender import albedo, arithmetic, files  # noqa: E402
from fanal_blender import export as exporting  # noqa: E402
from fanal_blender.lights import linear_edge  # noqa: E402

FANAL = os.environ["FANAL"]
WHITE = [1.0, 1.0, 1.0]


class Case(unittest.TestCase):
    def setUp(self):
        self.scene = scenes.begin(16)
        self.scene.render.resolution_x = self.scene.render.resolution_y = 32
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def export(self, **options):
        """The scene file and the warnings."""
        self.report = exporting.export_scene(self.folder, exporting.Options(**options))
        with open(self.report.scene) as file:
            return json.load(file), self.report.warnings

    def render(self, spp=16, size=None):
        """What fanal shows of the scene."""
        self.export(samples=spp, size=size, all_cameras=False)
        picture = os.path.join(self.folder, "out.exr")
        subprocess.run([FANAL, "render", self.report.scene, "-o", picture, "--guide", "none", "--quiet"], check=True)
        return read(picture)

    def world(self, radiance=(1.0, 1.0, 1.0)):
        self.scene.world = bpy.data.worlds.new("world")
        self.scene.world.color = radiance

    def glowing(self, name, color, strength=1.0):
        return scenes.material(name, "ShaderNodeEmission", Color=color, Strength=strength)[0]


class Cameras(Case):
    """Three small lights are where Blender says that they are, whatever the camera."""

    POINTS = {(1.0, 0.0, 0.0): (0.9, 0.3, 0.3), (0.0, 0.9, 0.1): (0.0, 1.1, -0.2), (0.0, 0.0, 1.0): (-0.4, 0.2, 0.9)}

    def check(self, size=(48, 32), **settings):
        for i, (color, place) in enumerate(self.POINTS.items()):
            scenes.ball(f"dot {i}", place, 0.1, self.glowing(f"dot {i}", color), smooth=False)
        self.scene.render.resolution_x, self.scene.render.resolution_y = size
        eye = scenes.camera("eye", (3.0, -4.0, 2.0), (0.1, 0.4, 0.2), **settings)
        eye.matrix_world = eye.matrix_world @ Matrix.Rotation(0.4, 4, "Z")
        self.scene.camera = eye
        bpy.context.view_layer.update()
        picture = self.render(64)
        rows, columns = np.mgrid[0 : size[1], 0 : size[0]] + 0.5
        for color, place in self.POINTS.items():
            x, y, _ = world_to_camera_view(self.scene, eye, Vector(place))
            weight = picture[:, :, int(np.argmax(color))] - 0.5 * picture.sum(axis=2) * (max(color) < 1.0)
            weight = np.where(picture.argmax(axis=2) == int(np.argmax(color)), np.maximum(weight, 0.0), 0.0)
            self.assertGreater(weight.sum(), 0.5, "it is not seen")
            center = (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()
            self.assertAlmostEqual(center[0], x * size[0], delta=0.35)
            self.assertAlmostEqual(center[1], (1.0 - y) * size[1], delta=0.35)

    def test_wide(self):
        self.check(lens=50.0)

    def test_upright(self):
        self.check(size=(32, 48), lens=50.0)

    def test_sensors_and_shifts(self):
        self.check(lens=40.0, sensor_fit="VERTICAL", sensor_height=20.0, shift_x=0.1, shift_y=-0.15)

    def test_upright_shifted(self):
        self.check(size=(32, 48), lens=45.0, shift_x=-0.1, shift_y=0.08)

    def test_orthographic(self):
        self.check(type="ORTHO", ortho_scale=4.0, shift_x=0.05, shift_y=0.1)

    def test_lens_and_names(self):
        self.scene.camera = scenes.camera("eye", (0, -4, 0), (0, 0, 0), lens=50.0)
        target = scenes.link(bpy.data.objects.new("target", None))
        target.location = (1.0, -1.5, 0.3)
        dof = self.scene.camera.data.dof
        dof.use_dof, dof.aperture_fstop, dof.focus_object = True, 2.0, target
        scenes.camera("other", (0, -9, 0), (0, 0, 0), lens=36.0)
        scene, _ = self.export()
        self.assertAlmostEqual(scene["camera"]["aperture_radius"], 0.0125)
        self.assertAlmostEqual(scene["camera"]["focus_distance"], 2.5, places=5)
        self.assertEqual(list(scene["cameras"]), ["other"])
        self.assertAlmostEqual(scene["cameras"]["other"]["fov"], math.degrees(2 * math.atan(0.5)), places=4)
        self.assertNotIn("cameras", self.export(all_cameras=False)[0])


class Shapes(Case):
    def test_instances_share_a_mesh(self):
        made, _, _ = scenes.material("grey", "ShaderNodeBsdfDiffuse")
        first = scenes.box("box", (0, 0, 0), (1, 1, 1), made)
        second = scenes.link(bpy.data.objects.new("copy", first.data))
        second.matrix_world = Matrix.LocRotScale(Vector((2, 0, 0)), None, Vector((-1, 1, 2)))
        self.scene.camera = scenes.camera("eye", (0, -9, 0), (0, 0, 0))
        scene, _ = self.export()
        self.assertEqual(len(scene["shapes"]), 2)
        self.assertEqual(len({shape["geometry"]["mesh"] for shape in scene["shapes"]}), 1)
        np.testing.assert_allclose(scene["shapes"][1]["to_world"], [-1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1], atol=1e-6)
        self.assertEqual(len(os.listdir(os.path.join(self.folder, "meshes"))), 1)

    def test_mirrored_transforms_keep_their_fronts(self):
        """A closed lamp shines outwards, mirrored or not."""
        for scale in [(1, 1, 1), (-1, 1, 1), (-1, -1, -1)]:
            self.scene = scenes.begin(16)
            self.scene.render.resolution_x = self.scene.render.resolution_y = 8
            scenes.box("box", (0, 0, 0), scale, self.glowing("glow", (0.2, 0.4, 0.6), 2.0))
            self.scene.camera = scenes.camera("eye", (0, -3, 0), (0, 0, 0), lens=100.0)
            np.testing.assert_allclose(self.render(4).mean(axis=(0, 1)), [0.4, 0.8, 1.2], rtol=1e-4)

    def test_open_lamps_shine_on_both_sides(self):
        scenes.plane("plane", (0, 0, 0), (4, 4), self.glowing("glow", WHITE, 3.0))
        for z in (3.0, -3.0):
            self.scene.camera = scenes.camera("eye", (0, 0, z), (0, 0, 0), lens=100.0)
            np.testing.assert_allclose(self.render(4).mean(), 3.0, rtol=1e-4)

    def test_closed_lamps_shine_inside_where_something_is(self):
        """A dome shines on the camera or the object within it; one that holds neither, or is of glass, has one sheet."""
        def faces(eye, place, made):
            self.scene = scenes.begin(16)
            scenes.ball("dome", (0, 0, 0), 5.0, made(), smooth=False)
            scenes.box("box", place, (1, 1, 1), scenes.material("grey", "ShaderNodeBsdfDiffuse")[0])
            self.scene.camera = scenes.camera("eye", eye, (0, 0, 9), lens=100.0)
            shapes = {shape["name"]: shape for shape in self.export()[0]["shapes"]}
            with open(os.path.join(self.folder, "meshes", shapes["dome"]["geometry"]["mesh"] + ".ply"), "rb") as file:
                return int(file.read().split(b"element face ")[1].split()[0])

        glow = lambda: self.glowing("glow", WHITE, 3.0)
        glass = lambda: scenes.material("glass", Transmission_Weight=1.0, Emission_Color=WHITE, Emission_Strength=1.0)[0]
        one = faces((0, -20, 0), (0, -9, 0), glow)
        self.assertEqual(faces((0, 0, 0), (0, -9, 0), glow), 2 * one)
        # The picture of the camera within.
        self.scene.render.resolution_x = self.scene.render.resolution_y = 8
        np.testing.assert_allclose(self.render(4).mean(), 3.0, rtol=1e-4)
        self.assertEqual(faces((0, -20, 0), (0, 0, 0), glow), 2 * one)
        self.assertEqual(faces((0, 0, 0), (0, -9, 0), glass), one)

    def test_flat_and_smooth(self):
        made, _, _ = scenes.material("grey", "ShaderNodeBsdfDiffuse")
        scenes.ball("smooth", (0, 0, 0), 1.0, made)
        scenes.ball("flat", (3, 0, 0), 1.0, made, smooth=False)
        self.scene.camera = scenes.camera("eye", (0, -9, 0), (0, 0, 0))
        scene, _ = self.export()
        flat = [scene["meshes"][shape["geometry"]["mesh"]].get("face_normals", False) for shape in scene["shapes"]]
        self.assertEqual([shape["name"] for shape in scene["shapes"]], ["flat", "smooth"] if flat[0] else ["smooth", "flat"])
        self.assertEqual(sorted(flat), [False, True])

    def test_what_is_rendered_is_exported(self):
        """Visibility and modifiers are those of renders, and stay as they were."""
        made, _, _ = scenes.material("grey", "ShaderNodeBsdfDiffuse")
        boxes = [scenes.box(name, (i, 0, 0), (0.5, 0.5, 0.5), made) for i, name in enumerate(["unrendered", "unviewed", "closed eye"])]
        boxes[0].hide_render, boxes[1].hide_viewport = True, True
        boxes[2].hide_set(True)
        modifier = boxes[2].modifiers.new("array", "ARRAY")
        modifier.count, modifier.show_viewport = 3, False
        self.scene.camera = scenes.camera("eye", (0, -9, 0), (0, 0, 0))
        scene, _ = self.export()
        self.assertEqual(sorted(shape["name"] for shape in scene["shapes"]), ["closed eye", "unviewed"])
        of_array = next(shape["geometry"]["mesh"] for shape in scene["shapes"] if shape["name"] == "closed eye")
        with open(os.path.join(self.folder, "meshes", of_array + ".ply"), "rb") as file:
            self.assertIn(b"element face 36\n", file.read())
        self.assertEqual((boxes[0].hide_viewport, boxes[1].hide_viewport, boxes[2].hide_get(), modifier.show_viewport),
                         (False, True, True, False))

    def test_selection(self):
        made, _, _ = scenes.material("grey", "ShaderNodeBsdfDiffuse")
        scenes.box("one", (0, 0, 0), (1, 1, 1), made)
        scenes.box("two", (2, 0, 0), (1, 1, 1), made)
        self.scene.camera = scenes.camera("eye", (0, -9, 0), (0, 0, 0))
        bpy.data.objects["one"].select_set(False)
        self.assertEqual([shape["name"] for shape in self.export(selection=True)[0]["shapes"]], ["two"])

    def test_curves_and_metaballs(self):
        curve = bpy.data.curves.new("text", "FONT")
        curve.body, curve.extrude = "x", 0.1
        scenes.link(bpy.data.objects.new("text", curve))
        ball = bpy.data.metaballs.new("drop")
        ball.elements.new()
        scenes.link(bpy.data.objects.new("drop", ball))
        self.scene.camera = scenes.camera("eye", (0, -9, 0), (0, 0, 0))
        self.assertEqual({shape["name"] for shape in self.export()[0]["shapes"]}, {"text", "drop"})


class Materials(Case):
    def textured_plane(self, change=lambda tree, node: None, **settings):
        """A plane that fills the picture under a uniform sky, and so has the radiance of its albedo; four colours on it."""
        self.scene = scenes.begin(16)
        made, tree, shader = scenes.material("quarters", "ShaderNodeBsdfDiffuse")
        quarters = np.array([[(1, 0, 0), (0, 1, 0)], [(0, 0, 1), (1, 1, 0)]], float)
        node = scenes.textured(tree, shader, "Color", scenes.image("quarters", quarters), interpolation="Closest", **settings)
        change(tree, node)
        scenes.plane("plane", (0, 0, 0), (2, 2), made)
        self.world()
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0), type="ORTHO", ortho_scale=2.0)
        self.scene.camera.matrix_world = Matrix.Translation((0, 0, 5))
        picture = self.render(16, (32, 32))
        # Of 256 pixels each, whose mean is known to a percent.
        return np.round(picture.reshape(2, 16, 2, 16, 3).mean(axis=(1, 3)).reshape(4, 3), 1).tolist()

    def test_pictures_are_upright(self):
        self.assertEqual(self.textured_plane(), [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]])

    def test_mapping(self):
        """A quarter turn about the origin brings what was at the right to the top."""
        turned = self.textured_plane(lambda tree, node: scenes.mapped(tree, node, Rotation=(0, 0, -math.pi / 2)))
        self.assertEqual(turned, [[0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 1]])
        shifted = self.textured_plane(lambda tree, node: scenes.mapped(tree, node, Location=(0.5, 0, 0)))
        self.assertEqual(shifted, [[0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1]])

    def test_generated_coordinates(self):
        def generated(tree, node):
            tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], node.inputs["Vector"])

        self.assertEqual(self.textured_plane(generated), [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]])

    def test_nodes_between(self):
        """Inverted colours are a new picture, which is used where the old one was."""
        def inverted(tree, node):
            invert = tree.nodes.new("ShaderNodeInvert")
            target = node.outputs["Color"].links[0].to_socket
            tree.links.new(node.outputs["Color"], invert.inputs["Color"])
            tree.links.new(invert.outputs["Color"], target)

        self.assertEqual(self.textured_plane(inverted), [[0, 1, 1], [1, 0, 1], [1, 1, 0], [0, 0, 1]])

    def constant(self, build):
        """The diffuse colour that nodes make, as the scene file has it."""
        made, tree, shader = scenes.material("nodes", "ShaderNodeBsdfDiffuse")
        build(tree, shader.inputs["Color"])
        scenes.plane("plane", (0, 0, 0), (2, 2), made)
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0))
        scene, warnings = self.export()
        return scene["materials"]["nodes"]["material"]["reflectance"]["value"], warnings

    def test_constant_nodes(self):
        def build(tree, target):
            mix, gamma, math_node = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Mix", "Gamma", "Math"))
            mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
            mix.inputs["A_Color" if "A_Color" in mix.inputs else 6].default_value = (0.5, 0.8, 0.2, 1)
            mix.inputs[7].default_value = (0.5, 0.25, 1.0, 1)
            math_node.operation = "ADD"
            math_node.inputs[0].default_value, math_node.inputs[1].default_value = 0.25, 0.25
            tree.links.new(math_node.outputs[0], mix.inputs[0])
            gamma.inputs["Gamma"].default_value = 2.0
            tree.links.new(mix.outputs[2], gamma.inputs["Color"])
            tree.links.new(gamma.outputs["Color"], target)

        value, warnings = self.constant(build)
        np.testing.assert_allclose(value, np.array([0.5 * 0.75, 0.8 * 0.625, 0.2]) ** 2, rtol=1e-5)
        self.assertEqual(warnings, [])

    def test_groups(self):
        def build(tree, target):
            group = bpy.data.node_groups.new("half", "ShaderNodeTree")
            group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
            group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
            begin, end, invert = (group.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeInvert"))
            group.links.new(begin.outputs[0], invert.inputs["Color"])
            group.links.new(invert.outputs[0], end.inputs[0])
            node = tree.nodes.new("ShaderNodeGroup")
            node.node_tree = group
            node.inputs[0].default_value = (0.1, 0.2, 0.3, 1.0)
            tree.links.new(node.outputs[0], target)

        np.testing.assert_allclose(self.constant(build)[0], [0.9, 0.8, 0.7], rtol=1e-5)

    def in_group(self, name, inner, socket, kind):
        """A group of one input that feeds `socket` of the node that `inner` makes, whose first output is the group's."""
        group = bpy.data.node_groups.new(name, "ShaderNodeTree")
        group.interface.new_socket("In", in_out="INPUT", socket_type=kind)
        group.interface.new_socket("Out", in_out="OUTPUT", socket_type=kind)
        begin, end, node = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput"), inner(group)
        group.links.new(begin.outputs[0], node.inputs[socket])
        group.links.new(node.outputs[0], end.inputs[0])

        def use(tree):
            made = tree.nodes.new("ShaderNodeGroup")
            made.node_tree = group
            return made

        return use

    def test_groups_within_groups(self):
        """The same inner group in two uses of an outer one is two things."""
        def build(tree, target):
            inner = self.in_group("inner", lambda tree: tree.nodes.new("ShaderNodeInvert"), "Color", "NodeSocketColor")
            outer = self.in_group("outer", inner, 0, "NodeSocketColor")
            mix = tree.nodes.new("ShaderNodeMix")
            mix.data_type = "RGBA"
            mix.inputs[0].default_value = 0.5
            for index, color in [(6, (0.1, 0.2, 0.3, 1.0)), (7, (0.5, 0.8, 0.9, 1.0))]:
                node = outer(tree)
                node.inputs[0].default_value = color
                tree.links.new(node.outputs[0], mix.inputs[index])
            tree.links.new(mix.outputs[2], target)

        np.testing.assert_allclose(self.constant(build)[0], [0.7, 0.5, 0.4], rtol=1e-5)

    def test_fresnel_in_a_group(self):
        """A coat's index is the group's input."""
        made, tree, shader = scenes.material("coated", "ShaderNodeMixShader")
        fresnel = self.in_group("edge", lambda tree: tree.nodes.new("ShaderNodeFresnel"), "IOR", "NodeSocketFloat")(tree)
        fresnel.inputs[0].default_value = 1.7
        base, coat = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeBsdfAnisotropic")
        base.inputs["Color"].default_value, coat.inputs["Roughness"].default_value = (0.5, 0.5, 0.5, 1.0), 0.0
        coat.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        for index, node in enumerate((fresnel, base, coat)):
            tree.links.new(node.outputs[0], shader.inputs[index])
        scenes.plane("plane", (0, 0, 0), (2, 2), made)
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0))
        plastic = self.export()[0]["materials"]["coated"]["material"]
        self.assertEqual(plastic["type"], "plastic")
        self.assertAlmostEqual(plastic["int_ior"], 1.7, places=5)

    def test_checker_is_over_generated_coordinates(self):
        made, tree, shader = scenes.material("squares", "ShaderNodeBsdfDiffuse")
        tree.links.new(tree.nodes.new("ShaderNodeTexChecker").outputs["Color"], shader.inputs["Color"])
        plane = scenes.plane("plane", (0, 0, 0), (2, 2), made)
        plane.data.uv_layers.remove(plane.data.uv_layers[0])
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0))
        scene, warnings = self.export()
        self.assertTrue(scene["meshes"]["Plane"]["flip_v"])
        self.assertEqual(len(warnings), 1)
        self.assertIn("two dimensions", warnings[0])

    def test_strengths_that_are_not_known(self):
        """They are 1 rather than 0, through other nodes too."""
        made, tree, shader = scenes.material("glow", "ShaderNodeEmission", Color=(0.25, 0.5, 1.0))
        unknown, times = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeMath")
        times.operation, times.inputs[1].default_value = "MULTIPLY", 4.0
        tree.links.new(unknown.outputs["Random"], times.inputs[0])
        tree.links.new(times.outputs[0], shader.inputs["Strength"])
        scenes.plane("plane", (0, 0, 0), (2, 2), made)
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0))
        scene, warnings = self.export()
        self.assertEqual(scene["shapes"][0]["emission"], [1.0, 2.0, 4.0])
        self.assertEqual(len(warnings), 1)
        self.assertIn("1 stands for “Random”", warnings[0])

    def test_nothing_is_dropped_silently(self):
        def build(tree, target):
            tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], target)

        value, warnings = self.constant(build)
        self.assertEqual(value, [0.5, 0.5, 0.5])
        self.assertEqual(len(warnings), 1)
        self.assertIn("material “nodes”", warnings[0])
        self.assertIn("node “Noise Texture”", warnings[0])

    def test_normal_maps_of_mirrored_pictures(self):
        """A normal map's slope along v is seen upside down where the picture is mirrored, or the transform."""
        made, tree, shader = scenes.material("mapped", "ShaderNodeBsdfDiffuse")
        scenes.normal_mapped(tree, shader, scenes.image("waves", scenes.bumps(), color=False))
        first = scenes.plane("plane", (0, 0, 0), (2, 2), made)
        second = scenes.link(bpy.data.objects.new("mirrored", first.data))
        second.scale = (-1, 1, 1)
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0))
        scene, warnings = self.export()
        by_name = {shape["name"]: shape["material"] for shape in scene["shapes"]}
        self.assertEqual(by_name, {"plane": "mapped", "mirrored": "mapped (mirrored)"})
        self.assertEqual([warning for warning in warnings if "uneven scale" not in warning], [])
        maps = [scene["materials"][name]["material"]["texture"]["file"] for name in ("mapped", "mapped (mirrored)")]
        straight, mirrored = (read(os.path.join(self.folder, path)) for path in maps)
        # The first is the PNG file itself, of whole bytes.
        np.testing.assert_allclose(mirrored[:, :, 1], 1.0 - straight[:, :, 1], atol=1e-3)

    def test_halves_of_shared_meshes(self):
        """Of a picture that is mirrored on one of two quads a mirrored object flips the other one."""
        made, tree, shader = scenes.material("mapped", "ShaderNodeBsdfDiffuse")
        scenes.normal_mapped(tree, shader, scenes.image("waves", scenes.bumps(), color=False))
        data = bpy.data.meshes.new("quads")
        data.from_pydata([(x, y, 0) for x in (-1, 0, 1) for y in (0, 1)], [], [(0, 2, 3, 1), (2, 4, 5, 3)])
        uvs = [(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (0, 0), (0, 1), (1, 1)]
        data.uv_layers.new().uv.foreach_set("vector", np.array(uvs, np.float32).ravel())
        data.materials.append(made)
        for name, scale in [("straight", 1), ("mirrored", -1)]:
            scenes.link(bpy.data.objects.new(name, data)).scale = (scale, 1, 1)
        self.scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0))
        scene, _ = self.export()
        of = {name: {shape["geometry"]["mesh"]: shape["material"] for shape in scene["shapes"] if shape["name"] == name}
              for name in ("straight", "mirrored")}
        self.assertEqual(sorted(of["straight"].values()), ["mapped", "mapped (mirrored)"])
        other = {"mapped": "mapped (mirrored)", "mapped (mirrored)": "mapped"}
        self.assertEqual(of["mirrored"], {mesh: other[name] for mesh, name in of["straight"].items()})

    def test_volumes_without_a_medium(self):
        """Where there is nothing but a volume that is left out, or is empty, there is nothing."""
        for kind, values, count in [("Emission", {}, 1), ("VolumeScatter", {"Density": 0.0}, 0)]:
            self.scene = scenes.begin(16)
            made, tree, shader = scenes.material("mist", f"ShaderNode{kind}", **values)
            output = tree.nodes["Material Output"]
            tree.links.clear()
            tree.links.new(shader.outputs[0], output.inputs["Volume"])
            scenes.box("domain", (0, 0, 0), (1, 1, 1), made)
            self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0))
            scene, warnings = self.export()
            self.assertEqual((scene["shapes"], len(warnings)), ([], count), kind)

    def test_principled_volume(self):
        made, tree, shader = scenes.material("mist", "ShaderNodeVolumePrincipled", Color=(0.5, 0.25, 0.0), Density=2.0,
                                             Absorption_Color=(0.25, 0.0, 0.64))
        output = tree.nodes["Material Output"]
        tree.links.clear()
        tree.links.new(shader.outputs[0], output.inputs["Volume"])
        scenes.box("domain", (0, 0, 0), (1, 1, 1), made)
        self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0))
        # Twice the sum of the colour and (1 - colour)·(1 - √absorption).
        np.testing.assert_allclose(self.export()[0]["media"]["mist"]["sigma_t"], [1.5, 2.0, 0.4], rtol=1e-5)

    def test_mask_media_and_glass(self):
        made, tree, shader = scenes.material("glass", "ShaderNodeBsdfGlass", IOR=1.3, Roughness=0.0)
        volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
        volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (0.9, 0.5, 0.0, 1.0), 2.0
        tree.links.new(volume.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
        scenes.ball("ball", (0, 0, 0), 1.0, made)
        holes, _, _ = scenes.material("holes", Alpha=0.25)
        scenes.plane("plane", (0, 0, 2), (1, 1), holes)
        self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0))
        scene, warnings = self.export()
        self.assertEqual(warnings, [])
        np.testing.assert_allclose(scene["media"]["glass"]["sigma_t"], [0.2, 1.0, 2.0], rtol=1e-5)
        self.assertEqual(scene["materials"]["holes"]["opacity"], {"type": "rgb", "value": [0.25] * 3})
        self.assertEqual({shape["name"]: shape.get("interior") for shape in scene["shapes"]}, {"ball": "glass", "plane": None})
        self.render(1)

    def test_packed_pictures_are_copied(self):
        self.textured_plane()
        path = os.path.join(self.folder, "textures", "quarters.png")
        with open(path, "rb") as file:
            self.assertEqual(file.read(), bpy.data.images["quarters"].packed_file.data)


class Lights(Case):
    def lamp(self, kind, **settings):
        scale = settings.pop("scale", (1, 1, 1))
        made = scenes.light(kind, "lamp", (0, 0, 3), settings.pop("energy", 100.0), **settings)
        made.scale = scale
        self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0))
        bpy.context.view_layer.update()
        scene, self.warnings = self.export()
        return (scene["lights"] + scene["shapes"])[0]

    def test_units(self):
        power = 100.0 / (4.0 * math.pi)
        near = lambda value, wanted: np.testing.assert_allclose(value, wanted, rtol=1e-5)
        near(self.lamp("POINT", shadow_soft_size=0.0)["intensity"], [power] * 3)

    def test_soft_point(self):
        sphere = self.lamp("POINT", shadow_soft_size=0.1, color=(1.0, 0.5, 0.0))
        np.testing.assert_allclose(sphere["emission"], np.array([1, 0.5, 0]) * 100.0 / (4 * math.pi**2 * 0.01), rtol=1e-5)

    def test_scaled_ellipse(self):
        disk = self.lamp("AREA", shape="ELLIPSE", size=1.0, size_y=0.5, scale=(2, 3, 1))
        area = math.pi * 1.0 * 0.75
        np.testing.assert_allclose(disk["emission"], [100.0 / (math.pi * area)] * 3, rtol=1e-5)

    def test_sun(self):
        sun = self.lamp("SUN", energy=3.0, angle=math.radians(5.0))
        np.testing.assert_allclose(sun["irradiance"], [3.0] * 3, rtol=1e-5)
        np.testing.assert_allclose(sun["direction"], [0, 0, -1], atol=1e-6)
        self.assertAlmostEqual(sun["angle"], 5.0, places=4)

    def test_edge_of_a_spot_keeps_its_power(self):
        cutoff, blend = math.radians(30.0), 0.5
        beam = linear_edge(cutoff, blend)
        theta = np.linspace(0, cutoff, 200001)
        x = np.clip((np.cos(theta) - math.cos(cutoff)) / ((1 - math.cos(cutoff)) * blend), 0, 1)
        linear = np.clip((cutoff - theta) / (cutoff - beam), 0, 1)
        both = [(part * np.sin(theta)).mean() for part in (x * x * (3 - 2 * x), linear)]
        self.assertAlmostEqual(both[0] / both[1], 1.0, places=4)
        self.lamp("SPOT", spot_size=2 * cutoff, spot_blend=blend)
        self.assertEqual(len(self.warnings), 1)

    def test_profiles_and_falloffs(self):
        """A node that Cycles alone has the profile or the falloff of counts by its strength."""
        for kind, output, smooth, count in [("TexIES", 0, None, 1), ("LightFalloff", "Quadratic", 0.0, 0),
                                            ("LightFalloff", "Quadratic", 0.5, 1), ("LightFalloff", "Linear", 0.0, 1)]:
            self.scene = scenes.begin(16)
            data = scenes.light("POINT", "lamp", (0, 0, 3), 100.0, shadow_soft_size=0.0).data
            data.use_nodes = True
            node = data.node_tree.nodes.new(f"ShaderNode{kind}")
            node.inputs["Strength"].default_value = 2.0
            if smooth is not None:
                node.inputs["Smooth"].default_value = smooth
            data.node_tree.links.new(node.outputs[output], data.node_tree.nodes["Emission"].inputs["Strength"])
            self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0))
            scene, warnings = self.export()
            np.testing.assert_allclose(scene["lights"][0]["intensity"], [200.0 / (4.0 * math.pi)] * 3, rtol=1e-5)
            self.assertEqual(len(warnings), count, (kind, output, smooth))

    def test_light_linking_is_told_of(self):
        for name in ("receiver_collection", "blocker_collection"):
            self.scene = scenes.begin(16)
            lamp = scenes.light("SUN", "lamp", (0, 0, 3), 1.0)
            setattr(lamp.light_linking, name, bpy.data.collections.new("some"))
            self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0))
            warnings = self.export()[1]
            self.assertEqual(len(warnings), 1)
            self.assertIn("light linking", warnings[0])

    def test_lamps_let_light_through(self):
        """What is behind a lamp is seen through its back."""
        self.world((0.5, 0.5, 0.5))
        scenes.light("AREA", "lamp", (0, 0, 0), 100.0, size=4.0)
        self.scene.camera = scenes.camera("eye", (0, 0, 2), (0, 0, 0), lens=100.0)
        np.testing.assert_allclose(self.render(4), 0.5, rtol=1e-4)

    def test_hidden_lamps_that_are_in_view(self):
        """Lamps that Blender hides from cameras are told of where a camera may see them, not elsewhere."""
        for location, told in [((0, 0, 0), 1), ((0, -9, 0), 0), ((6, 0, 0), 0)]:
            self.scene = scenes.begin(16)
            scenes.light("POINT", "lamp", location, 10.0, shadow_soft_size=0.2).visible_camera = False
            self.scene.camera = scenes.camera("eye", (0, -5, 0), (0, 0, 0), lens=50.0)
            bpy.context.view_layer.update()
            self.assertEqual(len(self.export()[1]), told, location)

    def test_exposure(self):
        self.scene.cycles.film_exposure = 2.0
        self.assertAlmostEqual(self.lamp("POINT", shadow_soft_size=0.0)["intensity"][0], 200.0 / (4 * math.pi), places=4)


class Worlds(Case):
    def test_directions(self):
        """The picture's middle is at +x, a quarter to the right of it at -y; its upper rows are above."""
        pixels = np.zeros((64, 128, 3))
        for column, row, color in [(64, 32, (1, 0, 0)), (96, 32, (0, 1, 0)), (64, 8, (0, 0, 1)), (32, 40, (1, 1, 0))]:
            pixels[row - 4 : row + 4, column - 4 : column + 4] = color
        picture = bpy.data.images.new("sky", 128, 64, float_buffer=True)
        picture.pixels.foreach_set(np.concatenate([pixels[::-1], np.ones((64, 128, 1))], axis=2).astype(np.float32).ravel())
        world = bpy.data.worlds.new("sky")
        world.use_nodes = True
        node = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
        node.image = picture
        world.node_tree.links.new(node.outputs["Color"], world.node_tree.nodes["Background"].inputs["Color"])
        self.scene.world = world
        low, high = 8 / 64 * math.pi, 40 / 64 * math.pi
        for ahead, color in [((1, 0, 0), (1, 0, 0)), ((0, -1, 0), (0, 1, 0)), ((math.sin(low), 0, math.cos(low)), (0, 0, 1)),
                             ((0, math.sin(high), math.cos(high)), (1, 1, 0))]:
            self.scene.camera = scenes.camera("eye", (0, 0, 0), ahead, lens=600.0)
            np.testing.assert_allclose(self.render(4, (8, 8)).mean(axis=(0, 1)), color, atol=1e-3)


class Nodes(unittest.TestCase):
    """What Cycles' nodes compute."""

    def check(self, function, *cases):
        for *given, wanted in cases:
            value = function(*(np.full((1, 1, 1), number, np.float32) for number in given))
            self.assertAlmostEqual(float(value[0, 0, 0]), wanted, places=5, msg=given)

    def test_powers(self):
        """Of negative numbers too where the exponent is whole."""
        self.check(arithmetic.MATH["POWER"], (2.0, 0.5, 0.0, 2.0**0.5), (-2.0, 3.0, 0.0, -8.0), (-2.0, 2.0, 0.0, 4.0),
                   (-2.0, -1.0, 0.0, -0.5), (-2.0, 0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))

    def test_logarithms(self):
        self.check(arithmetic.MATH["LOGARITHM"], (8.0, 2.0, 0.0, 3.0), (0.0, 2.0, 0.0, 0.0), (-1.0, 2.0, 0.0, 0.0),
                   (8.0, 0.0, 0.0, 0.0), (8.0, -2.0, 0.0, 0.0), (8.0, 1.0, 0.0, 0.0))

    def test_lighten(self):
        lighten = lambda *given: arithmetic.blended("LIGHTEN", *given)
        self.check(lighten, (0.5, 0.2, 0.6, 0.4), (0.5, 0.6, 0.2, 0.6), (0.0, 0.2, 0.6, 0.2))


class Files(Case):
    def test_exr_holds_what_was_written(self):
        random = np.random.default_rng(7)
        for shape, half in [((17, 5, 3), False), ((40, 33, 1), True)]:
            wanted = random.random(shape).astype(np.float32)
            path = os.path.join(self.folder, "picture.exr")
            files.write_bytes(path, files.exr(wanted, half))
            np.testing.assert_allclose(read(path), np.broadcast_to(wanted, shape[:2] + (3,)), rtol=1e-3 if half else 0)

    def test_nothing_is_left_of_files_that_fail(self):
        with self.assertRaises(TypeError):
            files.write_bytes(os.path.join(self.folder, "x"), "text")
        self.assertEqual(os.listdir(self.folder), [])

    def test_factors_of_albedos(self):
        """A smooth plastic has the base that Cycles has; white glass reflects 0.0918 of light from everywhere at an index of 1.5."""
        self.assertEqual(albedo.plastic_factor(0.0, 1.5), 1.0)
        self.assertAlmostEqual(1.0 - albedo.left(0.0, 1.5), 0.0918, places=3)


if __name__ == "__main__":
    unittest.main()
