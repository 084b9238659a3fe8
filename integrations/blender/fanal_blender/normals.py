"""Normal maps, bump maps and displacements."""

import numpy as np

from .fields import combine
from .layers import Normals
from .nodes import named, source_of

# Tangent-space normals that are flat, as a picture holds them.
_FLAT = np.array([0.5, 0.5, 1.0], np.float32)


class NormalMaps:
    """The part of a `Translator` that is about normals."""

    def _normals(self, node, place, name="Normal"):
        """The normal or bump map of a shader's input; None without."""
        socket = named(node, name)
        output, other = source_of(socket, place) if socket else (None, None)
        if output is None:
            return None
        node = output.node
        if node.bl_idname == "ShaderNodeNormalMap":
            return self._normal_map(node, other)
        if node.bl_idname == "ShaderNodeBump":
            return self._bump(node, other)
        if not (node.bl_idname in ("ShaderNodeNewGeometry", "ShaderNodeTexCoord") and output.name == "Normal"):
            self.warn(f"node “{node.name}” ({node.bl_label}) as a normal is left out")
        return None

    def _normal_map(self, node, place):
        if node.space != "TANGENT":
            self.warn(f"node “{node.name}”: a normal map in {node.space.lower().replace('_', ' ')} space is left out")
            return None
        texture = self._of(node, "Color", place)
        if texture.is_constant:
            if not np.allclose(texture.mean(), _FLAT, atol=2e-3):
                self.warn(f"node “{node.name}”: one normal for all the surface is left out")
            return None
        if node.uv_map and texture.lookup.coordinates != ("uv", node.uv_map):
            self.warn(f"node “{node.name}”: its tangents are those of the picture's texture coordinates, not of {node.uv_map}")
        strength = self._number(node, "Strength", place)
        if strength == 0.0:
            return None
        if strength != 1.0:
            texture = combine(lambda data: _strengthened(data, strength), texture)
        return Normals("normal_map", texture, key=(node.as_pointer(), place.chain))

    def _bump(self, node, place):
        height = self._of(node, "Height", place)
        scale = self._number(node, "Distance", place) * self._number(node, "Strength", place)
        if source_of(named(node, "Normal"), place)[0] is not None:
            inner = self._normals(node, place)
            if inner is not None:
                self.warn(f"node “{node.name}”: of two maps of normals, one within the other, the inner one is used")
                return inner
        if height.is_constant or scale == 0.0:
            return None
        return Normals("bump_map", height, -scale if node.invert else scale, (node.as_pointer(), place.chain))

    def _displacement(self, material, output, place, layer):
        """A displacement as a bump map."""
        given, other = source_of(output.inputs["Displacement"], place)
        if given is None:
            return
        if material.displacement_method != "BUMP":
            self.warn("its displacement is taken for a bump map")
        node = given.node
        if node.bl_idname != "ShaderNodeDisplacement":
            self.warn(f"node “{node.name}” ({node.bl_label}): its displacement is left out")
            return
        height, scale = self._of(node, "Height", other), self._number(node, "Scale", other)
        if height.is_constant or scale == 0.0:
            return
        if layer.normals is not None:
            self.warn("it has a map of normals and a displacement: the displacement is left out")
            return
        layer.normals = Normals("bump_map", height, scale, (node.as_pointer(), other.chain))


def _strengthened(data, strength):
    """Normals as a picture holds them, with slopes of another strength as Blender's Normal Map node makes them."""
    normals = data * 2.0 - 1.0
    normals[:, :, :2] *= strength
    normals[:, :, 2] = 1.0 + (normals[:, :, 2] - 1.0) * min(max(strength, 0.0), 1.0)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-6)
    return normals * 0.5 + 0.5
