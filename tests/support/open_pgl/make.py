#!/usr/bin/env python3
"""Asks Open PGL itself what it makes of samples whose truth is known, and writes both to `fixture.bin` beside this file.

    pip install bpy==4.2.0 numpy        (its library contains Open PGL 0.6.0, with the names of its functions; a C compiler is needed too)
    python3 tests/support/open_pgl/make.py

Four kinds of light, each learned from `UPDATES` batches of `BATCH` samples: three lobes; a sky with a sun; a near lamp, seen from all points of
a voxel; a lamp that is rarely found. Numbers are little-endian and of 32 bits. Of each kind: samples (point, direction, value over density, density,
distance: 9 numbers), then of each place its point, DIRECTIONS directions drawn by the true density, the true density in each, and Open PGL's. How
long a query takes is printed.
"""

import ctypes
import math
import pathlib
import subprocess
import tempfile

import bpy  # noqa: F401 (its library is what is asked)
import numpy as np

BATCH, UPDATES, DIRECTIONS = 2048, 3, 1024
HALF = 0.1  # of the voxel's side

SHIM = r"""
#include <stddef.h>
#include <stdint.h>
#include <time.h>
typedef struct { float x, y, z; } V3;
typedef struct { float x, y; } V2;
typedef struct { V3 lower, upper; } Box;
typedef struct { char bytes[512]; } Arguments;
typedef struct { V3 point, direction; float weight, pdf, distance; uint32_t flags; } Sample;
void *(*new_device)(int, size_t), *(*new_field)(void *, Arguments), *(*new_storage)(void), *(*new_distribution)(void *);
void (*defaults)(Arguments *, int, int, _Bool, size_t), (*bounds)(void *, Box), (*add)(void *, const Sample *, size_t);
void (*update)(void *, void *), (*clear)(void *);
_Bool (*valid)(void *), (*init)(void *, void *, V3, float *, _Bool);
float (*density)(void *, V3), (*drawn)(void *, V2, V3 *);
size_t (*size)(void *);

void *begin(float half) {
  Arguments arguments = {{0}};
  defaults(&arguments, 0, 0, 1, 32000);
  void *field = new_field(new_device(1, 1), arguments);
  Box box = {{-half, -half, -half}, {half, half, half}};
  bounds(field, box);
  return field;
}
int learn(void *field, const Sample *samples, size_t count) {
  void *storage = new_storage();
  add(storage, samples, count);
  int right = valid(storage) && size(storage) == count;
  update(field, storage);
  return right;
}
int ask(void *field, V3 point, const V3 *directions, size_t count, float *out) {
  void *distribution = new_distribution(field);
  float u = 0.5f;
  if (!init(field, distribution, point, &u, 1)) return 0;
  for (size_t i = 0; i < count; i++) out[i] = density(distribution, directions[i]);
  return 1;
}
static double now(void) { struct timespec t; clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t); return t.tv_sec + 1e-9 * t.tv_nsec; }
/* Nanoseconds of aiming a distribution at a place, a density there, and a sample with its density. */
void time_it(void *field, const V3 *directions, size_t count, float half, double *ns) {
  void *distribution = new_distribution(field);
  volatile float sum = 0;
  V3 found;
  double start = now();
  for (size_t i = 0; i < count; i++) {
    float u = 0.5f;
    V3 at = {half * directions[i].x, half * directions[i].y, half * directions[i].z};
    init(field, distribution, at, &u, 1);
  }
  ns[0] = 1e9 * (now() - start) / count;
  start = now();
  for (size_t i = 0; i < count; i++) sum += density(distribution, directions[i]);
  ns[1] = 1e9 * (now() - start) / count;
  start = now();
  for (size_t i = 0; i < count; i++) { V2 u = {i / (float)count, (i * 7 % count) / (float)count}; sum += drawn(distribution, u, &found); }
  ns[2] = 1e9 * (now() - start) / count;
}
"""

NAMES = {
    "new_device": "pglNewDevice", "new_field": "pglDeviceNewField", "new_storage": "pglNewSampleStorage",
    "new_distribution": "pglFieldNewSurfaceSamplingDistribution", "defaults": "pglFieldArgumentsSetDefaults",
    "bounds": "pglFieldSetSceneBounds", "add": "pglSampleStorageAddSamples", "update": "pglFieldUpdate", "clear": "pglSampleStorageClear",
    "valid": "pglSampleStorageValidate", "init": "pglFieldInitSurfaceSamplingDistribution",
    "density": "pglSurfaceSamplingDistributionPDF", "drawn": "pglSurfaceSamplingDistributionSamplePDF",
    "size": "pglSampleStorageGetSizeSurface",
}  # fmt: skip


def library(folder):
    """The shim, told where in Blender's library the functions are: they are not exported, but its table of symbols names them."""
    source = folder / "shim.c"
    source.write_text(SHIM)
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", folder / "shim.so", source], check=True)
    shim = ctypes.CDLL(str(folder / "shim.so"))
    # The package takes another module's place once it is loaded.
    path = next(line.split()[-1] for line in open("/proc/self/maps") if line.rstrip().endswith("bpy/__init__.so"))
    symbols = subprocess.run(["nm", "--defined-only", path], check=True, capture_output=True, text=True).stdout
    places = {line.split()[2]: int(line.split()[0], 16) for line in symbols.splitlines() if " pgl" in line}
    # The first mapping of the file is where its address 0 lies.
    base = next(int(line.split("-")[0], 16) for line in open("/proc/self/maps") if line.rstrip().endswith(path))
    for own, name in NAMES.items():
        ctypes.c_void_p.in_dll(shim, own).value = base + places[name]
    shim.begin.restype, shim.begin.argtypes = ctypes.c_void_p, [ctypes.c_float]
    return shim


class V3(ctypes.Structure):
    """A vector as it is passed by value."""

    _fields_ = [("x", ctypes.c_float), ("y", ctypes.c_float), ("z", ctypes.c_float)]


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def lobe(mean, kappa):
    mean = unit(np.array(mean, float))
    peak = kappa / (2 * math.pi * -math.expm1(-2 * kappa))
    return lambda d: peak * np.exp(-0.5 * kappa * np.sum((d - mean) ** 2, -1))


def spherical(u):
    """Uniform directions for points of the unit square."""
    z, phi = 2 * u[..., 0] - 1, 2 * math.pi * u[..., 1]
    r = np.sqrt(np.maximum(0, 1 - z * z))
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)


LAMP, RADIUS = np.array([0.3, 0.5, 0.1]), 0.06


def near_lamp(points, directions):
    """Radiance of a ball that shines, and of dim surroundings."""
    to = LAMP - points
    along = np.sum(to * directions, -1)
    away = np.sum(to * to, -1) - along**2
    return np.where((along > 0) & (away < RADIUS**2), 200.0, 1.0)


def kinds(random):
    """Name, radiance as a function of points and directions, distance in the same way, how directions are drawn."""
    three = [(0.5, lobe((0.2, 0.1, 1.0), 20)), (0.3, lobe((1.0, -0.3, 0.1), 200)), (0.2, lobe((-0.5, 0.8, -0.4), 2000))]
    sun = lobe((0.4, 0.2, 0.7), 3000)
    far = lambda points, directions: np.full(len(points), 100.0)
    uniform = (lambda n: spherical(random.random((n, 2))), lambda d: np.full(d.shape[:-1], 0.25 / math.pi))

    def mixed(n):
        """Half of the directions uniformly, half towards a wide lobe, as a path tracer that knows a little has them."""
        towards = unit(np.array([0.3, 0.5, 0.1]) + 0.5 * spherical(random.random((n, 2))))
        return np.where(random.random((n, 1)) < 0.5, spherical(random.random((n, 2))), towards)

    # Where a direction of unit length + 0.5 · uniform points: no closed form that is short, so tabulated by how far it lies off the axis.
    axis, r = unit(np.array([0.3, 0.5, 0.1])), 0.5
    length = float(np.linalg.norm([0.3, 0.5, 0.1]))

    def mixed_pdf(d):
        c = np.sum(d * axis, -1)
        root = r * r - length**2 * (1 - c * c)
        inside = np.sqrt(np.maximum(root, 1e-12))
        # Both crossings of the ray with the sphere of radius r around the axis' end: t²/(4π r²·|cos|) each.
        total = np.zeros(c.shape)
        for sign in (-1, 1):
            t = length * c + sign * inside
            cosine = inside / r
            total += np.where((root > 0) & (t > 0), t * t / (4 * math.pi * r * r * cosine), 0)
        return 0.5 * 0.25 / math.pi + 0.5 * total

    yield "three lobes", lambda p, d: sum(w * of(d) for w, of in three), far, uniform
    yield "a sky with a sun", lambda p, d: np.maximum(d[..., 2], 0) + 0.2 + 2 * sun(d), far, uniform
    lamp_distance = lambda p, d: np.where(near_lamp(p, d) > 1, np.linalg.norm(LAMP - p, axis=-1) - RADIUS, 3.0)
    yield "a near lamp", near_lamp, lamp_distance, (mixed, mixed_pdf)
    small = lobe((0.0, 0.0, 1.0), 1000)
    yield "a lamp that is rarely found", lambda p, d: 0.05 + small(d), far, uniform


def main():
    random = np.random.default_rng(20261127)
    many = np.float32(spherical((np.arange(1 << 20)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])) % 1))
    places = np.array([[0, 0, 0], [HALF, HALF, HALF], [-HALF, HALF, -HALF]], np.float32) * 0.9
    out = [np.array([4, UPDATES, BATCH, len(places), DIRECTIONS], np.uint32).tobytes()]
    pointer = lambda array: array.ctypes.data_as(ctypes.c_void_p)
    with tempfile.TemporaryDirectory() as folder:
        shim = library(pathlib.Path(folder))
        for name, radiance, distance, (draw, pdf) in kinds(random):
            field = ctypes.c_void_p(shim.begin(HALF))
            for _ in range(UPDATES):
                points = HALF * (2 * random.random((BATCH, 3)) - 1)
                to = unit(draw(BATCH))
                density = pdf(to)
                value = radiance(points, to) / density
                columns = [points, to, value[:, None], density[:, None], distance(points, to)[:, None], np.zeros((BATCH, 1))]
                samples = np.ascontiguousarray(np.concatenate(columns, 1), np.float32)
                right = shim.learn(field, pointer(samples), ctypes.c_size_t(BATCH))
                assert right, "Open PGL does not take the samples as they are meant"
                out.append(samples[:, :9].tobytes())
            for place in places:
                truth = radiance(np.broadcast_to(place, many.shape), many.astype(float))
                truth /= 4 * math.pi * truth.mean()
                # As many in all parts of equal light, so that the mean of log p/q over them is the Kullback-Leibler divergence.
                sums = np.cumsum(truth)
                chosen = np.searchsorted(sums, (np.arange(DIRECTIONS) + random.random(DIRECTIONS)) / DIRECTIONS * sums[-1])
                chosen = np.minimum(chosen, len(many) - 1)
                directions, expected = np.ascontiguousarray(many[chosen]), truth[chosen].astype(np.float32)
                found = np.zeros(DIRECTIONS, np.float32)
                asked = shim.ask(field, V3(*place), pointer(directions), ctypes.c_size_t(DIRECTIONS), pointer(found))
                assert asked, "Open PGL has no distribution there"
                out += [array.tobytes() for array in (place, directions, expected, found)]
                print(f"{name}: divergence of Open PGL's density {np.log(expected / found).mean():.4f}")
            ns = (ctypes.c_double * 3)()
            shim.time_it(field, pointer(directions), ctypes.c_size_t(DIRECTIONS), ctypes.c_float(HALF), ns)
            print(f"{name}: {ns[0]:.0f} ns to aim, {ns[1]:.0f} ns a density, {ns[2]:.0f} ns a sample with its density")
    pathlib.Path(__file__).with_name("fixture.bin").write_bytes(b"".join(out))


if __name__ == "__main__":
    main()
