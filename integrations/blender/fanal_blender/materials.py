"""Shader trees translated to fanal's materials."""

import math

import numpy as np

from . import albedo
from .fields import Field, combine
from .layers import BLACK, LEAST_STEP, Layer, Translated, blend, index_of, rgb, two_sided
from .nodes import Evaluator, Place, named, source_of
from .normals import NormalMaps
from .principled import Principled
from .volumes import VolumeShaders

# Roughness up to which plastic's base has about the angles of Cycles'.
_ROUGHEST_PLASTIC = 0.3
# Roughness up to which the principled material's base is about Lambert's.
_ROUGHEST_PRINCIPLED = 0.65
# Least part of a reflection in its mixture with a base.
_LEAST_SHARE = 0.05


class Translator(NormalMaps, VolumeShaders):
    """Translates materials of Blender; `warn` gets messages, `pictures` holds images."""

    def __init__(self, pictures, warn):
        self.pictures, self._warn = pictures, warn
        self.name, self.evaluator = "", None

    def warn(self, message):
        self._warn(f"material “{self.name}”: {message}")

    def translate(self, material):
        """The translation of a material; None is Blender's grey."""
        self.name = material.name if material else ""
        self.evaluator = Evaluator(self.pictures, self.warn)
        if material is None:
            return Translated(Layer(two_sided({"type": "diffuse", "reflectance": rgb(0.8)})))
        if not material.use_nodes or material.node_tree is None:
            color = list(material.diffuse_color)[:3]
            return Translated(Layer(two_sided({"type": "diffuse", "reflectance": Field.constant(color)})))
        place = Place(material.node_tree)
        output = material.node_tree.get_output_node("CYCLES") or material.node_tree.get_output_node("ALL")
        if output is None:
            self.warn("there is no output node: it is black")
            return Translated(Layer(BLACK))
        layer = self.shader(output.inputs["Surface"], place)
        medium = self._medium(output.inputs["Volume"], place)
        has_surface, has_volume = (source_of(output.inputs[name], place)[0] is not None for name in ("Surface", "Volume"))
        self._displacement(material, output, place, layer)
        return Translated(layer, medium, has_volume and not has_surface)

    # Shaders.

    def shader(self, socket, place):
        """What the shader that feeds a socket does."""
        output, other = source_of(socket, place)
        if output is None:
            return Layer(BLACK)
        node = output.node
        function = getattr(self, "_" + node.bl_idname.removeprefix("ShaderNode").lower(), None)
        if function is None:
            self.warn(f"shader “{node.name}” ({node.bl_label}) is not translated: it is grey and diffuse")
            return Layer(two_sided({"type": "diffuse", "reflectance": self._color_of(node, other)}))
        return function(node, other)

    def _color_of(self, node, place):
        socket = named(node, "Color")
        return self.evaluator.socket(socket, place) if socket else rgb(0.5)

    def _of(self, node, name, place):
        return self.evaluator.input(node, name, place)

    def _number(self, node, name, place):
        return self.evaluator.number(node, name, place)

    def _given(self, node, name, place, usual=0.0):
        """One number for an input that may not be there."""
        return self._number(node, name, place) if named(node, name) else usual

    def _product(self, *fields):
        def function(*arrays):
            result = arrays[0]
            for array in arrays[1:]:
                result = result * array
            return result

        kept = [field for field in fields if not field.is_value(1.0)]
        if not kept:
            return fields[0]
        return kept[0] if len(kept) == 1 else combine(function, *kept, lost=self._lost)

    def _lost(self, _):
        self.warn("two pictures with other texture coordinates or edges in one value: the mean of the smaller is used")

    def _mixshader(self, node, place):
        weight = self.evaluator.socket(node.inputs[0], place)
        weight = combine(lambda w: np.clip(w, 0.0, 1.0), weight) if weight.source is None else weight
        plastic = self._coated(node, place)
        if plastic is not None:
            return plastic
        first, second = (self.shader(node.inputs[i], place) for i in (1, 2))
        if weight.is_value(0.0):
            return first
        if weight.is_value(1.0):
            return second
        rest = combine(lambda w: 1.0 - w, weight)
        shares = [self._product(rest, first.opacity), self._product(weight, second.opacity)]
        opacity = combine(lambda a, b: a + b, *shares, lost=self._lost)
        emission = combine(lambda w, a, b: (1.0 - w) * a + w * b, weight, first.emission, second.emission, lost=self._lost)
        if second.opacity.is_value(0.0) or first.opacity.is_value(0.0):
            of = first if second.opacity.is_value(0.0) else second
            return Layer(of.material, opacity, emission, of.normals)
        share = weight
        if not (first.opacity.is_value(1.0) and second.opacity.is_value(1.0)):
            share = combine(lambda s, o: np.where(o > 0.0, s / np.where(o > 0.0, o, 1.0), 0.5), shares[1], opacity, lost=self._lost)
        material = blend(share, first.material, second.material)
        return Layer(material, opacity, emission, self._common(node, first, second))

    def _coated(self, node, place):
        """A glossy coat over a diffuse base, mixed by Fresnel's equations: plastic."""
        weight, within = source_of(node.inputs[0], place)
        parts = [source_of(node.inputs[i], place) for i in (1, 2)]
        kinds = [output and output.node.bl_idname for output, _ in parts]
        if weight is None or weight.node.bl_idname != "ShaderNodeFresnel":
            return None
        if kinds[0] != "ShaderNodeBsdfDiffuse" or kinds[1] != "ShaderNodeBsdfAnisotropic":
            return None
        base, coat = (output.node for output, _ in parts)
        index = self._number(weight.node, "IOR", within)
        rough = self._of(coat, "Roughness", parts[1][1])
        if not rough.is_constant or index <= 1.0 + LEAST_STEP:
            return None
        material = self._layered(rough, index, self._of(base, "Color", parts[0][1]), self._of(coat, "Color", parts[1][1]))
        layers = [Layer(normals=self._normals(n, p)) for n, p in ((base, parts[0][1]), (coat, parts[1][1]))]
        return Layer(material, normals=self._common(node, *layers))

    def _common(self, node, first, second):
        """The normals of two layers: there can be only one map around both."""
        maps = [layer.normals for layer in (first, second) if layer.normals is not None]
        if not maps:
            return None
        scatters = [layer for layer in (first, second) if layer.material is not BLACK]
        if any((layer.normals.key if layer.normals else None) != maps[0].key for layer in scatters):
            self.warn(f"node “{node.name}”: the normal map of one shader is used for both")
        return maps[0]

    def _addshader(self, node, place):
        first, second = (self.shader(node.inputs[i], place) for i in (0, 1))
        emission = combine(lambda a, b: a + b, first.emission, second.emission, lost=self._lost)
        if first.material is BLACK or second.material is BLACK:
            of = second if first.material is BLACK else first
            # Adding light to what lets all light pass: fanal's emitters are opaque.
            return Layer(of.material, of.opacity, emission, of.normals)
        self.warn(f"node “{node.name}”: the sum of two shaders is taken for their mean")
        half = Field.constant(0.5)
        opacity = combine(lambda a, b: np.maximum(a, b), first.opacity, second.opacity, lost=self._lost)
        return Layer(blend(half, first.material, second.material), opacity, emission, self._common(node, first, second))

    def _emission(self, node, place):
        return Layer(BLACK, emission=self._product(self._of(node, "Color", place), self._of(node, "Strength", place)))

    def _background(self, node, place):
        return self._emission(node, place)

    def _bsdftransparent(self, node, place):
        color = self._of(node, "Color", place)
        if color.is_value(1.0):
            return Layer(None, opacity=Field.constant(0.0))
        # What is stopped of the light is stopped for all colours alike.
        if not np.allclose(color.mean(), color.number(), atol=1e-3):
            self.warn(f"node “{node.name}”: its colour is taken for grey")
        return Layer(BLACK, opacity=combine(lambda c: 1.0 - np.clip(c, 0.0, 1.0), color.as_number()))

    def _holdout(self, node, place):
        self.warn(f"node “{node.name}”: a holdout is black")
        return Layer(BLACK)

    def _bsdfdiffuse(self, node, place):
        color, rough = self._of(node, "Color", place), self._number(node, "Roughness", place)
        return Layer(two_sided(self._diffuse(color, rough)), normals=self._normals(node, place))

    def _diffuse(self, color, rough):
        if rough <= 0.0:
            return {"type": "diffuse", "reflectance": color}
        return {"type": "rough_diffuse", "reflectance": color, "alpha": rough}

    def _bsdftranslucent(self, node, place):
        self.warn(f"node “{node.name}”: light that a translucent surface lets through is scattered back instead")
        return Layer(two_sided(self._diffuse(self._of(node, "Color", place), 0.0)), normals=self._normals(node, place))

    def _subsurfacescattering(self, node, place):
        self.warn(f"node “{node.name}”: subsurface scattering is taken for diffuse reflection")
        return Layer(two_sided(self._diffuse(self._of(node, "Color", place), 0.0)), normals=self._normals(node, place))

    def _bsdfsheen(self, node, place):
        self.warn(f"node “{node.name}”: sheen alone is taken for that of the principled material")
        sheen = {"type": "principled", "base_color": rgb(0.0), "roughness": rgb(1.0), "eta": 1.0, "sheen": 1.0}
        return Layer(two_sided(sheen), normals=self._normals(node, place))

    def _bsdftoon(self, node, place):
        self.warn(f"node “{node.name}”: toon shading is taken for diffuse")
        return Layer(two_sided(self._diffuse(self._of(node, "Color", place), 0.0)), normals=self._normals(node, place))

    def _bsdfanisotropic(self, node, place):
        """The Glossy BSDF: reflects everything, whatever the angle."""
        if self._given(node, "Anisotropy", place) != 0.0:
            self.warn(f"node “{node.name}”: its anisotropy is left out")
        color, rough = self._of(node, "Color", place), self._of(node, "Roughness", place)
        if not rough.is_constant:
            self.warn(f"node “{node.name}”: with a varying roughness it reflects everything at grazing angles")
            return Layer(two_sided(self._metal(color, rough)), normals=self._normals(node, place))
        kind = "beckmann" if node.distribution == "BECKMANN" else "ggx"
        mirror = {"type": "rough_conductor", "alpha": rough.number() ** 2, "distribution": kind,
                  "eta": [0.0] * 3, "k": [1.0] * 3, "specular_reflectance": color}
        return Layer(two_sided(mirror), normals=self._normals(node, place))

    _bsdfglossy = _bsdfanisotropic

    def _bsdfmetallic(self, node, place):
        if self._given(node, "Anisotropy", place) != 0.0:
            self.warn(f"node “{node.name}”: its anisotropy is left out")
        rough, normals = self._of(node, "Roughness", place), self._normals(node, place)
        if node.fresnel_type == "PHYSICAL_CONDUCTOR":
            alpha = self._number(node, "Roughness", place) ** 2
            index, extinction = (self._of(node, name, place).mean().tolist() for name in ("IOR", "Extinction"))
            kind = "beckmann" if node.distribution == "BECKMANN" else "ggx"
            metal = {"type": "rough_conductor", "alpha": alpha, "distribution": kind, "eta": index, "k": extinction}
            return Layer(two_sided(metal), normals=normals)
        if not self._of(node, "Edge Tint", place).is_value(1.0):
            self.warn(f"node “{node.name}”: its edge tint is left out")
        return Layer(two_sided(self._metal(self._of(node, "Base Color", place), rough)), normals=normals)

    def _bsdfglass(self, node, place):
        color, normals = self._of(node, "Color", place), self._normals(node, place)
        index, rough = self._number(node, "IOR", place), self._number(node, "Roughness", place)
        kind = "beckmann" if node.distribution == "BECKMANN" else "ggx"
        return Layer(self._clear(index, rough, kind, color, color), normals=normals)

    def _bsdfrefraction(self, node, place):
        color, normals = self._of(node, "Color", place), self._normals(node, place)
        index, rough = self._number(node, "IOR", place), self._number(node, "Roughness", place)
        self.warn(f"node “{node.name}”: it loses the light that glass would reflect")
        return Layer(self._clear(index, rough, "ggx", rgb(0.0), color), normals=normals)

    def _clear(self, index, rough, kind, reflected, transmitted):
        """Glass with factors on what it reflects and transmits."""
        material = {"type": "dielectric", "int_ior": max(index, 1e-3), "ext_ior": 1.0}
        if rough > 0.0:
            material = material | {"type": "rough_dielectric", "alpha": rough * rough, "distribution": kind}
        if reflected.is_value(1.0) and transmitted.is_value(1.0):
            return material
        return {"type": "tinted", "specular_reflectance": reflected, "specular_transmittance": transmitted, "material": material}

    def _layered(self, rough, index, base, tint):
        """A reflection over a diffuse base: plastic where it is fairly smooth; otherwise, since fanal's rough plastic loses light, the
        principled material, or the base beside the reflection, of the same albedos; see `albedo`."""
        mean = round(rough.number(), 3)
        if rough.is_constant and mean <= _ROUGHEST_PLASTIC:
            brighter = base.times(albedo.plastic_factor(mean, index))
            if brighter.data.max() <= 1.0:
                coat = {"type": "plastic", "alpha": mean * mean, "distribution": "ggx", "int_ior": index, "ext_ior": 1.0,
                        "diffuse_reflectance": brighter}
                return two_sided(coat if tint.is_value(1.0) else coat | {"specular_reflectance": tint})
        if not tint.is_value(1.0):
            self.warn("the tint of a reflection is taken for grey")
            index = index_of(((index - 1.0) / (index + 1.0)) ** 2 * tint.number())
            if index <= 1.0 + LEAST_STEP:
                return two_sided(self._diffuse(base, 0.0))
        if not base.is_constant and mean <= _ROUGHEST_PRINCIPLED:
            # Beside the brightest texels the darkest would have too strong a reflection in a blend.
            base = base.times(albedo.principled_factor(mean, index))
            return two_sided({"type": "principled", "base_color": base, "roughness": rough, "eta": index})
        left = albedo.left(mean, index)
        # Rounded down, so that the base stays within what it may scatter.
        share = math.floor(100.0 * (1.0 - left * float(base.data.max()))) / 100.0
        share = min(max(share, _LEAST_SHARE), 1.0 - _LEAST_SHARE)
        facets = {"type": "principled", "base_color": rgb(0.0), "roughness": rough, "eta": albedo.stronger(mean, index, share)}
        diffuse = self._diffuse(base.times(left / (1.0 - share)), 0.0)
        return blend(Field.constant(share), two_sided(diffuse), two_sided(facets))

    def _metal(self, color, rough):
        return {"type": "principled", "base_color": color, "roughness": rough, "metallic": rgb(1.0)}

    def _bsdfprincipled(self, node, place):
        return Principled(self, node, place).layer()
