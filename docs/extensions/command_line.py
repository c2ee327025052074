"""Write the page of the command line from the output of `femseal COMMAND --help`."""

from pathlib import Path

from typer.testing import CliRunner

from femseal.cli import app

_HEAD = """# Command line

This page contains the output of `femseal --help` and of `femseal COMMAND --help`. The exit code is 0 if the command
has succeeded, 2 if the input is wrong (then nothing is written), and 1 in all other cases, for example if a run is
stopped with Ctrl-C.
"""


def write_command_line(page: Path) -> None:
    """Write the page; the help texts are printed without frames."""
    app.rich_markup_mode = None
    names = [command.name or command.callback.__name__ for command in app.registered_commands]
    blocks = [f"## {name}\n\n```text\n{_help(name)}\n```" for name in names]
    page.write_text(
        "\n\n".join([_HEAD + f"\n```text\n{_help()}\n```", *blocks]) + "\n", encoding="utf-8"
    )


def _help(*command: str) -> str:
    done = CliRunner().invoke(
        app, [*command, "--help"], prog_name="femseal", env={"COLUMNS": "110"}
    )
    assert done.exit_code == 0, done.output
    return done.output.strip()
