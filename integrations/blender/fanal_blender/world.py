"""The world: one colour, a picture around the scene, or what Cycles makes of its nodes, as a picture."""

import math
import os
import tempfile

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import files
from .camera import rows
from .nodes import Evaluator, Place, named, source_of

# fanal's environments have y up, and what is straight ahead in the middle of the picture at +z; Blender has z up and +x there.
# fanal's axes are the columns x -> y, y -> z, z -> x.
TO_BLENDER = Matrix(((0.0, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
# Rows from which on the half row by which the two programs' pictures are apart is not worth a larger picture.
_FINE = 1024
# Size of a baked world.
_BAKED = (1024, 512)
_BAKED_SAMPLES = 16


class World:
    """Translates a world. `out` gets lights; `folder` is where pictures go; `can_bake` says whether Cycles may be asked."""

    def __init__(self, pictures, warn, out, can_bake):
        self.pictures, self._warn, self.out, self.can_bake = pictures, warn, out, can_bake

    def warn(self, message):
        self._warn(f"world: {message}")

    def add(self, world):
        """Adds the light of a world, which may be None."""
        if world is None:
            return
        if not (world.use_nodes and world.node_tree):
            self._constant(np.array(world.color[:]))
            return
        output = world.node_tree.get_output_node("CYCLES") or world.node_tree.get_output_node("ALL")
        if output is None:
            return
        if source_of(output.inputs["Volume"], Place(world.node_tree))[0] is not None:
            self.warn("its volume is left out")
        given, place = source_of(output.inputs["Surface"], Place(world.node_tree))
        if given is None:
            return
        if given.node.bl_idname != "ShaderNodeBackground" or not self._background(given.node, place):
            self._baked(world)

    def _constant(self, radiance):
        if (radiance > 0.0).any():
            self.out["lights"].append({"type": "constant", "radiance": np.maximum(radiance, 0.0).tolist()})

    def _background(self, node, place):
        """Adds the light of a Background node; False if its nodes are none that are translated."""
        evaluator = Evaluator(self.pictures, self.warn)
        if source_of(named(node, "Strength"), place)[0] is not None and not _is_value(named(node, "Strength"), place):
            return False
        strength = evaluator.number(node, "Strength", place)
        color, other = source_of(named(node, "Color"), place)
        if color is None or color.node.bl_idname in ("ShaderNodeRGB", "ShaderNodeBlackbody"):
            self._constant(evaluator.input(node, "Color", place).mean() * strength)
            return True
        if color.node.bl_idname != "ShaderNodeTexEnvironment":
            return False
        return self._environment(color.node, other, strength, evaluator)

    def _environment(self, node, place, strength, evaluator):
        image = node.image
        if image is None or node.projection != "EQUIRECTANGULAR" or image.size[0] * image.size[1] == 0:
            return False
        turn = self._rotation(node, place, evaluator)
        if turn is None:
            return False
        source = self.pictures.source(image)
        # fanal knows no raw environments: only float pictures are what they are.
        if source is not None and image.size[1] >= _FINE and source.ending in (".exr", ".hdr"):
            path = self.pictures.store_source(source)
        else:
            pixels = self.pictures.pixels(image)
            if pixels is None:
                return False
            path = self._store(between_rows(pixels[:, :, :3]))
        self._add(path, turn, strength)
        return True

    def _rotation(self, node, place, evaluator):
        """The rotation from the picture's directions to the world's; None where there is none."""
        output, other = source_of(named(node, "Vector"), place)
        matrix = Matrix.Identity(4)
        while output is not None:
            inner = output.node
            if inner.bl_idname == "ShaderNodeMapping":
                matrix = matrix @ evaluator.mapping(inner, other)
                output, other = source_of(named(inner, "Vector"), other)
                if output is None:
                    return None
            elif inner.bl_idname == "ShaderNodeTexCoord" and output.name in ("Generated", "Object") and inner.object is None:
                break
            else:
                return None
        linear = matrix.to_3x3()
        is_rotation = linear.determinant() > 0.0 and all(
            abs(x) < 1e-4 for row in linear @ linear.transposed() - Matrix.Identity(3) for x in row)
        return linear.inverted().to_4x4() if is_rotation and matrix.translation.length < 1e-6 else None

    def _store(self, pixels):
        folder = os.path.join(self.pictures.folder, "textures")
        os.makedirs(folder, exist_ok=True)
        files.write_bytes(os.path.join(folder, "(world).exr"), files.exr(np.maximum(pixels, 0.0), half=False))
        return "textures/(world).exr"

    def _add(self, path, turn, strength):
        self.out["lights"].append({"type": "envmap", "file": path, "scale": max(float(strength), 0.0),
                                   "to_world": rows(turn @ TO_BLENDER)})

    def _baked(self, world):
        """Has Cycles render the world's nodes as a picture, without a sun's disk, which becomes a sun."""
        if not self.can_bake:
            self.warn("its nodes have to be rendered by Cycles, which a running render cannot: export the scene instead; it is black here")
            return
        self.warn(f"its nodes are rendered by Cycles as a picture of {_BAKED[0]} × {_BAKED[1]} pixels")
        baker = _Baker(world)
        try:
            self._store(between_rows(baker.panorama()))
            self._add("textures/(world).exr", Matrix.Identity(4), 1.0)
            for sun in baker.suns():
                self.out["lights"].append(sun)
        finally:
            baker.close()


def _is_value(socket, place):
    output, _ = source_of(socket, place)
    return output.node.bl_idname == "ShaderNodeValue"


def between_rows(pixels):
    """The picture with rows where fanal has them: at both poles and evenly between. Blender's rows begin half a row below the pole; in
    twice as many plus one, its rows and the middles between them are found again."""
    height, width, channels = pixels.shape
    if height >= _FINE:
        return pixels
    out = np.empty((2 * height + 1, width, channels), np.float32)
    out[1::2] = pixels
    out[2:-1:2] = 0.5 * (pixels[1:] + pixels[:-1])
    # At a pole there is one colour only.
    out[0], out[-1] = pixels[0].mean(axis=0), pixels[-1].mean(axis=0)
    return out


class _Baker:
    """A scene of nothing but a copy of a world, rendered by Cycles."""

    def __init__(self, world):
        self.world = world.copy()
        self.skies = [node for node in self.world.node_tree.nodes
                      if node.bl_idname == "ShaderNodeTexSky" and getattr(node, "sun_disc", False)
                      and node.sky_type not in ("PREETHAM", "HOSEK_WILKIE")]
        self.scene = bpy.data.scenes.new("fanal world")
        self.camera = bpy.data.cameras.new("fanal world")
        self.eye = bpy.data.objects.new("fanal world", self.camera)
        self.scene.collection.objects.link(self.eye)
        self.scene.camera, self.scene.world = self.eye, self.world
        self.scene.render.engine = "CYCLES"
        cycles = self.scene.cycles
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.pixel_filter_type, cycles.sample_clamp_direct = "BOX", 0.0

    def close(self):
        bpy.data.objects.remove(self.eye)
        bpy.data.cameras.remove(self.camera)
        bpy.data.scenes.remove(self.scene)
        bpy.data.worlds.remove(self.world)

    def panorama(self):
        """The world without disks of suns, in equal angles, as Blender has it: +x in the middle."""
        for node in self.skies:
            node.sun_disc = False
        return self._panorama(_BAKED, _BAKED_SAMPLES)

    def _panorama(self, size, samples):
        self.camera.type = "PANO"
        self.camera.panorama_type = "EQUIRECTANGULAR"
        self._look(Vector((1.0, 0.0, 0.0)))
        return self._render(size, samples)

    def suns(self):
        """fanal's suns for the disks of sky textures."""
        out = []
        for node in self.skies:
            for other in self.skies:
                other.sun_disc = False
            node.sun_disc = True
            sun = self._sun(node)
            if sun is not None:
                out.append(sun)
        return out

    def _sun(self, node):
        """Finds the disk in a picture of all directions, then measures it in one of its surroundings."""
        pixels = self._panorama((2048, 1024), 1).sum(axis=2)
        y, x = np.unravel_index(int(pixels.argmax()), pixels.shape)
        height, width = pixels.shape
        around, down = (0.5 - (x + 0.5) / width) * math.tau, (y + 0.5) / height * math.pi
        ahead = Vector((math.sin(down) * math.cos(around), math.sin(down) * math.sin(around), math.cos(down)))
        field = max(3.0 * node.sun_size, math.radians(1.0))
        self.camera.type, self.camera.angle = "PERSP", field
        self._look(ahead)
        count = 128
        bright = self._render((count, count), 16)
        node.sun_disc = False
        light = np.maximum(bright - self._render((count, count), 16), 0.0)
        step = 2.0 * math.tan(field / 2.0) / count
        across = (np.arange(count) + 0.5 - count / 2.0) * step
        right, below = np.meshgrid(across, across)
        solid = step * step / (1.0 + right**2 + below**2) ** 1.5
        irradiance = (light * solid[:, :, None]).sum(axis=(0, 1))
        if irradiance.sum() <= 0.0:
            return None
        weight = light.sum(axis=2) * solid
        offset = [(weight * part).sum() / weight.sum() for part in (right, below)]
        axes = self.eye.matrix_world.to_3x3()
        toward = (axes @ Vector((offset[0], -offset[1], -1.0))).normalized()
        return {"type": "sun", "direction": list(-toward), "irradiance": irradiance.tolist(),
                "angle": min(max(math.degrees(node.sun_size), 0.1), 180.0)}

    def _look(self, ahead):
        self.eye.matrix_world = ahead.to_track_quat("-Z", "Y").to_matrix().to_4x4()

    def _render(self, size, samples):
        render, path = self.scene.render, tempfile.mktemp(suffix=".exr")
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
        self.scene.cycles.samples = samples
        render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
        render.filepath = path
        try:
            bpy.ops.render.render(write_still=True, scene=self.scene.name)
            image = bpy.data.images.load(path)
            values = np.empty(size[0] * size[1] * 4, np.float32)
            image.pixels.foreach_get(values)
            bpy.data.images.remove(image)
        finally:
            if os.path.exists(path):
                os.remove(path)
        return values.reshape(size[1], size[0], 4)[::-1, :, :3]
