"""Scenes."""

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from . import _fanal, _options
from ._errors import SceneWarning


class Scene:
    """A scene in memory: meshes and pictures are read, ray queries are not yet made ready. It never changes.

    Made by :func:`fanal.load`.
    """

    def __init__(self, inner: _fanal.Scene, effects: list[str]) -> None:
        self._inner = inner
        self._effects = effects

    @property
    def path(self) -> str:
        """The path that it was read from."""
        return os.fspath(self._inner.path)

    @property
    def name(self) -> str:
        """The name that it has in its file; may be empty."""
        return self._inner.name

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of its picture."""
        return self._inner.size

    @property
    def warnings(self) -> list[str]:
        """What is done in another way than it may have been meant, with file and place."""
        return self._inner.warnings

    @property
    def missing_files(self) -> list[str]:
        """Meshes and pictures that were not there and were done without (``missing="skip"``)."""
        return self._inner.missing_files

    @property
    def skipped_triangles(self) -> int:
        """Triangles that were left out because they have no area."""
        return self._inner.skipped_triangles

    def plan(self) -> list[dict[str, Any]]:
        """The effects that the scene calls for: ``name``, whether it is ``on``, and its ``cause``, as ``fanal plan --json`` has them."""
        effects: list[dict[str, Any]] = json.loads(self._inner.plan())["effects"]
        return effects

    def __repr__(self) -> str:
        columns, rows = self.size
        return f"<fanal.Scene {self.path!r}, {columns}x{rows}>"


def load(
    path: _options.Path,
    *,
    missing: str = "refuse",
    effects: str | Sequence[str] = (),
    define: Mapping[str, str | float] | None = None,
    threads: int | None = None,
) -> Scene:
    """Reads a scene: our JSON, Mitsuba XML, pbrt, glTF, or a folder that holds one of them called ``scene``.

    Its warnings are issued as :class:`fanal.SceneWarning` and kept in :attr:`Scene.warnings`. Ctrl-C is heeded at once.

    :param missing: ``"refuse"`` a scene that names files that are not there, or ``"skip"`` them.
    :param effects: effects to switch on (``"+photons"``) or off (``"-medium"``) against the plan.
    :param define: values for ``$name`` in a Mitsuba scene, in place of the scene's defaults.
    :param threads: threads to read on; all cores if not given.
    :raises fanal.NotFoundError: the scene, or a file that it names, is not there.
    :raises fanal.FormatError: a file breaks its format; the message has file and place.
    :raises fanal.OptionError: an option is not one of those above.
    """
    name = _options.path(path)
    effects = [effects] if isinstance(effects, str) else list(effects)
    given = {"missing": missing, "effects": effects, "define": define, "threads": threads}
    inner = _fanal.load(name, _options.words(_options.SCENE, given))
    for text in inner.warnings:
        warnings.warn(text, SceneWarning, stacklevel=2)
    return Scene(inner, effects)
