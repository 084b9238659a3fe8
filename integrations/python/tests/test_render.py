"""Pictures: the same bits as the program's, with any number of threads; layers, windows and ends."""

import threading

import numpy as np
import pytest

import fanal


def same(a, b):
    return a.dtype == b.dtype == np.float32 and a.shape == b.shape and a.tobytes() == b.tobytes()


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("cornell", {"guide": "none"}, ["--guide", "none"]),
        ("door-ajar", {}, []),
        ("door-ajar", {"guide": "variance", "max_depth": 4}, ["--guide", "variance", "--max-depth", "4"]),
        ("glass-caustic", {"adaptive": True, "pixel_filter": "tent"}, ["--adaptive", "on", "--pixel-filter", "tent"]),
        (
            "lamp-room",
            {"guide": "gaussian", "light_sampling": False, "roulette": "off"},
            ["--guide", "gaussian", "--light-sampling", "off", "--roulette", "off"],
        ),
        ("cornell", {"crop": (3, 5, 17, 9), "effects": "-photons"}, ["--crop", "3,5,17,9", "--effects=-photons"]),
    ],
)
def test_pictures_are_those_of_the_program(tmp_path, scene, program, name, options, words):
    out = tmp_path / "out.exr"
    fixed = ["--spp", 24, "--size", "40x30", "--seed", 7]
    program("render", scene(name), "-o", out, "--quiet", *fixed, *words)
    loaded = fanal.load(scene(name), effects=options.pop("effects", ()))
    image = fanal.render(loaded, spp=24, size=(40, 30), seed=7, **options)
    assert same(image, fanal.read_image(out))
    assert image.max() > 0.0


def test_threads_and_neighbours_change_no_bit(scene):
    loaded = fanal.load(scene("door-ajar"))
    options = {"spp": 24, "size": (32, 24), "seed": 3}
    alone = fanal.render(loaded, threads=1, **options)
    assert same(alone, fanal.render(loaded, threads=3, **options))
    assert not same(alone, fanal.render(loaded, **{**options, "seed": 4}))
    found = [None, None]

    def work(i):
        found[i] = fanal.render(loaded, threads=1 + i, **options)

    workers = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    [worker.start() for worker in workers]
    [worker.join() for worker in workers]
    assert all(same(alone, image) for image in found)


def test_layers_are_arrays(scene):
    result = fanal.render_full(scene("cornell"), spp=16, size=(24, 20), guide="none", aovs="all")
    assert result.image.shape == (20, 24, 3) and result.size == (24, 20) and result.window == (0, 0, 24, 20)
    shapes = {name: layer.shape for name, layer in result.aovs.items()}
    three, one = (20, 24, 3), (20, 24)
    assert shapes == {
        "albedo": three,
        "normal": three,
        "position": three,
        "depth": one,
        "samples": one,
        "variance": three,
        "guiding": one,
        **{f"crypto_{kind}{rank:02}": (20, 24, 4) for kind in ("object", "material") for rank in range(3)},
    }
    assert all(layer.dtype == np.float32 and layer.flags.c_contiguous for layer in result.aovs.values())
    assert (result.aovs["samples"] == 16).all() and (result.aovs["guiding"] == 0).all()
    assert ((result.aovs["depth"] > 0) == (np.abs(result.aovs["normal"]).sum(axis=2) > 0)).all()
    lengths = np.linalg.norm(result.aovs["normal"], axis=2)
    assert (lengths < 1 + 1e-5).all() and np.median(lengths) > 0.999
    assert "depth" in repr(result)
    only = fanal.render_full(scene("cornell"), spp=16, size=(24, 20), guide="none", aovs=["depth", "albedo"])
    assert set(only.aovs) == {"depth", "albedo"} and same(only.aovs["depth"], result.aovs["depth"])
    assert same(only.image, result.image)


def test_windows_are_parts_of_the_picture(scene):
    options = {"spp": 8, "size": (40, 30), "guide": "none"}
    whole = fanal.render(scene("cornell"), **options)
    part = fanal.render_full(scene("cornell"), crop=np.array([5, 7, 20, 11]), **options)
    assert same(part.image, np.ascontiguousarray(whole[7:18, 5:25]))
    assert part.size == (40, 30) and part.window == (5, 7, 20, 11)


def test_statistics_are_those_of_the_program(tmp_path, scene, program):
    stats, out = tmp_path / "stats.json", tmp_path / "out.exr"
    program("render", scene("door-ajar"), "-o", out, "--quiet", "--spp", 24, "--size", "32x24", "--stats", stats)
    import json

    theirs = json.loads(stats.read_text())
    ours = fanal.render_full(scene("door-ajar"), spp=24, size=(32, 24)).statistics
    assert ours.keys() == theirs.keys()
    for key in ("version", "scene", "method", "seed", "width", "height", "spp", "rays", "samples", "effects", "decisions"):
        assert ours[key] == theirs[key], key
    assert ours["guide"]["nodes"] == theirs["guide"]["nodes"] and ours["seconds"]["load"] > 0.0


def test_renders_end_by_time_and_by_error(scene):
    by_time = fanal.render_full(scene("cornell"), time=0.5, size=(24, 24), guide="none")
    assert by_time.statistics["spp"] > 1 and not by_time.interrupted
    by_error = fanal.render_full(scene("cornell"), target_error=0.5, size=(24, 24), guide="none")
    assert by_error.statistics["estimated_relmse"] <= 0.5
    default = fanal.render_full(scene("white-furnace"), size=(8, 8), guide="none")
    assert default.statistics["spp"] == fanal.render_full(scene("white-furnace"), size=(9, 9), guide="none").statistics["spp"]


def test_checkpoints_are_resumed(tmp_path, scene):
    options = {"size": (32, 24), "guide": "none", "spp": 64}
    whole = fanal.render(scene("cornell"), **options)
    part = tmp_path / "a.part"
    # The first is due as soon as anything was traced.
    first = fanal.render(scene("cornell"), checkpoint=part, every=1e-9, **options)
    assert same(first, whole)
    assert same(fanal.render(scene("cornell"), resume=part, **options), whole)
    assert same(fanal.render(scene("cornell"), checkpoint=part, resume=part, **options), whole)
    with pytest.raises(fanal.Error, match="a.part"):
        fanal.render(scene("cornell"), resume=part, **{**options, "spp": 65})


def test_checkpoints_are_not_replaced(tmp_path, scene):
    options = {"size": (16, 12), "guide": "none", "spp": 4}
    kept, other = tmp_path / "my--kept.part", tmp_path / "other.part"
    for path in (kept, other):
        fanal.render(scene("cornell"), checkpoint=path, every=1e-9, **options)
    held = kept.read_bytes()
    for more in ({}, {"resume": other}):
        # What looks like an option in the name of a file is none.
        with pytest.raises(fanal.OptionError, match="my--kept.part: there is a checkpoint already.* with resume .*my--kept.part"):
            fanal.render(scene("cornell"), checkpoint=kept, **more, **options)
        assert kept.read_bytes() == held
    with pytest.raises(fanal.FileError, match="missing"):
        fanal.render(scene("cornell"), checkpoint=tmp_path / "missing" / "a.part", **options)


def test_fireflies_are_a_layer(scene):
    options = {"spp": 16, "size": (24, 20), "guide": "none"}
    plain = fanal.render(scene("door-ajar"), **options)
    judged = fanal.render_full(scene("door-ajar"), fireflies="reweight", kappa=8, **options)
    assert set(judged.aovs) == {"fireflies"} and judged.aovs["fireflies"].max() > 0
    assert np.allclose(judged.image + judged.aovs["fireflies"], plain, rtol=1e-6, atol=0)
    assert same(fanal.render(scene("door-ajar"), fireflies="keep", **options), plain)
    with pytest.raises(ValueError, match="kappa"):
        fanal.render(scene("door-ajar"), kappa=8, **options)
