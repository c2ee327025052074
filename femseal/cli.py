"""Command line: `femseal new`, `check`, `run`, `accuracy`.

Exit code 0 done, 2 bad input (nothing written), 1 anything else.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from . import __version__
from .errors import FemsealError, InputError

app = typer.Typer(
    name="femseal",
    help="Leakage of metal-to-metal seals over a loading-unloading cycle, from measured roughness.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"femseal {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@app.command()
def new(path: Annotated[Path, typer.Argument(help="Case file to write.")] = Path("case.toml")) -> None:
    """Write a commented case file to start from."""
    from importlib.resources import files

    if path.exists():
        raise InputError.of("path", f"'{path}', which exists", "a new file")
    try:
        path.write_text(files("femseal").joinpath("template.toml").read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        raise InputError.of("path", f"'{path}'", f"a file that can be written ({error.strerror})") from None
    typer.echo(f"{path} written; edit it, then: femseal run {path}")


@app.command()
def check(path: Annotated[Path, typer.Argument(metavar="CASE", help="Case file.")]) -> None:
    """Validate a case and say what a run will compute; nothing is written."""
    from .case import load_case
    from .forecast import describe

    case = load_case(path)
    for line in describe(case, case.prepare()):
        typer.echo(line)


@app.command()
def run(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Case file.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Results folder [results/CASE].")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Keep complete results of the same case.")] = False,
    workers: Annotated[int | None, typer.Option(help="Processes [all cores].")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, no table.")] = False,
) -> None:
    """Compute a case, write its results folder and print the leakage at every load."""
    from . import job
    from .case import load_case

    folder = output or Path("results") / path.stem
    case = load_case(path)
    with _Progress(show=not quiet and sys.stderr.isatty()) as progress:
        results = job.run(case, folder, resume, workers, scheduler, progress=progress)
    if not quiet:
        from rich.console import Console

        Console(width=None if sys.stdout.isatty() else 160).print(results.table())
        for warning in results.warnings[:5]:
            typer.echo(f"warning: {warning}", err=True)
        if len(results.warnings) > 5:
            typer.echo(f"warning: {len(results.warnings) - 5} more in {folder / 'run.log'}", err=True)
        typer.echo(f"results in {folder}")


@app.command()
def accuracy(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Case file.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder for table and picture [none].")] = None,
    limit: Annotated[str, typer.Option(help="Skip solutions expected to take longer on one core.")] = "10 min",
    memory: Annotated[str, typer.Option(help="Skip solutions expected to need more.")] = "4 GB",
    workers: Annotated[int | None, typer.Option(help="Processes [all cores].")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="No plan, no progress, no table.")] = False,
) -> None:
    """Report speed against error for a case: coarser pixels, other windows, smaller libraries."""
    from .accuracy import measure_accuracy
    from .quantities import to_si

    limits = {"limit": to_si(limit, "s", "limit"), "memory": to_si(memory, "byte", "memory")}
    announce = None if quiet else typer.echo
    with _Progress(show=not quiet and sys.stderr.isatty()) as progress:
        report = measure_accuracy(path, output, workers, **limits, announce=announce, progress=progress)
    if not quiet:
        from rich.console import Console

        Console(width=None if sys.stdout.isatty() else 160).print(report.table())
        for warning in report.warnings[:5]:
            typer.echo(f"warning: {warning}", err=True)
        if len(report.warnings) > 5:
            typer.echo(f"warning: {len(report.warnings) - 5} more", err=True)
        if output is not None:
            typer.echo(f"accuracy in {output}")


class _Progress:
    """A bar for each stage on a terminal, nothing elsewhere."""

    def __init__(self, show: bool) -> None:
        self._bars: Any = None
        self._tasks: dict[str, Any] = {}
        if show:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            self._bars = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
                console=Console(stderr=True),
            )

    def __enter__(self) -> _Progress:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *details: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        if self._bars is None:
            return
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=total)
        self._bars.update(self._tasks[stage], completed=done, total=total)


def main() -> None:
    """Run the command line; errors are one line each."""
    try:
        app(standalone_mode=False)
    except InputError as error:
        typer.echo(f"femseal: {error}", err=True)
        sys.exit(2)
    except FemsealError as error:
        typer.echo(f"femseal: {error}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo("femseal: stopped", err=True)
        sys.exit(1)
    except Exception as error:
        # usage errors of the parser know how to show themselves and their exit code
        if hasattr(error, "show") and hasattr(error, "exit_code"):
            error.show()
            sys.exit(error.exit_code)
        typer.echo(f"femseal: {type(error).__name__}: {error}", err=True)
        sys.exit(1)
