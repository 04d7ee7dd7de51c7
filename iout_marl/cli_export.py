"""The command that takes a trained policy along."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import Imports, file, folder, take
from iout_marl.errors import InputError
from iout_marl.extras import require
from iout_marl.files import write_atomically
from iout_marl.terminal import imports_uninterrupted, present


def export(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", parser=folder, help="Folder of a trained policy.")
    ],
    onnx: Annotated[
        Path,
        typer.Option("--onnx", metavar="FILE", parser=file, help="The ONNX file to write."),
    ],
    imports: Imports = None,
) -> None:
    """Write a trained policy's most probable actions as ONNX, to be run without torch.

    Observations go in as the environment gives them, with or without a mask; onnxruntime is seen to
    find what torch does.
    """
    if os.path.lexists(onnx):
        raise InputError(f"{onnx}: is there already, and is not written over: name another file")
    require("iout export --onnx", "onnx")
    take(imports)
    with imports_uninterrupted():
        from trainers.onnx_file import onnx_file
        from trainers.runs.folder import RunFolder

    own = RunFolder(run)
    policy, scenario = own.load_policy(), own.scenario()
    contents = onnx_file(policy, scenario)
    write_atomically(onnx, contents)
    masked = ", trained with masks" * policy.use_mask
    present(f"{onnx}: written: {scenario.name} ({scenario.hash}), {len(contents):,} bytes{masked}")
