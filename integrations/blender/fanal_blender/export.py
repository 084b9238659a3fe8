"""Exports a scene of Blender as one folder: scene.json, meshes/*.ply, textures/*.

`export` takes an evaluated dependency graph, `export_scene` the scene as it is; both need no user interface.
"""

import json
import os
import re
from dataclasses import dataclass, field as member

import bpy
import numpy as np

from . import camera as cameras
from . import files, meshes
from .dressing import Dressing
from .lights import Lamps
from .materials import Translator
from .pictures import Pictures
from .visibility import as_rendered
from .world import World

_AIR = "(air)"
# Types of objects that have surfaces.
_SURFACES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
# Types of objects that nobody expects in a picture.
_UNSEEN = {"EMPTY", "CAMERA", "LATTICE", "ARMATURE", "LIGHT", "SPEAKER", "LIGHT_PROBE"}


@dataclass
class Options:
    """What to export, and how."""

    # Samples per pixel; None is Cycles' number.
    samples: int | None = None
    # Columns and rows of the picture; None is the scene's.
    size: tuple | None = None
    # Only selected surfaces and lights.
    selection: bool = False
    # Whether all other cameras are written too, under "cameras".
    all_cameras: bool = True
    # Whether Cycles may be asked to render the world.
    bake_world: bool = True


@dataclass
class Report:
    """What came of an export."""

    scene: str
    warnings: list = member(default_factory=list)


class _Out(dict):
    """The scene file that grows."""

    def air(self):
        """The material that lets all light pass as if it were not there."""
        self["materials"][_AIR] = {"type": "thin_dielectric", "int_ior": 1.0, "ext_ior": 1.0}
        return _AIR


def export_scene(folder, options=None, scene=None):
    """Exports `scene` (or the one of the context) as it would be rendered, see `export`."""
    scene = scene or bpy.context.scene
    layer = bpy.context.view_layer if scene == bpy.context.scene else scene.view_layers[0]
    options = options or Options()
    with as_rendered(scene, layer):
        layer.update()
        return export(layer.depsgraph, folder, options)


def export(depsgraph, folder, options=None):
    """Exports what an evaluated dependency graph shows into `folder`, which is made, and returns a `Report`. Raises `ValueError`
    without a camera and `OSError` where files cannot be written."""
    return _Exporter(depsgraph, folder, options or Options()).run()


class _Exporter:
    def __init__(self, depsgraph, folder, options):
        self.depsgraph, self.folder, self.options = depsgraph, folder, options
        self.scene = depsgraph.scene_eval
        self.warnings = []
        self.pictures = Pictures(folder, self.warn)
        self.translator = Translator(self.pictures, self.warn)
        self.size = options.size or cameras.size_of(self.scene)
        self.out = _Out(version=1, name=self.scene.name, camera=None, film=None, render=None, materials={}, media={}, meshes={},
                        shapes=[], lights=[])
        # What is known of materials and meshes.
        self.translated, self.corners, self.written = {}, {}, {}
        self.file_names = set()
        # Where the cameras are, and the origins of all surfaces, instance by instance.
        self.eyes, self.origins = np.zeros((0, 3)), np.zeros((0, 3))

    def warn(self, message):
        """Notes a warning, once."""
        if message not in self.warnings:
            self.warnings.append(message)

    def run(self):
        os.makedirs(os.path.join(self.folder, "meshes"), exist_ok=True)
        self._cameras()
        eyes = [self.scene.camera] + ([eye for _, eye in self._others()] if self.options.all_cameras else [])
        sees = lambda points: any(cameras.sees(eye, self.scene, self.size, points) for eye in eyes)
        lamps = Lamps(self.pictures, self.warn, self.out, sees)
        self.eyes = np.array([eye.matrix_world.translation[:] for eye in eyes]).reshape(-1, 3)
        self.origins = np.array([instance.matrix_world.translation[:] for instance in self.depsgraph.object_instances
                                 if instance.object.type in _SURFACES and self._chosen(instance)]).reshape(-1, 3)
        for instance in self.depsgraph.object_instances:
            self._instance(instance, lamps)
        World(self.pictures, self.warn, self.out, self.options.bake_world).add(self.scene.world)
        self._expose()
        path = os.path.join(self.folder, "scene.json")
        text = json.dumps({key: value for key, value in self.out.items() if value or key != "media"}, indent=1, ensure_ascii=False)
        files.write_bytes(path, (text + "\n").encode())
        return Report(path, self.warnings)

    # Cameras.

    def _cameras(self):
        if self.scene.camera is None:
            raise ValueError("the scene has no camera")
        self.out["camera"] = cameras.camera(self.scene.camera.evaluated_get(self.depsgraph), self.scene, self.size, self.warn)
        self.out["film"] = cameras.film(self.scene, self.size, self.warn)
        self.out["render"] = cameras.render(self.scene, self.options.samples, self.warn)
        others = self._others()
        if others and self.options.all_cameras:
            of = lambda eye: cameras.camera(eye, self.scene, self.size, self.warn)
            self.out["camera_name"] = self.scene.camera.name
            self.out["cameras"] = {name: of(eye) for name, eye in others}

    def _others(self):
        """Names and evaluated objects of all cameras but the active one."""
        active = self.scene.camera.name
        eyes = [object for object in self.scene.objects if object.type == "CAMERA" and object.name != active]
        return [(eye.name, eye.evaluated_get(self.depsgraph)) for eye in sorted(eyes, key=lambda eye: eye.name)]

    # Objects.

    def _instance(self, instance, lamps):
        object = instance.object
        if not self._chosen(instance):
            return
        if _is_linked(object) or instance.is_instance and _is_linked(instance.parent):
            self.warn(f"object “{object.name}”: its light linking is left out: it lights all objects, and all throw its shadows")
        if object.type == "LIGHT":
            lamps.add(object, instance.matrix_world)
        elif object.type in _SURFACES:
            self._surface(object, instance.matrix_world.copy())
        elif object.type not in _UNSEEN:
            self.warn(f"object “{object.name}”: {object.type.lower().replace('_', ' ')} is left out")
        if object.type not in _UNSEEN and any(system.settings.type == "HAIR" and system.settings.render_type == "PATH"
                                              for system in object.particle_systems):
            self.warn(f"object “{object.name}”: its hair is left out")

    def _chosen(self, instance):
        if not instance.show_self:
            return False
        if not self.options.selection:
            return True
        owner = instance.parent if instance.is_instance else instance.object
        return owner is not None and owner.original.select_get()

    def _surface(self, object, world):
        corners = self._corners(object)
        if corners is None:
            return
        hidden = [name for name in ("camera", "diffuse", "glossy", "transmission", "shadow", "volume_scatter")
                  if not getattr(object, f"visible_{name}")]
        if hidden:
            self.warn(f"object “{object.name}”: rays see it that do not in Blender ({', '.join(hidden).replace('_', ' ')})")
        if object.is_holdout or object.is_shadow_catcher:
            self.warn(f"object “{object.name}”: it is an object like others, neither holdout nor shadow catcher")
        slots = object.material_slots
        used = np.unique(corners.slots).tolist()
        for slot in used:
            # Blender takes the last slot where there is none.
            material = slots[min(slot, len(slots) - 1)].material if len(slots) else None
            self._part(object, corners, slot, material, world)

    def _corners(self, object):
        """The object's triangles, which objects with the same data share; None without any."""
        data = object.data
        own = object.original.as_pointer() if object.type != "MESH" else 0
        key = (data.as_pointer(), own)
        if key not in self.corners:
            self.corners[key] = self._read(object)
            if self.corners[key] is not None:
                self.corners[key].name = data.name
                self.corners[key].key = key
        return self.corners[key]

    def _read(self, object):
        try:
            mesh = object.to_mesh()
        except RuntimeError as error:
            self.warn(f"object “{object.name}”: {error}")
            return None
        try:
            if mesh is None or len(mesh.polygons) == 0:
                return None
            mesh.calc_loop_triangles()
            return meshes.Corners(mesh)
        finally:
            object.to_mesh_clear()

    def _part(self, object, corners, slot, material, world):
        """The shapes of one material slot: two where half of it shows its normal map mirrored."""
        known = self._material(material)
        if known.layer.material is None and not known.shines and not known.is_border:
            return
        if known.is_border and known.medium is None:
            # The border of a volume that is left out: there is nothing.
            return
        chosen = corners.slots == slot
        coordinates = known.coordinates
        if coordinates is not None and corners.uvs(coordinates) is None:
            self.warn(f"object “{object.name}”: there are no texture coordinates “{coordinates[1] or 'UV'}”: its pictures count by one pixel")
            coordinates = None
        halves = [(chosen, False)]
        if known.has_normal_map and coordinates is not None:
            mirrored = corners.is_mirrored(coordinates)
            # A transform that mirrors turns the tangent frame over too.
            flips = world.determinant() < 0.0
            halves = [(chosen & ~mirrored, flips), (chosen & mirrored, not flips)]
            scale = world.to_scale()
            if max(map(abs, scale)) > 1.001 * min(map(abs, scale)):
                self.warn(f"object “{object.name}”: its normal map has the slopes that it has without the object's uneven scale")
        is_double = known.shines and self._is_seen_from_both_sides(known, corners, chosen, world)
        for half, (triangles, flipped) in enumerate(halves):
            if not triangles.any():
                continue
            # Objects that share the data share its halves; which of them is flipped is each object's own.
            name = self._mesh(corners, triangles, coordinates, is_double, (slot, half if len(halves) > 1 else None))
            shape = {"name": object.name, "geometry": {"type": "mesh", "mesh": name}, "to_world": cameras.rows(world),
                     "material": self._stored(known, flipped)}
            if known.medium is not None:
                shape["interior"] = known.medium
                if not corners.is_closed(chosen):
                    self.warn(f"object “{object.name}”: it is not closed, though there is a medium within")
            if known.shines:
                shape["emission"] = known.radiance
            self.out["shapes"].append(shape)

    def _is_seen_from_both_sides(self, known, corners, chosen, world):
        """Whether a part of a mesh is open, or something is within its bounds that sees its inside: a camera or another object."""
        if not corners.is_closed(chosen):
            return True
        if known.has_inside:
            return False
        matrix = np.array(cameras.rows(world)).reshape(4, 4)
        points = corners.positions[np.unique(corners.vertices[chosen])] @ matrix[:3, :3].T + matrix[:3, 3]
        low, high = points.min(axis=0), points.max(axis=0)
        within = lambda places: ((low <= places) & (places <= high)).all(axis=1).sum()
        # Its own origin is one of all.
        return bool(within(self.eyes) > 0 or within(self.origins) > within(matrix[None, :3, 3]))

    def _mesh(self, corners, triangles, coordinates, is_double, part):
        """Name of the mesh of some of the triangles, written once."""
        key = (corners.key, coordinates, is_double, part)
        if key in self.written:
            return self.written[key]
        mesh = corners.part(triangles, coordinates)
        if is_double:
            mesh = meshes.sheets(mesh)
        name = self._unique(corners.name)
        files.write_bytes(os.path.join(self.folder, "meshes", name + ".ply"),
                          files.ply(mesh.positions, mesh.triangles, mesh.normals, mesh.uvs))
        given = {"type": "ply", "file": f"meshes/{name}.ply"}
        if mesh.normals is None:
            given["face_normals"] = True
        if mesh.uvs is not None:
            # Blender's v points up on pictures.
            given["flip_v"] = True
        self.out["meshes"][name] = given
        self.written[key] = name
        return name

    def _unique(self, name):
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:60].strip("._") or "mesh"
        unique, count = stem, 1
        while unique.lower() in self.file_names:
            count += 1
            unique = f"{stem}-{count}"
        self.file_names.add(unique.lower())
        return unique

    # Materials.

    def _material(self, material):
        key = material.name_full if material else None
        if key not in self.translated:
            self.translated[key] = Dressing(self, material)
        return self.translated[key]

    def _stored(self, known, flipped):
        """Name of a material in the scene file, with normal maps flipped if the picture is seen mirrored."""
        flipped = flipped and known.has_normal_map
        if flipped not in known.names:
            name = known.name + (" (mirrored)" if flipped else "")
            while name in self.out["materials"]:
                name += "'"
            self.out["materials"][name] = known.json(flipped)
            known.names[flipped] = name
        return known.names[flipped]

    def _expose(self):
        """Cycles' exposure is a factor on every pixel, so on all light."""
        factor = getattr(getattr(self.scene, "cycles", None), "film_exposure", 1.0)
        if factor == 1.0:
            return
        times = lambda values: [value * factor for value in values]
        for shape in self.out["shapes"]:
            if "emission" in shape:
                shape["emission"] = times(shape["emission"])
        for light in self.out["lights"]:
            for name in ("intensity", "irradiance", "radiance"):
                if name in light:
                    light[name] = times(light[name])
            if "scale" in light:
                light["scale"] *= factor


def _is_linked(object):
    """Whether an object's light is for some objects only, or only some throw its shadows."""
    linking = getattr(getattr(object, "original", None), "light_linking", None)
    return any(getattr(linking, name, None) is not None for name in ("receiver_collection", "blocker_collection"))
