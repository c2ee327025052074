"""Define the commands that use several runs: sweep, compare, design and calibrate."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from .base import FemsealError
from .execution.run import Progress, reporting_compilation
from .execution.terminal import (
    CasePath,
    Formats,
    PartOption,
    Quiet,
    Scheduler,
    Workers,
    flag,
    option,
    print_table,
    show_progress,
)

#: Options that several commands have.
Resume = Annotated[
    bool, flag("--resume", "Continue a run that was stopped, and keep what is complete.")
]
Replace = Annotated[bool, flag("--replace", "Replace the results of a finished run in the folder.")]
Unit = Annotated[str | None, option("Unit of leakage.", "as in the case")]


@contextmanager
def all_progress(quiet: bool, how_to_resume: str) -> Iterator[Progress]:
    """Show the progress of a command that runs several cases, including the compilation of loops at its beginning.

    how_to_resume : text that tells the user how to resume the command. The message after Ctrl-C ends with this text.
    """
    try:
        with show_progress(quiet) as progress, reporting_compilation(progress):
            yield progress
    except KeyboardInterrupt:
        raise FemsealError(f"stopped; {how_to_resume}") from None


def sweep(
    path: CasePath,
    keys: Annotated[
        list[str],
        typer.Argument(
            metavar="KEY=V1,V2 …",
            help="Values of dotted keys, such as material.hardness=3GPa,4GPa.",
        ),
    ],
    output: Annotated[
        Path | None, option("Folder of all cases.", "results/CASE-sweep", "-o", "--output")
    ] = None,
    resume: Resume = False,
    replace: Replace = False,
    unit: Unit = None,
    picture_format: Formats = None,
    part: PartOption = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Run a case with every combination of the values of some keys, and compare the runs in a table and a picture."""
    from .results.file_options import read_formats
    from .sweeps.sweeping import parsed_keys
    from .sweeps.sweeping import sweep as run_sweep

    formats = read_formats(picture_format)
    folder = output or Path("results") / f"{path.stem}-sweep"
    announce = None if quiet else typer.echo
    with all_progress(quiet, "the same command with --resume continues it") as progress:
        comparison = run_sweep(
            path,
            parsed_keys(keys),
            folder,
            resume=resume,
            replace_results=replace,
            workers=workers,
            scheduler=scheduler,
            unit=unit,
            formats=formats,
            progress=progress,
            announce=announce,
        )
    if not quiet:
        print_table(comparison.table())
        typer.echo(f"table and picture in {folder / 'sweep.csv'} and {_files('sweep', formats)}")


def compare(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="DIR …", help="Results folders, each as DIR or as NAME=DIR."),
    ],
    output: Annotated[
        Path | None,
        option("Folder for comparison.csv and the picture.", "none", "-o", "--output"),
    ] = None,
    unit: Unit = None,
    picture_format: Formats = None,
) -> None:
    """Compare the leakage of several finished runs in one table and one picture."""
    from .results import compare as compare_runs
    from .results.file_options import read_formats
    from .results.run_comparison import named

    formats = read_formats(picture_format) or ("png",)
    comparison = compare_runs(named(runs), unit=unit)
    print_table(comparison.table())
    if output is not None:
        comparison.write(output, formats=formats)
        pictures = _files("comparison", formats)
        typer.echo(f"table and picture in {output / 'comparison.csv'} and {pictures}")


def _files(stem: str, formats: Sequence[str]) -> str:
    """Name the files of a picture in several formats, such as "sweep.svg and sweep.pdf"."""
    return " and ".join(f"{stem}.{form}" for form in formats or ("png",))


def design(
    path: Annotated[
        Path, typer.Argument(metavar="CASE|DIR", help="Case file, or results folder of a run.")
    ],
    classes: Annotated[
        list[str] | None,
        typer.Option(
            "--class",
            help="Leakage class, such as L0.01, 'TA Luft', 'ISO 5208 C', or '5 mL/min'; can be given several times.",
            show_default="those of the case, else L0.01, L0.1, L1",
        ),
    ] = None,
    probability: Annotated[
        float,
        typer.Option(
            help="Fraction of the realisations; the pressure that this fraction needs is given as well."
        ),
    ] = 0.95,
    assembly: Annotated[
        list[str] | None,
        option(
            "Further load in assembly Q_A, such as '300 MPa' or '60 kN'; can be given several times.",
            "none",
        ),
    ] = None,
    diameter: Annotated[
        str | None, option("Nominal diameter of the valve, seat or stem.", "from the case")
    ] = None,
    output: Annotated[
        Path | None,
        option("Folder of results and answer.", "results/CASE, or DIR", "-o", "--output"),
    ] = None,
    solve: Annotated[
        bool,
        typer.Option(
            "--solve/--no-solve",
            help="Find the sensitivity to hardness by solving a case again.",
        ),
    ] = True,
    replace: Replace = False,
    workers: Workers = None,
    quiet: Quiet = False,
) -> None:
    """Find the pressures that a seal needs in assembly (Qmin) and in service (QSmin) to meet leakage classes.

    A case is run, unless its results folder already contains the complete results. If a folder is given instead of a
    case, its results are used, and nothing is run.
    """
    from .designs.answer import design as find_answer

    folder = output or (path if path.is_dir() else Path("results") / path.stem)
    with all_progress(
        quiet, "the same command continues it, and keeps what is complete"
    ) as progress:
        answer = find_answer(
            path,
            folder,
            classes=classes or (),
            probability=probability,
            assembly=assembly or (),
            nominal_diameter=diameter,
            solve=solve,
            replace_results=replace,
            workers=workers,
            progress=progress,
        )
    if not quiet:
        print_table(answer.table())
        typer.echo(f"design.csv, design.json and design.png in {folder}")


def calibrate(
    path: CasePath,
    data: Annotated[
        Path,
        typer.Argument(metavar="DATA.csv", help="Columns of a leak test: load, branch, leakage."),
    ],
    output: Annotated[
        Path | None, option("Folder of the results.", "results/CASE-calibrated", "-o", "--output")
    ] = None,
    hardness: Annotated[
        tuple[str, str] | None,
        option(
            "Range of the hardness, such as '2 GPa' '5 GPa'.", "1/3 to 3 times that of the case"
        ),
    ] = None,
    shortest_wave: Annotated[
        tuple[str, str] | None,
        option(
            "Range of the shortest wave, such as '4 um' '20 um'.",
            "8 pixels to 3 times that of the case",
        ),
    ] = None,
    factor: Annotated[
        tuple[float, float],
        typer.Option(help="Range of the factor between test and model."),
    ] = (0.2, 5.0),
    error: Annotated[str, typer.Option(help="Relative error of a measured leakage.")] = "10 %",
    scenes: Annotated[int, typer.Option(help="Largest number of simulations.")] = 40,
    resume: Resume = False,
    replace: Replace = False,
    part: PartOption = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Estimate the hardness, the shortest wave and the ratio of measured to computed leakage from a leak test."""
    from .calibration.calibrating import CASE_FILE
    from .calibration.calibrating import calibrate as run_calibration

    folder = output or Path("results") / f"{path.stem}-calibrated"
    how_to_resume = f"`femseal calibrate {path} {data} -o {folder} --resume` continues it"
    with all_progress(quiet, how_to_resume) as progress:
        calibration = run_calibration(
            path,
            data,
            folder,
            hardness=hardness,
            shortest_wave=shortest_wave,
            factor=factor,
            error=error,
            scenes=scenes,
            resume=resume,
            replace_results=replace,
            workers=workers,
            scheduler=scheduler,
            progress=progress,
        )
    if not quiet:
        print_table(calibration.table())
        written = f"calibration.json, calibration.csv, calibration.png and {CASE_FILE} in {folder}"
        typer.echo(written)
