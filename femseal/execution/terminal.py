"""Show the progress of a command as bars on a terminal, and as log lines in pipes and files."""

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
    """Declare an on/off option of a command."""
    return typer.Option(name, help=help, show_default="off")


def option(help: str, default: str, *names: str) -> Any:
    """Declare an option of a command.

    help : help text.
    default : description of the default value, for the help text.
    names : names of the option on the command line; by default, the name of the argument.
    """
    return typer.Option(*names, help=help, show_default=default)


# Arguments and options that several commands share.
CasePath = Annotated[Path, typer.Argument(metavar="CASE", help="Case file.")]
Workers = Annotated[int | None, option("Processes.", "all cores")]
Scheduler = Annotated[
    str | None,
    option('Address of a Dask scheduler, or "local" for one with WORKERS processes.', "none"),
]
Formats = Annotated[
    str | None,
    option("Formats of the pictures: png, svg, pdf, or several with commas.", "png", "--format"),
]
Quiet = Annotated[bool, flag("--quiet", "No progress, no log lines, no tables.")]


def _refuse_part(part: str | None) -> None:
    """Raise InputError for the removed option `--part`, which divided a run among several jobs."""
    if part is not None:
        expected = (
            "none: removed; start a Dask cluster and give its address with --scheduler, as "
            "examples/slurm.sh does"
        )
        raise InputError("--part", shown(part), expected)


#: Removed option of the commands that can run on several machines.
PartOption = Annotated[str | None, typer.Option(hidden=True, callback=_refuse_part)]


def print_table(table: Any) -> None:
    """Print a table with rich, as wide as the terminal. In files and pipes, the table is up to 160 characters wide."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 160).print(table)


def print_text(text: str) -> None:
    """Print a text, wrapped at the width of the terminal."""
    from rich.markup import escape

    print_table(escape(text))


@contextmanager
def show_progress(quiet: bool, log_file: Path | None = None) -> Iterator[Progress]:
    """Show the progress of a command as bars on a terminal, or as log lines in files and pipes.

    quiet : if True, no progress is shown.
    log_file : file to which log lines are appended, whether or not progress is shown.
    """
    is_terminal = sys.stderr.isatty()
    handlers: list[logging.Handler] = []
    if log_file is not None:
        handlers.append(_open_log_file(log_file))
    if not quiet:
        handlers.append(_echo_handler(is_terminal))
    bars = _bars() if is_terminal and not quiet else nullcontext(no_progress)
    with logging_to(*handlers), bars as progress:
        yield progress


def _open_log_file(path: Path) -> logging.Handler:
    """Return a handler that appends log lines to a file."""
    writable = path if path.exists() else path.parent
    if path.is_dir() or not os.access(writable, os.W_OK):
        raise InputError("log-file", f"'{path}'", "a file that can be written")
    return LogFile(path, encoding="utf-8", delay=True)


def _echo_handler(is_terminal: bool) -> logging.Handler:
    """Return a handler that prints log lines; on a terminal, only warnings are printed."""
    handler = _Echo(logging.WARNING if is_terminal else logging.INFO)

    def is_shown(record: logging.LogRecord) -> bool:
        # failures of studies are shown with the results; on a terminal the command itself reports how the run ended
        has_failed = record.exc_info is not None
        is_reported = is_terminal and record.name == "femseal"
        return not has_failed and not is_reported

    handler.addFilter(is_shown)
    return handler


class _Echo(logging.Handler):
    """Print log lines on standard error, above the progress bars of a terminal."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        typer.echo(self.format(record), err=True)


@contextmanager
def _bars() -> Iterator[Progress]:
    """Show a bar for each stage on a terminal, with the number of items and the remaining time."""
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
