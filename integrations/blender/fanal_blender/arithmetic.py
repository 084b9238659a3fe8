"""What Blender's nodes compute, on arrays of rows, columns and channels."""

import numpy as np


def blended(kind, factor, a, b):
    """Colours mixed as Blender mixes them; None for kinds that are not known."""
    inverse = 1.0 - factor
    if kind == "MIX":
        return inverse * a + factor * b
    if kind == "ADD":
        return a + factor * b
    if kind == "SUBTRACT":
        return a - factor * b
    if kind == "MULTIPLY":
        return a * (inverse + factor * b)
    if kind == "SCREEN":
        return 1.0 - (inverse + factor * (1.0 - b)) * (1.0 - a)
    if kind == "DIFFERENCE":
        return inverse * a + factor * np.abs(a - b)
    if kind == "EXCLUSION":
        return np.maximum(inverse * a + factor * (a + b - 2.0 * a * b), 0.0)
    if kind == "DARKEN":
        return inverse * a + factor * np.minimum(a, b)
    if kind == "LIGHTEN":
        return inverse * a + factor * np.maximum(a, b)
    if kind == "OVERLAY":
        low = a * (inverse + 2.0 * factor * b)
        high = 1.0 - (inverse + 2.0 * factor * (1.0 - b)) * (1.0 - a)
        return np.where(a < 0.5, low, high)
    if kind == "LINEAR_LIGHT":
        return a + factor * (2.0 * b - 1.0)
    if kind == "SOFT_LIGHT":
        screen = 1.0 - (1.0 - b) * (1.0 - a)
        return inverse * a + factor * ((1.0 - a) * b * a + a * screen)
    if kind == "DIVIDE":
        return np.where(b != 0.0, inverse * a + factor * a / np.where(b != 0.0, b, 1.0), a)
    return None


def safe_divide(a, b):
    """Quotients; 0 where there is none."""
    return np.where(b != 0.0, a / np.where(b != 0.0, b, 1.0), 0.0)


def safe_power(a, b):
    """Powers; 0 where there is none: of negative numbers to exponents that are not whole."""
    none = (a < 0.0) & (b != np.trunc(b))
    return np.where(none, 0.0, np.power(np.where(none, 1.0, a), b))


def safe_log(a, b):
    """Logarithms of `a` to the base `b`; 0 where there is none."""
    some = (a > 0.0) & (b > 0.0)
    return safe_divide(np.log(np.where(some, a, 1.0)), np.log(np.where(some, b, 1.0)))


# Operations of the Math node, of three numbers.
MATH = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: safe_divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: safe_power(a, b),
    "LOGARITHM": lambda a, b, c: safe_log(a, b),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0.0)),
    "INVERSE_SQRT": lambda a, b, c: safe_divide(1.0, np.sqrt(np.maximum(a, 0.0))),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: (a < b).astype(np.float32),
    "GREATER_THAN": lambda a, b, c: (a > b).astype(np.float32),
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": lambda a, b, c: (np.abs(a - b) <= np.maximum(c, 1e-5)).astype(np.float32),
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: np.where(b != 0.0, np.fmod(a, np.where(b != 0.0, b, 1.0)), 0.0),
    "SNAP": lambda a, b, c: np.floor(safe_divide(a, b)) * b,
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}


def to_hsv(c):
    """Hue, saturation and value of colours, without channels."""
    most, least = c.max(axis=2), c.min(axis=2)
    spread = most - least
    safe = np.where(spread > 0.0, spread, 1.0)
    r, g, b = ((most - c[:, :, i]) / safe for i in range(3))
    hue = np.where(c[:, :, 0] == most, b - g, np.where(c[:, :, 1] == most, 2.0 + r - b, 4.0 + g - r)) / 6.0
    hue = np.where(spread > 0.0, hue - np.floor(hue), 0.0)
    return hue, np.where(most > 0.0, spread / np.where(most > 0.0, most, 1.0), 0.0), most


def from_hsv(h, s, v):
    """Colours of hue, saturation and value."""
    h = (h - np.floor(h)) * 6.0
    rgb = [np.abs(h - 3.0) - 1.0, 2.0 - np.abs(h - 2.0), 2.0 - np.abs(h - 4.0)]
    return np.stack([((np.clip(x, 0.0, 1.0) - 1.0) * s + 1.0) * v for x in rgb], axis=2)
