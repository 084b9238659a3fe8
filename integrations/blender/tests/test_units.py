"""One thing at a time, by Cycles and by fanal: each kind of lamp on a white plane and looked at, maps of normals, a sky."""

import math
import os
import sys
import tempfile
import unittest

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.dirname(HERE)]

import scenes  # noqa: E402
from compare import cycles, fanal  # noqa: E402
from fanal_blender import export as exporting  # noqa: E402

FANAL = os.environ["FANAL"]
# Half a percent is five standard deviations of the noisiest of these.
NEAR = 0.005


class Units(unittest.TestCase):
    def check(self, kind, look=None, location=(0.3, -0.2, 2.0), scale=(1, 1, 1), near=NEAR, lens=200.0, **settings):
        scene = scenes.begin(256, bounces=0)
        scene.render.resolution_x = scene.render.resolution_y = 16
        white, _, _ = scenes.material("white", "ShaderNodeBsdfDiffuse", Color=(1, 1, 1))
        scenes.plane("plane", (0, 0, 0), (8, 8), white)
        made = scenes.light(kind, "lamp", location, settings.pop("energy", 100.0), **settings)
        made.scale = scale
        scene.camera = scenes.camera("eye", (2, 0, 1), look or (0, 0, 0), lens=lens)
        bpy.context.view_layer.update()
        with tempfile.TemporaryDirectory() as folder:
            report = exporting.export_scene(folder)
            theirs = cycles(scene, os.path.join(folder, "cycles.exr"), 1).mean(axis=(0, 1))
            ours = fanal(FANAL, report.scene, os.path.join(folder, "fanal.exr"), 1, 256).mean(axis=(0, 1))
        self.assertGreater(theirs.min(), 0.0)
        np.testing.assert_allclose(ours, theirs, rtol=near)

    def test_point(self):
        self.check("POINT", shadow_soft_size=0.0)

    def test_soft_point(self):
        self.check("POINT", shadow_soft_size=0.3, color=(1.0, 0.7, 0.4), use_soft_falloff=False)

    def test_soft_point_seen(self):
        self.check("POINT", look=(0.3, -0.2, 2.0), shadow_soft_size=0.3, lens=500.0)

    def test_scaled_point_seen(self):
        self.check("POINT", look=(0.3, -0.2, 2.0), shadow_soft_size=0.3, scale=(2, 2, 2), lens=60.0, use_soft_falloff=False)

    def test_unnormalized_point(self):
        self.check("POINT", shadow_soft_size=0.2, normalize=False, use_soft_falloff=False)

    def test_spot(self):
        self.check("SPOT", shadow_soft_size=0.0, spot_size=math.radians(70), spot_blend=0.0)

    def test_whole_edge_of_a_spot(self):
        """The picture holds all of the cone, of which a linear edge shows the same sum."""
        self.check("SPOT", location=(0.0, 0.0, 1.0), shadow_soft_size=0.0, spot_size=math.radians(40), spot_blend=0.6, lens=40.0,
                   near=0.02)

    def test_sun(self):
        self.check("SUN", energy=3.0, angle=math.radians(10.0))

    def test_directional(self):
        self.check("SUN", energy=3.0, angle=0.0)

    def test_unnormalized_sun(self):
        self.check("SUN", energy=3.0, angle=math.radians(20.0), normalize=False)

    def test_square(self):
        self.check("AREA", size=1.0, exposure=1.0)

    def test_scaled_rectangle(self):
        self.check("AREA", shape="RECTANGLE", size=1.0, size_y=0.5, scale=(1.5, 2.0, 1.0))

    def test_mirrored_rectangle(self):
        self.check("AREA", shape="RECTANGLE", size=1.0, size_y=0.5, scale=(-1.5, 2.0, 1.0))

    def test_disk(self):
        self.check("AREA", shape="DISK", size=1.2)

    def test_ellipse_seen(self):
        self.check("AREA", look=(0.3, -0.2, 2.0), shape="ELLIPSE", size=1.2, size_y=0.8, lens=500.0)

    def test_unnormalized_disk(self):
        self.check("AREA", shape="DISK", size=1.2, normalize=False)

    def test_temperature(self):
        self.check("AREA", size=1.0, use_temperature=True, temperature=3000.0)

class Slopes(unittest.TestCase):
    """Normal and bump maps under a low sun: the same bright and dark places as in Cycles, upright and mirrored."""

    def check(self, build, scale=(4, 4, 4)):
        scene = scenes.begin(48, bounces=0)
        scene.render.resolution_x = scene.render.resolution_y = 32
        made, tree, shader = scenes.material("grey", "ShaderNodeBsdfDiffuse", Color=(0.8, 0.8, 0.8))
        build(tree, shader)
        scenes.plane("plane", (0, 0, 0), (1, 1), made).scale = scale
        scenes.light("SUN", "sun", (0, 0, 5), 3.0, target=(3, 1.5, 3), angle=0.02)
        scene.camera = scenes.camera("eye", (0, 0, 5), (0, 0, 0), type="ORTHO", ortho_scale=3.9)
        bpy.context.view_layer.update()
        with tempfile.TemporaryDirectory() as folder:
            report = exporting.export_scene(folder)
            self.assertEqual(report.warnings, [])
            pictures = [cycles(scene, os.path.join(folder, "cycles.exr"), 1),
                        fanal(FANAL, report.scene, os.path.join(folder, "fanal.exr"), 1, 48)]
        theirs, ours = (picture.reshape(8, 4, 8, 4, 3).mean(axis=(1, 3, 4)) for picture in pictures)
        self.assertGreater(theirs.std(), 0.05 * theirs.mean())
        np.testing.assert_allclose(ours, theirs, atol=0.02 * theirs.mean())

    def normals(self, strength):
        picture = scenes.bumps()
        return lambda tree, shader: scenes.normal_mapped(tree, shader, scenes.image("waves", picture, color=False), strength)

    def bump(self, invert):
        y, x = np.mgrid[0:64, 0:64] / 64
        height = 0.5 + 0.25 * np.sin(4 * math.pi * x) * np.cos(3 * math.pi * (y + 0.1)) + 0.2 * x

        def build(tree, shader):
            node = tree.nodes.new("ShaderNodeBump")
            node.inputs["Distance"].default_value, node.invert = 0.3, invert
            picture = scenes.image("hill", np.repeat(height[:, :, None], 3, axis=2), color=False)
            scenes.textured(tree, node, "Height", picture)
            tree.links.new(node.outputs["Normal"], shader.inputs["Normal"])

        return build

    def test_normals(self):
        self.check(self.normals(1.0))

    def test_strong_normals(self):
        self.check(self.normals(2.0))

    def test_weak_normals(self):
        self.check(self.normals(0.5))

    def test_mirrored_normals(self):
        self.check(self.normals(1.0), (-4, 4, 4))

    def test_upside_down_normals(self):
        self.check(self.normals(1.0), (4, -4, 4))

    def test_bump(self):
        self.check(self.bump(False))

    def test_inverted_bump(self):
        self.check(self.bump(True), (-4, 4, 4))


class Sky(unittest.TestCase):
    def test_sky_and_its_sun(self):
        """A sky texture is rendered by Cycles as a picture, and its sun measured: a box and its shadow are as bright as in Cycles."""
        scene = scenes.begin(64, bounces=2)
        scene.render.resolution_x, scene.render.resolution_y = 32, 24
        grey, _, _ = scenes.material("grey", "ShaderNodeBsdfDiffuse", Color=(0.5, 0.5, 0.5))
        scenes.plane("plane", (0, 0, 0), (20, 20), grey)
        scenes.box("box", (0, 0, 1), (1, 1, 2), grey)
        scene.world = bpy.data.worlds.new("world")
        scene.world.use_nodes = True
        tree = scene.world.node_tree
        sky = tree.nodes.new("ShaderNodeTexSky")
        sky.sky_type, sky.sun_elevation, sky.sun_rotation = "NISHITA", math.radians(35.0), math.radians(70.0)
        tree.nodes["Background"].inputs["Strength"].default_value = 0.1
        tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
        scene.camera = scenes.camera("eye", (4, -6, 4), (0, 0, 1))
        with tempfile.TemporaryDirectory() as folder:
            report = exporting.export_scene(folder)
            self.assertEqual(len(report.warnings), 1)
            theirs = cycles(scene, os.path.join(folder, "cycles.exr"), 1)
            ours = fanal(FANAL, report.scene, os.path.join(folder, "fanal.exr"), 1, 64)
        self.assertEqual(len(bpy.data.scenes), 1, "the scene that was made for it is gone")
        blocks = [picture.reshape(2, 12, 2, 16, 3).mean(axis=(1, 3)) for picture in (theirs, ours)]
        np.testing.assert_allclose(blocks[1], blocks[0], rtol=0.02)


if __name__ == "__main__":
    unittest.main()
