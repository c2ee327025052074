"""The command `femseal calibrate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..base.errors import FemsealError
from ..execution.parts import parsed_part
from ..execution.terminal import (
    CasePath,
    PartOption,
    ProgressBars,
    Quiet,
    Scheduler,
    Workers,
    flag,
    log_lines,
    option,
    print_table,
)


def calibrate(
    path: CasePath,
    data: Annotated[Path, typer.Argument(metavar="DATA.csv", help="Columns of a leak test: load, branch, leakage.")],
    output: Annotated[Path | None, option("Folder.", "results/CASE-calibrated", "-o", "--output")] = None,
    hardness: Annotated[
        tuple[str, str] | None,
        option("Range of the prior, such as '2 GPa' '5 GPa'.", "a third to 3 times the case's"),
    ] = None,
    shortest_wave: Annotated[
        tuple[str, str] | None,
        option("Range of the prior, such as '4 um' '20 um'.", "8 pixels to 3 times the case's"),
    ] = None,
    factor: Annotated[
        tuple[float, float], typer.Option(help="Range of the prior of the factor between test and model.")
    ] = (0.2, 5.0),
    error: Annotated[str, typer.Option(help="Relative error of a measured leakage.")] = "10 %",
    scenes: Annotated[int, typer.Option(help="Scenes that are solved at most.")] = 40,
    resume: Annotated[bool, flag("--resume", "Take the scenes that the folder has.")] = False,
    part: PartOption = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Find hardness, shortest wave and the factor between model and test from a measured curve of leakage."""
    from .calibrating import CASE_FILE
    from .calibrating import calibrate as calibrated

    folder = output or Path("results") / f"{path.stem}-calibrated"
    terminal = sys.stderr.isatty()
    try:
        with log_lines(None, quiet or not terminal, terminal), ProgressBars(show=not quiet and terminal) as progress:
            found = calibrated(
                path,
                data,
                folder,
                hardness=hardness,
                shortest_wave=shortest_wave,
                factor=factor,
                error=error,
                scenes=scenes,
                resume=resume,
                part=parsed_part(part),
                workers=workers,
                scheduler=scheduler,
                progress=progress,
            )
    except KeyboardInterrupt:
        raise FemsealError(f"stopped; `femseal calibrate {path} {data} -o {folder} --resume` goes on") from None
    if not quiet:
        print_table(found.table())
    if part is not None and not quiet:
        typer.echo(f"part {part}: all scenes are solved; --resume without --part writes the results")
    elif not quiet:
        typer.echo(f"calibration.json, calibration.csv, calibration.png and {CASE_FILE} in {folder}")
