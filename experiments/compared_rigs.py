"""Does `compare` name the friction law of rigs that another simulator has made (`drawn_rigs`)?

    python -m experiments.compared_rigs --rigs 0:100
    python -m experiments.compared_rigs --rigs 0:100 --here  # one process, no workers

Each rig is a folder with study, records, truth, and the comparison of all five laws; what is done is not done again.
The table has a row for each rig: law, law chosen, how far the chosen one's log score is below that of the true law on
held-out blocks and on records that no fit has seen, what each leaves of the record to validate [nm], and seconds.

A choice is right if it is the true law, or a simpler one that predicts the record that no fit has seen as well.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import pdssjax
from experiments.common import OUT
from experiments.drawn_rigs import LAWS, NOISE, draw, write_rig
from pdssjax import Comparison, prepare_jax
from tests.helpers.compared_laws import Here

AS_WELL = 3.0
"""Log score by which a simpler law may predict a record worse: odds of twenty to one."""

Found = dict[str, Any]
"""Of one rig, as JSON holds it."""


def compared(number: int, folder: Path, here: bool = False) -> Found:
    """What `compare` says of rig `number`, whose folder is made where it is not there."""
    result, study = folder / "result.json", folder / "study.toml"
    if result.exists():
        return json.loads(result.read_text(encoding="utf-8"))
    if not study.exists():
        write_rig(draw(number), folder)
    out = folder / "which-law"
    comparison = pdssjax.compare(
        pdssjax.load_study(study),
        friction=LAWS,
        executor=Here() if here else None,
        out=out,
        resume=(out / "candidates").is_dir(),
        overwrite=True,
    )
    found = summary(json.loads((folder / "truth.json").read_text(encoding="utf-8")), comparison, folder)
    result.write_text(json.dumps(found, indent=2), encoding="utf-8")
    return found


def summary(truth: Found, comparison: Comparison, folder: Path) -> Found:
    """The truth beside the choice."""
    scores = {}
    with np.load(folder / "clean.npz") as clean:
        for result in comparison.results:
            if result.fitted.failure:
                continue
            last = len(comparison.records) - 1
            record, residual = comparison.records[last], result.fitted.residuals[last]
            away = record.measured - residual - clean[record.name]
            scores[result.name] = {
                "free": len(result.fitted.free),
                "blocks": result.time.total if result.time else 0.0,
                "records": result.records.total if result.records else 0.0,
                "error": float(np.std(away)),
                "seconds": result.fitted.seconds,
            }
    found = {
        "number": truth["number"],
        "law": truth["law"],
        "coloured": truth["correlation_time"] > 0.0,
        "chosen": comparison.chosen,
        "ambiguous": list(comparison.ambiguous),
        "failed": {r.name: r.fitted.failure for r in comparison.results if r.fitted.failure},
        "scores": scores,
        "seconds": comparison.seconds,
    }
    return found | {"right": is_right(found), "worse": predicts_worse(found)}


def deficit(found: Found, what: str) -> float:
    """How far the log score of the chosen law is below that of the true one; NaN where one of them has no fit."""
    scores = found["scores"]
    if not {found["law"], found["chosen"]} <= set(scores):
        return float("nan")
    return scores[found["chosen"]][what] - scores[found["law"]][what]


def predicts_worse(found: Found) -> bool:
    """The chosen law predicts records that no fit has seen worse than the true one."""
    return not deficit(found, "records") <= AS_WELL


def is_right(found: Found) -> bool:
    """The true law, or a simpler one that predicts as well."""
    if found["chosen"] == found["law"]:
        return True
    scores = found["scores"]
    if predicts_worse(found):
        return False
    return scores[found["chosen"]]["free"] < scores[found["law"]]["free"]


def table(rigs: list[Found]) -> str:
    """One row a rig, and how many are right."""
    lines = ["| rig | law | noise | chosen | | blocks | records | true law, nm | chosen, nm | s |"]
    lines.append("|--:|---|---|---|---|--:|--:|--:|--:|--:|")
    for found in rigs:
        error = lambda name, f=found: f"{1e9 * f['scores'][name]['error']:.2f}" if name in f["scores"] else "-"
        cells = [
            str(found["number"]),
            found["law"],
            "coloured" if found["coloured"] else "white",
            found["chosen"],
            "" if found["chosen"] == found["law"] else "simpler" if found["right"] else "WRONG",
            f"{deficit(found, 'blocks'):.1f}",
            f"{deficit(found, 'records'):.1f}",
            error(found["law"]),
            error(found["chosen"]),
            f"{found['seconds']:.0f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    right, worse = sum(found["right"] for found in rigs), sum(found["worse"] for found in rigs)
    lines.append("")
    lines.append(f"Right: {right} of {len(rigs)}. A law that predicts worse is chosen in {worse}.")
    lines.append(f"Noise {1e9 * NOISE:g} nm; a comparison takes {np.median([f['seconds'] for f in rigs]):.0f} s.")
    return "\n".join(lines)


def main() -> None:
    """Compare, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", default="0:10", help="first and one past the last number")
    parser.add_argument("--out", type=Path, default=OUT / "rigs", help="where the folders are")
    parser.add_argument("--here", action="store_true", help="fit in this process, one law after the other")
    options = parser.parse_args()
    prepare_jax(dedicated=True)
    first, _, last = options.rigs.partition(":")
    rigs = []
    for number in range(int(first), int(last or int(first) + 1)):
        rigs.append(compared(number, options.out / f"{number:03d}", options.here))
        told = rigs[-1]
        print(f"{number}: {told['law']} -> {told['chosen']}, {told['seconds']:.0f} s", flush=True)
    print(table(rigs))


if __name__ == "__main__":
    main()
