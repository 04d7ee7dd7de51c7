"""Python code from outside, which a user names on the command line or in Python: never a file.

Modules are looked for wherever Python looks, and last in the working folder: a folder in it with
the name of a package, `trainers` say, does not stand in for that package.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import sys
import traceback
import warnings
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from iout_marl.errors import InputError, did_you_mean
from iout_marl.files import note_input

#: What the names of Python files end in.
_SUFFIX = ".py"
_FOLDER = "is a folder, not a module or a file"
#: The folder of this package.
_PACKAGE = str(Path(__file__).parent) + os.sep
#: The entry point by which an installed package brings parts: the name of a module.
ENTRY_POINT = "iout_marl.parts"
#: What was brought in, as others can be told to import it too: by the name of its module.
_brought: dict[str, str] = {}


def bring_in(*sources: str) -> None:
    """Import modules for the parts and metrics that they register.

    Args:
        sources: names of modules, or paths of files.

    Raises:
        InputError: as `import_module`.
    """
    for source in sources:
        module = import_module(source)
        is_file = source.endswith(_SUFFIX) or os.sep in source
        _brought[module.__name__] = str(Path(source).expanduser().resolve()) if is_file else source


def brought_in() -> tuple[str, ...]:
    """What was brought in: what other processes of the same work have to import."""
    return tuple(_brought.values())


def import_words() -> list[str]:
    """`--import` and the name, of all that was brought in."""
    return [word for source in brought_in() for word in ("--import", source)]


def source_of(module: str) -> str:
    """What to import for a module's parts: its name, or the path of its file."""
    return _brought.get(module, module)


@cache
def load_entry_points() -> None:
    """Import what installed packages bring, once; what fails is said in a warning."""
    for point in metadata.entry_points(group=ENTRY_POINT):
        try:
            importlib.import_module(point.module)
        except Exception as error:  # a package may do anything
            whose = f"{point.dist.name}: " if point.dist else ""
            warnings.warn(
                f"{whose}entry point {ENTRY_POINT}: {_failure(point.module, error)}",
                RuntimeWarning,
                stacklevel=2,
            )


def import_named(name: str) -> Any:
    """What a name in a module or in a file stands for.

    Args:
        name: `MODULE:NAME` or `FILE.py:NAME`; of what is inside a class, `NAME.NAME`.

    Raises:
        InputError: there is no such module, file or name, or importing it has failed.
    """
    place, _, attribute = name.rpartition(":")
    words = attribute.split(".")
    if not place.strip() or not all(map(str.isidentifier, words)):
        raise InputError(f"{name!r}: must be of the form MODULE:NAME or FILE.py:NAME")
    found: Any = import_module(place)
    origin = getattr(found, "__file__", None)
    for word in words:
        try:
            found = getattr(found, word)
        except AttributeError:
            known = [
                each
                for each in dir(found)
                if not each.startswith("_")
                and not isinstance(getattr(found, each, None), ModuleType)
            ]
            hint = did_you_mean(word, known, or_list=False)
            of = f", which is {origin}," if origin and not place.endswith(_SUFFIX) else ""
            raise InputError(f"{place}{of} has no {word!r}{hint}") from None
    return found


def import_module(name: str) -> ModuleType:
    """A module by its name, or by the path of its file; each is run once.

    Raises:
        InputError: there is none, or running it has failed.
    """
    from iout_marl.registration import register  # takes Gymnasium and PettingZoo along

    register()  # which the command line leaves to those that may make environments by name
    if name.endswith(_SUFFIX) or os.sep in name:
        return _import_file(name)
    _look_last_in(Path())
    importlib.invalidate_caches()
    try:
        found = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and (name == error.name or name.startswith(f"{error.name}.")):
            raise InputError(f"there is no module {name!r}{_near_files(name)}") from None
        raise InputError(_failure(name, error)) from None
    except (Exception, SystemExit) as error:  # a module may do anything
        raise InputError(_failure(name, error)) from None
    if getattr(found, "__file__", None) is None and hasattr(found, "__path__"):
        raise InputError(f"{name}: {_FOLDER}")  # without code: it is no package
    return found


def _import_file(name: str) -> ModuleType:
    path = Path(name).expanduser()
    if not os.path.isfile(path):  # noqa: PTH113 (never raises)
        is_folder = os.path.isdir(path)  # noqa: PTH112
        raise InputError(f"{name}: {_FOLDER}" if is_folder else f"there is no file {name!r}")
    path = path.resolve()
    note_input(path)
    # What a file defines may ask for its module by name, as data classes do.
    own_name = f"{path.stem}_{hashlib.sha256(os.fsencode(path)).hexdigest()[:8]}"
    if own_name in sys.modules:
        return sys.modules[own_name]
    spec = importlib.util.spec_from_file_location(own_name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{name}: is no Python file: its name must end in {_SUFFIX}")
    _look_last_in(path.parent)
    module = importlib.util.module_from_spec(spec)
    sys.modules[own_name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[own_name]
        if not isinstance(error, Exception | SystemExit):
            raise
        raise InputError(_failure(name, error)) from None
    return module


def _look_last_in(folder: Path) -> None:
    """Let modules be looked for in a folder, after all else."""
    with suppress(OSError):  # a working folder that is gone holds none
        place = str(folder.resolve())
        if place not in map(os.path.abspath, sys.path):
            sys.path.append(place)


def _near_files(name: str) -> str:
    try:
        near = [path.stem for path in Path().glob(f"*{_SUFFIX}")]
    except OSError:
        near = []
    return did_you_mean(name, near, or_list=False)


def _failure(name: str, error: BaseException) -> str:
    """Where importing a module has failed, and why."""
    if isinstance(error, SyntaxError):
        return f"{name} cannot be imported: {error.filename}:{error.lineno}: {error.msg}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename != __file__ and not frame.filename.startswith("<")
    ]
    frames = [frame for frame in frames if os.sep + "importlib" + os.sep not in frame.filename]
    # What its line asks of this package is its own matter.
    frames = [frame for frame in frames if not frame.filename.startswith(_PACKAGE)] or frames
    where = f"{frames[-1].filename}:{frames[-1].lineno}: " if frames else ""
    kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    return f"{name} cannot be imported: {where}{kind}{error}"
