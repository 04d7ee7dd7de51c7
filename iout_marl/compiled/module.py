"""Source that Numba compiles, as modules in a folder of the user's, where what it makes is kept.

Numba keeps machine code beside the file that a function is in, and none of what has no file. A
module is called by a digest of all that it depends on; known numbers, such as tables of levels, are
handed to its function, so that scenarios which differ in nothing else share one.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import os
import platform
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from iout_marl.compiled.code import Code

#: Arguments of a compiled slot after the number of environments, by letter of their type; those of
#: chance may lie in memory as they come.
_ARGUMENTS = {
    "in_f": "f",
    "in_i": "i",
    "kept_f": "f",
    "kept_i": "i",
    "action": "i",
    **dict.fromkeys(("fading", "wind", "current", "arrival"), "a"),
    "table_f": "t",
    "table_i": "n",
    "table_b": "l",
    "out_f": "f",
    "out_i": "i",
    "event_f": "f",
    "event_i": "i",
    "event_b": "b",
    "reward": "f",
    "terms": "f",
    "seen": "o",
    "mask": "b",
}
#: When every module was changed last, in s: Numba takes another time for another source.
_CHANGED_S = 1_000_000_000
#: For how long a module is kept that nothing uses.
_KEPT_S = 60 * 86400.0


def source_of(code: Code, dtype: str, observed: str) -> str:
    """A module with a function `slots`.

    Args:
        code: what it does for an environment.
        dtype: floating type.
        observed: that of observations.
    """
    types = {
        "f": f"{dtype}[:, ::1]",
        "i": "int64[:, ::1]",
        "b": "boolean[:, ::1]",
        "a": f"{dtype}[:, ::1]",
        "t": f"{dtype}[::1]",
        "n": "int64[::1]",
        "l": "boolean[::1]",
        "o": f"{observed}[:, ::1]",
    }
    signature = ", ".join(["int64", *(types[letter] for letter in _ARGUMENTS.values())])
    kinds = {"f": dtype, "i": "int64", "b": "bool_"}
    lines = [
        "import numpy as np",
        "from math import expm1, sqrt",
        "from numba import njit",
        "from iout_marl.compiled.operations import larger, select, smaller",
        f"real = np.{dtype}",
        f"ZERO, ONE, inf = np.{dtype}(0.0), np.{dtype}(1.0), np.{dtype}(np.inf)",
        f'@njit("void({signature})", cache=KEPT, error_model="numpy", nogil=True)',
        f"def slots(num_envs, {', '.join(_ARGUMENTS)}):",
        *(
            f"    scratch_{letter} = np.empty({size}, np.{kinds[letter]})"
            for letter, size in code.scratch.items()
            if size
        ),
        "    for env in range(num_envs):",
        *(f"        {line}" for line in code.lines),
    ]
    return "\n".join(lines) + "\n"


def is_kept(source: str) -> bool:
    """Whether a source has been compiled before."""
    path = _path(source)
    return path is not None and any(path.parent.glob(f"__pycache__/{path.stem}.slots-*.nbi"))


@functools.lru_cache(maxsize=64)
def compiled_function(source: str) -> Callable[..., None]:
    """The compiled function of a source, from the user's folder where it is kept there."""
    path = _path(source)
    if path is None or not _written(path, source.replace("KEPT", "True")):
        scope: dict[str, Any] = {"__name__": "iout_compiled"}
        exec(source.replace("KEPT", "False"), scope)
        function: Callable[..., None] = scope["slots"]
        return function
    name = f"iout_compiled_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # Numba looks for it there when it reads what it has kept
    spec.loader.exec_module(module)
    kept: Callable[..., None] = module.slots
    return kept


def _path(source: str) -> Path | None:
    """Where the module of a source is, or is to be; None where there is no folder for it."""
    import numba

    folder = cache_folder()
    if folder is None:
        return None
    operations = Path(__file__).with_name("operations.py").read_text(encoding="utf-8")
    versions = (numba.__version__, np.__version__, platform.python_version(), operations)
    digest = hashlib.sha256("\n".join([source, *versions]).encode()).hexdigest()[:32]
    return folder / f"slot_{digest}.py"


def cache_folder() -> Path | None:
    """The user's folder for compiled modules, made if need be; None where there can be none.

    It is `iout_marl/compiled` in `$XDG_CACHE_HOME`, or in `~/.cache`. Nobody else may write there:
    what is in it is executed.
    """
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
        folder = root / "iout_marl" / "compiled"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except (OSError, RuntimeError):
        return None
    if hasattr(os, "getuid") and found.st_uid != os.getuid():
        return None
    if os.name == "posix" and found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return None
    return folder if os.access(folder, os.W_OK) else None


def _written(path: Path, source: str) -> bool:
    """See to it that a module has this source: whether it has."""
    text = source.encode()
    try:
        is_new = not path.is_file() or path.read_bytes() != text
        if is_new:
            handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(text)
                os.utime(name, (time.time(), _CHANGED_S))
                Path(name).replace(path)
            except BaseException:
                Path(name).unlink(missing_ok=True)
                raise
            _remove_unused(path.parent)
        else:
            os.utime(path, (time.time(), _CHANGED_S))
    except OSError:
        return False
    return True


def _remove_unused(folder: Path) -> None:
    """Remove modules that nothing has used for long, and what was compiled of them."""
    oldest = time.time() - _KEPT_S
    for path in folder.glob("slot_*.py"):
        # Another process may remove it, too.
        with contextlib.suppress(OSError):
            if path.stat().st_atime < oldest:
                for made in folder.glob(f"__pycache__/{path.stem}.*"):
                    made.unlink(missing_ok=True)
                path.unlink(missing_ok=True)
