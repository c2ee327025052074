"""The commands `femseal sweep` and `femseal compare`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..execution.parts import parsed_part
from ..execution.terminal import PartOption, ProgressBars, log_lines, print_table


def sweep(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Case file.")],
    keys: Annotated[
        list[str],
        typer.Argument(metavar="KEY=V1,V2 …", help="Values of dotted keys, such as material.hardness=3GPa,4GPa."),
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder of all cases.", show_default="results/CASE-sweep")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep complete cases, and go on with the others.", show_default="off")
    ] = False,
    unit: Annotated[str | None, typer.Option(help="Unit of leakage.", show_default="as in the case")] = None,
    part: PartOption = None,
    workers: Annotated[int | None, typer.Option(help="Processes.", show_default="all cores")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help='Address of a Dask scheduler, or "local".', show_default="none")
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="No progress, no log lines, no table.", show_default="off")
    ] = False,
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
        Path | None,
        typer.Option("-o", "--output", help="Folder for comparison.csv and comparison.png.", show_default="none"),
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of leakage.", show_default="as in the cases")] = None,
) -> None:
    """Compare the leakage of several finished runs in one table and one picture."""
    from ..results import compare as side_by_side
    from ..results.run_comparison import named

    found = side_by_side(named(runs), unit=unit)
    print_table(found.table())
    if output is not None:
        found.write(output)
        typer.echo(f"table and picture in {output / 'comparison.csv'} and comparison.png")
