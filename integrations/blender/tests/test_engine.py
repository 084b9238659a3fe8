"""The add-on as Blender has it: the operator and the render engine. FANAL names the program."""

import json
import os
import signal
import sys
import tempfile
import unittest

import bpy
import numpy as np

sys.path[:0] = [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]

import fanal_blender  # noqa: E402
from fanal_blender import engine, program  # noqa: E402

FANAL = os.environ["FANAL"]


def lit_plane():
    """A white plane under a world of radiance 1, which is as bright, and the camera above it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=10)
    made = bpy.data.materials.new("half")
    made.use_nodes = False
    made.diffuse_color = (0.5, 0.25, 1.0, 1.0)
    bpy.context.object.data.materials.append(made)
    scene.world = bpy.data.worlds.new("world")
    scene.world.color = (1.0, 1.0, 1.0)
    bpy.ops.object.camera_add(location=(0, 0, 3), rotation=(0, 0, 0))
    scene.camera = bpy.context.object
    scene.render.resolution_x, scene.render.resolution_y = 24, 16
    return scene


class Engine(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        fanal_blender.register()

    @classmethod
    def tearDownClass(cls):
        fanal_blender.unregister()

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def test_operator(self):
        lit_plane()
        bpy.ops.object.camera_add(location=(0, 0, 9))
        path = os.path.join(self.folder.name, "out")
        self.assertEqual(bpy.ops.export_scene.fanal(directory=path, samples=7, width=30, height=20), {"FINISHED"})
        with open(os.path.join(path, "scene.json")) as file:
            scene = json.load(file)
        self.assertEqual((scene["film"]["width"], scene["film"]["height"], scene["render"]["spp"]), (30, 20, 7))
        self.assertEqual(list(scene["cameras"]), ["Camera.001"])

    def test_no_camera(self):
        lit_plane().camera = None
        with self.assertRaisesRegex(RuntimeError, "no camera"):
            bpy.ops.export_scene.fanal(directory=self.folder.name)

    def rendered(self, scene, size):
        """RGBA of the scene's picture as Blender writes it, which has this size."""
        scene.render.engine = "FANAL"
        scene.fanal.samples, scene.fanal.guide = 16, "none"
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.filepath = os.path.join(self.folder.name, "out.exr")
        with program_on_path():
            bpy.ops.render.render(write_still=True)
        return engine.pixels(scene.render.filepath, size)

    def test_render(self):
        scene = lit_plane()
        values = self.rendered(scene, (24, 16))
        # A plane that fills the picture under a uniform sky has the radiance of its albedo.
        np.testing.assert_allclose(values.mean(axis=0), [0.5, 0.25, 1.0, 1.0], rtol=2e-3)

    def test_region(self):
        # The left half of the picture is a darker plane.
        scene = lit_plane()
        bpy.ops.mesh.primitive_plane_add(size=10, location=(-5, 0, 0.01))
        dark = bpy.data.materials.new("dark")
        dark.use_nodes = False
        dark.diffuse_color = (0.1, 0.1, 0.1, 1.0)
        bpy.context.object.data.materials.append(dark)
        render = scene.render
        render.use_border, render.use_crop_to_border = True, True
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.5, 1.0
        values = self.rendered(scene, (12, 8)).reshape(8, 12, 4)
        np.testing.assert_allclose(values[:, 1:5, 1].mean(), 0.1, rtol=0.1)
        np.testing.assert_allclose(values[:, 7:11, 1].mean(), 0.25, rtol=0.1)

    def test_layers(self):
        # The plane is not in the second layer, which shows the world alone; the file is of the first.
        scene = lit_plane()
        plane = next(thing for thing in scene.objects if thing.type == "MESH")
        planes = bpy.data.collections.new("planes")
        scene.collection.children.link(planes)
        planes.objects.link(plane)
        scene.collection.objects.unlink(plane)
        scene.view_layers.new("world").layer_collection.children["planes"].exclude = True
        values = self.rendered(scene, (24, 16))
        np.testing.assert_allclose(values.mean(axis=0), [0.5, 0.25, 1.0, 1.0], rtol=2e-3)

    def test_missing_program(self):
        with self.assertRaisesRegex(FileNotFoundError, "preferences"):
            program.find("/nowhere/fanal")

    def test_failing_program(self):
        run = program.Run(FANAL, os.path.join(self.folder.name, "nothing.json"), os.path.join(self.folder.name, "out.exr"))
        with self.assertRaisesRegex(RuntimeError, "nothing.json"):
            run.finish()

    def test_stop(self):
        scene = lit_plane()
        path = os.path.join(self.folder.name, "scene")
        report = fanal_blender.export.export_scene(path, scene=scene)
        picture = os.path.join(path, "out.exr")
        run = program.Run(FANAL, report.scene, picture, ["--spp", "4000000", "--guide", "none"])
        # A run that has not begun to render has nothing to write.
        while run.is_running() and not os.path.exists(picture):
            pass
        # As Blender asks: again and again, until it has ended.
        while run.is_running():
            run.stop()
        run.finish()
        self.assertEqual(run.process.returncode, 75)
        self.assertTrue(np.isfinite(engine.pixels(picture, (24, 16))).all())

    @unittest.skipIf(os.name == "nt", "there are no signals")
    def test_stop_before_it_renders(self):
        """A program that a signal ends while it reads the scene has not failed if that was asked for."""
        path = os.path.join(self.folder.name, "reading")
        with open(path, "w") as file:
            file.write(f"#!{sys.executable}\nimport signal, sys\nsignal.signal(signal.SIGINT, signal.SIG_DFL)\n"
                       "print('reading', file=sys.stderr, flush=True)\nsignal.pause()\n")
        os.chmod(path, 0o755)
        for asked in (True, False):
            run = program.Run(path, "scene.json", os.path.join(self.folder.name, "out.exr"))
            while run.is_running() and not run.lines:
                pass
            if asked:
                run.stop()
                run.finish()
            else:
                run.process.send_signal(signal.SIGINT)
                with self.assertRaisesRegex(RuntimeError, "reading"):
                    run.finish()
            self.assertEqual(run.process.returncode, -signal.SIGINT)


class program_on_path:
    """Puts the program that FANAL names on PATH as `fanal`."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        os.symlink(os.path.abspath(FANAL), os.path.join(self.folder.name, "fanal"))
        self.before = os.environ["PATH"]
        os.environ["PATH"] = self.folder.name + os.pathsep + self.before

    def __exit__(self, *_):
        os.environ["PATH"] = self.before
        self.folder.cleanup()


if __name__ == "__main__":
    unittest.main()
