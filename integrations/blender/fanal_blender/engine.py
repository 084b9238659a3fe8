"""fanal as a render engine of Blender, and its settings."""

import os
import tempfile
import time

import bpy
import numpy as np

from . import camera as cameras
from . import export as exporting
from . import program

# Seconds between two looks at the picture so far.
_REFRESH = 2.0
_GUIDES = [
    ("neural", "Neural", "Guided by trees that a network completes"),
    ("gaussian", "Gaussian", "Guided by smoothed trees"),
    ("variance", "Variance", "Guided by trees as counted"),
    ("none", "None", "Plain path tracing"),
]


class FanalPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program", description="Path of the fanal program; empty for the one on PATH", subtype="FILE_PATH")

    def draw(self, context):
        self.layout.prop(self, "program")


class FanalSettings(bpy.types.PropertyGroup):
    samples: bpy.props.IntProperty(
        name="Samples", description="Samples per pixel", default=128, min=1, max=1 << 24)
    seconds: bpy.props.FloatProperty(
        name="Time", description="Seconds to render for in place of a number of samples; 0 for samples", default=0.0, min=0.0)
    guide: bpy.props.EnumProperty(name="Guide", description="How camera rays find light", items=_GUIDES)


def configured(context):
    """The program's path in the preferences of the add-on; empty without."""
    addon = context.preferences.addons.get(__package__)
    return addon.preferences.program if addon and addon.preferences else ""


class FanalEngine(bpy.types.RenderEngine):
    bl_idname = "FANAL"
    bl_label = "fanal"
    bl_use_preview = False
    bl_use_shading_nodes_custom = False
    # Materials' panels are those of Cycles.
    bl_use_eevee_viewport = True

    def render(self, depsgraph):
        try:
            self._render(depsgraph)
        except (OSError, ValueError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            self.error_set(str(error))

    def _render(self, depsgraph):
        scene = depsgraph.scene_eval
        path = program.find(configured(bpy.context))
        settings = scene.fanal
        with tempfile.TemporaryDirectory(prefix="fanal-") as folder:
            self.update_stats("", "fanal: exporting")
            options = exporting.Options(samples=settings.samples, all_cameras=False, bake_world=False)
            report = exporting.export(depsgraph, folder, options)
            for warning in report.warnings:
                self.report({"WARNING"}, warning)
            picture = os.path.join(folder, "picture.exr")
            arguments = ["--guide", settings.guide]
            if settings.seconds > 0.0:
                arguments += ["--time", str(settings.seconds)]
            window = cameras.window_of(scene)
            if window is not None:
                arguments += ["--crop", ",".join(map(str, window))]
            size = cameras.size_of(scene) if window is None else window[2:]
            run = program.Run(path, report.scene, picture, arguments)
            layer = depsgraph.view_layer_eval.name
            try:
                self._follow(run, layer, size)
            finally:
                run.stop()
            run.finish()
            self._show(picture, layer, size)

    def _follow(self, run, layer, size):
        """Shows the picture as it comes, until the run ends or Blender asks for its end."""
        shown = time.monotonic()
        while run.is_running():
            if self.test_break():
                run.stop()
            self.update_progress(run.progress)
            self.update_stats("", f"fanal: {run.message}")
            if time.monotonic() - shown > _REFRESH:
                self._show(run.picture, layer, size)
                shown = time.monotonic()
            time.sleep(0.05)

    def _show(self, picture, layer, size):
        if not os.path.exists(picture):
            return
        values = pixels(picture, size)
        result = self.begin_result(0, 0, *size, layer=layer)
        result.layers[0].passes["Combined"].rect.foreach_set(values.ravel())
        self.end_result(result)


def pixels(picture, size):
    """RGBA of an EXR file, rows from the bottom."""
    image = bpy.data.images.load(picture, check_existing=False)
    try:
        values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
        image.pixels.foreach_get(values)
        values = values.reshape(-1, image.channels)
        if tuple(image.size) != tuple(size):
            raise RuntimeError(f"the picture has {image.size[0]} × {image.size[1]} pixels, not {size[0]} × {size[1]}")
    finally:
        bpy.data.images.remove(image)
    return np.concatenate([values[:, :3], np.ones((len(values), 1), np.float32)], axis=1)


class FANAL_PT_sampling(bpy.types.Panel):
    bl_label = "fanal"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"FANAL"}

    @classmethod
    def poll(cls, context):
        return context.engine == "FANAL"

    def draw(self, context):
        self.layout.use_property_split = True
        for name in ("samples", "seconds", "guide"):
            self.layout.prop(context.scene.fanal, name)


_CLASSES = (FanalPreferences, FanalSettings, FanalEngine, FANAL_PT_sampling)
# Panels that are not for a renderer of one's own.
_NOT_OURS = {"RENDER_PT_simplify", "RENDER_PT_gpencil", "RENDER_PT_freestyle"}


def _shared_panels():
    """Panels of Blender that other engines share: those of lights, materials, worlds, cameras and the output."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines is not None and panel.__name__ not in _NOT_OURS:
            if "BLENDER_RENDER" in engines or panel.__module__.startswith("cycles") and panel.__name__ in _OF_CYCLES:
                yield panel


# Panels of Cycles for what Blender itself shows only to its own engines.
_OF_CYCLES = {"CYCLES_LIGHT_PT_light", "CYCLES_LIGHT_PT_nodes", "CYCLES_WORLD_PT_surface", "CYCLES_MATERIAL_PT_surface",
              "CYCLES_MATERIAL_PT_volume", "CYCLES_CAMERA_PT_dof", "CYCLES_CAMERA_PT_dof_aperture", "CYCLES_PT_context_material"}


def register():
    for kind in _CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.fanal = bpy.props.PointerProperty(type=FanalSettings)
    for panel in _shared_panels():
        # A set of its own: Cycles' panels share one.
        panel.COMPAT_ENGINES = panel.COMPAT_ENGINES | {FanalEngine.bl_idname}


def unregister():
    for panel in _shared_panels():
        panel.COMPAT_ENGINES = panel.COMPAT_ENGINES - {FanalEngine.bl_idname}
    del bpy.types.Scene.fanal
    for kind in reversed(_CLASSES):
        bpy.utils.unregister_class(kind)
