"""A cycle of twelve states on a large face, killed once and resumed.

    python tests/benchmarks/large_cycle.py --points 1024 --folder DIR
    python tests/benchmarks/large_cycle.py --folder DIR --kill-after 900 --write

The face is self-affine with 8 pixels for the shortest wave; pieces have 128 pixels a side. `femseal run` is ended by SIGKILL
after `--kill-after` seconds and run again with `--resume`, until it ends by itself. A folder with runs is gone on with.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from common import kept, machine, rows, save_report

CASE = """
title = "Cycle of a large face"
method = "two-scale"
seed = 1

[face]
kind = "self-affine"
points = [{points}, {points}]
size = ["{points} um", "{points} um"]
hurst = 0.8
rms_slope = 0.1
roll_off = "{roll_off} um"
cut_off = "8 um"

[material]
young = "210 GPa"
poisson = 0.3
hardness = "2.3 GPa"

[load]
loading = ["20 MPa", "40 MPa", "80 MPa", "120 MPa", "180 MPa", "240 MPa", "300 MPa"]
unload_from = ["300 MPa"]
unloading = ["240 MPa", "160 MPa", "80 MPa", "40 MPa", "20 MPa"]

[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"

[cells]
count = [{pieces}, {pieces}]

[output]
budget = false
"""


def size(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(path.stat().st_blocks * 512 for path in folder.rglob("*") if path.is_file())


def run(case: Path, kill_after: float | None) -> dict[str, float]:
    """A run of a case, resumed if there is one: processor and elapsed time [s], peak memory and disk [byte]."""
    output = case.with_suffix("")
    command = [sys.executable, "-m", "femseal", "run", str(case), "-o", str(output), "--resume"]
    start = time.perf_counter()
    with case.with_suffix(".log").open("ab") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        deadline, ended = start + (kill_after or float("inf")), 0
        while not ended:
            if time.perf_counter() > deadline:
                process.send_signal(signal.SIGKILL)
            time.sleep(1)
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, -signal.SIGKILL):
        raise RuntimeError(f"femseal run ended with status {process.returncode}, see {case.with_suffix('.log')}")
    return {"elapsed": time.perf_counter() - start, "processor": usage.ru_utime + usage.ru_stime,
            "memory": 1024 * usage.ru_maxrss, "disk": size(output), "status": process.returncode}  # fmt: skip


def leakages(output: Path) -> dict[str, list[float]]:
    """Load [Pa] and leakage [m²/s] of every state."""
    import femseal as fs

    results = fs.open_results(output)
    found = results.dataset
    return {
        "pressure": found["nominal_pressure"].values.tolist(),
        "leakage": found["leakage_two_scale"].values.tolist(),
    }


def report(points: int, records: list[dict[str, Any]], found: dict[str, list[float]]) -> str:
    """Tables of the runs and of the leakage of all states."""
    head = ["run", "processor time [min]", "elapsed [min]", "peak memory [GB]", "disk [GB]"]
    cells = [[f"{r['run']}{', killed' if r['status'] else ''}", f"{r['processor'] / 60:.1f}",
              f"{r['elapsed'] / 60:.1f}", f"{r['memory'] / 1e9:.1f}", f"{r['disk'] / 1e9:.1f}"] for r in records]  # fmt: skip
    columns = ["state", "load [MPa]", "leakage [m²/s]"]
    values = zip(found["pressure"], found["leakage"], strict=True)
    lines = [[str(step), f"{load / 1e6:.0f}", f"{q:.4g}"] for step, (load, q) in enumerate(values)]
    return f"{machine({})}; {points}² points.\n\n{rows(head, cells)}\n\n{rows(columns, lines)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=8192)
    parser.add_argument("--folder", type=Path, required=True, help="folder of the runs, which are gone on with")
    parser.add_argument("--kill-after", type=float, default=900, help="seconds before the first run is killed")
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    path, records, status, number = given.folder / "records.jsonl", [], -1, 0
    case = given.folder / "cycle.toml"
    values = {"roll_off": given.points / 8, "pieces": given.points // 128}
    case.write_text(CASE.format(points=given.points, **values), encoding="utf-8")
    while status:
        number += 1
        task = {"run": number, "points": given.points}
        kill_after = given.kill_after if number == 1 else None
        records.append(kept(task, task, path, lambda k=kill_after, t=task: t | run(case, k)))
        status = records[-1]["status"]
    found = leakages(case.with_suffix(""))
    text = report(given.points, records, found)
    print(text)
    if given.write:
        save_report(__file__, "Cycle of a large face", text)


if __name__ == "__main__":
    main()
