"""Machine code of slots, kept in a folder of the user's.

Code is called by a digest of all that it depends on; known numbers, such as tables of levels, are
handed to its function, so that scenarios which differ in nothing else share one.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import os
import stat
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.blocks import LETTERS, types_kept
from iout_marl.compiled.code import Code

#: Arrays of a compiled slot, by letter of their type, `o` that of observations.
_ARRAYS = {
    **{f"in_{letter}": letter for letter in "fi"},
    **{f"kept_{letter}": letter for letter in "fi"},
    "action": "i",
    **dict.fromkeys(("fading", "wind", "current", "arrival"), "f"),
    **{f"table_{letter}": letter for letter in LETTERS},
    **{f"out_{letter}": letter for letter in LETTERS},
    "seen": "o",
    "mask": "b",
    **{f"scratch_{letter}": letter for letter in LETTERS},
}
#: What comes before them.
_NUMBERS = ("num_envs", "width")
#: How many environments are played together, and how much memory what is kept of them may take:
#: half of what the second cache has room for.
_TILES, _TILE_BYTES = (8, 16, 32, 64, 128), 512 * 1024
#: For how long code is kept that nothing uses.
_KEPT_S = 60 * 86400.0


class Module(NamedTuple):
    """A function to be compiled: with a number of environments, and the width of columns, it takes
    the addresses of arrays.

    Attributes:
        source: the loops that it consists of.
        arrays: names of the arrays, and types of their numbers.
        scratch: of the last ones, in which it keeps numbers, the types and sizes.
        tile: how many environments it plays together.
        dtype: of its floating numbers.
    """

    source: str
    arrays: tuple[tuple[str, str], ...]
    scratch: tuple[tuple[str, int], ...]
    tile: int
    dtype: str

    def text(self) -> str:
        """It in LLVM's language."""
        from iout_marl.compiled.llvm import Function

        constants = {"TILE": self.tile}
        return Function(self.source, dict(self.arrays), _NUMBERS, constants, self.dtype).text()


def module_of(code: Code, dtype: str, observed: str) -> Module:
    """A module of what is done for a tile of environments.

    Args:
        code: what is done.
        dtype: floating type.
        observed: that of observations.
    """
    types = {letter: kind.name for letter, kind in types_kept(dtype).items()} | {"o": observed}
    sizes = [(types[letter], size) for letter, size in code.scratch.items()]
    lane_bytes = sum(np.dtype(kind).itemsize * size for kind, size in sizes)
    fitting = (lanes for lanes in _TILES if lanes * lane_bytes <= _TILE_BYTES)
    tile = max(fitting, default=_TILES[0])
    lines = [
        "for base in range(0, num_envs, TILE):",
        "    lanes = smaller(TILE, num_envs - base)",
        *("    " + line for line in code.lines),
    ]
    arrays = tuple((name, types[letter]) for name, letter in _ARRAYS.items())
    scratch = tuple((kind, size * tile) for kind, size in sizes)
    return Module("\n".join(lines) + "\n", arrays, scratch, tile, dtype)


def is_kept(module: Module) -> bool:
    """Whether a module has been compiled before."""
    path = _path(module)
    return path is not None and _read(path) is not None


def compiled_function(module: Module) -> Callable[..., None]:
    """The compiled function of a module, from the user's folder where it is kept there.

    It takes the numbers, and the addresses of all arrays but those in which it keeps numbers; they
    must be C-contiguous and of their types.
    """
    called = loaded_function(module)
    scratch = [(size, np.dtype(kind)) for kind, size in module.scratch]

    def function(num_envs: int, width: int, *addresses: int | None) -> None:
        own = [np.empty(size, dtype) for size, dtype in scratch]
        called(num_envs, width, *addresses, *map(address_of, own))

    return function


def address_of(array: npt.NDArray[Any]) -> int | None:
    """Where an array is, faster than it says so itself; None of one of nothing."""
    if not array.size:
        return None
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(cast(Any, array)))
    except TypeError:  # it may not be written
        assert array.flags.c_contiguous
        return array.ctypes.data


@functools.lru_cache(maxsize=64)
def loaded_function(module: Module) -> Callable[..., None]:
    """The function of a module, which takes the addresses of all its arrays."""
    from iout_marl.compiled import llvm

    path = _path(module)
    code = None if path is None else _read(path)
    if code is None:
        code = llvm.compiled(module.text())
        if path is not None:
            _write(path, code)
    address, engine = llvm.loaded(code)
    types = [*[ctypes.c_int64] * len(_NUMBERS), *[ctypes.c_void_p] * len(module.arrays)]
    function: Any = ctypes.CFUNCTYPE(None, *types)(address)
    function.engine = engine  # the code lives as long
    called: Callable[..., None] = function
    return called


def _path(module: Module) -> Path | None:
    """Where the code of a module is, or is to be; None where there is no folder for it."""
    import llvmlite

    from iout_marl.compiled import llvm

    folder = cache_folder()
    if folder is None:
        return None
    translator = Path(llvm.__file__).read_text(encoding="utf-8")
    parts = (repr((_NUMBERS, module)), llvmlite.__version__, llvm.processor(), translator)
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
    return folder / f"slot_{digest}.o"


def cache_folder() -> Path | None:
    """The user's folder for machine code, made if need be; None where there can be none.

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


def _read(path: Path) -> bytes | None:
    """The code that is kept in a file, if there is one that was not damaged."""
    try:
        digest, code = (read := path.read_bytes())[:32], read[32:]
        os.utime(path)  # it is used
    except OSError:
        return None
    return code if hashlib.sha256(code).digest() == digest else None


def _write(path: Path, code: bytes) -> None:
    """Keep code in a file after its digest, if it can be written."""
    with contextlib.suppress(OSError):
        handle, name = tempfile.mkstemp(prefix="slot_", suffix=".tmp", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(code).digest() + code)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        _remove_unused(path.parent)


def _remove_unused(folder: Path) -> None:
    """Remove code that nothing has used for long."""
    oldest = time.time() - _KEPT_S
    for path in folder.glob("slot_*"):
        # Another process may remove it, too.
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < oldest:
                path.unlink(missing_ok=True)
