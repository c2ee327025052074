"""The command `femseal hard-cases`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..base.errors import InputError
from ..base.files import write_text
from ..execution.terminal import print_table


def hard_cases(
    stage: Annotated[
        str | None, typer.Option(help="Only the scenes of contact, flow, seal or chain.", show_default="all")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Only the scene of this name, or those that contain it.", show_default="all")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Table as a file: .csv, .json or .md.", show_default="none"),
    ] = None,
) -> None:
    """Solve hard scenes of contact, flow, seals and the whole chain, and say what must come out and what came.

    Exit code 1 when one of them does not give what it must.
    """
    from .collection import ENDINGS, chosen, file_text, table

    cases = chosen(stage, name)
    if output is not None and output.suffix not in ENDINGS:
        raise InputError.of("output", f"'{output}'", f"a file ending in one of {', '.join(ENDINGS)}")
    outcomes = [case.outcome() for case in cases]
    print_table(table(outcomes))
    if output is not None:
        write_text(output, file_text(outcomes, output.suffix))
        typer.echo(f"table in {output}")
    if not all(outcome.within for outcome in outcomes):
        raise typer.Exit(1)
