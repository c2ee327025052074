"""All hard scenes, and their outcomes as a table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..base.errors import InputError
from ..base.text import comma_separated
from .chain_cases import CASES as CHAIN
from .contact_cases import CASES as CONTACT
from .drawn_cases import CASES as DRAWN
from .flow_cases import CASES as FLOW
from .gas_cases import CASES as GAS
from .groove_cases import CASES as GROOVES
from .hard_case import HardCase, Outcome
from .ring_cases import CASES as RINGS
from .seal_cases import CASES as SEAL

if TYPE_CHECKING:
    from rich.table import Table

#: Endings of files that a table can be written to.
ENDINGS = (".csv", ".json", ".md")
STAGES = ("contact", "flow", "seal", "chain")
CASES: tuple[HardCase, ...] = (*CONTACT, *FLOW, *GAS, *SEAL, *RINGS, *GROOVES, *CHAIN, *DRAWN)


def chosen(stage: str | None = None, name: str | None = None) -> tuple[HardCase, ...]:
    """The scenes of a stage, or those whose name contains a text; all of them if neither is given.

    Raises
    ------
    InputError : there is no such stage or name.
    """
    if stage is not None and stage not in STAGES:
        raise InputError("stage", f"'{stage}'", f"one of {', '.join(STAGES)}")
    found = tuple(case for case in CASES if stage in (None, case.stage))
    if name is not None:
        named = tuple(case for case in found if name == case.name)
        named = named or tuple(case for case in found if name in case.name)
        if not named:
            raise InputError("name", f"'{name}'", f"all or a part of one of: {'; '.join(c.name for c in found)}")
        found = named
    return found


def rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One dictionary for each scene."""
    return [
        {
            "stage": outcome.case.stage,
            "scene": outcome.case.name,
            "what": outcome.case.what,
            "must": outcome.case.must.text,
            "came": outcome.came,
            "within": outcome.within,
            "seconds": round(outcome.seconds, 3),
        }
        for outcome in outcomes
    ]


def file_text(outcomes: Sequence[Outcome], suffix: str) -> str:
    """The rows as comma-separated values, JSON or a table of Markdown, by one of the `ENDINGS`."""
    lines = rows(outcomes)
    if suffix == ".json":
        return json.dumps(lines, indent=1, ensure_ascii=False) + "\n"
    if suffix == ".csv":
        return comma_separated(lines)
    return _markdown(lines)


def _markdown(lines: Sequence[dict[str, Any]]) -> str:
    head = "| stage | scene | what it is | must | came | within |\n|---|---|---|---|---|---|\n"
    keys = ("stage", "scene", "what", "must", "came")
    cells = [[str(line[key]).replace("|", "\\|") for key in keys] for line in lines]
    verdicts = ["yes" if line["within"] else "NO" for line in lines]
    return head + "".join(f"| {' | '.join(c)} | {v} |\n" for c, v in zip(cells, verdicts, strict=True))


def table(outcomes: Sequence[Outcome]) -> Table:
    """The table for a terminal, to be given to `rich.print`."""
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape as plain
    from rich.table import Table

    failed = sum(not outcome.within for outcome in outcomes)
    scenes = "hard scene" if len(outcomes) == 1 else "hard scenes"
    title = f"{len(outcomes)} {scenes}, {failed or 'none'} failed, {sum(o.seconds for o in outcomes):.1f} s"
    shown = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for name, justify in (("stage", "left"), ("scene", "left"), ("must", "left"), ("came", "left"), ("within", "left")):
        shown.add_column(name, justify=justify, overflow="fold")  # type: ignore[arg-type]
    shown.add_column("seconds", justify="right")
    for line in rows(outcomes):
        verdict = "yes" if line["within"] else "NO"
        cells = (line["stage"], line["scene"], line["must"], line["came"], verdict, f"{line['seconds']:.2f}")
        shown.add_row(*map(plain, cells))
    return shown
