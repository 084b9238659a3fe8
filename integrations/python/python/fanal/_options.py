"""Keyword arguments as words of the command line, which has the one set of names, defaults and limits."""

import operator
import os
from collections.abc import Callable, Iterable
from typing import Any

Path = str | os.PathLike[str]
"""A path."""

Word = Callable[[Any], str | list[str] | None]
"""Makes the value of an option a word; none where the option is left out, several where it is given several times."""


def whole(value: Any) -> str:
    if isinstance(value, bool):
        raise TypeError
    return str(operator.index(value))


def real(value: Any) -> str:
    if isinstance(value, (str, bytes)):
        raise TypeError
    return repr(float(value))


def text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def path(value: Any) -> str:
    name = os.fspath(value)
    if not isinstance(name, str):
        raise TypeError
    return name


def switch(value: Any) -> str:
    if not isinstance(value, bool):
        raise TypeError
    return "on" if value else "off"


def joined(between: str, item: Word, count: int | None = None) -> Word:
    """A sequence of items, `count` of them if that is given. A single string stands for itself."""

    def word(value: Any) -> str | list[str] | None:
        if isinstance(value, str):
            if count is not None:
                raise TypeError
            return item(value)
        values = list(value)
        if count is not None and len(values) != count:
            raise TypeError
        return between.join(str(item(each)) for each in values) if values else None

    return word


def shown(value: Any) -> str:
    """A number, string or truth value as scene files write it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value
    try:
        return whole(value)
    except TypeError:
        return real(value)


def named(value: Any) -> list[str]:
    """A mapping of names, a word for each."""
    return [f"{text(name)}={shown(each)}" for name, each in dict(value).items()]


SCENE: dict[str, tuple[str, Word, str]] = {
    "missing": ("missing", text, 'the string "refuse" or "skip"'),
    "effects": ("effects", joined(",", text), 'strings such as "+photons" or "-medium"'),
    "define": ("define", named, "a mapping of names to numbers, strings or truth values"),
    "threads": ("threads", whole, "a whole number"),
}
"""Options of scenes: name on the command line, how its word is made, what is expected."""

RENDER: dict[str, tuple[str, Word, str]] = {
    "spp": ("spp", whole, "a whole number"),
    "time": ("time", real, "a number of seconds"),
    "target_error": ("target-error", real, "a number"),
    "guide": ("guide", text, "a string"),
    "seed": ("seed", whole, "a whole number"),
    "size": ("size", joined("x", whole, 2), "two whole numbers, columns and rows"),
    "max_depth": ("max-depth", whole, "a whole number"),
    "crop": ("crop", joined(",", whole, 4), "four whole numbers: column, row, columns and rows"),
    "aovs": ("aov", joined(",", text), "names of layers"),
    "threads": ("threads", whole, "a whole number"),
    "model": ("model", path, "a path"),
    "load_guide": ("load-guide", path, "a path or a Guide"),
    "adaptive": ("adaptive", switch, "True or False"),
    "fireflies": ("fireflies", text, "a string"),
    "kappa": ("kappa", real, "a number"),
    "pixel_filter": ("pixel-filter", text, "a string"),
    "light_sampling": ("light-sampling", switch, "True or False"),
    "roulette": ("roulette", text, "a string"),
    "guide_memory": ("guide-memory", whole, "a whole number of megabytes"),
    "backend": ("backend", text, "a string"),
    "checkpoint": ("checkpoint", path, "a path"),
    "every": ("every", real, "a number of seconds"),
    "resume": ("resume", path, "a path"),
}
"""Options of renders, likewise."""


def words(known: dict[str, tuple[str, Word, str]], given: dict[str, Any]) -> list[str]:
    """The words of all options that were given; those that are None were not."""
    return [word for name, value in given.items() for word in _words(name, known[name], value)]


def _words(name: str, known: tuple[str, Word, str], value: Any) -> Iterable[str]:
    option, make, expected = known
    if value is None:
        return []
    try:
        made = make(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name}: expected {expected}, not {_shown(value)}") from None
    words = made if isinstance(made, list) else [made]
    return [f"--{option}={word}" for word in words if word is not None]


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else f"a value of type {type(value).__name__}"
