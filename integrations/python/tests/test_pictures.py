"""Pictures on disk, and errors between pictures."""

import json
import math

import numpy as np
import pytest

import fanal


def picture(rows=5, columns=7):
    return np.random.default_rng(1).random((rows, columns, 3), dtype=np.float32) * 4


def test_exr_files_keep_every_bit(tmp_path):
    image = picture()
    path = tmp_path / "a.exr"
    fanal.write_image(path, image)
    assert fanal.read_image(path).tobytes() == image.tobytes() and fanal.read_image(str(path)).dtype == np.float32
    for other in (np.asfortranarray(image), image[::-1][::-1], image.astype(np.float64), image.tolist()):
        fanal.write_image(path, other)
        assert fanal.read_image(path).tobytes() == image.tobytes()
    grey = image[..., 0]
    fanal.write_image(path, grey)
    assert (fanal.read_image(path) == grey[..., np.newaxis]).all()


def test_png_files_are_for_the_screen(tmp_path):
    path = tmp_path / "a.png"
    image = np.full((3, 4, 3), 0.25, np.float32)
    fanal.write_image(path, image)
    assert np.allclose(fanal.read_image(path), 0.25, atol=0.01)
    assert np.allclose(fanal.read_image(path, raw=True), 0.537, atol=0.003)
    fanal.write_image(path, image, exposure=1)
    assert np.allclose(fanal.read_image(path), 0.5, atol=0.01)


def test_errors_are_those_of_the_program(tmp_path, program):
    a, b = picture(), picture()[::-1]
    fanal.write_image(tmp_path / "a.exr", a)
    fanal.write_image(tmp_path / "b.exr", b)
    theirs = json.loads(program("error", tmp_path / "a.exr", tmp_path / "b.exr", "--json"))
    assert fanal.error(a, b) == theirs and theirs["relmse"] > 0.0
    assert fanal.error(np.full((2, 3), 0.3), np.full((2, 3), 0.1))["relmse"] == pytest.approx(2.0)
    assert fanal.error(np.ones((2, 2)), np.zeros((2, 2)))["mean_ratio"] == math.inf
    assert fanal.error(a, a)["mse"] == 0.0


def test_what_is_refused(tmp_path):
    image = picture()
    for wrong, kind in [
        (image[..., :2], ValueError),
        (np.zeros((0, 4, 3)), ValueError),
        (np.zeros(3), ValueError),
        (np.full((2, 2, 3), math.nan), ValueError),
        (np.full((2, 2, 3), math.inf), ValueError),
        ("picture", TypeError),
        (np.zeros((2, 2, 3), complex), TypeError),
        (np.zeros((2, 2, 3), object), TypeError),
        (None, TypeError),
    ]:
        with pytest.raises(kind, match="image"):
            fanal.write_image(tmp_path / "a.exr", wrong)
        with pytest.raises(kind, match="reference"):
            fanal.error(image, wrong)
    with pytest.raises(fanal.OptionError, match="5x7|7x5"):
        fanal.error(image, picture(7, 5))
    with pytest.raises(fanal.OptionError, match="a.jpg"):
        fanal.write_image(tmp_path / "a.jpg", image)
    with pytest.raises(fanal.FileError, match="missing"):
        fanal.write_image(tmp_path / "missing" / "a.exr", image)
    for exposure, name in [(1.0, "a.exr"), (math.nan, "a.png"), (100.0, "a.png")]:
        with pytest.raises(fanal.OptionError, match="exposure"):
            fanal.write_image(tmp_path / name, image, exposure=exposure)
    with pytest.raises(TypeError):
        fanal.write_image(7, image)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError, match="no-such.exr"):
        fanal.read_image(tmp_path / "no-such.exr")
    (tmp_path / "text.exr").write_text("no picture")
    with pytest.raises(fanal.FormatError, match="text.exr"):
        fanal.read_image(tmp_path / "text.exr")
