"""Cameras, film and matrices as fanal has them."""

import math

import numpy as np
from mathutils import Matrix

# Blender's cameras look along -z with +x to the right; fanal's along +z with +x to the left.
_TURN = Matrix.Diagonal((-1.0, 1.0, -1.0, 1.0))


def rows(matrix):
    """A 4x4 matrix as a list, row by row."""
    return [float(x) for row in matrix for x in row]


def camera(eye, scene, size, warn):
    """fanal's camera of the evaluated camera object `eye`, for a picture of `size` pixels."""
    def tell(message):
        warn(f"camera “{eye.name}”: {message}")

    data, (width, height) = eye.data, size
    location, turn, _ = eye.matrix_world.decompose()
    world = Matrix.Translation(location) @ turn.to_matrix().to_4x4() @ _TURN
    render = scene.render
    if render.pixel_aspect_x != render.pixel_aspect_y:
        tell("its pixels are taken for squares")
    horizontal = data.sensor_fit == "HORIZONTAL" or data.sensor_fit == "AUTO" and width >= height
    # Shifts and sensors are measured along one side of the picture.
    side = width if horizontal else height
    out = {"to_world": rows(world)}
    if data.type == "ORTHO":
        out["orthographic_width"] = data.ortho_scale * width / side
    else:
        if data.type == "PANO":
            tell("a panorama is taken for a perspective of its lens")
        sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
        out["fov"] = math.degrees(2.0 * math.atan(sensor / (2.0 * data.lens) * width / side))
    shift = [data.shift_x * side / width, -data.shift_y * side / height]
    if any(shift):
        out["principal_point_offset"] = shift
    if data.dof.use_dof:
        lens = _lens(data, world, tell)
        if data.type == "ORTHO":
            tell("an orthographic camera of fanal has no lens: everything is in focus")
        else:
            out |= lens
    if render.use_motion_blur:
        warn("motion blur is left out")
    return out


def _lens(data, world, tell):
    dof = data.dof
    distance = dof.focus_distance
    if dof.focus_object is not None:
        axis = world.to_3x3().col[2]
        distance = abs((dof.focus_object.matrix_world.translation - world.translation).dot(axis))
    if dof.aperture_blades > 2 or dof.aperture_ratio != 1.0:
        tell("its aperture is taken for a disk")
    radius = data.lens * 1e-3 / (2.0 * dof.aperture_fstop) if dof.aperture_fstop > 0.0 else 0.0
    return {"aperture_radius": radius, "focus_distance": max(distance, 1e-6)}


def size_of(scene):
    """Columns and rows of the scene's picture."""
    render = scene.render
    sides = render.resolution_x, render.resolution_y
    width, height = (max(side * render.resolution_percentage // 100, 1) for side in sides)
    return width, height


def window_of(scene):
    """The render region as fanal's --crop has it: columns to the left of it, rows above it, its columns and rows; none without one."""
    render = scene.render
    if not render.use_border:
        return None
    width, height = size_of(scene)
    # Blender rounds the borders down, and counts rows from below.
    left, right = int(render.border_min_x * width), int(render.border_max_x * width)
    bottom, top = int(render.border_min_y * height), int(render.border_max_y * height)
    if right <= left or top <= bottom:
        return None
    return left, height - top, right - left, top - bottom


def film(scene, size, warn):
    """fanal's film: size and pixel filter, which is Cycles' if the scene has its settings."""
    out = {"width": size[0], "height": size[1]}
    cycles = getattr(scene, "cycles", None)
    if cycles is not None:
        # Cycles' numbers are full widths, which it multiplies by 2 and 3.
        width = cycles.filter_width
        if cycles.pixel_filter_type == "BLACKMAN_HARRIS":
            out["filter"] = {"type": "blackman_harris", "radius": width}
        elif cycles.pixel_filter_type == "GAUSSIAN":
            out["filter"] = {"type": "gaussian", "stddev": width / 4.0, "radius": 1.5 * width}
    if scene.render.use_border:
        warn("the render region is not exported: an F12 render keeps to it, elsewhere give it to fanal as --crop")
    if scene.render.film_transparent:
        warn("the background stays in the picture")
    return out


def render(scene, samples, warn):
    """fanal's rendering defaults."""
    cycles = getattr(scene, "cycles", None)
    if cycles is None:
        return {"spp": samples or 64}
    least = min(cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces)
    if least < cycles.max_bounces:
        warn(f"bounces of one kind are not limited by themselves (to {least}), only all together (to {cycles.max_bounces})")
    # Without bounces Cycles still shows direct light.
    return {"spp": samples or max(cycles.samples, 1), "max_depth": cycles.max_bounces + 2}


def sees(eye, scene, size, points):
    """Whether any of the points (n, 3) is within the camera's view, whatever is in front of it."""
    given = camera(eye, scene, size, lambda _: None)
    world = np.array(given["to_world"]).reshape(4, 4)
    local = (np.linalg.inv(world) @ np.concatenate([points, np.ones((len(points), 1))], axis=1).T).T[:, :3]
    if "fov" in given:
        half = math.tan(math.radians(given["fov"]) / 2.0)
        front = local[:, 2] > 0.0
        plane = local[:, :2] / np.where(front, local[:, 2], 1.0)[:, None]
    else:
        half = given["orthographic_width"] / 2.0
        front, plane = np.ones(len(local), bool), local[:, :2]
    shift = np.array(given.get("principal_point_offset", [0.0, 0.0])) * 2.0
    x = -plane[:, 0] / half - shift[0]
    y = -plane[:, 1] / (half * size[1] / size[0]) - shift[1]
    return bool((front & (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0)).any())
