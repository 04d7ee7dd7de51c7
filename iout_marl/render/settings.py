"""matplotlib as it comes, whatever the settings of the user and the surroundings are."""

from __future__ import annotations

import importlib
import importlib.util
import logging
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from iout_marl.render.fonts import fonts_for

#: Not a matter of looks: what the user has chosen stays.
_KEPT = {"backend", "backend_fallback", "interactive"}


@contextmanager
def drawing(text: str, settings: Mapping[str, Any] | None = None) -> Iterator[Mapping[int, str]]:
    """Draw by matplotlib's own defaults and these settings; the user's are back afterwards.

    Args:
        text: all words of a user's that will be drawn.
        settings: further ones of matplotlib.

    Yields:
        for `str.translate`: what to draw instead of characters that no installed font has.
    """
    with _quiet():
        mpl = _matplotlib()
        families, replaced = fonts_for(text)
        plain = {key: value for key, value in mpl.rcParamsDefault.items() if key not in _KEPT}
        # A `$` in a name is a dollar sign and starts no formula.
        own = {"text.parse_math": False, "font.family": list(families)}
        with mpl.rc_context({**plain, **own, **(settings or {})}):
            yield replaced


def _matplotlib() -> Any:
    """The library; it takes its time to load, and most want no picture.

    MPLBACKEND may name a backend that is not installed here, as in a process that a notebook
    has started, and a matplotlibrc may have faults: matplotlib then refuses to be loaded at all.
    Pictures need neither.
    """
    if "matplotlib" in sys.modules:
        return importlib.import_module("matplotlib")
    backend = os.environ.get("MPLBACKEND")
    with _environment(MPLBACKEND=None):
        try:
            mpl = importlib.import_module("matplotlib")
        except Exception:  # whatever a fault in a matplotlibrc may raise
            found = importlib.util.find_spec("matplotlib")
            if found is None or found.origin is None:
                raise
            for name in [n for n in sys.modules if n.partition(".")[0] == "matplotlib"]:
                del sys.modules[name]  # what has been loaded of it so far
            own = Path(found.origin).parent / "mpl-data" / "matplotlibrc"
            with _environment(MATPLOTLIBRC=str(own)):
                mpl = importlib.import_module("matplotlib")
    if backend:
        with suppress(ValueError):
            mpl.rcParams["backend"] = backend
    return mpl


@contextmanager
def _environment(**variables: str | None) -> Iterator[None]:
    """Variables of the environment for a while; None for one that is not there."""
    before = {name: os.environ.pop(name, None) for name in variables}
    os.environ.update({name: value for name, value in variables.items() if value is not None})
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextmanager
def _quiet() -> Iterator[None]:
    """Without matplotlib's remarks on folders and caches, which nobody has asked for."""
    logger = logging.getLogger("matplotlib")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)
