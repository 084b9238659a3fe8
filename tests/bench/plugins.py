#!/usr/bin/env python3
"""Are scenes of Mitsuba 3 read as they are meant? One small scene for every plugin and most of their parameters, rendered by both.

    pip install mitsuba numpy          (for llvm_ad_rgb LLVM 19, too)
    python3 tests/bench/plugins.py OUT [--fanal FANAL] [--only PART_OF_A_NAME] [--variant llvm_ad_rgb]

Both render each scene with four seeds. For the whole picture and for its 8 × 8 blocks the table has the difference of the means over Mitsuba's,
the largest of a block in standard errors of the eight renders too. What differs by more than 1 % and four standard errors as a whole, or by more
than 4 % of the picture's mean and seven of them in a block, is marked and makes the exit code 1. Differences that are known and meant are listed in KNOWN, with why.
"""

import argparse
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
SIZE, BLOCK, SEEDS, SAMPLES = 64, 8, 4, 64

CAMERA = """<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0.6,-4.2,2.6" target="0,0,0.7" up="0,0,1"/></transform>{film}</sensor>"""
FILM = f"""<film type="hdrfilm"><integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/><rfilter type="box"/></film><sampler type="independent"><integer name="sample_count" value="{SAMPLES}"/></sampler>"""
LIGHTS = """<emitter type="constant"><rgb name="radiance" value="0.4,0.5,0.7"/></emitter>
<shape type="rectangle"><transform name="to_world"><scale value="0.7"/><lookat origin="2,-1.5,3.5" target="0,0,0.5" up="0,1,0"/></transform><emitter type="area"><rgb name="radiance" value="12,10,8"/></emitter></shape>"""
FLOOR = """<shape type="rectangle"><transform name="to_world"><scale value="4"/></transform><bsdf type="diffuse"><texture name="reflectance" type="checkerboard"><rgb name="color0" value="0.2,0.3,0.4"/><rgb name="color1" value="0.6,0.5,0.4"/><transform name="to_uv"><scale x="8" y="8"/></transform></texture></bsdf></shape>"""
BALL = """<shape type="sphere"><point name="center" x="0" y="0" z="0.8"/><float name="radius" value="0.75"/>{inside}</shape>"""
GREY = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5,0.6,0.4"/></bsdf>'


def scene(material=GREY, shape=BALL, lights=LIGHTS, floor=FLOOR, camera=CAMERA, film=FILM, integrator="path", depth=12):
    return f"""<scene version="3.0.0"><integrator type="{integrator}"><integer name="max_depth" value="{depth}"/><integer name="rr_depth" value="100"/></integrator>
{camera.format(film=film)}
{lights}
{floor}
{shape.format(inside=material)}
</scene>
"""


def bsdf(kind, *inside):
    return f'<bsdf type="{kind}">{"".join(inside)}</bsdf>'


def number(name, value):
    return f'<float name="{name}" value="{value}"/>'


def word(name, value):
    return f'<string name="{name}" value="{value}"/>'


def truth(name, value):
    return f'<boolean name="{name}" value="{value}"/>'


def rgb(name, value):
    return f'<rgb name="{name}" value="{value}"/>'


def picture(name, *inside, file="picture.png"):
    return f'<texture name="{name}" type="bitmap"><string name="filename" value="{file}"/>{"".join(inside)}</texture>'


def to_uv(inside):
    return f'<transform name="to_uv">{inside}</transform>'


def materials():
    red = rgb("reflectance", "0.7,0.3,0.1")
    yield "diffuse", bsdf("diffuse", red)
    yield "diffuse spectrum", bsdf("diffuse", '<spectrum name="reflectance" value="400:0.1, 500:0.3, 600:0.8, 700:0.6"/>')
    yield "diffuse uniform spectrum", bsdf("diffuse", '<spectrum name="reflectance" value="0.4"/>')
    yield "bitmap", bsdf("diffuse", picture("reflectance"))
    yield "bitmap nearest", bsdf("diffuse", picture("reflectance", word("filter_type", "nearest")))
    yield "bitmap raw", bsdf("diffuse", picture("reflectance", truth("raw", "true")))
    for wrap in "repeat", "mirror", "clamp":
        yield f"bitmap {wrap}", bsdf("diffuse", picture("reflectance", word("wrap_mode", wrap), to_uv('<scale x="2.7" y="1.9"/><translate x="-0.3" y="0.2"/>')))
    yield "bitmap turned", bsdf("diffuse", picture("reflectance", to_uv('<rotate z="1" angle="30"/>')))
    yield "checkerboard turned", bsdf("diffuse", '<texture name="reflectance" type="checkerboard">' + rgb("color0", "0.1,0.6,0.2") + rgb("color1", "0.8,0.3,0.2") + to_uv('<scale x="6" y="4"/><rotate z="1" angle="20"/>') + "</texture>")
    yield "conductor default", bsdf("conductor")
    for metal in "Au", "Cu", "Al", "Ag", "none", "Cr", "W", "Ir", "TiN", "VN", "Li", "Hg":
        yield f"conductor {metal}", bsdf("conductor", word("material", metal))
    yield "conductor rgb", bsdf("conductor", rgb("eta", "0.2,0.9,1.1"), rgb("k", "3.9,2.4,2.2"), rgb("specular_reflectance", "0.9,0.8,0.7"))
    for distribution in "beckmann", "ggx":
        for alpha in 0.02, 0.15, 0.5, 0.9:
            yield f"roughconductor {distribution} {alpha}", bsdf("roughconductor", word("distribution", distribution), number("alpha", alpha), word("material", "Au"))
        yield f"roughconductor {distribution} anisotropic", bsdf("roughconductor", word("distribution", distribution), number("alpha_u", 0.05), number("alpha_v", 0.4), word("material", "Al"))
        for alpha in 0.05, 0.3, 0.7:
            yield f"roughdielectric {distribution} {alpha}", bsdf("roughdielectric", word("distribution", distribution), number("alpha", alpha))
            yield f"roughplastic {distribution} {alpha}", bsdf("roughplastic", word("distribution", distribution), number("alpha", alpha), rgb("diffuse_reflectance", "0.2,0.5,0.7"))
    yield "roughconductor defaults", bsdf("roughconductor")
    yield "roughconductor textured", bsdf("roughconductor", picture("alpha", truth("raw", "true")), word("distribution", "ggx"), word("material", "Al"))
    yield "roughconductor reflectance", bsdf("roughconductor", number("alpha", 0.3), picture("specular_reflectance"))
    yield "dielectric", bsdf("dielectric")
    yield "dielectric diamond", bsdf("dielectric", word("int_ior", "diamond"))
    yield "dielectric tinted", bsdf("dielectric", number("int_ior", 1.33), rgb("specular_reflectance", "0.9,0.5,0.5"), rgb("specular_transmittance", "0.5,0.9,0.7"))
    yield "dielectric turned about", bsdf("dielectric", number("int_ior", 1.0), number("ext_ior", 1.5))
    yield "thindielectric", bsdf("thindielectric", number("int_ior", 1.7), rgb("specular_transmittance", "0.9,0.7,0.8"))
    yield "roughdielectric turned about", bsdf("roughdielectric", number("int_ior", 1.0), number("ext_ior", 1.5), number("alpha", 0.2))
    yield "roughdielectric tinted", bsdf("roughdielectric", number("alpha", 0.2), rgb("specular_reflectance", "0.9,0.5,0.5"), rgb("specular_transmittance", "0.5,0.9,0.7"))
    for nonlinear in "false", "true":
        yield f"plastic nonlinear {nonlinear}", bsdf("plastic", truth("nonlinear", nonlinear), rgb("diffuse_reflectance", "0.7,0.2,0.3"))
        yield f"roughplastic nonlinear {nonlinear}", bsdf("roughplastic", truth("nonlinear", nonlinear), rgb("diffuse_reflectance", "0.7,0.2,0.3"), number("int_ior", 1.9))
    yield "plastic textured", bsdf("plastic", picture("diffuse_reflectance"), rgb("specular_reflectance", "0.5,0.8,0.2"))
    yield "roughplastic textured", bsdf("roughplastic", picture("diffuse_reflectance"), rgb("specular_reflectance", "0.5,0.8,0.2"))
    yield "principled", bsdf("principled", rgb("base_color", "0.7,0.3,0.2"))
    for name, value in (("metallic", 0.7), ("roughness", 0.1), ("roughness", 0.9), ("specular", 0.9), ("spec_tint", 0.8), ("sheen", 0.9), ("clearcoat", 0.9), ("flatness", 0.8), ("spec_trans", 0.8), ("anisotropic", 0.8), ("eta", 1.9)):
        rest = [number("roughness", 0.4)] if name != "roughness" else []
        yield f"principled {name} {value}", bsdf("principled", rgb("base_color", "0.7,0.3,0.2"), number(name, value), *rest)
    yield "principled sheen_tint", bsdf("principled", rgb("base_color", "0.7,0.3,0.2"), number("sheen", 0.9), number("sheen_tint", 0.9))
    yield "principled clearcoat_gloss", bsdf("principled", rgb("base_color", "0.7,0.3,0.2"), number("clearcoat", 0.9), number("clearcoat_gloss", 0.9))
    yield "principled glass", bsdf("principled", rgb("base_color", "0.9,0.95,0.9"), number("spec_trans", 1.0), number("roughness", 0.2))
    yield "principled metal", bsdf("principled", rgb("base_color", "0.9,0.6,0.3"), number("metallic", 1.0), number("roughness", 0.3), number("anisotropic", 0.0))
    yield "principled textured", bsdf("principled", picture("base_color"), picture("roughness", truth("raw", "true")))
    for name, value in (("roughness", 0.3), ("spec_trans", 0.7), ("diff_trans", 1.2), ("sheen", 0.8), ("flatness", 0.7), ("eta", 1.8)):
        yield f"principledthin {name}", bsdf("principledthin", rgb("base_color", "0.7,0.5,0.2"), number(name, value))
    yield "blendbsdf", bsdf("blendbsdf", number("weight", 0.3), bsdf("diffuse", red), bsdf("roughconductor", number("alpha", 0.2)))
    yield "blendbsdf textured", bsdf("blendbsdf", picture("weight", truth("raw", "true")), bsdf("diffuse", red), bsdf("conductor"))
    yield "blendbsdf smooth", bsdf("blendbsdf", number("weight", 0.3), bsdf("diffuse", red), bsdf("conductor"))
    yield "blendbsdf textured rough", bsdf("blendbsdf", picture("weight", truth("raw", "true")), bsdf("diffuse", red), bsdf("roughconductor", number("alpha", 0.2)))
    yield "mask", bsdf("mask", number("opacity", 0.4), bsdf("diffuse", red))
    yield "mask textured", bsdf("mask", picture("opacity", truth("raw", "true")), bsdf("twosided", bsdf("diffuse", red)))
    yield "twosided two", bsdf("twosided", bsdf("diffuse", red), bsdf("diffuse", rgb("reflectance", "0.1,0.2,0.8")))
    yield "bumpmap", bsdf("bumpmap", picture("arbitrary", truth("raw", "true")), number("scale", 0.6), bsdf("diffuse", red))
    yield "bumpmap glossy", bsdf("bumpmap", picture("arbitrary", truth("raw", "true")), number("scale", 0.3), bsdf("roughconductor", number("alpha", 0.2)))
    yield "normalmap", bsdf("normalmap", picture("normalmap", truth("raw", "true"), file="normals.png"), bsdf("diffuse", red))
    yield "null", bsdf("null")
    yield "hair", bsdf("hair")


def shapes():
    turn = '<transform name="to_world"><rotate x="1" angle="25"/><rotate z="1" angle="40"/><translate z="0.8"/></transform>'
    textured = bsdf("twosided", bsdf("diffuse", picture("reflectance")))
    yield "sphere textured turned", scene(textured, f'<shape type="sphere"><float name="radius" value="0.7"/>{turn}{{inside}}</shape>')
    yield "cylinder", scene(textured, f'<shape type="cylinder"><float name="radius" value="0.4"/><point name="p0" value="0,0,-0.5"/><point name="p1" value="0.3,0.1,0.6"/>{turn}{{inside}}</shape>')
    yield "disk", scene(textured, f'<shape type="disk"><transform name="to_world"><rotate x="1" angle="70"/><translate z="0.9"/></transform>{{inside}}</shape>')
    yield "rectangle", scene(textured, '<shape type="rectangle"><transform name="to_world"><scale value="0.7"/><rotate x="1" angle="70"/><translate z="0.9"/></transform>{inside}</shape>')
    yield "cube", scene(textured, f'<shape type="cube"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="25"/><rotate z="1" angle="40"/><translate z="0.8"/></transform>{{inside}}</shape>')
    yield "mirrored", scene(textured, '<shape type="cube"><transform name="to_world"><scale x="-0.5" y="0.5" z="0.4"/><rotate z="1" angle="40"/><translate z="0.8"/></transform>{inside}</shape>')
    yield "flipped glass", scene(bsdf("dielectric"), BALL.replace("{inside}", truth("flip_normals", "true") + "{inside}"))
    yield "instances", scene(GREY, '<shape type="shapegroup" id="group"><shape type="cube">{inside}</shape><shape type="sphere"><point name="center" value="0,0,1.5"/><float name="radius" value="0.5"/>' + bsdf("plastic") + '</shape></shape><shape type="instance"><ref id="group"/><transform name="to_world"><scale value="0.3"/><rotate z="1" angle="20"/><translate x="-0.6" z="0.5"/></transform></shape><shape type="instance"><ref id="group"/><transform name="to_world"><scale x="0.4" y="-0.2" z="0.4"/><translate x="0.6" z="0.6"/></transform></shape>')
    for normals in "false", "true":
        yield f"obj face_normals {normals}", scene(GREY, '<shape type="obj"><string name="filename" value="ring.obj"/>' + truth("face_normals", normals) + turn + "{inside}</shape>")
    yield "obj flip_tex_coords", scene(textured, '<shape type="obj"><string name="filename" value="ring.obj"/>' + truth("flip_tex_coords", "false") + turn + "{inside}</shape>")
    yield "ply attributes", scene(bsdf("diffuse", '<texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/></texture>'), f'<shape type="ply"><string name="filename" value="ring.ply"/>{turn}{{inside}}</shape>')
    curve = '<shape type="{kind}"><string name="filename" value="curve.txt"/>{{inside}}</shape>'
    for kind in "linearcurve", "bsplinecurve":
        yield kind, scene(GREY, curve.format(kind=kind))
        yield f"{kind} placed", scene(GREY, curve.format(kind=kind).replace("{inside}", '<transform name="to_world"><scale value="0.6"/><rotate x="1" angle="20"/></transform>{inside}'))
    yield "bsplinecurve textured", scene(textured, curve.format(kind="bsplinecurve"))


def lights():
    bare = lambda *inside: "".join(inside)
    yield "area sphere", bare('<shape type="sphere"><point name="center" value="1.5,-1,3"/><float name="radius" value="0.4"/><emitter type="area"><rgb name="radiance" value="20,18,15"/></emitter></shape>')
    yield "area disk", bare('<shape type="disk"><transform name="to_world"><lookat origin="2,-1.5,3.5" target="0,0,0.5" up="0,1,0"/></transform><emitter type="area"><rgb name="radiance" value="9,8,7"/></emitter></shape>')
    yield "area cylinder", bare('<shape type="cylinder"><float name="radius" value="0.1"/><point name="p0" value="-1,-1,3"/><point name="p1" value="1,-1,3"/><emitter type="area"><rgb name="radiance" value="20,18,15"/></emitter></shape>')
    yield "area textured", bare('<shape type="rectangle"><transform name="to_world"><scale value="0.7"/><lookat origin="2,-1.5,3.5" target="0,0,0.5" up="0,1,0"/></transform><emitter type="area">' + picture("radiance", file="bright.exr") + "</emitter></shape>")
    yield "area spectrum", bare('<shape type="sphere"><point name="center" value="1.5,-1,3"/><float name="radius" value="0.4"/><emitter type="area"><spectrum name="radiance" value="400:5, 500:8, 600:15, 700:18"/></emitter></shape>')
    yield "area d65", bare('<shape type="sphere"><point name="center" value="1.5,-1,3"/><float name="radius" value="0.4"/><emitter type="area"><spectrum name="radiance" type="d65"><float name="scale" value="15"/></spectrum></emitter></shape>')
    yield "point", bare('<emitter type="point"><point name="position" value="1.5,-1.5,3"/><rgb name="intensity" value="20,18,15"/></emitter>')
    yield "spot", bare('<emitter type="spot"><transform name="to_world"><lookat origin="1.5,-1.5,3" target="0,0,0.5" up="0,0,1"/></transform><rgb name="intensity" value="30,28,25"/><float name="cutoff_angle" value="25"/><float name="beam_width" value="12"/></emitter>')
    yield "spot textured", bare('<emitter type="spot"><transform name="to_world"><lookat origin="1.5,-1.5,3" target="0,0,0.5" up="0,0,1"/></transform><rgb name="intensity" value="30,28,25"/><float name="cutoff_angle" value="30"/>' + picture("texture") + "</emitter>")
    yield "directional", bare('<emitter type="directional"><vector name="direction" value="-0.5,0.4,-0.8"/><rgb name="irradiance" value="2,1.8,1.5"/></emitter>')
    yield "constant", bare('<emitter type="constant"><rgb name="radiance" value="0.4,0.5,0.7"/></emitter>')
    yield "envmap", bare('<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>')
    yield "envmap turned", bare('<emitter type="envmap"><string name="filename" value="sky.exr"/><float name="scale" value="1.7"/><transform name="to_world"><rotate x="1" angle="90"/><rotate z="1" angle="70"/></transform></emitter>')
    yield "projector", bare('<emitter type="projector"><transform name="to_world"><lookat origin="1.5,-1.5,3" target="0,0,0.5" up="0,0,1"/></transform>' + picture("irradiance") + '<float name="fov" value="35"/><float name="scale" value="20"/></emitter>')
    for turbidity in 2, 6:
        yield f"sunsky {turbidity}", bare(f'<emitter type="sunsky"><vector name="sun_direction" value="0.4,-0.5,0.6"/><float name="turbidity" value="{turbidity}"/><float name="sun_scale" value="0.3"/><float name="sky_scale" value="1"/></emitter>')
    yield "sunsky time", bare('<emitter type="sunsky"><integer name="year" value="2020"/><integer name="month" value="6"/><integer name="day" value="10"/><float name="hour" value="10"/><float name="latitude" value="48"/><float name="longitude" value="2"/><float name="timezone" value="2"/></emitter>')


def cameras():
    place = '<transform name="to_world"><lookat origin="0.6,-4.2,2.6" target="0,0,0.7" up="0,0,1"/></transform>'
    wide = FILM.replace(f'"height" value="{SIZE}"', '"height" value="32"')
    for axis in "x", "y", "diagonal", "smaller", "larger":
        yield f"fov_axis {axis}", scene(camera=f'<sensor type="perspective"><float name="fov" value="35"/><string name="fov_axis" value="{axis}"/>{place}{{film}}</sensor>', film=wide)
    yield "focal_length", scene(camera=f'<sensor type="perspective"><string name="focal_length" value="50mm"/>{place}{{film}}</sensor>', film=wide)
    yield "principal point", scene(camera=f'<sensor type="perspective"><float name="fov" value="35"/><float name="principal_point_offset_x" value="0.2"/><float name="principal_point_offset_y" value="-0.1"/>{place}{{film}}</sensor>')
    yield "near_clip", scene(camera=f'<sensor type="perspective"><float name="fov" value="35"/><float name="near_clip" value="4.4"/>{place}{{film}}</sensor>')
    yield "thinlens", scene(camera=f'<sensor type="thinlens"><float name="fov" value="40"/><float name="aperture_radius" value="0.25"/><float name="focus_distance" value="3.5"/>{place}{{film}}</sensor>')
    yield "orthographic", scene(camera='<sensor type="orthographic"><transform name="to_world"><scale x="2" y="2"/><lookat origin="0.6,-4.2,2.6" target="0,0,0.7" up="0,0,1"/></transform>{film}</sensor>')
    yield "crop", scene(film=f'<film type="hdrfilm"><integer name="width" value="128"/><integer name="height" value="96"/><integer name="crop_width" value="{SIZE}"/><integer name="crop_height" value="{SIZE}"/><integer name="crop_offset_x" value="30"/><integer name="crop_offset_y" value="10"/><rfilter type="box"/></film><sampler type="independent"><integer name="sample_count" value="{SAMPLES}"/></sampler>')
    for filter in "gaussian", "tent", "mitchell", "catmullrom", "lanczos":
        yield f"rfilter {filter}", scene(film=FILM.replace('"box"', f'"{filter}"'))
    for depth in 1, 2, 3, 5:
        yield f"max_depth {depth}", scene(bsdf("dielectric"), depth=depth)
    yield "hide_emitters", scene().replace('<integer name="rr_depth"', truth("hide_emitters", "true") + '<integer name="rr_depth"')


def media():
    ball = lambda medium, surface='<bsdf type="null"/>': BALL.replace("{inside}", surface + medium)
    inside = lambda *words: f'<medium name="interior" type="homogeneous">{"".join(words)}</medium>'
    volume = lambda **rest: scene(integrator="volpath", depth=40, **rest)
    for name, phase in (("isotropic", '<phase type="isotropic"/>'), ("hg", '<phase type="hg"><float name="g" value="0.7"/></phase>'), ("hg back", '<phase type="hg"><float name="g" value="-0.5"/></phase>'), ("rayleigh", '<phase type="rayleigh"/>'), ("blendphase", '<phase type="blendphase"><float name="weight" value="0.3"/><phase type="isotropic"/><phase type="hg"><float name="g" value="0.8"/></phase></phase>')):
        yield f"homogeneous {name}", volume(shape=ball(inside(rgb("albedo", "0.9,0.7,0.5"), number("sigma_t", 2.5), phase)))
    yield "homogeneous in glass", volume(shape=ball(inside(rgb("albedo", "0.9,0.7,0.5"), number("sigma_t", 1.5)), '<bsdf type="dielectric"/>'))
    yield "homogeneous in rough glass", volume(shape=ball(inside(rgb("albedo", "0.9,0.7,0.5"), number("sigma_t", 1.5)), '<bsdf type="roughdielectric"><float name="alpha" value="0.2"/></bsdf>'))
    cloud = lambda *words: f'<medium name="interior" type="heterogeneous"><volume name="sigma_t" type="gridvolume"><string name="filename" value="cloud.vol"/><transform name="to_world"><scale value="1.5"/><translate x="-0.75" y="-0.75" z="0.05"/></transform></volume>{"".join(words)}</medium>'
    yield "heterogeneous", volume(shape=ball(cloud(number("scale", 4), '<rgb name="albedo" value="0.9,0.7,0.5"/>')))
    yield "heterogeneous hg", volume(shape=ball(cloud(number("scale", 4), '<rgb name="albedo" value="0.9,0.7,0.5"/>', '<phase type="hg"><float name="g" value="0.6"/></phase>')))


def cases():
    for name, material in materials():
        yield name, scene(material)
    yield from shapes()
    for name, light in lights():
        yield name, scene(lights=light)
    yield from cameras()
    yield from media()


# Names that differ and are meant to, and why.
SMOOTH_BLEND = "Mitsuba's is darker than the sum of its parts, ours is that sum (without light between surfaces it can be added up)"
LEAKS = "rays that leave a strand of Mitsuba's from inside pass, so that its open ends let light through"
KNOWN = {
    "bsplinecurve": LEAKS,
    "bsplinecurve placed": LEAKS,
    "blendbsdf smooth": SMOOTH_BLEND,
    "blendbsdf textured": SMOOTH_BLEND,
    "instances": "Mitsuba's LLVM mode turns the normals of instanced spheres that are scaled unevenly in another way than its scalar mode, which agrees with ours",
    "hair": "hair is read as a coat over a diffuse base",
    "bsplinecurve textured": "around a curve Mitsuba's texture coordinates begin where it bends to, ours anywhere",
    "linearcurve": "tubes meet in a plane, Mitsuba's straight pieces in a ball",
    "linearcurve placed": "tubes meet in a plane, Mitsuba's straight pieces in a ball",
    "homogeneous blendphase": "other phase functions than hg are isotropic",
}


def files(out, mi, np):
    """Pictures, meshes and a volume that the scenes ask for."""
    generator = np.random.default_rng(7)
    smooth = lambda *size: sum(np.kron(generator.uniform(0, 1, [side if axis < 2 else s for axis, s in enumerate(size)]), np.ones([size[0] // side, size[1] // side] + [1] * (len(size) - 2))) for side in (4, 8)) / 2
    to_byte = lambda values: np.clip(values * 255, 0, 255).astype(np.uint8)
    mi.Bitmap(to_byte(0.1 + 0.8 * smooth(32, 32, 3))).write(str(out / "picture.png"))
    slopes = 0.35 * (smooth(32, 32, 2) - 0.5)
    normals = np.concatenate([slopes, np.ones((32, 32, 1))], -1)
    mi.Bitmap(to_byte(normals / np.linalg.norm(normals, axis=-1, keepdims=True) / 2 + 0.5)).write(str(out / "normals.png"))
    mi.Bitmap((20 * smooth(16, 16, 3)).astype(np.float32)).write(str(out / "bright.exr"))
    sky = smooth(32, 64, 3).astype(np.float32)
    sky[6:9, 40:44] += 25
    mi.Bitmap(sky).write(str(out / "sky.exr"))
    density = generator.uniform(0.2, 1.0, (8, 8, 8)).astype(np.float32)
    mi.VolumeGrid(density).write(str(out / "cloud.vol"))
    # A ring with a square section, its normals those of a torus.
    around, across = 24, 4
    points, turned, places = [], [], []
    for i in range(around + 1):
        for j in range(across + 1):
            a, b = 2 * np.pi * i / around, 2 * np.pi * j / across
            points.append(((0.6 + 0.2 * np.cos(b)) * np.cos(a), (0.6 + 0.2 * np.cos(b)) * np.sin(a), 0.2 * np.sin(b)))
            turned.append((np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)))
            places.append((i / around, j / across))
    faces = [(k, k + across + 1, k + 1) for i in range(around) for j in range(across) for k in [i * (across + 1) + j]]
    faces += [(k + across + 1, k + across + 2, k + 1) for i in range(around) for j in range(across) for k in [i * (across + 1) + j]]
    lines = ["v %g %g %g" % p for p in points] + ["vn %g %g %g" % n for n in turned] + ["vt %g %g" % p for p in places]
    lines += ["f " + " ".join(f"{v + 1}/{v + 1}/{v + 1}" for v in face) for face in faces]
    (out / "ring.obj").write_text("\n".join(lines) + "\n")
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property float {c}" for c in ("x", "y", "z", "r", "g", "b")), f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    body = ["%g %g %g %g %g %g" % (*p, 0.2 + 0.6 * u, 0.3, 0.8 - 0.6 * v) for p, (u, v) in zip(points, places)] + ["3 %d %d %d" % face for face in faces]
    (out / "ring.ply").write_text("\n".join(head + body) + "\n")
    strands = ["\n".join("%g %g %g %g" % (0.5 * s - 0.75 + 0.2 * np.sin(3 * t), 0.3 * np.cos(2 * t), 0.1 + 0.4 * t, 0.12 - 0.02 * t) for t in range(5)) for s in range(4)]
    (out / "curve.txt").write_text("\n\n".join(strands) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--fanal", default=str(ROOT / "target/release/fanal"))
    parser.add_argument("--only", default="")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args()
    import mitsuba as mi
    import numpy as np

    mi.set_variant(args.variant)
    mi.set_log_level(mi.LogLevel.Error)
    args.out.mkdir(parents=True, exist_ok=True)
    files(args.out, mi, np)
    blocks = lambda image: image[..., :3].reshape(image.shape[0] // BLOCK, BLOCK, image.shape[1] // BLOCK, BLOCK, 3).mean((1, 3))
    failed = 0
    print(f"| scene | ours | Mitsuba's | difference | largest of a block | in standard errors | |\n|---|---|---|---|---|---|---|")
    for name, text in cases():
        if args.only not in name:
            continue
        file = args.out / (name.replace(" ", "-") + ".xml")
        file.write_text(text)
        pictures = []
        for seed in range(SEEDS):
            out = file.with_suffix(f".{seed}.exr")
            command = [args.fanal, "render", file, "-o", out, "--guide", "none", "--spp", SAMPLES, "--adaptive", "off", "--seed", seed, "--quiet"]
            ran = subprocess.run(list(map(str, command)), capture_output=True, text=True)
            if ran.returncode:
                break
            pictures.append(np.array(mi.Bitmap(str(out)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32)))
        said = " ".join(ran.stderr.split())[:200]
        if ran.returncode:
            failed += 1
            print(f"| {name} | refused: {said} | | | | | **!** |", flush=True)
            continue
        try:
            loaded = mi.load_file(str(file))
            theirs = [np.array(mi.render(loaded, spp=SAMPLES, seed=seed))[..., :3] for seed in range(SEEDS)]
        except Exception as problem:
            print(f"| {name} | | refuses: {' '.join(str(problem).split())[:150]} | | | | |", flush=True)
            continue
        if pictures[0].shape != theirs[0].shape:
            failed += name not in KNOWN
            print(f"| {name} | {pictures[0].shape} | {theirs[0].shape} | | | | **!** sizes {KNOWN.get(name, '')} {said} |", flush=True)
            continue
        ours, theirs = (np.stack([blocks(image.astype(np.float64)) for image in images]) for images in (pictures, theirs))
        mean = theirs.mean() + 1e-12
        spread = np.sqrt((ours.var(0, ddof=1) + theirs.var(0, ddof=1)) / SEEDS)
        off = np.abs(ours.mean(0) - theirs.mean(0))
        # Four seeds know little of their variance: what the picture's blocks have in the median is the least.
        errors = off / np.maximum(spread, np.median(spread) + 1e-9)
        worst = np.unravel_index(errors.argmax(), errors.shape)
        whole = ours.mean() / mean - 1
        of_whole = np.sqrt((ours.mean((1, 2, 3)).var(ddof=1) + theirs.mean((1, 2, 3)).var(ddof=1)) / SEEDS) / mean
        bad = abs(whole) > max(0.01, 4 * of_whole) or (errors.max() > 7 and off[worst] > 0.04 * mean)
        known = KNOWN.get(name, "")
        failed += bad and not known
        print(f"| {name} | {ours.mean():.5f} | {mean:.5f} | {100 * whole:+.2f} % | {100 * off[worst] / mean:.1f} % | {errors.max():.1f} | {('**!** ' if bad else '') + known} {said} |", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
