"""Pressure in assembly and in service
====================================

This script finds the nominal pressure in assembly that keeps the leakage of a seal below a limit (Qmin), and
the pressure to which it may fall in service (QSmin). It reads a results folder. To create one, run ``femseal
run examples/turned_seal.toml -o results/turned_seal``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import femseal as fs


def margin(answer: fs.Design) -> dict[float, float]:
    """Compute which fraction of each assembly pressure may be lost in service.

    The seal must still meet the first leakage class after this loss.
    """
    service = answer.requirements[0].service
    return {
        assembly: 1 - needed.value / assembly
        for assembly, needed in service.items()
        if needed.known
    }


if __name__ == "__main__":
    import rich

    try:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else "results/turned_seal")
        answer = fs.design(
            fs.open_results(folder), classes=sys.argv[2:] or ["1000 mg/(m·s)", "500 mg/(m·s)"]
        )
    except fs.InputError as error:
        sys.exit(f"{error}\nusage: python design_answer.py DIR CLASS …")
    rich.print(answer.table())
    for assembly, part in margin(answer).items():
        print(f"after {assembly / 1e6:g} MPa in assembly {part:.0%} of it may be lost in service")
    picture = answer.plot()
    picture.savefig("design.png")
