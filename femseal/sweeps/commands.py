"""The commands `femseal sweep` and `femseal compare`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

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


def sweep(
    path: CasePath,
    keys: Annotated[
        list[str],
        typer.Argument(metavar="KEY=V1,V2 …", help="Values of dotted keys, such as material.hardness=3GPa,4GPa."),
    ],
    output: Annotated[Path | None, option("Folder of all cases.", "results/CASE-sweep", "-o", "--output")] = None,
    resume: Annotated[bool, flag("--resume", "Keep complete cases, and go on with the others.")] = False,
    unit: Annotated[str | None, option("Unit of leakage.", "as in the case")] = None,
    part: PartOption = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Run a case with every combination of the values of some keys; one table and one picture for all of them."""
    from .sweeping import sweep as over_all
    from .variations import parsed_keys

    folder = output or Path("results") / f"{path.stem}-sweep"
    terminal = sys.stderr.isatty()
    announce = None if quiet else typer.echo
    with log_lines(None, quiet, terminal), ProgressBars(show=not quiet and terminal) as progress:
        found = over_all(
            path,
            parsed_keys(keys),
            folder,
            resume=resume,
            workers=workers,
            scheduler=scheduler,
            unit=unit,
            part=parsed_part(part),
            progress=progress,
            announce=announce,
        )
    if not quiet:
        print_table(found.table())
        done = f"part {part}: its cases are done; --resume without --part compares all"
        typer.echo(done if part else f"table and picture in {folder / 'sweep.csv'} and sweep.png")


def compare(
    runs: Annotated[list[str], typer.Argument(metavar="DIR …", help="Results folders, each as DIR or as NAME=DIR.")],
    output: Annotated[
        Path | None, option("Folder for comparison.csv and comparison.png.", "none", "-o", "--output")
    ] = None,
    unit: Annotated[str | None, option("Unit of leakage.", "as in the cases")] = None,
) -> None:
    """Compare the leakage of several finished runs in one table and one picture."""
    from ..results import compare as side_by_side
    from ..results.run_comparison import named

    found = side_by_side(named(runs), unit=unit)
    print_table(found.table())
    if output is not None:
        found.write(output)
        typer.echo(f"table and picture in {output / 'comparison.csv'} and comparison.png")
