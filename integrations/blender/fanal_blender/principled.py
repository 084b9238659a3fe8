"""The Principled BSDF, whose parts fanal has as materials of their own."""

import numpy as np

from . import albedo
from .fields import Field, combine
from .layers import LEAST_STEP, Layer, blend, index_of, rgb, two_sided
from .nodes import named, source_of


class Principled:
    """One node, translated by `translator`."""

    def __init__(self, translator, node, place):
        self.to, self.node, self.place = translator, node, place

    def field(self, name):
        return self.to._of(self.node, name, self.place)

    def number(self, name):
        return self.to._number(self.node, name, self.place)

    def warn(self, message):
        self.to.warn(f"node “{self.node.name}”: {message}")

    def layer(self):
        self._left_out()
        metallic, clear = self.field("Metallic"), self.field("Transmission Weight")
        opaque = self._opaque(metallic)
        material = opaque
        if not clear.is_value(0.0):
            glass = self._glass()
            # A metal lets nothing through.
            weight = clear
            if not metallic.is_value(0.0):
                weight = combine(lambda c, m: c * (1.0 - m), clear, metallic, lost=self.to._lost)
            material = blend(weight, opaque, glass)
        alpha = self.field("Alpha")
        emission = self.to._product(self.field("Emission Color"), self.field("Emission Strength"))
        if not alpha.is_value(1.0):
            emission = self.to._product(emission, alpha)
        return Layer(material, alpha, emission, self.to._normals(self.node, self.place))

    def _left_out(self):
        for name, what in [
            ("Subsurface Weight", "its subsurface scattering is taken for diffuse reflection"),
            ("Anisotropic", "its anisotropy is left out"),
            ("Thin Film Thickness", "its thin film is left out"),
        ]:
            if self.to._given(self.node, name, self.place) != 0.0:
                self.warn(what)
        if self.number("Coat Weight") > 0.0 and not self.field("Coat Tint").is_value(1.0):
            self.warn("the tint of its coat is left out")
        if source_of(named(self.node, "Coat Normal"), self.place)[0] is not None:
            self.warn("the normals of its coat are left out")

    def _index(self):
        """Refractive index of the reflection: Blender's level scales the reflectance at normal incidence, and is 0.5 usually."""
        index, level = self.number("IOR"), self.number("Specular IOR Level")
        if level == 0.5:
            return index
        return index_of(((index - 1.0) / (index + 1.0)) ** 2 * 2.0 * level)

    def _opaque(self, metallic):
        """All but what light passes through, on both sides."""
        rough, color = self.field("Roughness"), self.field("Base Color")
        sheen, coat = self.number("Sheen Weight"), self.number("Coat Weight")
        tint = self.field("Specular Tint")
        if not metallic.is_value(0.0) and not tint.is_value(1.0):
            self.warn("the specular tint of a metal is left out")
        if sheen > 0.0 or coat > 0.0 and not metallic.is_value(0.0):
            return two_sided(self._burley(color, rough, metallic, tint, self._lobes(sheen, coat)))
        metal = two_sided(self.to._metal(color, rough))
        if metallic.is_value(1.0):
            return metal
        return blend(metallic, self._dielectric(color, rough, tint, coat), metal)

    def _dielectric(self, color, rough, tint, coat):
        index = self._index()
        diffuse_rough = self.to._given(self.node, "Diffuse Roughness", self.place)
        if coat > 0.0:
            self.warn("where there is a coat, it stands for the base's own reflection")
        if index <= 1.0 + LEAST_STEP or coat >= 1.0:
            base = two_sided(self.to._diffuse(color, diffuse_rough))
        else:
            base = self.to._layered(rough, index, color, tint)
        if diffuse_rough > 0.0 and (coat > 0.0 or index > 1.0 + LEAST_STEP):
            self.warn("under a reflection its diffuse roughness is left out")
        if coat == 0.0:
            return base
        above = Field.constant(self.number("Coat Roughness"))
        coated = self.to._layered(above, max(self.number("Coat IOR"), 1.001), color, rgb(1.0))
        return blend(Field.constant(min(coat, 1.0)), base, coated)

    def _lobes(self, sheen, coat):
        """Parameters of the principled material for lobes that only it has."""
        lobes = {}
        if sheen > 0.0:
            self.warn("its sheen is that of fanal's principled material")
            tint, color = self.field("Sheen Tint").mean(), self.field("Base Color").mean()
            is_white = np.ptp(tint) < 0.1
            lobes["sheen"] = min(sheen * (1.0 if is_white else float(tint.mean())), 1.0)
            if not is_white:
                lobes["sheen_tint"] = 1.0 if np.ptp(color) > 0.0 else 0.0
        if coat > 0.0:
            self.warn("its coat is that of fanal's principled material: of a quarter of the strength at most, and it takes nothing from the base")
            rough = self.number("Coat Roughness")
            lobes["clearcoat"] = min(4.0 * coat, 1.0)
            lobes["clearcoat_gloss"] = min(max((0.1 - rough * rough) / 0.099, 0.0), 1.0)
        return lobes

    def _burley(self, color, rough, metallic, tint, lobes):
        index = max(self._index(), 1.0)
        if index > 1.0 + LEAST_STEP and not metallic.is_value(1.0) and metallic.is_constant:
            # A metal's colour is that of its reflection.
            factor = albedo.principled_factor(round(rough.number(), 3), round(index, 4))
            color = color.times(1.0 + (factor - 1.0) * (1.0 - metallic.number()))
        given = {"type": "principled", "base_color": color, "roughness": rough, "metallic": metallic, "eta": index}
        if not tint.is_value(1.0):
            self.warn("its specular tint is taken for the base's hue")
            given["spec_tint"] = 1.0
        return given | lobes

    def _glass(self):
        color, rough = self.field("Base Color"), self.number("Roughness")
        # What passes both sides has the colour once.
        root = combine(lambda c: np.sqrt(np.maximum(c, 0.0)), color)
        return self.to._clear(self.number("IOR"), rough, "ggx", self.field("Specular Tint"), root)
