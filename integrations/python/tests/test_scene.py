"""Scenes, options, and what is said where they are wrong."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import fanal


def test_the_package_is_the_installed_one():
    assert Path(fanal.__file__).is_relative_to(sys.prefix)
    assert all(hasattr(fanal, name) and getattr(fanal, name).__doc__ for name in fanal.__all__ if name != "__version__")


def test_scenes_tell_of_themselves(scene, program):
    loaded = fanal.load(scene("cornell"))
    assert loaded.path == scene("cornell") and loaded.size == fanal.render_full(loaded, spp=1, guide="none").size
    assert loaded.warnings == [] and loaded.missing_files == [] and loaded.skipped_triangles == 0
    assert loaded.plan() == json.loads(program("plan", scene("cornell"), "--json"))["effects"]
    changed = fanal.load(Path(scene("cornell")), effects=["+medium", "-photons"]).plan()
    assert {effect["name"]: effect["on"] for effect in changed}["medium"] is True
    assert "cornell" in repr(loaded)


def test_missing_files(tmp_path, scene):
    document = json.loads((Path(scene("lamp-room")) / "scene.json").read_text())
    (tmp_path / "scene.json").write_text(json.dumps(document))
    with pytest.raises(FileNotFoundError, match="shade.obj") as refused:
        fanal.load(tmp_path)
    assert isinstance(refused.value, fanal.NotFoundError) and "--" not in str(refused.value)
    with pytest.warns(fanal.SceneWarning) as told:
        loaded = fanal.load(tmp_path, missing="skip")
    assert any("shade.obj" in name for name in loaded.missing_files)
    assert [str(warning.message) for warning in told] == loaded.warnings != []


def test_names_of_mitsuba_scenes_are_defined(tmp_path):
    (tmp_path / "scene.xml").write_text(
        """<scene version="3.0.0"><default name="wide" value="32"/><default name="high" value="24"/>
        <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="$wide"/><integer name="height" value="$high"/></film></sensor>
        <shape type="sphere"/><emitter type="constant"/></scene>"""
    )
    assert fanal.load(tmp_path).size == (32, 24)
    assert fanal.load(tmp_path, define={"wide": np.int64(48), "high": "36"}).size == (48, 36)
    with pytest.raises(fanal.FormatError, match="tall"):
        fanal.load(tmp_path, define={"tall": 2})
    with pytest.raises(TypeError, match="define: expected a mapping"):
        fanal.load(tmp_path, define=7)
    with pytest.raises(TypeError, match="define: expected a mapping"):
        fanal.load(tmp_path, define={"wide": None})


def test_broken_scenes_are_told_with_their_place(tmp_path):
    (tmp_path / "broken.json").write_text('{\n"version": 1,\n"camera": 7\n}')
    with pytest.raises(fanal.FormatError, match="broken.json:3"):
        fanal.load(tmp_path / "broken.json")
    with pytest.raises(fanal.NotFoundError, match="no-such.xml"):
        fanal.render(tmp_path / "no-such.xml")
    with pytest.raises(fanal.FormatError, match="this kind of scene file"):
        fanal.load(__file__)


@pytest.mark.parametrize(
    ("options", "kind", "told"),
    [
        ({"spp": 0}, ValueError, "spp"),
        ({"spp": 1.5}, TypeError, "spp: expected a whole number, not 1.5"),
        ({"spp": "8"}, TypeError, "spp"),
        ({"spp": 8, "time": 1.0}, ValueError, "spp.*time|time.*spp"),
        ({"time": -1}, ValueError, "time"),
        ({"time": float("nan")}, ValueError, "time"),
        ({"time": "1"}, TypeError, "time"),
        ({"target_error": 0.0}, ValueError, "target_error"),
        ({"guide": "magic"}, ValueError, "magic.*neural"),
        ({"guide": None}, TypeError, "none"),
        ({"guide": "none", "load_guide": "a.guide"}, ValueError, "load_guide"),
        ({"guide": "none\n--spp=3"}, ValueError, "guide"),
        ({"size": (0, 5)}, ValueError, "0x5"),
        ({"size": (-4, 5)}, ValueError, "size"),
        ({"size": (1 << 40, 5)}, ValueError, "size"),
        ({"size": (4, 5, 6)}, TypeError, "size: expected two whole numbers"),
        ({"size": "4x5"}, TypeError, "size"),
        ({"size": 4}, TypeError, "size"),
        ({"crop": (0, 0, 0, 1)}, ValueError, "crop"),
        ({"crop": (0, 0, 1)}, TypeError, "crop"),
        ({"aovs": "lantern"}, ValueError, "lantern.*aovs"),
        ({"every": 5}, ValueError, "every.*checkpoint.*resume"),
        ({"aovs": [3]}, TypeError, "aovs"),
        ({"threads": 0}, ValueError, "threads"),
        ({"seed": -1}, ValueError, "seed"),
        ({"seed": 1 << 64}, ValueError, "seed"),
        ({"adaptive": "on"}, TypeError, "adaptive: expected True or False"),
        ({"adaptive": True, "target_error": 0.1}, ValueError, "adaptive"),
        ({"model": "no-such-model"}, FileNotFoundError, "no-such-model"),
        ({"model": 7}, TypeError, "model"),
        ({"resume": "no-such.part"}, FileNotFoundError, "no-such.part"),
        ({"progress": 7}, TypeError, "progress"),
        ({"max_depth": 0}, ValueError, "max_depth"),
        ({"lanterns": 3}, TypeError, "lanterns"),
    ],
)
def test_options_that_are_refused(scene, options, kind, told):
    with pytest.raises(kind, match=told) as refused:
        fanal.render_full(scene("cornell"), **options)
    assert kind is TypeError or isinstance(refused.value, fanal.Error)
    assert "--" not in str(refused.value).replace("--spp=3", "")


def test_numbers_of_numpy_are_numbers(scene):
    plain = fanal.render(scene("cornell"), spp=2, size=(9, 8), seed=3, guide="none")
    again = fanal.render(scene("cornell"), spp=np.int32(2), size=np.array([9, 8]), seed=np.uint64(3), guide="none")
    assert plain.tobytes() == again.tobytes()


def test_scenes_that_are_refused(scene):
    for wrong in (None, 7, b"scenes", [scene("cornell")]):
        with pytest.raises(TypeError):
            fanal.load(wrong)
    with pytest.raises(fanal.OptionError, match="effect"):
        fanal.load(scene("cornell"), effects="photons")
    with pytest.raises(fanal.OptionError):
        fanal.load(scene("cornell"), missing="perhaps")
    with pytest.raises(fanal.Error):
        fanal.load("")
