"""How much of the light Blender's dielectric and fanal's scatter.

Cycles lets through to the base what the reflection leaves of the light; the base is Lambert's. fanal has three relatives, which the
numbers here make scatter the same part as Cycles of light that comes alike from all directions: the base of rough plastic, which is
darker by what rough facets take twice (Mitsuba's model); that of the principled material, which is Burley's (2012, §5.3), and on which
the reflection takes nothing; and a blend of a diffuse base with the reflection alone, which is to have its strength in spite of that.
"""

import functools

import numpy as np

# Roughness α below which fanal's surfaces are smooth.
_SMOOTH = 1e-4
# Cosines and points along each axis of the quadratures.
_COSINES = (np.arange(24) + 0.5) / 24
_POINTS = (np.arange(24) + 0.5) / 24


@functools.lru_cache(maxsize=256)
def principled_factor(roughness, index):
    """Factor on the colour of the principled material's base, for a roughness (not squared) and a refractive index."""
    return left(roughness, index) / _burley(roughness)


@functools.lru_cache(maxsize=256)
def plastic_factor(roughness, index):
    """Factor on the colour of plastic's base."""
    alpha = roughness**2
    if alpha < _SMOOTH:
        return 1.0
    passed = _mean([_hemispheric(cos, alpha, index, False) for cos in _COSINES])
    # As fanal sums it, at 64 cosines with both ends.
    cosines = np.arange(64) / 63.0
    inside = 2.0 / 64.0 * sum(cos * _hemispheric(cos, alpha, 1.0 / index, True) for cos in cosines)
    return left(roughness, index) * index**2 * (1.0 - inside) / passed**2


@functools.lru_cache(maxsize=256)
def stronger(roughness, index, share):
    """The refractive index whose reflection, in a blend that has `share` of it, is on average as strong as that of `index` whole."""
    alpha = max(roughness**2, 1e-3)
    wanted = (1.0 - left(roughness, index)) / share
    low, high = 1.0, 20.0
    for _ in range(24):
        middle = 0.5 * (low + high)
        mean = _mean([_reflected(cos, alpha, middle, False) for cos in _COSINES])
        low, high = (middle, high) if mean < wanted else (low, middle)
    return round(0.5 * (low + high), 4)


@functools.lru_cache(maxsize=256)
def left(roughness, index):
    """What Cycles' reflection leaves of light from everywhere."""
    alpha = max(roughness**2, 1e-3)
    return 1.0 - _mean([_reflected(cos, alpha, index) for cos in _COSINES])


def _mean(albedos):
    """The albedo for light from everywhere, of those at the cosines."""
    return float((np.array(albedos) * _COSINES).sum() / _COSINES.sum())


def _fresnel(cos, index):
    """Unpolarised reflectance, and the cosine on the other side; total reflection has 1 and 0."""
    passed = np.maximum(1.0 - (1.0 - cos * cos) / index**2, 0.0)
    other = np.sqrt(passed)
    across = (cos - index * other) / (cos + index * other)
    along = (index * cos - other) / (index * cos + other)
    return np.where(passed > 0.0, 0.5 * (across**2 + along**2), 1.0), other


def _smith(cos, alpha):
    """Λ of GGX."""
    cos = np.maximum(np.abs(cos), 1e-9)
    return 0.5 * (np.sqrt(1.0 + alpha**2 * np.maximum(1.0 - cos * cos, 0.0) / (cos * cos)) - 1.0)


def _visible(cos, alpha):
    """The direction `out` with the cosine `cos`, and GGX normals that it sees (Heitz 2018), evenly."""
    u, v = np.meshgrid(_POINTS, _POINTS)
    out = np.array([np.sqrt(1.0 - cos * cos), 0.0, max(cos, 1e-6)])
    stretched = out * [alpha, alpha, 1.0]
    stretched /= np.linalg.norm(stretched)
    first = np.array([0.0, 1.0, 0.0])
    second = np.cross(stretched, first)
    radius, angle = np.sqrt(u), 2.0 * np.pi * v
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    half = 0.5 * (1.0 + stretched[2])
    y = (1.0 - half) * np.sqrt(np.maximum(1.0 - x * x, 0.0)) + half * y
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    normal = x[..., None] * first + y[..., None] * second + z[..., None] * stretched
    normal = normal * [alpha, alpha, 1.0]
    return out, normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _reflected(cos, alpha, index, correlated=True):
    """Albedo of GGX facets at an angle with cosine `cos`, with shadowing correlated in height as Cycles has it, or not as fanal."""
    out, normal = _visible(cos, alpha)
    dot = np.clip(normal @ out, 1e-9, 1.0)
    into = 2.0 * dot * normal[..., 2] - out[2]
    passed = 1.0 / (1.0 + _smith(into, alpha))
    if correlated:
        passed = (1.0 + _smith(cos, alpha)) / (1.0 + _smith(cos, alpha) + _smith(into, alpha))
    return float(np.where(into > 0.0, _fresnel(dot, index)[0] * passed, 0.0).mean())


def _hemispheric(cos, alpha, index, reflects):
    """What fanal's plastic takes for the coat's reflectance or transmittance at an angle with cosine `cos`."""
    out, normal = _visible(cos, alpha)
    dot = np.clip(normal @ out, 0.0, 1.0)
    reflected, other = _fresnel(dot, index)
    into = 2.0 * dot * normal[..., 2] - out[2] if reflects else (dot / index - other) * normal[..., 2] - out[2] / index
    part = reflected if reflects else 1.0 - reflected
    return float(np.where((into > 0.0) == reflects, part / (1.0 + _smith(into, alpha)), 0.0).mean())


@functools.lru_cache(maxsize=256)
def _burley(roughness):
    """Albedo of a white base for light from everywhere."""
    u, v = np.meshgrid(_POINTS, _POINTS)
    into_z, angle = np.sqrt(1.0 - u), 2.0 * np.pi * v
    sin = np.sqrt(u)
    albedos = []
    for cos in _COSINES:
        half = np.stack([np.sqrt(1.0 - cos * cos) + sin * np.cos(angle), sin * np.sin(angle), cos + into_z])
        half /= np.linalg.norm(half, axis=0)
        cos_d = sin * np.cos(angle) * half[0] + sin * np.sin(angle) * half[1] + into_z * half[2]
        out, into = (1.0 - cos) ** 5, (1.0 - into_z) ** 5
        retro = 2.0 * roughness * cos_d**2
        value = (1.0 - 0.5 * out) * (1.0 - 0.5 * into) + retro * (out + into + out * into * (retro - 1.0))
        albedos.append(float(value.mean()))
    return _mean(albedos)
