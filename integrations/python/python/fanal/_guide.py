"""Guides: what was learned of where light comes from."""

import numpy as np
from numpy.typing import ArrayLike

from . import _fanal, _options
from ._arrays import Floats, rows, together, units


class Guide:
    """A guiding field: for every place in a scene, the distribution of directions that the renderer draws rays from.

    Made by :func:`fanal.render_full` and :func:`fanal.load_guide`. It never changes.

    It is asked at points of surfaces, with the normal on the side where light is looked for: layers ``position`` and ``normal`` of a
    render are such points. Directions and normals are made unit vectors; none may be zero. Densities are per steradian, over the whole
    sphere of directions, and never zero.

    Not every place has a distribution: where no path came by, or where guiding was found not to help, the renderer samples the BSDF
    alone. Densities and directions are NaN there, and :meth:`bsdf_fraction` is 1. :meth:`guided` tells the places apart.

    One point, one normal, direction or ``u`` alone stands for an array of one row; rows are not repeated otherwise.
    """

    def __init__(self, inner: _fanal.Guide) -> None:
        self._inner = inner

    @property
    def voxels(self) -> int:
        """Number of places."""
        return self._inner.voxels

    @property
    def bytes(self) -> int:
        """Bytes in memory."""
        return self._inner.bytes

    def pdf(self, points: ArrayLike, normals: ArrayLike, directions: ArrayLike) -> Floats:
        """Densities (N,) of ``directions`` (N, 3), away from the surface points ``points`` (N, 3) with ``normals`` (N, 3)."""
        points, normals, directions = rows(points, "points", 3), units(normals, "normals"), units(directions, "directions")
        together(points=points, normals=normals, directions=directions)
        return self._inner.pdf(points, normals, directions)

    def sample(self, points: ArrayLike, normals: ArrayLike, u: ArrayLike) -> tuple[Floats, Floats]:
        """Directions (N, 3) that numbers ``u`` (N, 2) in [0, 1) map to, and their densities (N,).

        Uniform ``u`` give directions with the density that :meth:`pdf` has.
        """
        points, normals = rows(points, "points", 3), units(normals, "normals")
        u = rows(u, "u", 2, np.float64)
        if not ((u >= 0.0) & (u < 1.0)).all():
            raise ValueError("u: expected numbers of at least 0 and below 1")
        together(points=points, normals=normals, u=u)
        return self._inner.sample(points, normals, u)

    def bsdf_fraction(self, points: ArrayLike, normals: ArrayLike) -> Floats:
        """Probabilities (N,) with which the renderer samples the BSDF instead of the guide; 1 where the guide has no distribution."""
        points, normals = rows(points, "points", 3), units(normals, "normals")
        together(points=points, normals=normals)
        return self._inner.bsdf_fraction(points, normals)

    def guided(self, points: ArrayLike, normals: ArrayLike) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether the guide has a distribution at points, as (N,) bools."""
        points = rows(points, "points", 3)
        found = self.pdf(points, normals, np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), points.shape))
        return np.asarray(~np.isnan(found))

    def save(self, path: _options.Path) -> None:
        """Writes a guide file, for ``load_guide=``, :func:`fanal.load_guide` and ``fanal inspect``."""
        self._inner.save(_options.path(path))

    def __repr__(self) -> str:
        return f"<fanal.Guide, {self.voxels} voxels, {self.bytes / 1e6:.1f} MB>"


def load_guide(path: _options.Path) -> Guide:
    """Reads a guide file.

    :raises fanal.NotFoundError: it is not there.
    :raises fanal.FormatError: it is damaged or of another version.
    """
    return Guide(_fanal.load_guide(_options.path(path)))
