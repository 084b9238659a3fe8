"""Asks Embree's single-ray kernels what `rays.rs` asks, in turn with it, and prints the ratio of the speeds.

    pip install embreex numpy      (for the library that it contains; a C compiler is needed too)
    python tests/bench/rays_embree.py [--isa avx2] [--rounds 5] [--robust]

Both are given the same triangles and the same rays, on one thread, in seconds on the processor; the median of the rounds counts.
The distances of all hits are compared as well. Run from the root of the repository.
"""

import argparse
import ctypes
import pathlib
import statistics
import subprocess
import tempfile

import numpy as np

LOOP = r"""
#include <time.h>
#include <stdlib.h>
#include <string.h>

/* Embree 4's ray and hit, with room for fields that some builds add. */
struct Ray { float org[3], tnear, dir[3], time, tfar; unsigned mask, id, flags; };
struct RayHit { struct Ray ray; float normal[3], u, v; unsigned prim, geom, inst[16]; } __attribute__((aligned(16)));

static double seconds(void) {
  struct timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

static struct Ray make(const float *r, float tfar) {
  struct Ray ray = {{r[0], r[1], r[2]}, 0, {r[3], r[4], r[5]}, 0, tfar, ~0u, 0, 0};
  return ray;
}

double closest(void (*intersect)(void *, struct RayHit *, void *), void *scene, const float *rays, long n, float *out) {
  double start = seconds();
  for (long i = 0; i < n; i++) {
    struct RayHit hit;
    hit.ray = make(rays + 7 * i, __builtin_inff());
    hit.geom = hit.inst[0] = ~0u;
    intersect(scene, &hit, 0);
    out[i] = hit.geom == ~0u ? -1 : hit.ray.tfar;
  }
  return seconds() - start;
}

double any(void (*occluded)(void *, struct Ray *, void *), void *scene, const float *rays, long n, float *out) {
  double start = seconds();
  for (long i = 0; i < n; i++) {
    struct Ray ray __attribute__((aligned(16))) = make(rays + 7 * i, rays[7 * i + 6]);
    occluded(scene, &ray, 0);
    out[i] = ray.tfar < 0;
  }
  return seconds() - start;
}
"""


def embree():
    import embreex

    folder = pathlib.Path(embreex.__file__).parent.parent / "embreex.libs"
    for name in ("libtbb*", "libembree4*"):
        for path in folder.glob(name):
            library = ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    for name in ("rtcNewDevice", "rtcNewScene", "rtcNewGeometry"):
        getattr(library, name).restype = ctypes.c_void_p
    return library


def build(library, vertices, triangles, isa, robust):
    pointer = ctypes.c_void_p
    device = pointer(library.rtcNewDevice(f"max_isa={isa}".encode()))
    scene = pointer(library.rtcNewScene(device))
    if robust:
        library.rtcSetSceneFlags(scene, 4)
    geometry = pointer(library.rtcNewGeometry(device, 0))
    size = ctypes.c_size_t
    # Type (0 indices, 1 vertices), slot, format (three unsigned, three floats), data, offset, stride, count.
    for kind, layout, data in ((1, 0x9003, vertices), (0, 0x5003, triangles)):
        library.rtcSetSharedGeometryBuffer(
            geometry, kind, 0, layout, pointer(data.ctypes.data), size(0), size(12), size(len(data))
        )
    library.rtcCommitGeometry(geometry)
    library.rtcAttachGeometry(scene, geometry)
    library.rtcCommitScene(scene)
    assert library.rtcGetDeviceError(device) == 0
    return scene


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--isa", default="avx2")
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--robust", action="store_true")
    options = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "loop.c").write_text(LOOP)
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", folder / "loop.so", folder / "loop.c"], check=True)
        loop = ctypes.CDLL(str(folder / "loop.so"))
        loop.closest.restype = loop.any.restype = ctypes.c_double
        ours = lambda *more: [
            float(word)
            for word in subprocess.run(
                ["cargo", "bench", "--quiet", "--bench", "rays", "--", "queries", *more],
                check=True, capture_output=True, text=True,
            ).stdout.split()[1::2]
        ]
        ours("--raw", str(folder))
        read = lambda name, kind, width: np.fromfile(folder / name, kind).reshape(-1, width)
        # One vertex more: Embree reads 16 bytes of each.
        vertices = np.vstack([read("vertices", "<f4", 3), np.zeros((1, 3), "<f4")])[:-1]
        triangles, rays = read("triangles", "<u4", 3), read("rays", "<f4", 7)
        library = embree()
        scene = build(library, vertices, triangles, options.isa, options.robust)
        times = {"ours": [], "Embree": []}
        out = [np.zeros(len(rays), "<f4") for _ in range(2)]
        for _ in range(options.rounds):
            theirs = []
            for query, function, result in (
                (loop.closest, library.rtcIntersect1, out[0]), (loop.any, library.rtcOccluded1, out[1])
            ):
                theirs.append(
                    query(
                        function, scene, ctypes.c_void_p(rays.ctypes.data), ctypes.c_long(len(rays)),
                        ctypes.c_void_p(result.ctypes.data),
                    )
                )
            times["Embree"].append(theirs)
            times["ours"].append(ours())
        hits = np.fromfile(folder / "hits", "<f4")
    for index, kind in enumerate(("closest hit", "any hit")):
        speed = {
            who: len(rays) * 1e-6 / statistics.median(times[index] for times in rounds) for who, rounds in times.items()
        }
        print(
            f"{kind:12} ours {speed['ours']:6.3f} Mrays/s   Embree ({options.isa}{', robust' * options.robust}) "
            f"{speed['Embree']:6.3f} Mrays/s   ratio {speed['ours'] / speed['Embree']:.3f}"
        )
    near = np.isclose(hits, out[0], rtol=1e-4, atol=1e-6)
    print(f"{len(triangles)} triangles; {np.mean(hits > 0):.3f} of the rays hit; other hits than Embree: {np.sum(~near)}")


if __name__ == "__main__":
    main()
