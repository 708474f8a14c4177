"""What `scripts/paper_run.sh` came to, as Markdown for RESULTS.md: scores, time and cost of stages and steps.

Usage: paper_table.py RUN_FOLDER; PAPER_DEVICE names the device, PAPER_PRICE is the machine's cost an hour.
"""

import csv
import json
import os
import sys
from collections import Counter
from pathlib import Path

# Table III of arXiv 2506.23426: mean AP.
COLUMNS = [
    ("ID: mAP", "eval-id", "total"),
    ("OOD: mAP (total)", "eval-ood", "total"),
    ("OOD: mAP_ID (matched FPs only)", "eval-ood", "id_matched"),
    ("OOD: mAP_OOD (all FPs)", "eval-ood", "ood_all"),
    ("OOD: mAP_OOD (matched FPs only)", "eval-ood", "ood_matched"),
]


def scores(out: Path) -> list[str]:
    """Rows of AP."""
    rows = ["| AP | harmful | harmless | mean |", "|---|---|---|---|"]
    for title, folder, column in COLUMNS:
        metrics = json.loads((out / folder / "metrics.json").read_text())
        found = [metrics[column][name] for name in ("harmful", "harmless", "mean")]
        cells = ["unknown" if ap is None else f"{ap:.3f}" for ap in found]
        rows.append(f"| {title} | {' | '.join(cells)} |")
    return rows


def stage_seconds(out: Path) -> dict[str, float]:
    """Seconds of each stage, over all calls, in the order in which they began."""
    seconds: dict[str, float] = {}
    for line in (out / "times.tsv").read_text().splitlines():
        kind, stage, *rest = line.split("\t")
        if kind == "time":
            seconds[stage] = seconds.get(stage, 0.0) + float(rest[0])
    return seconds


def costs(out: Path, price: float | None) -> list[str]:
    """Rows of what the stages took, then what a step of the training took."""
    seconds = stage_seconds(out)
    rows = ["| stage | hours | cost |", "|---|---|---|"]
    told = [*seconds.items(), ("all", sum(seconds.values()))]
    for stage, of_stage in told:
        hours = of_stage / 3600
        rows.append(f"| {stage} | {hours:.2f} | {cost(hours, price)} |")
    with (out / "run" / "log.csv").open(newline="") as log:
        steps = Counter(row["stage"] for row in csv.DictReader(log))
    time = json.loads((out / "run" / "time.json").read_text())
    n_steps = sum(steps.values())
    of_step = time["wall_s"] / n_steps
    device = os.environ.get("PAPER_DEVICE", "unknown")
    of_stages = ", ".join(f"{n} {stage}" for stage, n in steps.items())
    rows += [
        "",
        f"{n_steps} steps ({of_stages}), {of_step:.3f} s each with inputs and validation, "
        f"{cost(of_step / 3600, price)} a step; {time['n_calls']} calls. Device: {device}.",
    ]
    return rows


def cost(hours: float, price: float | None) -> str:
    """What the hours cost; a step costs little, so digits that count are kept."""
    return "unknown" if price is None else f"{hours * price:.3g}"


def main() -> None:
    """Prints the tables."""
    out = Path(sys.argv[1])
    price = os.environ.get("PAPER_PRICE") or None
    parts = [
        scores(out),
        costs(out, None if price is None else float(price)),
        [
            "A step and an inference by their parts:",
            "",
            "```",
            (out / "profile.txt").read_text().strip(),
            "```",
        ],
    ]
    print("\n\n".join("\n".join(part) for part in parts))


if __name__ == "__main__":
    main()
