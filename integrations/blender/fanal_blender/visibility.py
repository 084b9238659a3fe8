"""Showing in the viewport what a render shows, whose dependency graph Blender keeps to itself."""

from contextlib import contextmanager

import bpy


@contextmanager
def as_rendered(scene, layer):
    """Shows what a render shows, as long as it lasts."""
    changed = []

    def set(owner, name, value):
        if getattr(owner, name) != value:
            changed.append((owner, name, getattr(owner, name)))
            setattr(owner, name, value)

    def collections(of):
        yield of
        for child in of.children:
            yield from collections(child)

    hidden = []
    try:
        for collection in collections(layer.layer_collection):
            set(collection, "hide_viewport", False)
            if collection.collection != scene.collection:
                set(collection.collection, "hide_viewport", collection.collection.hide_render)
        for collection in bpy.data.collections:
            if collection.library is None:
                set(collection, "hide_viewport", collection.hide_render)
        for object in scene.objects:
            if object.library is not None:
                continue
            set(object, "hide_viewport", object.hide_render)
            if object.hide_get(view_layer=layer):
                object.hide_set(False, view_layer=layer)
                hidden.append(object)
            for modifier in object.modifiers:
                set(modifier, "show_viewport", modifier.show_render)
                if modifier.type in ("SUBSURF", "MULTIRES"):
                    set(modifier, "levels", modifier.render_levels)
            for system in object.particle_systems:
                set(system.settings, "display_percentage", 100)
        yield
    finally:
        for owner, name, value in reversed(changed):
            setattr(owner, name, value)
        for object in hidden:
            object.hide_set(True, view_layer=layer)
