"""The command `femseal design`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..base.errors import FemsealError
from ..execution.terminal import ProgressBars, Quiet, Workers, log_lines, option, print_table


def design(
    path: Annotated[Path, typer.Argument(metavar="CASE|DIR", help="Case file, or results folder of a run.")],
    classes: Annotated[
        list[str] | None,
        typer.Option(
            "--class",
            help="Leakage class, such as L0.01, 'TA Luft', 'ISO 5208 C', or '5 mL/min'; may be given several times.",
            show_default="those of the case, else L0.01, L0.1, L1",
        ),
    ] = None,
    probability: Annotated[float, typer.Option(help="Fraction of the seals that is to keep the class.")] = 0.95,
    assembly: Annotated[
        list[str] | None,
        option(
            "Pressure in assembly Q_A besides those of the case, such as '300 MPa'; may be given several times.", "none"
        ),
    ] = None,
    diameter: Annotated[str | None, option("Nominal diameter, for ISO 5208.", "that of the case")] = None,
    output: Annotated[
        Path | None, option("Folder of results and answer.", "results/CASE, or DIR", "-o", "--output")
    ] = None,
    solve: Annotated[
        bool, typer.Option("--solve/--no-solve", help="Solve a case again with another hardness and turned by 90°.")
    ] = True,
    sobol: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=LOW,HIGH",
            help="Instead, Sobol indices of the leakage over ranges of keys, such as material.hardness=2GPa,4GPa.",
            show_default="none",
        ),
    ] = None,
    workers: Workers = None,
    quiet: Quiet = False,
) -> None:
    """Say what pressure a seal needs in assembly (Qmin) and in service (QSmin) for leakage classes.

    A case is run unless its folder holds its complete results; a results folder is taken as it is.
    """
    if sobol:
        _sobol(path, sobol, output, workers, quiet)
        return
    from .answer import design as answer_of

    folder = output or (path if path.is_dir() else Path("results") / path.stem)
    terminal = sys.stderr.isatty()
    try:
        with log_lines(None, quiet, terminal), ProgressBars(show=not quiet and terminal) as progress:
            answer = answer_of(
                path,
                folder,
                classes=classes or (),
                probability=probability,
                assembly=assembly or (),
                nominal_diameter=diameter,
                solve=solve,
                workers=workers,
                progress=progress,
            )
    except KeyboardInterrupt:
        raise FemsealError("stopped; the same command goes on with what is complete") from None
    if not quiet:
        print_table(answer.table())
        written = [f"design.{kind}" for kind in ("csv", "json", "png")]
        written += ["report.html"] if (folder / "report.html").is_file() else []
        typer.echo(f"{', '.join(written[:-1])} and {written[-1]} in {folder}")


def _sobol(path: Path, ranges: list[str], output: Path | None, workers: int | None, quiet: bool) -> None:
    """Sobol indices of a case file, on the terminal and in a folder."""
    from ..sweeps.variations import parsed_keys
    from .sobol import sobol as indices_of

    folder = output or Path("results") / f"{path.stem}-sobol"
    terminal = sys.stderr.isatty()
    with log_lines(None, quiet or not terminal, terminal), ProgressBars(show=not quiet and terminal) as progress:
        found = indices_of(path, parsed_keys(ranges), folder, workers=workers, progress=progress)
    if not quiet:
        print_table(found.table())
        typer.echo(f"sobol.csv and sobol.json in {folder}")
