"""Checks of arrays: what goes on to the renderer is finite, contiguous and of the right shape."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float32]
"""An array of 32-bit floats."""


def numbers(value: ArrayLike, name: str, dtype: type[Any] = np.float32) -> NDArray[Any]:
    """An array of finite real numbers, contiguous."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name}: expected an array of real numbers, not of type {array.dtype}")
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(array, dtype)
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"{name}: the number at {place} is {array[place]}; only finite numbers are accepted")
    return array


def rows(value: ArrayLike, name: str, columns: int, dtype: type[Any] = np.float32) -> NDArray[Any]:
    """An array of rows of numbers; one row alone stands for itself."""
    array = numbers(value, name, dtype)
    if array.ndim == 1:
        array = array[np.newaxis]
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name}: expected an array of shape (N, {columns}), not {np.shape(value)}")
    return array


def units(value: ArrayLike, name: str) -> Floats:
    """Rows of three numbers, as unit vectors."""
    vectors = rows(value, name, 3, np.float64)
    largest = np.abs(vectors).max(axis=1, initial=0.0, keepdims=True)
    if not (largest > 0.0).all():
        raise ValueError(f"{name}: the vector at {int(np.argmin(largest))} is zero and has no direction")
    vectors = vectors / largest
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.ascontiguousarray(vectors, np.float32)


def picture(value: ArrayLike, name: str) -> Floats:
    """A picture of rows, columns and three channels; one without channels is grey."""
    array = numbers(value, name)
    if array.ndim == 2:
        array = np.repeat(array[..., np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
        raise ValueError(f"{name}: expected a picture of shape (rows, columns, 3) or (rows, columns), not {np.shape(value)}")
    return array


def together(**arrays: NDArray[Any]) -> int:
    """The number of rows of arrays that must have as many."""
    counts = {name: len(array) for name, array in arrays.items()}
    if len(set(counts.values())) > 1:
        raise ValueError("as many rows are expected: " + ", ".join(f"{n} in {name}" for name, n in counts.items()))
    return next(iter(counts.values()))
