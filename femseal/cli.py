"""Command line: `femseal new`, `check`, `run`, `sweep`, `compare`, `design`, `report`, `export` and more.

Exit code 0 done, 2 bad input (nothing written), 1 anything else.
"""

import errno
import gc
import os
import signal
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from .base import FemsealError, InputError, shortened, writing
from .commands import Replace, Resume, calibrate, compare, design, sweep
from .execution.run import reporting_compilation
from .execution.terminal import (
    CasePath,
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

app = typer.Typer(
    name="femseal",
    help="Leakage of metal-to-metal seals over a loading-unloading cycle, from measured roughness.",
    epilog="Exit code: 0 done, 2 bad input (nothing is written), 1 anything else.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)


def _version(value: bool) -> None:
    if value:
        from .base.machine import versions

        for name, number in versions().items():
            typer.echo(f"{name} {number}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_version,
            is_eager=True,
            help="Show the versions of femseal and its stack.",
            show_default="off",
        ),
    ] = False,
    debug: Annotated[bool, flag("--debug", "Show the traceback of an error.")] = False,
) -> None:
    """Read the options before the command; `main` decides the exit code of an error."""
    global _debug
    _debug = debug


@app.command()
def new(
    path: Annotated[Path, typer.Argument(help="Case file to write.")] = Path("case.toml"),
    face: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="FILE", help="Measured face that the case is of.", show_default="none"
        ),
    ] = None,
    spacing: Annotated[
        tuple[str, str] | None,
        option("Pixel of the face, such as '2 um' '2 um'.", "as the file says"),
    ] = None,
    height_unit: Annotated[
        str | None, option("Unit of its heights, such as um.", "as the file says")
    ] = None,
) -> None:
    """Write a commented case file to start from, also of a measured face."""
    if path.exists():
        raise InputError("path", f"'{path}', which exists", "a new file")
    if face is None:
        from .case.case import Case
        from .case.template import case_template

        text = case_template(Case)
    else:
        from .preparation.survey import case_of_face

        text = case_of_face(face, path.absolute().parent, spacing=spacing, height_unit=height_unit)
    with writing("path", path):
        path.write_text(text, encoding="utf-8")
    typer.echo(f"{path} written; edit it, then: femseal run {path}")


@app.command()
def check(path: CasePath) -> None:
    """Validate a case and say what a run will compute; nothing is written."""
    from .case.reading import load_case

    case = load_case(path)  # before the solvers are loaded, so that a fault is shown at once
    from .preparation.preparation import prepare
    from .runs.forecast import describe, refuse_too_large

    with reporting_compilation(lambda what, done, _: None if done else typer.echo(what, err=True)):
        prepared = prepare(case)
        for line in describe(case, prepared):
            typer.echo(line)
        refuse_too_large(case, prepared)


@app.command()
def run(
    path: CasePath,
    output: Annotated[
        Path | None, option("Results folder.", "results/CASE", "-o", "--output")
    ] = None,
    resume: Resume = False,
    replace: Replace = False,
    part: PartOption = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    log_file: Annotated[
        Path | None, option("Log lines also go to the end of this file.", "none")
    ] = None,
) -> None:
    """Compute a case, write its results folder and print the leakage at every load.

    A terminal shows progress, anything else gets log lines. With --resume a run that was stopped goes on.
    """
    from .case.reading import load_case

    folder = output or Path("results") / path.stem
    case = load_case(path)  # before the solvers are loaded, so that a fault is shown at once
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
        again = f"femseal run {path} -o {folder} --resume"
        raise FemsealError(f"stopped; `{again}` goes on") from None
    if not quiet:
        for text in results.verdict_texts:
            print_text(text)
        print_table(results.table())
        if results.attempts is not None:
            print_table(results.attempts_table())
        if sys.stderr.isatty():  # without a terminal, the log lines say it
            for kind, texts in (("warning", results.warnings), ("failure", results.failures)):
                for text in texts[:5]:
                    typer.echo(f"{kind}: {text}", err=True)
                if len(texts) > 5:
                    typer.echo(f"{kind}: {len(texts) - 5} more in {folder / 'run.log'}", err=True)
        typer.echo(f"results in {folder}")


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
        expected = "none: removed; open report.html in a browser and print it to a PDF"
        raise InputError("--pdf", "an option of report", expected)
    from .report import write_report

    typer.echo(write_report(folder, output))


@app.command()
def export(
    folder: Folder,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .npz or .vti.")],
    step: Annotated[
        int | None, option("Load step, counted from 0 as in the table.", "all, numbered files")
    ] = None,
    field: Annotated[
        str,
        typer.Option(
            help='Over the pixels of the face: "gap", "contact_pressure" or "fluid_pressure".'
        ),
    ] = "gap",
    piece: Annotated[
        tuple[int, int] | None, option("Piece, counted from 0 along x1 and x2.", "the face")
    ] = None,
    window: Annotated[
        tuple[str, str, str, str] | None,
        option(
            'Part of the face: x1 from and to, x2 from and to, as "0 mm" "1 mm" "2 mm" "3 mm".',
            "the face",
        ),
    ] = None,
) -> None:
    """Write the gap, the contact or the fluid pressure at the load steps for other programs, with the pixel's size."""
    from .base.quantities import to_si
    from .results import open_results

    ends = None if window is None else tuple(to_si(text, "m", "window") for text in window)
    options = {"step": step, "field": field, "piece": piece, "window": ends}
    for path in open_results(folder).export(output, **options):
        typer.echo(path)


@app.command()
def surface(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="File with the heights of a face.")],
    size: Annotated[
        tuple[str, str] | None,
        option("Sides along x1 and x2, such as '1.2 mm' '0.9 mm'.", "as the file says"),
    ] = None,
    spacing: Annotated[
        tuple[str, str] | None,
        option("Pixel along x1 and x2 instead of the size.", "size / points"),
    ] = None,
    height_unit: Annotated[
        str | None, option("Unit of the heights in the file, such as um.", "as the file says")
    ] = None,
    channel: Annotated[
        str, typer.Option(help="Number or name of the channel in files with several.")
    ] = "0",
    array: Annotated[str | None, option("Array in an .npz with several.", "the only one")] = None,
    delimiter: Annotated[str | None, option("Between the numbers of a text.", "as found")] = None,
    transpose: Annotated[bool, flag("--transpose", "Exchange x and y.")] = False,
    mask: Annotated[
        Path | None, option("Image, text or .npy of the map's size, undefined where not 0.", "none")
    ] = None,
    file_mask: Annotated[
        bool,
        typer.Option(
            help="Points under the mask in a .gwy or .npz are undefined, or taken as they are."
        ),
    ] = True,
    no_data: Annotated[
        str | None,
        option(
            "Number of points that were not measured, such as -9999; none: all are heights.",
            "as the file says, or as found",
        ),
    ] = None,
    verify_checksum: Annotated[
        bool, typer.Option(help="An .x3p whose checksum is wrong is refused, or read all the same.")
    ] = True,
    crop: Annotated[
        tuple[str, str, str, str] | None,
        option("Part that is used: x1 from, x1 to, x2 from, x2 to.", "the whole"),
    ] = None,
    tip_radius: Annotated[
        str | None, option("Radius of the tip of the instrument.", "as the file says")
    ] = None,
    resolution: Annotated[
        str | None, option("Lateral period limit of the instrument.", "as the file says")
    ] = None,
    spikes: Annotated[
        float, typer.Option(help="Robust deviations beyond which an isolated point is a spike.")
    ] = 6.0,
    detrend: Annotated[
        int | None, option("Form taken off: 0 mean, 1 tilt, 2 tilt and curvature.", "1")
    ] = None,
    shortest_wave: Annotated[str | None, option("Low-pass of a run.", "measured ones")] = None,
    max_undefined: Annotated[
        float, typer.Option(help="Largest fraction of points that are filled.")
    ] = 0.05,
    picture: Annotated[
        Path | None, option("Picture to write (.png .pdf .svg).", "none", "-o", "--output")
    ] = None,
) -> None:
    """Describe a measured face, and say what a run would do to it; the options are keys of a case file too.

    A face that a run refuses is described and drawn too, with the reason.
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


_debug = False
#: Exit code that shells and typer have for a Ctrl-C.
_INTERRUPTED = 130


def main() -> None:
    """Run the command line; errors are one line each, with their traceback after `femseal --debug`.

    SIGTERM, which batch systems send before they kill, stops a run as Ctrl-C does.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        # typer may swallow a Ctrl-C and return its code
        if code := app(prog_name="femseal", standalone_mode=False):
            raise KeyboardInterrupt if code == _INTERRUPTED else SystemExit(code)
        sys.stdout.flush()
    except FemsealError as error:
        _stop(error, str(error), error.exit_code)
    except KeyboardInterrupt as error:
        _stop(error, "stopped", 1)
    except MemoryError as error:
        text = f"out of memory ({error or 'no more is free'})"
        _stop(error, f"{text}; `femseal check` says what a run takes", 1)
    except Exception as error:
        if isinstance(error, OSError) and _is_of_output(error):
            _stop(error, f"standard output: cannot be written ({error.strerror})", 1)
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            _stop(error, shortened(error), 2)
        # usage errors of the parser have their own message and exit code
        if hasattr(error, "show") and hasattr(error, "exit_code"):
            error.show()
            sys.exit(error.exit_code)
        _stop(error, f"{type(error).__name__}: {error}", 1)
    finally:
        gc.freeze()  # at its end Python would look for garbage among the objects of all libraries for half a second


def _is_of_output(error: OSError) -> bool:
    """Whether an error is of writing to standard output; what is left for it is dropped then."""
    *_, (frame, _line) = traceback.walk_tb(error.__traceback__)
    if (
        frame.f_globals["__name__"].partition(".")[0] not in ("click", "typer", "rich")
        and frame.f_code is not main.__code__
    ):
        return False
    with open(os.devnull, "w") as nowhere, suppress(OSError, ValueError):
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    return True


def _stop(error: BaseException, message: str, code: int) -> NoReturn:
    if _debug:
        traceback.print_exception(error)
    typer.echo(f"femseal: {message}", err=True)
    sys.exit(code)
