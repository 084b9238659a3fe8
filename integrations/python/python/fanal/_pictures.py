"""Pictures as arrays, and errors between them."""

import json
import math

from numpy.typing import ArrayLike

from . import _fanal, _options
from ._arrays import Floats, picture
from ._errors import OptionError


def read_image(path: _options.Path, *, raw: bool = False) -> Floats:
    """Reads an EXR, HDR, PFM, PNG, JPEG, TGA, BMP, WebP or QOI picture as linear RGB (rows, columns, 3), from the top left.

    Formats other than EXR, HDR and PFM hold sRGB values, which are made linear unless they are ``raw`` data. Of an EXR file that holds a window
    of a picture, the window is read.
    """
    return _fanal.read_image(_options.path(path), bool(raw))


def write_image(path: _options.Path, image: ArrayLike, *, exposure: float = 0.0) -> None:
    """Writes a picture of linear RGB (rows, columns, 3), or grey (rows, columns), as the name says: ``.exr`` or ``.png``.

    A PNG file is brightened by ``exposure`` stops, clamped to [0, 1] and encoded as sRGB; an EXR file stays linear.
    The file is written beside its place and renamed: what was there before survives a failure.
    """
    name = _options.path(path)
    stops = float(exposure)
    if not -64.0 <= stops <= 64.0:
        raise OptionError(f"exposure: expected a number of stops between -64 and 64, not {exposure}")
    if stops != 0.0 and not name.lower().endswith(".png"):
        raise OptionError("exposure is for PNG files; an EXR file holds linear radiance, brighten it in the viewer")
    _fanal.write_image(name, picture(image, "image"), stops)


def error(image: ArrayLike, reference: ArrayLike) -> dict[str, float]:
    """How far a picture is from a reference, as ``fanal error`` measures it.

    Returns ``relmse``, ``relmse_trimmed`` (without the worst 0.1 % of pixels), ``mse``, ``mape``, ``mean_ratio`` and ``relmse_ldr``.
    """
    measures = json.loads(_fanal.error(picture(image, "image"), picture(reference, "reference")))
    # JSON has no infinity: the mean of a picture over that of a black reference.
    return {name: math.inf if value is None else value for name, value in measures.items()}
