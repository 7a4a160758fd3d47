"""`python -m bench [--json] [--quick]`: a table on standard output, or one JSON document.

Every case runs in a fresh process, so that memory and first-call costs are its own.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from dataclasses import asdict
from typing import Any

import torch

from accpinn.methods.pinn.training import DEFAULT_THREADS
from bench import stability, start
from bench.speed import CASES, PAPER_ITERATIONS, folder, measure

PAPER_TIMED = 20
QUICK_TIMED = 5


def main() -> int:
    """Run all cases and print them; exit status 1 when one is slower than required."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument(
        "--quick", action="store_true", help="time fewer iterations of the paper's protocol"
    )
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    folder()
    timed = QUICK_TIMED if options.quick else PAPER_TIMED
    if options.one is not None:
        print(json.dumps(asdict(measure(CASES[options.one], timed))))
        return 0
    rows = []
    for index, case in enumerate(CASES):
        print(f"{case.name} ...", file=sys.stderr, flush=True)
        command = [sys.executable, "-m", "bench", "--one", str(index)]
        command += ["--quick"] if options.quick else []
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        rows.append(json.loads(done.stdout))
    machine = {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "fast_threads": DEFAULT_THREADS,
        "torch": torch.__version__,
        "python": platform.python_version(),
    }
    quick, starts = stability.measure(), start.measure()
    if options.json:
        document = {"machine": machine, "training": rows}
        document |= {"stability": [asdict(t) for t in quick], "start": [asdict(t) for t in starts]}
        print(json.dumps(document, indent=2))
    else:
        print(_text(machine, rows), "", stability.text(quick), "", start.text(starts), sep="\n")
    slow = any(row["least_ratio"] and row["ratio"] < row["least_ratio"] for row in rows)
    return int(slow or not all(timing.fast_enough for timing in (*quick, *starts)))


def _text(machine: dict[str, Any], rows: list[dict[str, Any]]) -> str:
    lines = [
        f"{machine['cores']} cores; {machine['threads']} threads for the paper's protocol,"
        f" {machine['fast_threads']} for the fast preset;"
        f" torch {machine['torch']}, Python {machine['python']}"
    ]
    for row in rows:
        fast = sorted(row["fast_seconds"])
        goal = f" (at least {row['least_ratio']:.0f})" if row["least_ratio"] else ""
        lines += [
            "",
            row["name"],
            f"  paper's protocol  {row['paper_iteration_ms']:.1f} ms an iteration, times"
            f" {PAPER_ITERATIONS:,} = {row['paper_seconds']:.0f} s",
            f"  fast preset       {fast[len(fast) // 2]:.2f} s (first {row['fast_seconds'][0]:.2f},"
            f" all {fast[0]:.2f}-{fast[-1]:.2f}), {row['fast_iterations']} iterations,"
            f" {row['outcome']}",
            f"  ratio             {row['ratio']:.0f}{goal}; first call {row['ratio_first']:.0f}",
            f"  loss              {row['loss_start']:.5f} before the hidden layers were trained,"
            f" {row['loss']:.5f} after; limit {row['loss_limit']:.5f}",
            "  gap MAE (m)       " + "  ".join(f"{value:.3f}" for value in row["gap_mae"]),
            f"  peak memory       {row['peak_memory_mb']:.0f} MB",
            "  parameters                              limit",
        ]
        for ours, limit in zip(row["parameters"], row["limit"], strict=True):
            lines.append(
                "    α {:.5f}  β {:.5f}  τ {:.4f}      {:.5f}    {:.5f}    {:.4f}".format(
                    *ours, *limit
                )
            )
        lines.append(
            "  distance          α {:.2f} %, β {:.2f} %, τ {:.2f} %".format(
                *row["distance_percent"]
            )
        )
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
