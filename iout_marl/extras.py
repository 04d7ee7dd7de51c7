"""What an installation may lack: packages that only an extra of `iout-marl` brings."""

from __future__ import annotations

from importlib.util import find_spec

from iout_marl.errors import InputError

#: The modules that are imported of each extra, by its name in `pyproject.toml`.
EXTRAS = {
    "cluster": ("distributed",),
    "compiled": ("llvmlite",),
    "currents": ("h5netcdf", "h5py", "pyproj", "xarray"),
    "emissions": ("codecarbon",),
    "film": ("imageio_ffmpeg", "matplotlib", "moviepy"),
    "mission": ("pyproj",),
    "onnx": ("onnx", "onnxruntime", "onnxscript"),
    "report": ("jinja2", "matplotlib", "plotly"),
    "sb3": ("stable_baselines3",),
}


def require(what: str, extra: str, *modules: str) -> None:
    """Refuse what needs packages that are not installed, before it has done anything.

    Args:
        what: the command, option, function or argument that needs them.
        extra: the extra that brings them.
        modules: those of the extra that are needed; all where none is given.

    Raises:
        InputError: one line that says which package is missing, and how to install it.
    """
    if lacking := missing(extra, *modules):
        raise InputError(f"{what} needs {lacking}: {how_to_install(extra)}")


def missing(extra: str, *modules: str) -> str:
    """The first of an extra's modules that is not installed; "" where all of them are."""
    return next((name for name in modules or EXTRAS[extra] if find_spec(name) is None), "")


def how_to_install(extra: str) -> str:
    """The command that installs an extra."""
    return f"pip install -e '.[{extra}]' in the clone"
