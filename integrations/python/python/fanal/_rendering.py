"""Rendering."""

import json
import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from . import _fanal, _options
from ._arrays import Floats
from ._errors import CheckpointWarning, OptionError
from ._guide import Guide
from ._scene import Scene, load


class Progress(NamedTuple):
    """What a progress callback is told."""

    fraction: float | None
    """Part of the work that is done, 0 to 1; None where it is not known, as with ``target_error``."""
    samples: int
    """Camera and light paths so far."""
    seconds: float
    """Seconds since the call."""
    message: str
    """What is being done, such as "learning, iteration 6"."""
    reached: str
    """The result so far, such as "131 spp"."""


@dataclass(frozen=True, repr=False)
class Result:
    """What a render leaves."""

    image: Floats
    """Linear RGB (rows, columns, 3), from the top left."""
    aovs: dict[str, Floats] = field(default_factory=dict)
    """Layers by name, of shape (rows, columns, 3) or, for depth, samples and guiding, (rows, columns). ``crypto-object`` and
    ``crypto-material`` are three layers each, ``crypto_object00`` to ``crypto_object02`` and so on, of shape (rows, columns, 4): two ids
    (Cryptomatte's hashes of names), each before the part of the pixel that it covers. With ``fireflies="reweight"`` there is ``fireflies``,
    the light that was taken out of ``image``."""
    statistics: dict[str, Any] = field(default_factory=dict)
    """Where time and samples went: what ``fanal render --stats`` writes."""
    guide: Guide | None = None
    """The guide of the final pass; None where nothing was guided or guiding was given up."""
    interrupted: bool = False
    """Whether the progress callback ended the render early by returning False."""
    size: tuple[int, int] = (0, 0)
    """Columns and rows of the whole picture."""
    window: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Part of it that ``image`` shows: columns to the left of it, rows above it, its columns and rows."""

    def __repr__(self) -> str:
        rows, columns, _ = self.image.shape
        layers = ", ".join(["image", *self.aovs])
        ended = ", interrupted" if self.interrupted else ""
        return f"<fanal.Result {columns}x{rows}, {layers}{ended}>"


def render_full(
    scene: Scene | _options.Path,
    *,
    spp: int | None = None,
    time: float | None = None,
    target_error: float | None = None,
    guide: str = "neural",
    seed: int = 0,
    size: Sequence[int] | None = None,
    max_depth: int | None = None,
    crop: Sequence[int] | None = None,
    aovs: str | Sequence[str] = (),
    threads: int | None = None,
    progress: Callable[[Progress], object] | None = None,
    model: _options.Path | None = None,
    load_guide: _options.Path | Guide | None = None,
    adaptive: bool | None = None,
    fireflies: str | None = None,
    kappa: float | None = None,
    pixel_filter: str | None = None,
    light_sampling: bool | None = None,
    roulette: str | None = None,
    guide_memory: int | None = None,
    backend: str | None = None,
    checkpoint: _options.Path | None = None,
    every: float | None = None,
    resume: _options.Path | None = None,
) -> Result:
    """Renders a scene, and returns the picture with all that belongs to it.

    Options are those of ``fanal render``; what is not given is as there. The same scene, options, seed and ``spp`` give the same
    picture, bit for bit, with any number of threads, and the one that the program writes.

    :param scene: a :class:`Scene`, or the path of one, which :func:`load` reads.
    :param spp: samples per pixel, camera and light paths together; the scene's if no other end is given.
    :param time: seconds for all of the call.
    :param target_error: relMSE to reach, as the render itself estimates it. Only one of the three can be given.
    :param guide: ``"none"``, ``"jensen"``, ``"ppg"``, ``"ppg2"``, ``"vmf"``, ``"gmm"``, ``"paths"``, ``"variance"``, ``"nilsson"``,
        ``"hybrid"``, ``"gaussian"``, ``"neural"`` or ``"zhu"``.
    :param size: columns and rows; the scene's if not given.
    :param max_depth: 1 for emission only, 2 for direct light, and so on.
    :param crop: part of the picture to render: column, row, columns and rows.
    :param aovs: layers: ``albedo``, ``normal``, ``position``, ``depth``, ``samples``, ``variance``, ``guiding``, ``crypto-object``,
        ``crypto-material``, or ``all``.
    :param threads: all cores if not given.
    :param progress: called with a :class:`Progress` about four times per second and at the end. Returning False ends the render early
        with the picture so far; an exception ends it too, and is raised here.
    :param model: folder of a network; the one inside the package if not given.
    :param load_guide: a guide, or the path of one, to render with. Nothing is learned then.
    :param adaptive: whether noisy pixels get more samples; with ``time`` they do if not given.
    :param fireflies: ``"keep"``, or ``"reweight"``: the light of samples so bright and so rare that they stand alone is taken out of the picture.
    :param kappa: samples of like brightness that ``"reweight"`` asks for; more take more light out.
    :param pixel_filter: ``"box"``, ``"tent"``, ``"gaussian"`` or ``"blackman-harris"``; the scene's if not given.
    :param light_sampling: next event estimation; on if not given, but off for the guide ``"zhu"``.
    :param roulette: ``"off"``, ``"throughput"`` or ``"window"``.
    :param guide_memory: ceiling of the guide in MB.
    :param backend: who executes the network, ``"embedded"`` or ``"onnx"``.
    :param checkpoint: file to keep the state in, written when the render is interrupted and from time to time. One that is there already
        is refused, unless it is the one to ``resume``.
    :param every: seconds between two checkpoints; 30 if not given.
    :param resume: checkpoint to go on from, which is kept up to date unless ``checkpoint`` is another file.

    Ctrl-C ends the render within about a second and raises KeyboardInterrupt; its picture is lost, a checkpoint is not. To keep the
    picture, handle the signal and return False from ``progress``. Other threads of Python run meanwhile.

    :raises fanal.Error: or one of its subclasses, see there.
    :raises TypeError: an argument is of the wrong type.
    """
    given = {name: value for name, value in locals().items() if name in _options.RENDER}
    if guide is None:
        raise TypeError('guide: expected a string; "none" renders without a guide')
    tell = None if progress is None else _telling(progress)
    if isinstance(load_guide, Guide):
        if checkpoint is not None or resume is not None:
            raise OptionError("a checkpoint belongs to a guide in a file: save the guide and give its path")
        given["load_guide"] = None
    words = _options.words(_options.RENDER, given)
    begun = monotonic()
    if not isinstance(scene, Scene):
        scene = load(scene, threads=threads)
    reading = monotonic() - begun
    words += [f"--effects={effect}" for effect in scene._effects]
    keeps = guide != "none" and load_guide is None
    with _file(load_guide) as guide_words:
        made = _fanal.render(scene._inner, words + guide_words, tell, keeps, reading)
    if made["unkept"] is not None:
        warnings.warn(f"no checkpoint could be written: {made['unkept']}", CheckpointWarning, stacklevel=2)
    return Result(
        image=made["image"],
        aovs=_layers(made["channels"]),
        statistics=json.loads(made["statistics"]),
        guide=None if made["guide"] is None else Guide(made["guide"]),
        interrupted=made["interrupted"],
        size=made["size"],
        window=made["window"],
    )


def render(
    scene: Scene | _options.Path,
    *,
    spp: int | None = None,
    time: float | None = None,
    target_error: float | None = None,
    guide: str = "neural",
    seed: int = 0,
    size: Sequence[int] | None = None,
    max_depth: int | None = None,
    crop: Sequence[int] | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], object] | None = None,
    model: _options.Path | None = None,
    load_guide: _options.Path | Guide | None = None,
    adaptive: bool | None = None,
    **more: Any,
) -> Floats:
    """Renders a scene and returns the picture alone: linear RGB (rows, columns, 3) as float32, from the top left.

    All options are those of :func:`render_full`, which also returns layers, statistics and the guide.
    """
    given = {name: value for name, value in locals().items() if name != "more"}
    return render_full(**given, **more).image


@contextmanager
def _file(guide: object) -> Iterator[list[str]]:
    """The option that names a temporary file with a guide that is given in memory."""
    if not isinstance(guide, Guide):
        yield []
        return
    with tempfile.TemporaryDirectory(prefix="fanal-") as folder:
        path = os.path.join(folder, "given.guide")
        guide.save(path)
        yield [f"--load-guide={path}"]


def _telling(progress: Callable[[Progress], object]) -> Callable[..., object]:
    if not callable(progress):
        raise TypeError(f"progress: expected a function, not {progress!r}")
    return lambda *told: progress(Progress(*told))


def _layers(channels: list[tuple[str, Floats]]) -> dict[str, Floats]:
    """Channels such as ``normal.X`` stacked to layers."""
    parts: dict[str, list[Floats]] = {}
    for name, values in channels:
        parts.setdefault(name.partition(".")[0], []).append(values)
    return {name: part[0] if len(part) == 1 else np.stack(part, axis=-1) for name, part in parts.items()}
