"""Guides: densities that integrate to one and agree with what is drawn, files, and what is refused.

The renders and numpy's random numbers have fixed seeds, so that nothing here fails by chance; were the seeds free, a bound of five
standard errors would be crossed by chance once in 1.7 million times.
"""

import math
import subprocess

import numpy as np
import pytest

import fanal

BOUND = 5.0
DRAWS = 40_000


@pytest.fixture(scope="module")
def learned(scene):
    return fanal.render_full(scene("door-ajar"), spp=128, size=(48, 36), guide="gaussian", aovs=["position", "normal"])


@pytest.fixture(scope="module")
def guide(learned):
    assert learned.guide is not None, "the scene needs its guide"
    return learned.guide


@pytest.fixture(scope="module")
def places(learned, guide):
    """Points and normals of surfaces that have a distribution."""
    points, normals = (learned.aovs[name].reshape(-1, 3) for name in ("position", "normal"))
    flat = np.linalg.norm(normals, axis=1) > 0.999
    points, normals = points[flat], normals[flat]
    found = guide.guided(points, normals)
    assert found.sum() > 100
    chosen = np.flatnonzero(found)[:: found.sum() // 12][:12]
    return points[chosen], normals[chosen]


def directions(random, count):
    """Uniform on the sphere."""
    vectors = random.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_densities_integrate_to_one(guide, places):
    random = np.random.default_rng(1)
    for point, normal in zip(*places):
        towards = directions(random, DRAWS)
        values = 4 * math.pi * guide.pdf(np.tile(point, (DRAWS, 1)), np.tile(normal, (DRAWS, 1)), towards)
        assert (values > 0).all()
        error = values.std() / math.sqrt(DRAWS)
        assert abs(values.mean() - 1) < BOUND * error + 1e-4, (point, values.mean(), error)
        # Not the uniform density, for which this would show nothing.
        assert values.std() > 0.1


def test_what_is_drawn_has_the_density(guide, places):
    random = np.random.default_rng(2)
    for point, normal in zip(*places):
        points, normals = np.tile(point, (DRAWS, 1)), np.tile(normal, (DRAWS, 1))
        drawn, density = guide.sample(points, normals, random.random((DRAWS, 2)))
        assert np.allclose(np.linalg.norm(drawn, axis=1), 1, atol=1e-4)
        again = guide.pdf(points, normals, drawn)
        # Directions on the border between two cells may round into the other.
        assert (np.abs(again - density) < 1e-2 * density).mean() > 0.99
        # The measure of each octant, by importance sampling.
        octant = ((drawn > 0) * [1, 2, 4]).sum(axis=1)
        for number in range(8):
            values = np.where(octant == number, 1 / density.astype(np.float64), 0.0)
            error = values.std() / math.sqrt(DRAWS)
            assert abs(values.mean() - math.pi / 2) < BOUND * error + 1e-3, (point, number, values.mean(), error)


def test_guides_are_saved_and_given(tmp_path, scene, guide, places, program, command):
    path = tmp_path / "door.guide"
    guide.save(path)
    loaded = fanal.load_guide(path)
    assert loaded.voxels == guide.voxels and loaded.bytes == guide.bytes
    towards = directions(np.random.default_rng(3), len(places[0]))
    assert guide.pdf(*places, towards).tobytes() == loaded.pdf(*places, towards).tobytes()
    options = {"spp": 16, "size": (32, 24), "seed": 5}
    given = fanal.render_full(scene("door-ajar"), load_guide=guide, **options)
    assert given.image.tobytes() == fanal.render(scene("door-ajar"), load_guide=path, **options).tobytes()
    assert given.guide.voxels == guide.voxels
    out = tmp_path / "out.exr"
    fixed = ["--quiet", "--spp", 16, "--size", "32x24", "--seed", 5, "-o", out]
    program("render", scene("door-ajar"), "--load-guide", path, *fixed)
    assert given.image.tobytes() == fanal.read_image(out).tobytes()
    shown = subprocess.run(command("inspect", path), capture_output=True, text=True, timeout=60)
    assert shown.returncode == 0 and shown.stdout


def test_saved_guides_are_those_of_the_program(tmp_path, scene, program):
    ours, theirs = tmp_path / "ours.guide", tmp_path / "theirs.guide"
    fixed = ["--quiet", "--spp", 24, "--size", "32x24", "-o", tmp_path / "out.exr"]
    program("render", scene("door-ajar"), "--save-guide", theirs, *fixed)
    fanal.render_full(scene("door-ajar"), spp=24, size=(32, 24)).guide.save(ours)
    assert ours.read_bytes() == theirs.read_bytes()


def test_where_nothing_was_learned(guide, scene):
    far = [[1e6, 1e6, 1e6]]
    assert np.isnan(guide.pdf(far, [[0, 0, 1]], [[0, 0, 1]])).all()
    drawn, density = guide.sample(far, [[0, 0, 1]], [[0.5, 0.5]])
    assert drawn.shape == (1, 3) and np.isnan(drawn).all() and np.isnan(density).all()
    assert guide.bsdf_fraction(far, [[0, 0, 1]]).tolist() == [1.0] and guide.guided(far, [[0, 0, 1]]).tolist() == [False]
    assert fanal.render_full(scene("cornell"), spp=2, size=(8, 8), guide="none").guide is None
    empty = np.zeros((0, 3))
    assert guide.pdf(empty, empty, empty).shape == (0,) and guide.sample(empty, empty, np.zeros((0, 2)))[0].shape == (0, 3)


def test_any_layout_and_type_of_numbers(guide, places):
    points, normals = places
    towards = directions(np.random.default_rng(4), len(points)).astype(np.float32)
    plain = guide.pdf(points, normals, towards)
    columns = [np.asfortranarray(array) for array in (points, normals, towards)]
    strided = [np.repeat(array, 2, axis=0)[::2] for array in (points, normals, towards)]
    reversed_ = [array[::-1][::-1] for array in (points, normals, towards)]
    lists = [array.tolist() for array in (points, normals, towards)]
    doubles = [array.astype(np.float64) for array in (points, normals, towards)]
    for arrays in (columns, strided, reversed_, lists, doubles):
        assert plain.tobytes() == guide.pdf(*arrays).tobytes()
    assert guide.pdf(points[0], normals[0], towards[0]).shape == (1,)
    # Lengths do not count, however large or small.
    assert np.allclose(guide.pdf(points, 1e30 * normals, 1e-30 * towards.astype(float)), plain, rtol=1e-2)


def test_arrays_that_are_refused(guide):
    one, up = [[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]]
    for wrong, kind, told in [
        ((one, up, [[0.0, 1.0]]), ValueError, r"directions: .*\(N, 3\)"),
        ((one, up, 1.0), ValueError, "directions"),
        ((np.zeros((1, 1, 3)), up, up), ValueError, "points"),
        ((one, up, [[0.0, 0.0, math.nan]]), ValueError, r"directions: the number at \(0, 2\) is nan"),
        (([[math.inf, 0, 0]], up, up), ValueError, "points"),
        (([[1e300, 0, 0]], up, up), ValueError, "points"),
        ((one, one, up), ValueError, "normals: .* zero"),
        ((one, up, one), ValueError, "directions: .* zero"),
        ((one * 2, up, up), ValueError, "2 in points"),
        ((one, up, [["a", "b", "c"]]), TypeError, "directions"),
        ((one, up, [[1j, 0, 0]]), TypeError, "directions: .*complex"),
        ((one, up, [[True, False, True]]), TypeError, "directions: .*bool"),
        ((one, up, None), TypeError, "directions"),
        ((one, up, [[1, 2, 3], [1, 2]]), ValueError, "."),
    ]:
        with pytest.raises(kind, match=told):
            guide.pdf(*wrong)
    for u in ([[0.5]], [[0.5, 1.0]], [[-0.1, 0.5]], [[math.nan, 0.5]]):
        with pytest.raises(ValueError, match="u"):
            guide.sample(one, up, u)
    with pytest.raises(ValueError, match="2 in u"):
        guide.sample(one, up, [[0.5, 0.5]] * 2)


def test_files_that_are_refused(tmp_path, scene, guide):
    with pytest.raises(fanal.NotFoundError, match="no-such.guide"):
        fanal.load_guide(tmp_path / "no-such.guide")
    broken = tmp_path / "broken.guide"
    broken.write_bytes(b"no guide")
    with pytest.raises(fanal.FormatError, match="broken.guide"):
        fanal.load_guide(broken)
    with pytest.raises(fanal.FormatError, match="broken.guide"):
        fanal.render(scene("cornell"), load_guide=broken)
    with pytest.raises(fanal.FileError):
        guide.save(tmp_path / "missing" / "a.guide")
    with pytest.raises(fanal.OptionError, match="checkpoint"):
        fanal.render(scene("cornell"), load_guide=guide, checkpoint=tmp_path / "a.part")
