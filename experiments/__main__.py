"""Runs every experiment, one process each, and collects tables and figures on one page.

    python -m experiments              # all of them
    python -m experiments mode_ratio   # those named

The page is out/experiments/index.html.  An experiment that fails is named there, the others
go on, and the exit status is 1.
"""

import subprocess
import sys
import time
from pathlib import Path

from markdown_it import MarkdownIt

from experiments.common import OUT

HERE = Path(__file__).parent
LIMIT = 7200.0
"""Seconds after which an experiment is given up."""

STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0; font-size: 13px }
th, td { border-bottom: 1px solid #ccc; padding: .25em .7em; text-align: left; vertical-align: top }
img { max-width: 100%; margin: 1em 0 }
.failed { color: #b00 }
"""


def experiments() -> list[str]:
    """Names of all experiments: the modules here that have a `main`."""
    return sorted(
        file.stem for file in HERE.glob("*.py") if file.stem != "__main__" and "\ndef main(" in file.read_text("utf-8")
    )


def main(chosen: list[str]) -> int:
    """Run the chosen experiments, or all, and write the page; 1 if one of them failed."""
    unknown = sorted(set(chosen) - set(experiments()))
    if unknown:
        print(f"experiments: found {', '.join(unknown)}, expected some of {', '.join(experiments())}.", file=sys.stderr)
        return 2
    failed = {}
    names = chosen or experiments()
    for number, name in enumerate(names, start=1):
        print(f"\n=== {name} ({number} of {len(names)})", flush=True)
        begun = time.monotonic()
        outcome = run(name)
        print(f"=== {name}: {outcome or 'done'}, {time.monotonic() - begun:.0f} s", flush=True)
        if outcome:
            failed[name] = outcome
    OUT.mkdir(parents=True, exist_ok=True)
    page = OUT / "index.html"
    page.write_text(summary(experiments(), failed), encoding="utf-8")
    print(f"\nSummary: {page}")
    return 1 if failed else 0


def run(name: str) -> str:
    """One experiment in a process of its own; what went wrong, or nothing."""
    try:
        done = subprocess.run([sys.executable, "-m", f"experiments.{name}"], timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return f"gave up after {LIMIT:.0f} s"
    return f"failed with exit status {done.returncode}" if done.returncode else ""


def summary(names: list[str], failed: dict[str, str]) -> str:
    """The page: of each experiment its question, its tables and its figures."""
    parser = MarkdownIt().enable("table")
    parts = ["<h1>pdssjax: experiments</h1>"]
    for name in names:
        question = (HERE / f"{name}.py").read_text("utf-8").split('"""')[1].split("\n", 1)[0]
        parts.append(f'<h2 id="{name}">{name}</h2>' + parser.render(question))
        if name in failed:
            parts.append(f'<p class="failed">{failed[name]}; what follows is of an earlier run, if anything.</p>')
        table = OUT / f"{name}.md"
        if table.exists():
            parts.append(parser.render(table.read_text("utf-8").replace("## ", "### ")))
        figures = sorted(OUT.glob(f"{name}*.png"))
        parts += [f'<a href="{figure.name}"><img src="{figure.name}" alt="{figure.stem}"></a>' for figure in figures]
    body = "\n".join(parts)
    return f'<!doctype html><meta charset="utf-8"><title>pdssjax</title><style>{STYLE}</style>\n{body}\n'


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
