#!/usr/bin/env python3
"""Writes a scene of ours as one for Mitsuba 3: FOLDER/scene.xml with meshes as PLY and copies of its pictures.

    pip install mitsuba numpy
    python3 tests/bench/as_mitsuba.py SCENE_FOLDER FOLDER

For what the generator makes, so that both programs can render it from the same file. What Mitsuba's plain path tracer has not, or not alike, is a
near relation that both read: a rough diffuse surface is diffuse, the sun's disk a direction; scenes with media are refused (exit code 3).
"""

import json
import pathlib
import shutil
import sys
from xml.sax.saxutils import quoteattr

import numpy as np
import mitsuba

NOT_ALIKE = 3


class NotAlike(Exception):
    """What has no counterpart."""


def element(tag, content="", **attributes):
    words = "".join(f" {name}={quoteattr(str(value))}" for name, value in attributes.items())
    return f"<{tag}{words}>{content}</{tag}>"


def number(name, value):
    return element("float", name=name, value=f"{value:.8g}")


def text(name, value):
    return element("string", name=name, value=value)


def triple(tag, name, values):
    return element(tag, name=name, value=", ".join(f"{value:.8g}" for value in values))


def rgb(name, values):
    return triple("rgb", name, values)


def transform(matrix):
    return element("transform", element("matrix", value=" ".join(f"{value:.9g}" for value in matrix)), name="to_world")


def texture(name, given, is_number=False):
    """A colour, or a number that three equal channels hold, constant or by a picture or board."""
    if given["type"] == "rgb":
        return number(name, given["value"][0]) if is_number else rgb(name, given["value"])
    scale = given.get("to_uv", [1, 0, 0, 0, 1, 0, 0, 0, 1])
    if any(scale[at] for at in (1, 2, 3, 5, 6, 7)):
        raise NotAlike("texture coordinates that are more than scaled")
    to_uv = element("transform", element("scale", x=scale[0], y=scale[4]), name="to_uv")
    if given["type"] == "checkerboard":
        inside = rgb("color0", given["color0"]) + rgb("color1", given["color1"])
    elif given["type"] == "bitmap" and given.get("scale", 1.0) == 1.0:
        inside = text("filename", given["file"]) + element("boolean", name="raw", value=str(given.get("raw", False)).lower())
    else:
        raise NotAlike(f"the texture {given['type']}")
    return element("texture", inside + to_uv, type=given["type"], name=name)


def bsdf(given, **attributes):
    kind = given["type"]
    indices = "".join(number(name, given[name]) for name in ("int_ior", "ext_ior") if name in given)
    facets = number("alpha", given.get("alpha", 0.0)) + text("distribution", given.get("distribution", "beckmann"))
    metal = lambda: rgb("eta", given["eta"]) + rgb("k", given["k"])
    if kind == "two_sided":
        plugin, inside = "twosided", bsdf(given["material"])
    elif kind == "normal_map":
        plugin, inside = "normalmap", texture("normalmap", given["texture"]) + bsdf(given["material"])
    elif kind in ("diffuse", "rough_diffuse"):
        plugin, inside = "diffuse", texture("reflectance", given["reflectance"])
    elif kind in ("dielectric", "thin_dielectric"):
        plugin, inside = kind.replace("_", ""), indices
    elif kind == "rough_dielectric":
        plugin, inside = "roughdielectric", facets + indices
    elif kind == "conductor":
        plugin, inside = kind, metal()
    elif kind == "rough_conductor":
        plugin, inside = "roughconductor", facets + metal()
    elif kind == "plastic":
        inside = indices + texture("diffuse_reflectance", given["diffuse_reflectance"])
        inside += element("boolean", name="nonlinear", value=str(given["nonlinear"]).lower())
        plugin, inside = ("roughplastic", facets + inside) if given.get("alpha", 0.0) > 0.0 else ("plastic", inside)
    elif kind == "principled":
        inside = texture("base_color", given["base_color"]) + texture("roughness", given["roughness"], True)
        inside += texture("metallic", given["metallic"], True)
        inside += "".join(number(name, given[name]) for name in ("eta", "spec_tint", "sheen", "sheen_tint", "clearcoat", "clearcoat_gloss", "flatness", "spec_trans"))
        plugin = kind
    elif kind == "principled_thin":
        inside = texture("base_color", given["base_color"]) + texture("roughness", given["roughness"], True)
        # From 0 to 2 there.
        inside += number("diff_trans", 2.0 * given["diff_trans"]["value"][0]) + number("spec_trans", given["spec_trans"]["value"][0])
        inside += "".join(number(name, given[name]) for name in ("eta", "spec_tint", "sheen", "sheen_tint", "flatness"))
        plugin = "principledthin"
    else:
        raise NotAlike(f"the material {kind}")
    return element("bsdf", inside, type=plugin, **attributes)


def write_mesh(given, path):
    vertices = np.array(given["positions"], np.float32)
    triangles = np.array(given["triangles"], np.uint32)
    parts = {"vertex_positions": vertices.ravel(), "faces": triangles.ravel()}
    for key, name in (("normals", "vertex_normals"), ("uvs", "vertex_texcoords")):
        if given.get(key):
            parts[name] = np.array(given[key], np.float32).ravel()
    mesh = mitsuba.Mesh(path.stem, vertices.size // 3, triangles.size // 3, has_vertex_normals="vertex_normals" in parts, has_vertex_texcoords="vertex_texcoords" in parts)
    held = mitsuba.traverse(mesh)
    for name, values in parts.items():
        held[name] = values
    held.update()
    mesh.write_ply(str(path))


def shape(given, meshes):
    inside = transform(given["to_world"]) if given.get("to_world") else ""
    geometry = given["geometry"]
    if geometry["type"] == "sphere":
        kind = "sphere"
        inside += triple("point", "center", geometry["center"]) + number("radius", geometry["radius"])
    else:
        mesh = meshes[geometry["mesh"]]
        kind = "ply" if mesh["type"] == "inline" else mesh["type"]
        if kind == "ply":
            flat = str(not mesh.get("normals")).lower()
            inside += text("filename", geometry["mesh"] + ".ply") + element("boolean", name="face_normals", value=flat)
    inside += element("ref", id=given["material"])
    if given.get("emission"):
        inside += element("emitter", rgb("radiance", given["emission"]), type="area")
    return element("shape", inside, type=kind)


def light(given):
    kind = given["type"]
    if kind == "constant":
        return element("emitter", rgb("radiance", given["radiance"]), type=kind)
    if kind == "spot":
        angles = number("cutoff_angle", given["cutoff_angle"]) + number("beam_width", given["beam_width"])
        return element("emitter", transform(given["to_world"]) + rgb("intensity", given["intensity"]) + angles, type=kind)
    if kind == "sun":
        return element("emitter", triple("vector", "direction", given["direction"]) + rgb("irradiance", given["irradiance"]), type="directional")
    if kind == "envmap":
        return element("emitter", text("filename", given["file"]) + number("scale", given["scale"]) + transform(given["to_world"]), type=kind)
    if kind == "sky":
        # Its own z is up there.
        up = np.array(given["up"]) / np.linalg.norm(given["up"])
        side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        side /= np.linalg.norm(side)
        to_world = np.eye(4)
        to_world[:3, :3] = np.stack([side, np.cross(up, side), up], axis=1)
        inside = "".join(number(name, value) for name, value in (("turbidity", given["turbidity"]), ("sky_scale", given["scale"]), ("sun_scale", 0.0)))
        inside += rgb("albedo", given["albedo"]) + triple("vector", "sun_direction", to_world[:3, :3].T @ np.array(given["sun"]))
        return element("emitter", inside + transform(to_world.ravel()), type="sunsky")
    raise NotAlike(f"the light {kind}")


def convert(source, target):
    """Writes the scene in the folder `source` to the folder `target`; raises `NotAlike`."""
    scene = json.loads((source / "scene.json").read_text())
    if scene.get("media"):
        raise NotAlike("media")
    mitsuba.set_variant("scalar_rgb")
    target.mkdir(parents=True, exist_ok=True)
    for picture in source.glob("*.exr"):
        shutil.copy(picture, target)
    for name, mesh in scene["meshes"].items():
        if mesh["type"] == "inline":
            write_mesh(mesh, target / f"{name}.ply")
    camera, film = scene["camera"], scene["film"]
    whole = lambda name, value: element("integer", name=name, value=value)
    size = whole("width", film["width"]) + whole("height", film["height"]) + element("rfilter", type="box")
    # Scenes of any size have a camera that sees all that is before it.
    sees = number("fov", camera["fov"]) + number("near_clip", 1e-6) + transform(camera["to_world"])
    parts = [
        element("integrator", whole("max_depth", 20), type="path"),
        element("sensor", sees + element("film", size, type="hdrfilm"), type="perspective"),
        *(bsdf(material, id=name) for name, material in scene["materials"].items()),
        *(shape(one, scene["meshes"]) for one in scene["shapes"]),
        *(light(one) for one in scene.get("lights", [])),
    ]
    (target / "scene.xml").write_text(element("scene", "\n" + "\n".join(parts) + "\n", version="3.0.0") + "\n")


def main():
    source, target = map(pathlib.Path, sys.argv[1:])
    try:
        convert(source, target)
    except NotAlike as what:
        print(f"as_mitsuba: {source}: {what}", file=sys.stderr)
        return NOT_ALIKE


if __name__ == "__main__":
    sys.exit(main())
