"""File > Export > fanal."""

import os

import bpy

from . import export as exporting


class EXPORT_SCENE_OT_fanal(bpy.types.Operator):
    """Write the scene as a folder that fanal renders"""

    bl_idname = "export_scene.fanal"
    bl_label = "Export fanal"
    bl_options = {"PRESET"}

    directory: bpy.props.StringProperty(name="Folder", description="Folder for scene.json and what it needs", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    selection: bpy.props.BoolProperty(
        name="Selection only", description="Only selected surfaces and lights; the camera and the world are always written")
    samples: bpy.props.IntProperty(name="Samples", description="Samples per pixel; 0 for Cycles' number", default=0, min=0, max=1 << 24)
    width: bpy.props.IntProperty(name="Width", description="Columns of the picture; 0 for the scene's", default=0, min=0, max=16384)
    height: bpy.props.IntProperty(name="Height", description="Rows of the picture; 0 for the scene's", default=0, min=0, max=16384)
    all_cameras: bpy.props.BoolProperty(name="All cameras", description="Write every camera, not only the active one", default=True)
    bake_world: bpy.props.BoolProperty(
        name="Bake world", description="Have Cycles render worlds whose nodes fanal has no counterpart for", default=True)

    def invoke(self, context, event):
        if not self.directory and bpy.data.filepath:
            self.directory = os.path.splitext(bpy.data.filepath)[0] + "-fanal"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        size = (self.width, self.height) if self.width and self.height else None
        options = exporting.Options(samples=self.samples or None, size=size, selection=self.selection,
                                    all_cameras=self.all_cameras, bake_world=self.bake_world)
        try:
            report = exporting.export_scene(bpy.path.abspath(self.directory), options, context.scene)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for warning in report.warnings:
            print(f"fanal: {warning}")
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"{report.scene}: {len(report.warnings)} warnings")
        return {"FINISHED"}


def _menu(self, context):
    self.layout.operator(EXPORT_SCENE_OT_fanal.bl_idname, text="fanal (folder)")


def register():
    bpy.utils.register_class(EXPORT_SCENE_OT_fanal)
    bpy.types.TOPBAR_MT_file_export.append(_menu)


def unregister():
    bpy.types.TOPBAR_MT_file_export.remove(_menu)
    bpy.utils.unregister_class(EXPORT_SCENE_OT_fanal)
