"""The command that takes a trained policy along."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import Imports, expanded, file, folder, take
from iout_marl.errors import InputError
from iout_marl.extras import require
from iout_marl.files import write_atomically
from iout_marl.policies.named import PRETRAINED
from iout_marl.scenario import load_scenario
from iout_marl.terminal import imports_uninterrupted, present


def export(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|pretrained",
            parser=folder,
            help=f"Folder of a trained policy, or {PRETRAINED} and a --scenario.",
        ),
    ],
    onnx: Annotated[
        Path,
        typer.Option("--onnx", metavar="FILE", parser=file, help="The ONNX file to write."),
    ],
    scenario: Annotated[
        str | None,
        typer.Option(
            "--scenario",
            metavar="SCENARIO",
            parser=expanded,
            help=f"Of {PRETRAINED}: whose actions it is to choose, with any number of nodes.",
        ),
    ] = None,
    imports: Imports = None,
) -> None:
    """Write a trained policy's most probable actions as ONNX, to be run without torch.

    Observations go in as the environment gives them, with or without a mask; onnxruntime is seen to
    find what torch does. Networks for node tables are written for any number of nodes.
    """
    if os.path.lexists(onnx):
        raise InputError(f"{onnx}: is there already, and is not written over: name another file")
    require("iout export --onnx", "onnx")
    take(imports)
    with imports_uninterrupted():
        from trainers.onnx_file import onnx_file
        from trainers.pretrained import pretrained
        from trainers.runs.folder import RunFolder
        from trainers.sizing import TABLE, with_table

    if str(run) != PRETRAINED:
        if scenario is not None:
            raise InputError(f"--scenario: is for {PRETRAINED} alone: {run} has one")
        own = RunFolder(run)
        policy, of = own.load_policy(), own.scenario()
    elif scenario is None:
        raise InputError(f"{PRETRAINED}: say for which --scenario, whose actions it is to choose")
    else:
        of = with_table(load_scenario(scenario), TABLE)
        policy = pretrained().policy_for(of)
    contents = onnx_file(policy, of)
    write_atomically(onnx, contents)
    masked = ", trained with masks" * policy.use_mask
    present(f"{onnx}: written: {of.name} ({of.hash}), {len(contents):,} bytes{masked}")
