"""Evaluated meshes as triangles: one mesh for each material slot, with normals as Blender shades them."""

from dataclasses import dataclass

import numpy as np

# Distance of the two sheets of a mesh that shines on both sides, relative to its size.
_GAP = 1e-4


@dataclass
class Triangles:
    """A part of a mesh: positions (n, 3), triangles (m, 3), and where there are any, normals (n, 3) and texture coordinates (n, 2)."""

    positions: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None


class Corners:
    """A Blender mesh, triangle corner by triangle corner, as arrays. It holds nothing of Blender's own."""

    def __init__(self, mesh):
        count = len(mesh.loop_triangles)
        self.vertices = _get(mesh.loop_triangles, "vertices", (count, 3), np.int32)
        loops = _get(mesh.loop_triangles, "loops", (count, 3), np.int32)
        self.slots = _get(mesh.loop_triangles, "material_index", (count,), np.int32)
        self.positions = _get(mesh.vertices, "co", (len(mesh.vertices), 3), np.float32)
        self.is_flat = mesh.normals_domain == "FACE"
        self.normals = None
        if not self.is_flat:
            self.normals = _get(mesh.corner_normals, "vector", (len(mesh.loops), 3), np.float32)[loops]
        self.layers = {}
        for layer in mesh.uv_layers:
            self.layers[layer.name] = _get(layer.uv, "vector", (len(mesh.loops), 2), np.float32)[loops]
        active = next((layer for layer in mesh.uv_layers if layer.active_render), None)
        self.active = active.name if active else None
        self.texture_space = np.array([mesh.texspace_location[:], mesh.texspace_size[:]], np.float64)

    def uvs(self, coordinates):
        """Texture coordinates of all corners; None where there are none of that name."""
        kind, of = coordinates
        if kind == "uv":
            return self.layers.get(of or self.active)
        points = self.positions.astype(np.float64)
        if kind == "generated":
            location, size = self.texture_space
            points = (points - location) / np.where(size != 0.0, size, 1.0) * 0.5 + 0.5
        projection = np.array(of)
        return (points @ projection[:, :3].T + projection[:, 3]).astype(np.float32)[self.vertices]

    def part(self, chosen, coordinates=None):
        """The triangles where `chosen` holds, with texture coordinates if they are asked for; None without triangles."""
        if not chosen.any():
            return None
        uvs = self.uvs(coordinates) if coordinates is not None else None
        normals = None if self.normals is None else self.normals[chosen].reshape(-1, 3)
        if uvs is not None:
            uvs = uvs[chosen].reshape(-1, 2)
        # Corners with the same bits become one vertex.
        rows = [self.vertices[chosen].reshape(-1, 1)]
        rows += [np.ascontiguousarray(values).view(np.int32) for values in (normals, uvs) if values is not None]
        rows = np.ascontiguousarray(np.concatenate(rows, axis=1))
        keys = rows.view([("", rows.dtype)] * rows.shape[1]).reshape(-1)
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        vertices = self.vertices[chosen].reshape(-1)[first]
        return Triangles(
            self.positions[vertices],
            inverse.reshape(-1, 3).astype(np.int32),
            None if normals is None else normals[first],
            None if uvs is None else uvs[first],
        )

    def is_mirrored(self, coordinates):
        """For each triangle, whether it shows pictures mirrored."""
        uvs = self.uvs(coordinates).astype(np.float64)
        (ax, ay), (bx, by) = ((uvs[:, i] - uvs[:, 0]).T for i in (1, 2))
        return ax * by - ay * bx < 0.0

    def is_closed(self, chosen):
        """Whether the chosen triangles have no border: each edge has one triangle on either side."""
        triangles = self.vertices[chosen].astype(np.int64)
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        size = len(self.positions)
        forth, back = np.sort(edges[:, 0] * size + edges[:, 1]), np.sort(edges[:, 1] * size + edges[:, 0])
        return len(np.unique(forth)) == len(forth) and bool(np.array_equal(forth, back))


def _get(collection, name, shape, kind):
    values = np.empty(int(np.prod(shape)), kind)
    collection.foreach_get(name, values)
    return values.reshape(shape)


def sheets(part):
    """Two sheets, one in front of the part and one behind it that faces backwards."""
    corners = part.positions[part.triangles].astype(np.float64)
    extent = (part.positions.max(axis=0) - part.positions.min(axis=0)).max()
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    step = (0.5 * _GAP * extent * normals)[:, None, :]
    positions = np.concatenate([corners + step, (corners - step)[:, ::-1]]).reshape(-1, 3)

    def both(values, sign):
        if values is None:
            return None
        values = values[part.triangles]
        return np.concatenate([values, sign * values[:, ::-1]]).reshape(-1, values.shape[2])

    triangles = np.arange(len(positions), dtype=np.int32).reshape(-1, 3)
    return Triangles(positions.astype(np.float32), triangles, both(part.normals, -1.0), both(part.uvs, 1.0))
