"""Lamps translated to fanal's lights and emitting shapes.

Blender's units are physical: a lamp of P watts that shines alike in all directions has the radiant intensity P/4π, a surface of
area A that does the radiance P/πA (a sphere's area is 4πr², what one sees of it πr²), a sun the irradiance of its strength.
tests/test_units.py holds that against Cycles.
"""

import math

import numpy as np
from mathutils import Matrix

from .camera import rows
from .nodes import Evaluator, Place, named, source_of

# Smallest sun that is a disk for fanal, degrees.
_LEAST_ANGLE = 0.1
# Directions on which soft lamps are looked for in the picture.
_POINTS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)


class Lamps:
    """Translates lamps. `out` gets lights and shapes, `sees(points)` says whether a camera has points in its view."""

    def __init__(self, pictures, warn, out, sees):
        self.pictures, self._warn, self.out, self.sees = pictures, warn, out, sees
        self.name = ""

    def warn(self, message):
        self._warn(f"light “{self.name}”: {message}")

    def add(self, object, world):
        """Adds the lamp of an evaluated object at the matrix `world`."""
        self.name, lamp = object.name, object.data
        color = self._color(lamp)
        if not any(color > 0.0):
            return
        if not lamp.use_shadow:
            self.warn("it casts shadows")
        for name in ("diffuse_factor", "specular_factor", "transmission_factor", "volume_factor"):
            if getattr(lamp, name, 1.0) != 1.0:
                self.warn(f"its {name.replace('_', ' ')} is left out")
        for name in ("visible_diffuse", "visible_glossy", "visible_transmission"):
            if not getattr(object, name):
                self.warn(f"rays for which it is not {name.replace('_', ' ')} see it")
        getattr(self, "_" + lamp.type.lower())(object, lamp, world, color)

    def _color(self, lamp):
        """Power (or strength) with all its factors, per channel."""
        color = np.array(lamp.color[:], float) * lamp.energy
        if getattr(lamp, "exposure", 0.0):
            color *= 2.0 ** lamp.exposure
        if getattr(lamp, "use_temperature", False):
            color *= np.array(lamp.temperature_color[:])
        if not (lamp.use_nodes and lamp.node_tree):
            return color
        output = lamp.node_tree.get_output_node("CYCLES") or lamp.node_tree.get_output_node("ALL")
        given, place = source_of(output.inputs["Surface"], Place(lamp.node_tree)) if output else (None, None)
        if given is None:
            return color * 0.0
        if given.node.bl_idname != "ShaderNodeEmission":
            self.warn(f"its shader “{given.node.name}” ({given.node.bl_label}) is left out")
            return color
        evaluator = Evaluator(self.pictures, self.warn)
        strength = evaluator.number(given.node, "Strength", place)
        shade = evaluator.socket(named(given.node, "Color"), place)
        if not shade.is_constant:
            self.warn("its light is the mean of a picture")
        return color * strength * np.broadcast_to(shade.mean(), 3)

    def _point(self, object, lamp, world, color):
        radius = lamp.shadow_soft_size
        intensity = color / (4.0 * math.pi)
        if radius <= 0.0:
            self.out["lights"].append({"type": "point", "position": list(world.translation), "intensity": intensity.tolist()})
            return
        if not getattr(lamp, "normalize", True):
            intensity *= 4.0 * math.pi * radius * radius
        center = np.array(world.translation)
        self._shape({"type": "sphere", "center": center.tolist(), "radius": radius}, None, intensity / (math.pi * radius * radius),
                    object, center + _POINTS * radius)

    def _spot(self, object, lamp, world, color):
        intensity = color / (4.0 * math.pi)
        if lamp.shadow_soft_size > 0.0:
            self.warn(f"its radius of {lamp.shadow_soft_size:g} is left out: its shadows are sharp")
            if not getattr(lamp, "normalize", True):
                intensity *= 4.0 * math.pi * lamp.shadow_soft_size ** 2
        if lamp.use_square:
            self.warn("its cone is round, not square")
        location, turn, scale = world.decompose()
        if max(scale) - min(scale) > 1e-4 * max(scale):
            self.warn("its cone is round, though the lamp is scaled")
        cutoff = min(lamp.spot_size / 2.0, math.pi)
        beam = cutoff if lamp.spot_blend <= 0.0 else linear_edge(cutoff, lamp.spot_blend)
        if lamp.spot_blend > 0.0:
            self.warn("its edge falls off linearly, with the same power")
        turn = turn.to_matrix().to_4x4() @ Matrix.Rotation(math.pi, 4, "X")
        self.out["lights"].append({
            "type": "spot", "to_world": rows(Matrix.Translation(location) @ turn), "intensity": intensity.tolist(),
            "cutoff_angle": math.degrees(cutoff), "beam_width": math.degrees(beam),
        })

    def _sun(self, object, lamp, world, color):
        direction = -world.to_3x3().col[2].normalized()
        light = {"type": "directional", "direction": list(direction), "irradiance": color.tolist()}
        angle = math.degrees(lamp.angle)
        if not getattr(lamp, "normalize", True) and lamp.angle > 0.0:
            light["irradiance"] = (color * math.pi * math.sin(lamp.angle / 2.0) ** 2).tolist()
        if angle >= _LEAST_ANGLE:
            light |= {"type": "sun", "angle": min(angle, 180.0)}
        self.out["lights"].append(light)

    def _area(self, object, lamp, world, color):
        width, height = lamp.size, lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size
        is_round = lamp.shape in ("DISK", "ELLIPSE")
        # Blender's lamps face -z.
        local = Matrix.Diagonal((width / 2.0, height / 2.0, 1.0, 1.0)) @ Matrix.Rotation(math.pi, 4, "X")
        across, up = (world.to_3x3() @ local.to_3x3()).col[0], (world.to_3x3() @ local.to_3x3()).col[1]
        area = (math.pi if is_round else 4.0) * across.cross(up).length
        if area <= 0.0:
            self.warn("it has no area: it is left out")
            return
        if lamp.spread < math.pi - 1e-3:
            self.warn("its spread is left out: it shines in all directions before it")
        # Without `normalize` the strength is that of a lamp of one square unit.
        radiance = color / (math.pi * (area if getattr(lamp, "normalize", True) else 1.0))
        # A lamp whose transform mirrors faces where Blender's does, since fanal's shapes keep their fronts.
        matrix = world @ local
        points = np.array([(matrix @ Matrix.Translation(point)).translation for point in _POINTS * (1.0, 1.0, 0.0)])
        self._shape({"type": "mesh", "mesh": self._mesh("disk" if is_round else "rectangle")}, matrix, radiance, object, points)

    def _mesh(self, kind):
        name = f"({kind})"
        self.out["meshes"][name] = {"type": kind}
        return name

    def _shape(self, geometry, matrix, radiance, object, points):
        """An emitting shape that lets light through as if it were not there: lamps throw no shadows."""
        if not object.visible_camera and self.sees(points):
            self.warn("a camera may see it, from which Blender hides it")
        shape = {"name": object.name, "geometry": geometry, "material": self.out.air(), "emission": radiance.tolist()}
        if matrix is not None:
            shape["to_world"] = rows(matrix)
        self.out["shapes"].append(shape)


def linear_edge(cutoff, blend):
    """The angle from which an intensity falls off linearly to 0 at `cutoff` so that a lamp has the power of Blender's, whose intensity
    is smoothstep((cos θ - cos c) / ((1 - cos c)·blend))."""
    theta = np.linspace(0.0, cutoff, 4001)
    middle = 0.5 * (theta[1:] + theta[:-1])
    x = np.clip((np.cos(middle) - math.cos(cutoff)) / ((1.0 - math.cos(cutoff)) * blend), 0.0, 1.0)
    wanted = (x * x * (3.0 - 2.0 * x) * np.sin(middle)).sum() * (theta[1] - theta[0])

    def power(beam):
        return 1.0 - (math.sin(cutoff) - math.sin(beam)) / (cutoff - beam)

    low, high = 0.0, cutoff * (1.0 - 1e-6)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if power(middle) < wanted else (low, middle)
    return 0.5 * (low + high)
