"""Values of a node's socket over a surface: one value everywhere, or a picture over texture coordinates. Needs NumPy alone."""

from dataclasses import dataclass, replace

import numpy as np

# Luminance of linear Rec. 709, by which Blender makes numbers of colours.
LUMINANCE = np.array([0.2126729, 0.7151522, 0.0721750], np.float32)


@dataclass(frozen=True)
class Lookup:
    """How a picture is looked up."""

    # ("uv", name of the layer, "" for the active one), ("generated", projection) or ("object", projection); a projection is
    # a 2x4 matrix as a tuple, from three coordinates to two.
    coordinates: tuple
    # From those coordinates to the picture's, v upwards: 2x3 row by row.
    matrix: tuple = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    # "repeat", "clamp" or "mirror".
    wrap: str = "repeat"
    # "bilinear" or "nearest".
    filter: str = "bilinear"


class Field:
    """A value over a surface. `data` has rows from the top, columns, and 1 (a number) or 3 channels (a colour or vector)."""

    def __init__(self, data, lookup=None, source=None, factor=1.0):
        self._data = data
        # Factor of the values on those of the source.
        self.factor = factor
        # None where the value is the same everywhere.
        self.lookup = lookup
        # The picture file that holds just this, if there is one; see `pictures.Source`.
        self.source = source

    @classmethod
    def constant(cls, value):
        value = np.atleast_1d(np.asarray(value, np.float32))[:3]
        return cls(value.reshape(1, 1, -1))

    @property
    def data(self):
        if callable(self._data):
            self._data = self._data()
        return self._data

    @property
    def is_constant(self):
        return self.lookup is None

    @property
    def channels(self):
        return self.data.shape[2]

    def mean(self):
        """The mean over the picture, per channel."""
        return self.data.mean(axis=(0, 1), dtype=np.float64)

    def number(self):
        """The mean of a number, or of a colour's luminance."""
        mean = self.mean()
        return float(mean[0]) if len(mean) == 1 else float(mean @ LUMINANCE)

    def flat(self):
        """The constant field of the mean."""
        return Field.constant(self.mean())

    def is_value(self, value):
        """Whether it is `value` everywhere."""
        return self.is_constant and bool(np.all(self.data == np.float32(value)))

    def times(self, factor):
        """The values times a number."""
        return self if factor == 1.0 else Field(lambda: self.data * np.float32(factor), self.lookup, self.source, self.factor * factor)

    def as_number(self):
        """A colour's luminance; numbers are left alone."""
        if self.source is None and self.channels == 1:
            return self
        # The file may stay what it is: fanal takes a colour's luminance where a number is asked for.
        return Field(lambda: _luminance(self.data), self.lookup, self.source, self.factor)

    def as_color(self):
        """Three channels; colours are left alone."""
        if self.source is not None or self.channels == 3:
            return self
        return Field(lambda: np.repeat(self.data, 3, axis=2), self.lookup)

    def channel(self, index):
        """One channel of a colour; a number is its own."""
        return Field(lambda: self.data[:, :, [min(index, self.channels - 1)]], self.lookup)


def _luminance(data):
    return data if data.shape[2] == 1 else (data @ LUMINANCE)[:, :, None]


def resized(data, rows, columns):
    """`data` at the pixel centres of a picture of that size: the nearest pixels."""
    height, width = data.shape[:2]
    if (height, width) == (rows, columns):
        return data
    down = ((np.arange(rows) + 0.5) * height / rows).astype(int)
    across = ((np.arange(columns) + 0.5) * width / columns).astype(int)
    return data[down][:, across]


def combine(function, *fields, lost=lambda field: None):
    """`function` of the fields' arrays. Pictures that are looked up in another way than the largest count by their mean; `lost` is
    called with each of them."""
    pictures = [field for field in fields if not field.is_constant]
    if not pictures:
        return Field(np.asarray(function(*(field.data for field in fields)), np.float32))
    first = max(pictures, key=lambda field: field.data.shape[0] * field.data.shape[1])
    kept = []
    for field in fields:
        if not field.is_constant and field.lookup != first.lookup:
            lost(field)
            field = field.flat()
        kept.append(field)
    sizes = [field.data.shape[:2] for field in kept if not field.is_constant]
    rows, columns = max(size[0] for size in sizes), max(size[1] for size in sizes)
    arrays = [field.data if field.is_constant else resized(field.data, rows, columns) for field in kept]
    result = np.asarray(function(*arrays), np.float32)
    result = np.broadcast_to(result, (rows, columns, result.shape[2]))
    return Field(result, first.lookup)


def with_matrix(lookup, matrix):
    """The lookup with a 2x3 matrix `matrix` (an array) in place of its own."""
    return replace(lookup, matrix=tuple(float(x) for x in np.asarray(matrix).reshape(-1)))


def srgb_to_linear(values):
    """IEC 61966-2-1."""
    values = np.asarray(values, np.float32)
    low = values / 12.92
    high = ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, low, high).astype(np.float32)
