"""All hard scenes: a line for each of what must come out and what came; exit status 1 where one falls short.

python tests/hard_scenes/report.py             all of them
python tests/hard_scenes/report.py grooves     those with this text in their stage or name
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from chain_scenes import SCENES as CHAIN
from contact_scenes import SCENES as CONTACT
from flow_scenes import SCENES as FLOW
from gas_scenes import SCENES as GAS
from groove_scenes import SCENES as GROOVES
from hard_scene import HardScene
from real_seal_scenes import SCENES as REAL_SEALS
from ring_scenes import SCENES as RINGS
from seal_scenes import SCENES as SEAL
from two_scale_scenes import SCENES as TWO_SCALES

STAGES = ("contact", "flow", "seal", "chain")
SCENES: tuple[HardScene, ...] = (
    *CONTACT,
    *FLOW,
    *GAS,
    *SEAL,
    *RINGS,
    *GROOVES,
    *CHAIN,
    *TWO_SCALES,
    *REAL_SEALS,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve the scenes and return the exit status."""
    parser = argparse.ArgumentParser(
        description="Solve hard scenes, and say what must come out and what came."
    )
    parser.add_argument(
        "text", nargs="?", default="", help="only scenes with this text in their stage or name"
    )
    given = parser.parse_args(arguments)
    chosen = [scene for scene in SCENES if given.text in f"{scene.stage} {scene.name}"]
    if not chosen:
        parser.error(f"no scene has the text '{given.text}'")
    outcomes = []
    for scene in chosen:
        outcomes.append(outcome := scene.outcome())
        verdict = "yes" if outcome.within else "NO "
        print(
            f"{verdict} {outcome.seconds:6.2f} s  {scene.stage}: {scene.name}", end="", flush=True
        )
        print(f": {scene.must.text}; came {outcome.came}")
    short = sum(not outcome.within for outcome in outcomes)
    print(
        f"{len(outcomes)} scenes, {short or 'none'} short, {sum(o.seconds for o in outcomes):.1f} s"
    )
    return 1 if short else 0


if __name__ == "__main__":
    sys.exit(main())
