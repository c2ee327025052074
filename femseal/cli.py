"""Define the command line: `femseal new`, `check`, `run`, `sweep`, `compare`, `design`, `report`, `export` and more.

The exit code is 0 if the command succeeded, 2 if the input cannot be used (then nothing is written), and 1 otherwise.
Libraries are imported inside the commands, so that `femseal --help` answers without delay.
"""

import errno
import gc
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from .base import FemsealError, InputError, shortened
from .commands import Replace, Resume, calibrate, compare, design, sweep
from .execution.run import reporting_compilation
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
    print_text,
    show_progress,
)
from .new_case import new

#: Largest number of warnings, and of failures, that a run prints.
_MOST_PRINTED = 5
#: Exit code of shells and typer after Ctrl-C.
_INTERRUPTED = 130
#: Whether `femseal --debug` was given, which shows the traceback of an error.
_debug = False

app = typer.Typer(
    name="femseal",
    help="Leakage of metal-to-metal seals over a loading-unloading cycle, from measured roughness.",
    epilog="Exit code: 0 done, 2 bad input (nothing is written), 1 anything else.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)


def _print_versions(is_wanted: bool) -> None:
    """Print the versions of femseal and of the libraries that it uses, and exit."""
    if not is_wanted:
        return
    from .base.package_versions import versions

    for name, number in versions().items():
        typer.echo(f"{name} {number}")
    raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_versions,
            is_eager=True,
            help="Show the versions of femseal and of the libraries that it uses.",
            show_default="off",
        ),
    ] = False,
    debug: Annotated[bool, flag("--debug", "Show the traceback of an error.")] = False,
) -> None:
    """Read the options that precede the command."""
    global _debug
    _debug = debug


app.command()(new)


@app.command()
def check(path: CasePath) -> None:
    """Check a case and print what a run will compute. Nothing is written."""
    from .case.reading import load_case

    case = load_case(path)  # before the solvers are imported, so that a fault is shown at once
    from .preparation.preparation import prepare
    from .runs.forecast import refuse_too_large
    from .runs.run_description import describe

    def report_begin(stage: str, done: int, total: int | None) -> None:
        """Print the name of a stage when it begins."""
        if not done:
            typer.echo(stage, err=True)

    with reporting_compilation(report_begin):
        study_input = prepare(case)
        for line in describe(case, study_input):
            typer.echo(line)
        refuse_too_large(case, study_input)


@app.command()
def run(
    path: CasePath,
    output: Annotated[
        Path | None, option("Results folder.", "results/CASE", "-o", "--output")
    ] = None,
    picture_format: Formats = None,
    resume: Resume = False,
    replace: Replace = False,
    part: PartOption = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    log_file: Annotated[
        Path | None, option("File to which log lines are appended.", "none")
    ] = None,
) -> None:
    """Run a case, write its results folder and print the leakage at every load.

    Progress is shown as bars in a terminal, and as log lines elsewhere. --resume continues a run that was stopped.
    """
    from .case.output_table import with_picture_formats
    from .case.reading import load_case
    from .results.file_options import read_formats

    formats = read_formats(picture_format)
    folder = output or Path("results") / path.stem
    case = load_case(path)  # before the solvers are imported, so that a fault is shown at once
    if formats:
        case = with_picture_formats(case, formats)
    from .runs import job

    try:
        with show_progress(quiet, log_file) as progress:
            results = job.run(
                case,
                folder,
                resume,
                workers,
                scheduler,
                replace_results=replace,
                progress=progress,
            )
    except KeyboardInterrupt:
        command = f"femseal run {path} -o {folder} --resume"
        raise FemsealError(f"stopped; `{command}` continues it") from None
    if quiet:
        return
    print_table(results.table())
    if results.attempts is not None:
        print_table(results.attempts_table())
    if sys.stderr.isatty():  # without a terminal, they have already appeared among the log lines
        _print_first("warning", results.warnings, folder)
        _print_first("failure", results.failures, folder)
    for text in results.verdict_lines:
        print_text(text)
    typer.echo(f"results in {folder}")


def _print_first(kind: str, texts: Sequence[str], folder: Path) -> None:
    """Print the first warnings or failures of a run, and say where the full list is."""
    for text in texts[:_MOST_PRINTED]:
        typer.echo(f"{kind}: {text}", err=True)
    n_more = len(texts) - _MOST_PRINTED
    if n_more > 0:
        typer.echo(f"{kind}: {n_more} more in {folder / 'run.log'}", err=True)


for command in (sweep, compare, design, calibrate):
    app.command()(command)


Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Results folder of a run.")]


@app.command()
def report(
    folder: Folder,
    output: Annotated[
        Path | None, option("Page to write.", "DIR/report.html", "-o", "--output")
    ] = None,
    pdf: Annotated[bool, typer.Option("--pdf", hidden=True)] = False,
) -> None:
    """Write one self-contained HTML page about a run: verdict, curves, maps, tables, error budget."""
    if pdf:
        expected = (
            "none: this option was removed; open report.html in a browser and print it to a PDF"
        )
        raise InputError("--pdf", "an option of report", expected)
    from .report import write_report

    typer.echo(write_report(folder, output))


@app.command()
def plot(
    folder: Folder,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="PICTURE …",
            help="Names of pictures, such as leakage, cells, seal, drawn.",
            show_default="all",
        ),
    ] = None,
    picture_format: Formats = None,
    step: Annotated[
        int | None,
        option(
            "Number of the load step of the maps, from 0 as in the table.",
            "highest load with leakage",
        ),
    ] = None,
    output: Annotated[
        Path | None, option("Folder of the pictures.", "DIR", "-o", "--output")
    ] = None,
) -> None:
    """Draw the pictures of a run again, in other formats or at other load steps."""
    from .report import write_pictures
    from .results import open_results
    from .results.file_options import read_formats

    formats = read_formats(picture_format) or ("png",)
    for path in write_pictures(open_results(folder), output, formats, names or (), step):
        typer.echo(path)


@app.command()
def view(
    folder: Folder,
    step: Annotated[
        int | None,
        option("Number of the load step, from 0 as in the table.", "highest load with leakage"),
    ] = None,
    field: Annotated[
        str | None, option('"gap", "contact_pressure" or "fluid_pressure".', "all three")
    ] = None,
    seal: Annotated[
        bool, flag("--seal", "Show the realisation of the seal, not the pixels of the surface.")
    ] = False,
    surface: Annotated[
        bool, flag("--surface", "Show the heights of the surface in three dimensions.")
    ] = False,
    picture: Annotated[
        Path | None, option("Picture to write (.png).", "a window opens", "-o", "--output")
    ] = None,
) -> None:
    """Open the fields of a run in a window, with inlet, outlet and a scale bar."""
    from .plots.surface_view import view_surface
    from .plots.view import view_run
    from .results import open_results

    if surface:
        view_surface(open_results(folder), picture=picture)
    else:
        view_run(open_results(folder), step=step, field=field, seal=seal, picture=picture)
    if picture is not None:
        typer.echo(picture)


@app.command()
def export(
    folder: Folder,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .npz or .vti.")],
    step: Annotated[
        int | None,
        option("Number of the load step, from 0 as in the table.", "all, in numbered files"),
    ] = None,
    field: Annotated[
        str,
        typer.Option(
            help='Field over the pixels of the surface: "gap", "contact_pressure" or "fluid_pressure".'
        ),
    ] = "gap",
    cell: Annotated[
        tuple[int, int] | None,
        option("Cell, by its numbers from 0 along x1 and x2.", "the whole surface"),
    ] = None,
    window: Annotated[
        tuple[str, str, str, str] | None,
        option(
            'Part of the surface: start and end of x1 and of x2, such as "0 mm" "1 mm" "2 mm" "3 mm".',
            "the whole surface",
        ),
    ] = None,
) -> None:
    """Write the gap, the contact pressure or the fluid pressure over the pixels to files for other programs.

    The pixel size is written as well. By default, a file is written for each load step.
    """
    from .base.quantities import to_si
    from .results import open_results

    window_in_m = None
    if window is not None:
        window_in_m = tuple(to_si(text, "m", "window") for text in window)
    results = open_results(folder)
    for path in results.export(output, step=step, field=field, cell=cell, window=window_in_m):
        typer.echo(path)


@app.command()
def surface(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="File with the heights of a face.")],
    size: Annotated[
        tuple[str, str] | None,
        option("Sides along x1 and x2, such as '1.2 mm' '0.9 mm'.", "from the file"),
    ] = None,
    spacing: Annotated[
        tuple[str, str] | None,
        option("Size of a pixel along x1 and x2, instead of the sides.", "sides / points"),
    ] = None,
    height_unit: Annotated[
        str | None, option("Unit of the heights in the file, such as um.", "from the file")
    ] = None,
    channel: Annotated[
        str, typer.Option(help="Number or name of the channel, in files with several.")
    ] = "0",
    array: Annotated[
        str | None, option("Name of the array, in an .npz with several.", "the only one")
    ] = None,
    delimiter: Annotated[
        str | None, option("Separator of the numbers in a text file.", "detected")
    ] = None,
    transpose: Annotated[bool, flag("--transpose", "Exchange x and y.")] = False,
    mask: Annotated[
        Path | None,
        option(
            "Image, text or .npy of the same size; points where it is not 0 are undefined.", "none"
        ),
    ] = None,
    file_mask: Annotated[
        bool,
        typer.Option(
            help="Points under the mask in a .gwy or .npz are undefined, or are used nevertheless."
        ),
    ] = True,
    no_data: Annotated[
        str | None,
        option(
            "Number that stands for points that were not measured, such as -9999; none: all numbers are heights.",
            "from the file, or detected",
        ),
    ] = None,
    verify_checksum: Annotated[
        bool, typer.Option(help="An .x3p with a wrong checksum is rejected, or read nevertheless.")
    ] = True,
    crop: Annotated[
        tuple[str, str, str, str] | None,
        option("Part that is used: start and end of x1 and of x2.", "the whole face"),
    ] = None,
    tip_radius: Annotated[
        str | None, option("Radius of the tip of the instrument.", "from the file")
    ] = None,
    resolution: Annotated[
        str | None,
        option(
            "Shortest wavelength that the instrument resolves (lateral period limit).",
            "from the file",
        ),
    ] = None,
    spikes: Annotated[
        float,
        typer.Option(help="Height of a spike, an isolated point, in robust standard deviations."),
    ] = 6.0,
    detrend: Annotated[
        int | None, option("Form that is removed: 0 mean, 1 tilt, 2 tilt and curvature.", "1")
    ] = None,
    shortest_wave: Annotated[
        str | None, option("Shortest wavelength that a run keeps.", "as measured")
    ] = None,
    max_undefined: Annotated[
        float, typer.Option(help="Largest fraction of undefined points that is filled in.")
    ] = 0.05,
    picture: Annotated[
        Path | None, option("Picture to write (.png, .pdf or .svg).", "none", "-o", "--output")
    ] = None,
) -> None:
    """Describe a measured face, and print how a run would prepare the face. All options are also keys of a case file.

    If a run would reject the face, it is still described and drawn, and the reason for the rejection is printed.
    """
    options = dict(locals())
    from .preparation.survey import survey

    for line in survey(**options):
        typer.echo(line)


@app.command()
def schema() -> None:
    """Print the JSON schema of the case file, for editors."""
    import json

    from .case.schema import case_schema

    typer.echo(json.dumps(case_schema(), indent=1, ensure_ascii=False))


def main() -> None:
    """Run the command line, and print an error as one line.

    SIGTERM, which batch systems send before they kill a program, stops a run as Ctrl-C does.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = app(prog_name="femseal", standalone_mode=False)
        if code == _INTERRUPTED:  # typer catches a Ctrl-C in some places
            raise KeyboardInterrupt
        if code:
            raise SystemExit(code)
        sys.stdout.flush()
    except FemsealError as error:
        _stop(error, str(error), error.exit_code)
    except KeyboardInterrupt as error:
        _stop(error, "stopped", 1)
    except MemoryError as error:
        reason = str(error) or "no more is free"
        _stop(error, f"out of memory ({reason}); `femseal check` says how much a run needs", 1)
    except Exception as error:
        if isinstance(error, OSError) and _is_output_error(error):
            _stop(error, f"standard output: cannot be written ({error.strerror})", 1)
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            _stop(error, shortened(error), 2)
        # errors in the use of the command line have their own message and exit code
        if hasattr(error, "show") and hasattr(error, "exit_code"):
            error.show()
            sys.exit(error.exit_code)
        _stop(error, f"{type(error).__name__}: {error}", 1)
    finally:
        # otherwise Python would spend half a second at exit on the garbage collection of all libraries
        gc.freeze()


def _is_output_error(error: OSError) -> bool:
    """Return whether writing to standard output caused an error, and discard all further output in this case."""
    *_, (last_frame, _line) = traceback.walk_tb(error.__traceback__)
    package = last_frame.f_globals["__name__"].partition(".")[0]
    # output is written by these packages, and by `sys.stdout.flush` in `main`
    if package not in ("click", "typer", "rich") and last_frame.f_code is not main.__code__:
        return False
    with open(os.devnull, "w") as nowhere, suppress(OSError, ValueError):
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    return True


def _stop(error: BaseException, message: str, code: int) -> NoReturn:
    """Print the message of an error and end the program with an exit code."""
    if _debug:
        traceback.print_exception(error)
    typer.echo(f"femseal: {message}", err=True)
    sys.exit(code)
