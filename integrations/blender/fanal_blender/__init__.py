"""fanal for Blender: export of scenes as folders, and a render engine that runs the program."""

bl_info = {
    "name": "fanal",
    "description": "Export scenes to the fanal renderer, and render with it",
    "author": "the fanal developers",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "File > Export > fanal; Render Properties > Render Engine",
    "category": "Import-Export",
}


def register():
    from . import engine, operators

    engine.register()
    operators.register()


def unregister():
    from . import engine, operators

    operators.unregister()
    engine.unregister()
