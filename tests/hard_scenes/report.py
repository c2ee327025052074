"""All hard scenes: a line for each of what must come out and what came; exit status 1 where one falls short.

python tests/hard_scenes/report.py             all of them
python tests/hard_scenes/report.py grooves     those with this text in their stage or name
python tests/hard_scenes/report.py --write     all of them, and the table of docs/evidence/hard_scenes.md
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from chain_scenes import SCENES as CHAIN
from contact_scenes import SCENES as CONTACT
from flow_scenes import SCENES as FLOW
from gas_scenes import SCENES as GAS
from groove_scenes import SCENES as GROOVES
from hard_scene import HardScene, Outcome
from real_seal_scenes import SCENES as REAL_SEALS
from ring_scenes import SCENES as RINGS
from seal_scenes import SCENES as SEAL
from two_scale_scenes import SCENES as TWO_SCALES

STAGES = ("contact", "flow", "seal", "chain")
SCENES: tuple[HardScene, ...] = (*CONTACT, *FLOW, *GAS, *SEAL, *RINGS, *GROOVES, *CHAIN, *TWO_SCALES, *REAL_SEALS)
PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "hard_scenes.md"
HEAD = "| stage | scene | what it is | must | came | within |\n|---|---|---|---|---|---|\n"


def row(outcome: Outcome) -> str:
    """A line of the table of the page."""
    scene = outcome.scene
    cells = (scene.stage, scene.name, scene.what, scene.must.text, outcome.came, "yes" if outcome.within else "NO")
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def write(page: Path, outcomes: Sequence[Outcome]) -> None:
    """Put the table, with which the page ends, in the place of the one that is there."""
    text, head, _ = page.read_text(encoding="utf-8").partition(HEAD)
    if not head:
        raise ValueError(f"{page} has no table")
    page.write_text(text + head + "".join(map(row, outcomes)), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve the scenes and return the exit status."""
    parser = argparse.ArgumentParser(description="Solve hard scenes, and say what must come out and what came.")
    parser.add_argument("text", nargs="?", default="", help="only scenes with this text in their stage or name")
    parser.add_argument("--write", action="store_true", help="write the table of the page of evidence")
    given = parser.parse_args(arguments)
    if given.write and given.text:
        parser.error("the page has all scenes: --write takes no text")
    chosen = [scene for scene in SCENES if given.text in f"{scene.stage} {scene.name}"]
    if not chosen:
        parser.error(f"no scene has the text '{given.text}'")
    outcomes = []
    for scene in chosen:
        outcomes.append(outcome := scene.outcome())
        verdict = "yes" if outcome.within else "NO "
        print(f"{verdict} {outcome.seconds:6.2f} s  {scene.stage}: {scene.name}", end="", flush=True)
        print(f": {scene.must.text}; came {outcome.came}")
    short = sum(not outcome.within for outcome in outcomes)
    print(f"{len(outcomes)} scenes, {short or 'none'} short, {sum(o.seconds for o in outcomes):.1f} s")
    if given.write:
        write(PAGE, outcomes)
    return 1 if short else 0


if __name__ == "__main__":
    sys.exit(main())
