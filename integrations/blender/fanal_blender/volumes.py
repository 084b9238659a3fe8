"""Shaders of volumes translated to fanal's homogeneous media."""

import numpy as np

from .nodes import source_of


class VolumeShaders:
    """The part of a `Translator` that is about volumes."""

    def _medium(self, socket, place):
        """fanal's medium for the shader of a volume; None without."""
        output, other = source_of(socket, place)
        if output is None:
            return None
        terms = self._coefficients(output.node, other)
        if terms is None:
            self.warn(f"volume shader “{output.node.name}” ({output.node.bl_label}) is left out")
            return None
        absorbed, scattered, g = terms
        extinction = absorbed + scattered
        if not extinction.any():
            return None
        albedo = np.divide(scattered, extinction, out=np.zeros(3), where=extinction > 0.0)
        return {"type": "homogeneous", "sigma_t": extinction.tolist(), "albedo": albedo.tolist(), "g": min(max(g, -0.99), 0.99)}

    def _coefficients(self, node, place):
        """Absorption and scattering coefficients and the mean cosine of a volume shader; None where it is of another kind."""
        kind = node.bl_idname.removeprefix("ShaderNode")
        if kind == "AddShader":
            parts = [self._part(node.inputs[i], place) for i in (0, 1)]
            if None in parts:
                return None
            (a0, s0, g0), (a1, s1, g1) = parts
            weights = s0.sum(), s1.sum()
            g = (g0 * weights[0] + g1 * weights[1]) / sum(weights) if sum(weights) > 0.0 else 0.0
            if g0 != g1 and min(weights) > 0.0:
                self.warn(f"node “{node.name}”: two phase functions are taken for one of their mean cosine")
            return a0 + a1, s0 + s1, g
        if kind not in ("VolumeAbsorption", "VolumeScatter", "VolumePrincipled"):
            return None
        color = np.clip(self._constant(node, "Color", place), 0.0, None)
        density = max(self._number(node, "Density", place), 0.0)
        none = np.zeros(3)
        if kind == "VolumeAbsorption":
            return np.clip(1.0 - color, 0.0, None) * density, none, 0.0
        if getattr(node, "phase", "HENYEY_GREENSTEIN") != "HENYEY_GREENSTEIN":
            self.warn(f"node “{node.name}”: phase function {node.phase.lower()} is taken for Henyey and Greenstein's")
        g = self._given(node, "Anisotropy", place)
        if kind == "VolumeScatter":
            return none, color * density, g
        if self._number(node, "Emission Strength", place) > 0.0 or self._number(node, "Blackbody Intensity", place) > 0.0:
            self.warn(f"node “{node.name}”: the volume's own light is left out")
        # Cycles takes the square root of this colour.
        kept = np.sqrt(np.clip(self._constant(node, "Absorption Color", place), 0.0, None))
        absorbed = np.clip(1.0 - color, 0.0, None) * np.clip(1.0 - kept, 0.0, None)
        return absorbed * density, color * density, g

    def _part(self, socket, place):
        output, other = source_of(socket, place)
        return (np.zeros(3), np.zeros(3), 0.0) if output is None else self._coefficients(output.node, other)

    def _constant(self, node, name, place):
        value = self._of(node, name, place)
        if not value.is_constant:
            self.warn(f"node “{node.name}”: the mean of {name} is used, which varies")
        return value.mean()
