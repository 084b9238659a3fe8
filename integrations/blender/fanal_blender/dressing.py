"""A translated material as shapes wear it: what they have to know of it, and how the scene file has it."""

import numpy as np

from .fields import Field
from .layers import blend


class Dressing:
    """A translated material of an export."""

    def __init__(self, exporter, material):
        self.exporter = exporter
        self.name = material.name if material else "(none)"
        self.names = {}
        translated = exporter.translator.translate(material)
        self.layer, self.is_border = translated.layer, translated.is_border
        self.radiance = self._radiance()
        self.shines = any(value > 0.0 for value in self.radiance)
        # Texture coordinates that all its pictures share; the first decide.
        self.coordinates = next((field.lookup.coordinates for field in self._fields() if not field.is_constant), None)
        self.has_normal_map = self.layer.normals is not None and self.layer.normals.kind == "normal_map"
        self.medium = None
        if translated.medium is not None:
            exporter.out["media"][self.name] = translated.medium
            self.medium = self.name
        # Whether what is behind the surface is another medium, which would be between two sheets of it only.
        self.has_inside = self.medium is not None or _refracts(self.layer.material)

    def warn(self, message):
        self.exporter.warn(f"material “{self.name}”: {message}")

    def _radiance(self):
        emission = self.layer.emission
        if not emission.is_constant and emission.mean().any():
            self.warn("its light is the mean of a picture")
        return np.broadcast_to(np.maximum(emission.mean(), 0.0), 3).tolist()

    def _fields(self):
        """All textures, the most visible first."""
        def inside(value):
            if isinstance(value, Field):
                yield value
            elif isinstance(value, (dict, list)):
                for item in value.values() if isinstance(value, dict) else value:
                    yield from inside(item)

        yield from inside(self.layer.material or {})
        yield self.layer.opacity
        if self.layer.normals is not None:
            yield self.layer.normals.texture

    def json(self, flipped):
        """The material as the scene file has it."""
        layer = self.layer
        if self.is_border:
            return {"type": "null"}
        air = {"type": "thin_dielectric", "int_ior": 1.0, "ext_ior": 1.0}
        material = air if layer.material is None else layer.material
        if not layer.opacity.is_value(1.0) and self.shines and layer.material is not None:
            # Emitters of fanal have no holes, but may be clear.
            material = blend(layer.opacity, air, material)
        material = self._with_textures(material)
        if layer.normals is not None:
            material = self._mapped(material, flipped)
        if not layer.opacity.is_value(1.0) and not self.shines:
            material = {"type": "mask", "opacity": self._texture(layer.opacity, "opacity"), "material": material}
        return material

    def _with_textures(self, value, key="texture"):
        if isinstance(value, Field):
            return self._texture(value, key)
        if isinstance(value, dict):
            return {key: self._with_textures(item, key) for key, item in value.items()}
        if isinstance(value, list):
            return [self._with_textures(item, key) for item in value]
        return value

    def _mapped(self, material, flipped):
        normals = self.layer.normals
        field = normals.texture
        if flipped:
            field = Field(lambda: _flipped(normals.texture.data), normals.texture.lookup)
        texture = self._texture(field, normals.kind, raw=True)
        if texture["type"] != "bitmap":
            return material
        given = {"type": normals.kind, "texture": texture}
        if normals.kind == "bump_map":
            given["scale"] = normals.scale
        # Bumps are within two sides: their backs are then fronts as well.
        if material["type"] == "two_sided":
            return {"type": "two_sided", "material": given | {"material": material["material"]}}
        return given | {"material": material}

    def _texture(self, field, key, raw=False):
        """fanal's texture for a field."""
        if not field.is_constant and field.lookup.coordinates != self.coordinates:
            self.warn(f"{key}: it has other texture coordinates than the first picture: its mean is used")
            field = field.flat()
        if field.is_constant:
            value = np.broadcast_to(field.mean(), 3)
            if value.min() < 0.0 or value.max() > 1.0:
                self.warn(f"{key} is {[round(float(x), 4) for x in value]}: it is brought between 0 and 1")
            return {"type": "rgb", "value": np.clip(value, 0.0, 1.0).tolist()}
        lookup, pictures = field.lookup, self.exporter.pictures
        if field.source is not None:
            texture = {"type": "bitmap", "file": pictures.store_source(field.source), "raw": field.source.raw}
            if field.factor != 1.0:
                texture["scale"] = field.factor
            if raw and not field.source.raw:
                self.warn(f"{key}: its picture is taken for sRGB, as its image says; data should be Non-Color")
        else:
            texture = {"type": "bitmap", "file": pictures.store_field(field, f"{self.name}-{key}"), "raw": True}
        (a, b, c), (d, e, f) = np.array(lookup.matrix).reshape(2, 3).tolist()
        # fanal counts v downwards, before and after the matrix.
        matrix = [a, -b, b + c, -d, e, 1.0 - e - f, 0.0, 0.0, 1.0]
        if matrix != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]:
            texture["to_uv"] = matrix
        if lookup.wrap != "repeat":
            texture["wrap"] = lookup.wrap
        if lookup.filter != "bilinear":
            texture["filter"] = lookup.filter
        return texture


def _refracts(material):
    """Whether a material, or one within it, lets light into what is behind it."""
    if isinstance(material, dict):
        return material.get("type") in ("dielectric", "rough_dielectric") or any(map(_refracts, material.values()))
    return isinstance(material, list) and any(map(_refracts, material))


def _flipped(data):
    """Normals with up and down exchanged."""
    data = np.array(data)
    data[:, :, 1] = 1.0 - data[:, :, 1]
    return data
