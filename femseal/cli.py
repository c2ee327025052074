"""Command line: `femseal new`, `check`, `run`. Exit code 0 done, 2 bad input (nothing written), 1 anything else."""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep complete results of the same case, or go on where a run was ended.")
    ] = False,
    workers: Annotated[int | None, typer.Option(help="Processes [all cores].")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help='Address of a Dask scheduler, or "local" for one with WORKERS processes.')
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, no log lines, no table.")] = False,
    log_file: Annotated[Path | None, typer.Option(help="Log lines also go to the end of this file.")] = None,
) -> None:
    """Compute a case, write its results folder and print the leakage at every load.

    On a terminal progress is shown, elsewhere log lines. A run that was ended, by Ctrl-C or otherwise, goes on with
    --resume.
    """
    from . import job
    from .case import load_case

    folder = output or Path("results") / path.stem
    case = load_case(path)
    terminal = sys.stderr.isatty()
    try:
        with _log(log_file, quiet, terminal), _Progress(show=not quiet and terminal) as progress:
            results = job.run(case, folder, resume, workers, scheduler, progress=progress)
    except KeyboardInterrupt:
        raise FemsealError(f"stopped; `femseal run {path} -o {folder} --resume` goes on") from None
    if not quiet:
        from rich.console import Console

        Console(width=None if sys.stdout.isatty() else 160).print(results.table())
        if terminal:  # elsewhere the log lines have said so
            for warning in results.warnings[:5]:
                typer.echo(f"warning: {warning}", err=True)
            if len(results.warnings) > 5:
                typer.echo(f"warning: {len(results.warnings) - 5} more in {folder / 'run.log'}", err=True)
        typer.echo(f"results in {folder}")


@contextmanager
def _log(path: Path | None, quiet: bool, terminal: bool) -> Iterator[None]:
    """Log lines to the end of a file and, unless quiet, to stderr."""
    log = logging.getLogger("femseal")
    handlers: list[logging.Handler] = []
    if path is not None:
        if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
            raise InputError.of("log-file", f"'{path}'", "a file that can be written")
        handlers.append(logging.FileHandler(path, encoding="utf-8", delay=True))
    if not quiet:
        handlers.append(_Echo(logging.WARNING if terminal else logging.INFO))
        # what went wrong in the studies is told with the results, and how a run ended at its end
        handlers[-1].addFilter(lambda record: record.exc_info is None and (not terminal or record.name != log.name))
    level = log.level
    log.setLevel(logging.INFO)
    for handler in handlers:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        log.addHandler(handler)
    try:
        yield
    finally:
        log.setLevel(level)
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()


class _Echo(logging.Handler):
    """Lines on stderr, above the bars if there are any."""

    def emit(self, record: logging.LogRecord) -> None:
        typer.echo(self.format(record), err=True)


class _Progress:
    """A bar for each stage on a terminal, with items done, their rate and the time left; nothing elsewhere."""

    def __init__(self, show: bool) -> None:
        self._bars: Any = None
        self._tasks: dict[str, Any] = {}
        if show:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn
            from rich.progress import TimeRemainingColumn as TimeLeft
            from rich.text import Text

            class Rate(ProgressColumn):
                """Items per second."""

                def render(self, task: Task) -> Text:
                    rate = task.finished_speed or task.speed
                    return Text("" if rate is None else f"{rate:.3g}/s")

            self._bars = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                Rate(),
                TimeLeft(),
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
    """Run the command line; errors are one line each.

    SIGTERM, which batch systems send before they kill, stops a run as Ctrl-C does.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
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
