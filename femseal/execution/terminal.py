"""Progress of a command: bars on a terminal, log lines elsewhere and in a file."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from ..base.errors import InputError, shown
from .run import LogFile, Progress, logging_to, no_progress


def flag(name: str, help: str) -> Any:
    """An option of a command that is off unless it is named."""
    return typer.Option(name, help=help, show_default="off")


def option(help: str, default: str, *names: str) -> Any:
    """An option of a command, named after its argument unless it has names; `default` says what holds without it."""
    return typer.Option(*names, help=help, show_default=default)


#: Arguments and options that several commands have.
CasePath = Annotated[Path, typer.Argument(metavar="CASE", help="Case file.")]
Workers = Annotated[int | None, option("Processes.", "all cores")]
Scheduler = Annotated[
    str | None,
    option('Address of a Dask scheduler, or "local" for one with WORKERS processes.', "none"),
]
Quiet = Annotated[bool, flag("--quiet", "No progress, no log lines, no tables.")]


def _refuse_part(part: str | None) -> None:
    """Answer the option of a former version that divided a run among jobs."""
    if part is not None:
        expected = (
            "none: removed; start a Dask cluster and give its address with --scheduler, as "
            "examples/slurm.sh does"
        )
        raise InputError("--part", shown(part), expected)


#: Former option of the commands whose work several machines divide.
PartOption = Annotated[str | None, typer.Option(hidden=True, callback=_refuse_part)]


def print_table(table: Any) -> None:
    """Print a table of rich, in files and pipes with room for long lines."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 160).print(table)


def print_text(text: str) -> None:
    """Print a text of some sentences, broken at the width of a terminal."""
    from rich.markup import escape

    print_table(escape(text))


@contextmanager
def show_progress(quiet: bool, log_file: Path | None = None) -> Iterator[Progress]:
    """Bars on a terminal, log lines elsewhere; nothing if quiet.

    log_file : to whose end log lines go too.
    """
    terminal = sys.stderr.isatty()
    bars = _bars() if terminal and not quiet else nullcontext(no_progress)
    handlers: list[logging.Handler] = []
    if (path := log_file) is not None:
        if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
            raise InputError("log-file", f"'{path}'", "a file that can be written")
        handlers.append(LogFile(path, encoding="utf-8", delay=True))
    if not quiet:
        handlers.append(_Echo(logging.WARNING if terminal else logging.INFO))
        # failures of studies are shown with the results, and the end of a run by the command
        handlers[-1].addFilter(
            lambda record: record.exc_info is None and (not terminal or record.name != "femseal")
        )
    with logging_to(*handlers), bars as progress:
        yield progress


class _Echo(logging.Handler):
    """Lines on stderr, above the bars if there are any."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record on standard error."""
        typer.echo(self.format(record), err=True)


@contextmanager
def _bars() -> Iterator[Progress]:
    """A bar for each stage on a terminal, with items done and the time left."""
    from rich import progress
    from rich.console import Console

    tasks: dict[str, Any] = {}
    with progress.Progress(
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeRemainingColumn(),
        console=Console(stderr=True),
    ) as bars:

        def show(stage: str, done: int, total: int | None) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield show
