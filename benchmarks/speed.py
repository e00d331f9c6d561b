"""Measures how fast pdssjax is, beside others: `python -m benchmarks.speed` or `make bench`.

Everything runs in one process, in turns, in double precision; only what starts from a fresh
process does not.  The table goes to the terminal, and with the plot and the JSON to
benchmarks/results.
"""

import argparse
import os
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the jobs, show and keep what they find."""
    options = _parser().parse_args(arguments)
    # To be set before equinox is imported: takes its checks at run time out of every solver.
    os.environ.setdefault("EQX_ON_ERROR", "nan")
    import jax

    from pdssjax import prepare_jax

    # As a program of ours runs, for all that JAX compiles here; but compile times are to be seen.
    prepare_jax(dedicated=True)
    jax.config.update("jax_enable_compilation_cache", False)
    from .jobs import jobs
    from .machine import header, label, load
    from .measure import Effort
    from .plot import draw
    from .table import as_json, as_markdown, as_text

    begun = time.perf_counter()
    report = lambda message: print(f"[{time.perf_counter() - begun:5.0f} s] {message}", file=sys.stderr, flush=True)
    effort = Effort(
        options.rounds, options.longest, not options.no_fits, options.patient, begun + options.budget, report
    )
    head, known = header(), jobs()
    for name in options.job:
        if name not in known:
            print(f"speed: found the unknown job {name}, expected one of {', '.join(known)}", file=sys.stderr)
            return 2
    chosen = options.job or list(known)
    outcomes, seconds = {}, {}
    for name in known:
        if name in chosen:
            started = time.perf_counter()
            outcomes[name] = _tried(known[name], name, effort)
            seconds[name] = round(time.perf_counter() - started)
    outcomes["reference"] = _checked_reference()
    head |= {"load_after": load(), "seconds": round(time.perf_counter() - begun), "seconds_of_jobs": seconds}

    options.out.mkdir(parents=True, exist_ok=True)
    stem = options.out / label(head)
    picture = stem.with_suffix(".png")
    drawn = draw([curve for outcome in outcomes.values() for curve in outcome.curves], picture)
    stem.with_suffix(".json").write_text(as_json(head, outcomes) + "\n", encoding="utf-8")
    markdown = as_markdown(head, outcomes, picture.name if drawn else None)
    stem.with_suffix(".md").write_text(markdown, encoding="utf-8")
    print(as_text(head, outcomes))
    print(f"\nWritten to {stem}.json and beside it, after {head['seconds']} s.")
    return 0


def _tried(measure, name: str, effort):
    """What a job finds; one that fails does not take the others with it, and none begins after the time is up."""
    from .measure import Outcome

    if time.perf_counter() > effort.ends:
        return Outcome([], lines=[f"{name}: left out, the time was up"])
    try:
        return measure(effort)
    except Exception:
        traceback.print_exc()
        return Outcome([], lines=[f"{name}: failed. {traceback.format_exc().strip().splitlines()[-1]}"])


def _checked_reference():
    """How far the reference is from the hand-written stepper in long double."""
    from .measure import Outcome
    from .peers.c_floor import CFloor, simulate
    from .problem import PARAMETERS, Problem, reference

    if reason := CFloor().missing():
        return Outcome([], lines=[f"The reference could not be checked. {reason}"])
    right = reference(Problem())
    values, slopes = simulate(PARAMETERS, Problem(), 1e-13, order=30, jacobian=True, precise=True)
    apart, turned = right.error(values), right.jacobian_error(slopes)
    line = f"reference: {apart:.0e} um from the C stepper in long double, worst Jacobian column {turned:.0e}"
    return Outcome([], facts={"reference": {"error_um": apart, "jacobian_error": turned}}, lines=[line])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__)
    parser.add_argument("job", nargs="*", help="jobs to run, all by default")
    parser.add_argument("--rounds", type=int, default=9, help="rounds of turns (default 9)")
    parser.add_argument("--longest", type=float, default=6.0, help="seconds for one entry's rounds (default 6)")
    parser.add_argument("--budget", type=float, default=720.0, help="seconds after which no job begins (default 720)")
    parser.add_argument("--no-fits", action="store_true", help="leave out the slow fits of the peers")
    parser.add_argument("--patient", action="store_true", help="let the fits of the peers run to their end")
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="DIR", help="folder for the results")
    return parser


if __name__ == "__main__":
    sys.exit(main())
