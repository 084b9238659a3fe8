"""What shaders do to light, and the parts that fanal's materials are made of."""

from dataclasses import dataclass, field as member

from .fields import Field

BLACK = {"type": "diffuse", "reflectance": Field.constant([0.0, 0.0, 0.0])}
# Least step of the refractive index at a surface that is worth a reflection.
LEAST_STEP = 1e-4


@dataclass
class Normals:
    """A normal map (with its picture's field) or a bump map (with its height's, and scene units per unit of height)."""

    kind: str
    texture: Field
    scale: float = 1.0
    # Identifies equal maps.
    key: tuple = ()


@dataclass
class Layer:
    """What a shader does to light."""

    # fanal's material with fields for textures; None where it scatters nothing.
    material: dict | None = None
    opacity: Field = member(default_factory=lambda: Field.constant(1.0))
    # Radiance, not divided by the opacity.
    emission: Field = member(default_factory=lambda: Field.constant([0.0, 0.0, 0.0]))
    normals: Normals | None = None


@dataclass
class Translated:
    """A material as the scene file has it, but for its pictures."""

    layer: Layer
    # fanal's medium behind the surface.
    medium: dict | None = None
    # Whether there is no surface, only a volume's border: the medium's, or that of one that is left out.
    is_border: bool = False


def two_sided(material):
    return {"type": "two_sided", "material": material}


def rgb(*values):
    return Field.constant(values if len(values) == 3 else values * 3)


def index_of(reflectance):
    """The refractive index whose reflectance at normal incidence that is."""
    root = min(max(reflectance, 0.0), 0.9) ** 0.5
    return (1.0 + root) / (1.0 - root)


def blend(weight, first, second):
    """(1 - weight) of the first material and weight of the second."""
    if first is second or weight.is_value(0.0):
        return first
    if weight.is_value(1.0):
        return second
    return {"type": "blend", "weight": weight, "materials": [first, second]}
