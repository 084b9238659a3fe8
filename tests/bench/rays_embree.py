"""Asks Embree what `rays.rs` asks, in turn with it, and prints the ratio of the speeds.

    pip install embreex numpy      (for the library that it contains; a C compiler is needed too)
    python tests/bench/rays_embree.py [--isa avx2] [--rounds 5] [--robust]
    python tests/bench/rays_embree.py --isa avx512 SCENE...

Without scenes: incoherent rays through a procedural mesh, one at a time. With them: rays of a render's paths in batches, ours as a
render asks for them, in the faster of its two ways; Embree's one at a time and in packets of 16, in the faster of coherent and incoherent.
Scenes must be of triangles alone, and nothing in them transparent.

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

/* Embree 4's packets of sixteen, with room for fields that some builds add. */
struct Ray16 { float org[3][16], tnear[16], dir[3][16], time[16], tfar[16]; unsigned mask[16], id[16], flags[16]; }
  __attribute__((aligned(64)));
struct RayHit16 { struct Ray16 ray; float normal[3][16], u[16], v[16]; unsigned prim[16], geom[16], inst[16][16]; }
  __attribute__((aligned(64)));
struct Arguments { int flags; unsigned features; void *context, *filter, *intersect; float width; char more[64]; };

/* Packets do not reach over the ends of batches. */
double packets(void (*ask)(const int *, void *, void *, void *), void *scene, const float *rays, const unsigned *batches,
               long count, int any, int coherent, float *out) {
  struct Arguments arguments;
  memset(&arguments, 0, sizeof arguments);
  arguments.flags = coherent ? 1 << 16 : 0;
  arguments.features = ~0u;
  int valid[16] __attribute__((aligned(64)));
  struct RayHit16 hit;
  memset(&hit, 0, sizeof hit);
  double start = seconds();
  for (long b = 0; b < count; b++) {
    for (unsigned first = 0; first < batches[b]; first += 16, rays += 7 * 16, out += 16) {
      unsigned lanes = batches[b] - first < 16 ? batches[b] - first : 16;
      for (unsigned i = 0; i < 16; i++) {
        const float *r = rays + 7 * (i < lanes ? i : 0);
        valid[i] = i < lanes ? -1 : 0;
        for (int axis = 0; axis < 3; axis++) {
          hit.ray.org[axis][i] = r[axis];
          hit.ray.dir[axis][i] = r[3 + axis];
        }
        hit.ray.tnear[i] = 0;
        hit.ray.tfar[i] = r[6];
        hit.ray.mask[i] = ~0u;
        hit.geom[i] = hit.inst[0][i] = ~0u;
      }
      ask(valid, scene, &hit, &arguments);
      for (unsigned i = 0; i < lanes; i++)
        out[i] = any ? hit.ray.tfar[i] < 0 : hit.geom[i] == ~0u ? -1 : hit.ray.tfar[i];
      if (lanes < 16) {
        rays -= 7 * (16 - lanes);
        out -= 16 - lanes;
      }
    }
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


def read(folder, name, kind, width=None):
    numbers = np.fromfile(folder / name, kind)
    return numbers.reshape(-1, width) if width else numbers


def mesh(folder):
    # One vertex more: Embree reads 16 bytes of each.
    vertices = np.vstack([read(folder, "vertices", "<f4", 3), np.zeros((1, 3), "<f4")])[:-1]
    return vertices, read(folder, "triangles", "<u4", 3)


def address(array):
    return ctypes.c_void_p(array.ctypes.data)


def bench(*arguments):
    command = ["cargo", "bench", "--quiet", "--bench", "rays", "--", *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def scenes(options, loop, folder):
    """One line for each kind of rays of each scene, and the geometric means."""
    library, ratios = embree(), {"one": [], "sixteen": []}
    print("Mrays/s: ours, Embree's single rays and packets of 16; ours over either")
    for path in options.scenes:
        rounds, theirs, met = [], {}, {}
        for turn in range(options.rounds):
            lines = bench("batches", path, "--raw", folder).splitlines()[2:]
            rounds.append([max(map(float, line.split()[-3:-1])) for line in lines])
            if turn == 0:
                scene = build(library, *mesh(folder), options.isa, options.robust)
                names = [" ".join(line.split()[1:-5]) for line in lines]
                kinds = [kind for kind in range(7) if (folder / f"rays{kind}").stat().st_size]
            for kind in kinds:
                rays, batches = read(folder, f"rays{kind}", "<f4", 7), read(folder, f"batches{kind}", "<u4")
                any_hit, out = kind >= 4, np.zeros(len(rays), "<f4")
                times = theirs.setdefault(kind, {"one": [], "coherent": [], "incoherent": []})
                # As often as the bench asks, so that all caches are as warm.
                for _ in range(max(1, (1 << 20) // len(rays))):
                    if any_hit:
                        time = loop.any(library.rtcOccluded1, scene, address(rays), ctypes.c_long(len(rays)), address(out))
                    else:
                        time = loop.closest(
                            library.rtcIntersect1, scene, address(rays), ctypes.c_long(len(rays)), address(out)
                        )
                    times["one"].append(time)
                    for coherent, way in ((0, "incoherent"), (1, "coherent")):
                        ask = library.rtcOccluded16 if any_hit else library.rtcIntersect16
                        time = loop.packets(
                            ask, scene, address(rays), address(batches), ctypes.c_long(len(batches)), any_hit, coherent,
                            address(out),
                        )
                        times[way].append(time)
                met[kind] = np.mean(~np.isclose(read(folder, f"met{kind}", "<f4"), out, rtol=1e-4, atol=1e-6))
        for index, kind in enumerate(kinds):
            count = (folder / f"rays{kind}").stat().st_size / 28 * 1e-6
            speed = {way: count / statistics.median(times) for way, times in theirs[kind].items()}
            ours = statistics.median(turn[index] for turn in rounds)
            packets = max(speed["coherent"], speed["incoherent"])
            ratios["one"].append(ours / speed["one"])
            ratios["sixteen"].append(ours / packets)
            print(
                f"{pathlib.Path(path).parent.name:>14} {names[index]:>12} {ours:7.2f} {speed['one']:7.2f} {packets:7.2f}"
                f"   {ours / speed['one']:5.2f} {ours / packets:5.2f}   met otherwise: {met[kind]:.4f}", flush=True
            )
    for way, of in ratios.items():
        print(f"geometric mean over {way}: {statistics.geometric_mean(of):.3f}")


def main():
    options = argparse.ArgumentParser()
    options.add_argument("scenes", nargs="*", metavar="SCENE")
    options.add_argument("--isa", default="avx2")
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--robust", action="store_true")
    options = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "loop.c").write_text(LOOP)
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", folder / "loop.so", folder / "loop.c"], check=True)
        loop = ctypes.CDLL(str(folder / "loop.so"))
        loop.closest.restype = loop.any.restype = loop.packets.restype = ctypes.c_double
        if options.scenes:
            return scenes(options, loop, folder)
        ours = lambda *more: [float(word) for word in bench("queries", *more).split()[1::2]]
        ours("--raw", folder)
        vertices, triangles = mesh(folder)
        rays = read(folder, "rays", "<f4", 7)
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
                        function, scene, address(rays), ctypes.c_long(len(rays)), address(result),
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
