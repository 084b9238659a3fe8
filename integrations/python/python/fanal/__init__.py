"""fanal: a physically based renderer that learns where light comes from.

>>> import fanal
>>> image = fanal.render("scenes/door-ajar", spp=64)
>>> fanal.write_image("door.png", image)

:func:`render` returns the picture; :func:`render_full` also layers, statistics and the guide. Messages of errors name options as
these functions do.
"""

from ._errors import CheckpointWarning, Error, FileError, FormatError, NotFoundError, OptionError, SceneWarning
from ._fanal import __version__
from ._guide import Guide, load_guide
from ._pictures import error, read_image, write_image
from ._rendering import Progress, Result, render, render_full
from ._scene import Scene, load

__all__ = [
    "CheckpointWarning",
    "Error",
    "FileError",
    "FormatError",
    "Guide",
    "NotFoundError",
    "OptionError",
    "Progress",
    "Result",
    "Scene",
    "SceneWarning",
    "__version__",
    "error",
    "load",
    "load_guide",
    "read_image",
    "render",
    "render_full",
    "write_image",
]
