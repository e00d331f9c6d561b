"""Studies, files, stores and options that are damaged at random, from a seed, and what becomes of them.

A script: `python mutants.py KIND FIRST LAST` tries the mutants FIRST to LAST of a KIND in one process.  It writes the
number of each before it is tried, so that whoever reads along knows which one ended the process or keeps it busy, then
"refused", "kept" or "find" with what was raised.  `tests/files/test_mutants.py` reads along.
"""

import contextlib
import io
import json
import random
import re
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import fabricated
import instrument_files
import numpy as np
import study_files

import pdssjax
from pdssjax import InputError
from pdssjax.files import DrawsFile, SweepStore, guess_file, read_covariance, starting_at_estimate, with_estimate
from pdssjax.files.channel_samples import open_file
from pdssjax.files.draws_file import DRAWS
from pdssjax.sweeps import BlockPlan, empty_results

MEMORY = 2 << 30
"""Bytes that the mutants of a process may take beyond what it begins with."""
SECONDS = 20
"""Of processor time that one mutant may take, however busy the machine is."""
ODD = [
    *("", "nan", "-inf", "1e999", "-1", "0", "-0.0", "1e-320", "9" * 400, "0x" + "f" * 5000, "1_0", "true", "[]", "{}"),
    *("\0", "µ步\u202e", '"', "'", "\\", "..", "/", "--", "=", "a=b", "1:2:3", "1:2:0", "0:0:9", ",", "1,,2", "none"),
    *("1 um/V**(9**9**9)", "1e400 Hz", "-86 g", "5 Hz", "10 um", "nan V", "x" * 3000, "[" * 2000, "sobol:-1", "\ud800"),
    *("friction.f_ss=1:2:3", "drive.voltage=nan", "piezo.gain=0", "drive.voltage=1 V", "speed=inf", "displacement=um"),
]
"""In place of numbers and words."""
NUMBER = re.compile(r'"[^"\n]*"|[-+]?\d[\w.+-]*|\b[a-z_]+\b')


class Work(BaseException):
    """Raised where a command would begin to compute."""


def damaged(data: bytes, dice: random.Random) -> bytes:
    """`data` with some bits flipped, some bytes replaced, or a part missing or twice."""
    made = bytearray(data)
    for _ in range(dice.choice([1, 1, 1, 2, 4])):
        place = dice.randrange(len(made) if dice.random() < 0.7 else min(len(made), 2048))
        kind = dice.random()
        if kind < 0.6:
            made[place] ^= 1 << dice.randrange(8)
        elif kind < 0.75:
            made[place] = dice.choice([0, 1, 127, 128, 255])
        elif kind < 0.85:
            made[place : place + 4] = dice.choice([b"\xff" * 4, bytes(4), b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f"])
        elif kind < 0.95:
            other = dice.randrange(len(made))
            made[place : place + 20] = made[other : other + dice.randrange(40)]
        else:
            del made[max(place, 1) :]
    return bytes(made)


def altered(text: str, dice: random.Random) -> bytes:
    """A `text` with words or numbers replaced, lines missing, twice or elsewhere, or damaged bytes."""
    for _ in range(dice.choice([1, 1, 2, 3])):
        kind, lines = dice.random(), text.split("\n")
        if kind < 0.6:
            found = dice.choice(list(NUMBER.finditer(text)) or [re.match("", text)])
            odd = dice.choice([*ODD, found[0] + "0", f'"{found[0]}"', found[0].strip('"')])
            text = text[: found.start()] + odd + text[found.end() :]
        elif kind < 0.85:
            line = lines.pop(dice.randrange(len(lines)))
            for _ in range(dice.choice([0, 1, 2])):
                lines.insert(dice.randrange(len(lines) + 1), line)
            text = "\n".join(lines)
        else:
            return damaged(text.encode(errors="surrogatepass") or b"\n", dice)
    return text.encode(errors="surrogatepass")


def of_studies(folder: Path) -> Callable[[random.Random], None]:
    """Studies and the tables that they name."""
    study_files.write_study(folder)
    pdssjax.files.copy_example(folder / "example")
    texts = [study_files.STUDY, (folder / "example" / "study.toml").read_text()]
    table = (folder / "step.csv").read_text()

    def attempt(dice: random.Random) -> None:
        number = dice.choice([0] * 7 + [1])
        place = [folder, folder / "example"][number] / "mutant.toml"
        spoiled = dice.random() < 0.3 and number == 0
        place.write_bytes(texts[number].encode() if spoiled else altered(texts[number], dice))
        (folder / "step.csv").write_bytes(altered(table, dice) if spoiled else table.encode())
        pdssjax.load_study(place, virtual=dice.random() < 0.1)

    return attempt


def of_files(name: str) -> Callable[[Path], Callable[[random.Random], None]]:
    """Files of the format or dialect `name`, 40 samples long."""
    ending, write = {
        **{text: (".csv", write) for text, write in instrument_files.TEXTS.items()},
        **{scope: (".csv", write) for scope, write in instrument_files.SCOPES.items()},
        **instrument_files.FORMATS,
        "ISF": (".isf", instrument_files.isf),
    }[name]

    def kind(folder: Path) -> Callable[[random.Random], None]:
        whole, file = folder / f"whole{ending}", folder / f"mutant{ending}"
        write(whole)

        def attempt(dice: random.Random) -> None:
            file.write_bytes(damaged(whole.read_bytes(), dice))
            reader = open_file(file)
            by_length: dict[int | None, list[int]] = {}
            for channel in reader.channels():
                by_length.setdefault(channel.samples, []).append(channel.number)
            for numbers in by_length.values():
                for _ in reader.blocks(numbers):
                    pass
            if dice.random() < 0.2:
                guess_file(file, pdssjax.files.Hints({}, {}, {}), pdssjax.files.RigOptions())

        return attempt

    return kind


def of_estimates(folder: Path) -> Callable[[random.Random], None]:
    """estimate.json, beside the study that takes numbers from it."""
    study = pdssjax.load_study(study_files.write_study(folder))
    document = json.loads(pdssjax.files.estimate_text(fabricated.estimate()))
    document["actuator"] = dict(study.models.chosen)
    document["parameters"] = {p: {"value": 0.01, "unit": study.legal()[p].unit} for p in study.parameters}
    whole, file = json.dumps(document, indent=1), folder / "estimate.json"
    readers = [read_covariance, lambda f: with_estimate(study, f), lambda f: starting_at_estimate(study, f)]

    def attempt(dice: random.Random) -> None:
        file.write_bytes(altered(whole, dice))
        dice.choice(readers)(file)

    return attempt


def of_draws(folder: Path) -> Callable[[random.Random], None]:
    """draws.jsonl: what is kept of it is what was drawn."""
    begun, drawn = {"study": 1}, [{"number": number, "free": [number / 7.0, 1e-7]} for number in range(8)]
    made = DrawsFile(folder, resume=False)
    made.begin(begun)
    for entry in drawn:
        made.keep(entry)
    whole = (folder / DRAWS).read_bytes()

    def attempt(dice: random.Random) -> None:
        (folder / DRAWS).write_bytes(damaged(whole, dice))
        kept = DrawsFile(folder, resume=True)
        if kept.begun() == begun:
            assert all(entry in drawn for entry in kept.kept()), "a draw has changed"

    return attempt


def of_sweeps(folder: Path) -> Callable[[random.Random], None]:
    """points.zarr: what is kept of it is what was computed."""
    document, lanes = {"metrics": ["speed"], "study": 1}, 4
    values = np.arange(16.0)[:, None]
    plan = BlockPlan(values, np.arange(len(values)), lanes)
    whole = folder / "whole.zarr"
    store = SweepStore(whole)
    store.open(document, plan)
    found = np.column_stack([values / 7.0, 0.0 * values])
    for number in range(plan.blocks):
        store.keep(number, found[plan.place(number)])
    store.close()
    names = sorted(file.relative_to(whole) for file in whole.rglob("*") if file.is_file())

    def attempt(dice: random.Random) -> None:
        place = folder / "points.zarr"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(whole, place)
        file = place / dice.choice(names)
        if dice.random() < 0.1:
            file.unlink()
        else:
            file.write_bytes((altered if file.suffix == ".json" and dice.random() < 0.5 else _bytes)(_read(file), dice))
        damaged_store = SweepStore(place, resume=True)
        try:
            damaged_store.open(document, plan)
            rows = damaged_store.read()
        finally:
            damaged_store.close()
        missing = np.all(np.isclose(rows, empty_results(1, rows.shape[1]), equal_nan=True), axis=1)
        assert np.array_equal(rows[~missing], found[~missing]), "a point has changed"

    return attempt


def _read(file: Path) -> str:
    return file.read_bytes().decode("latin-1")


def _bytes(text: str, dice: random.Random) -> bytes:
    return damaged(text.encode("latin-1"), dice)


def of_options(folder: Path) -> Callable[[random.Random], None]:
    """The options of every command, up to where it would begin to work."""
    from pdssjax.cli import main as command_line

    study, table = study_files.write_study(folder), folder / "step.csv"
    pdssjax.files.copy_example(folder / "example")
    (folder / "estimate.json").write_text(pdssjax.files.estimate_text(fabricated.estimate()))
    _stop_before_work()
    parser = command_line._parser()
    commands = parser._subparsers._group_actions[0].choices  # type: ignore[union-attr]
    for name in commands:
        command_line._parser([name])
    places = [
        str(study),
        str(folder / "example" / "study.toml"),
        str(table),
        str(folder / "estimate.json"),
        str(folder),
    ]

    def attempt(dice: random.Random) -> None:
        name = dice.choice([*command_line.COMMANDS, "sweep", "new", "characterise"])
        known = command_line._parser([name])._subparsers._group_actions[0].choices[name]._actions  # type: ignore[union-attr]
        words = [
            "lugre",
            "linear",
            "joint",
            "0.1",
            "5 Hz",
            "1",
            "speed",
            "step_V",
            "drive.voltage=20:80:3",
            "2:50:4:log",
        ]
        given = [name, dice.choice([*places[:2], *places])]
        for action in dice.choices(
            [a for a in known if a.option_strings and a.dest != "help"] or known, k=dice.randrange(5)
        ):
            option = dice.choice(action.option_strings or ["--"])
            count = {None: 1, 0: 0, 2: 2, "?": dice.randrange(2), "+": dice.randrange(1, 3)}.get(action.nargs, 1)
            texts = [str(dice.choice([*ODD, *words, *words, *(action.choices or []), *places])) for _ in range(count)]
            given += [f"{option}={texts[0]}"] if texts and dice.random() < 0.3 else [option, *texts]
        if dice.random() < 0.8 and any(action.dest == "out" for action in known):
            given += ["--out", str(folder / "out")]
        silent = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
        with silent[0], silent[1] as said:
            try:
                status = command_line.main(given)
            except Work:
                status = 0
            except SystemExit as end:
                status = end.code or 0
            finally:
                shutil.rmtree(folder / "out", ignore_errors=True)
        assert status in (0, 2, 3), f"status {status} of {given}: {said.getvalue()}"
        assert "Traceback" not in said.getvalue(), given
        if status == 2:
            raise InputError(said.getvalue())

    return attempt


def _stop_before_work() -> None:
    """Where a command would fit, simulate or serve, it ends."""
    import pdssjax.explore
    import pdssjax.files
    import pdssjax.inference
    import pdssjax.study
    import pdssjax.sweeps

    def work(*_: object, **__: object) -> None:
        raise Work

    def plan(study: object, points: object, **how: object) -> None:
        names = ("record", "cycles", "metrics", "derivatives")
        pdssjax.sweeps.plan_sweep(study, points, **{name: how[name] for name in names if name in how})
        raise Work

    # Set past the modules' own look-up, which would load the real ones.
    for module, name in (
        *((pdssjax, "identify"), (pdssjax, "initial_guess"), (pdssjax.inference, "pick_peaks")),
        *((pdssjax.study, "make_recordings"), (pdssjax.sweeps, "find_border")),
        *((pdssjax.sweeps, "cluster_executor"), (pdssjax.explore, "Workbench"), (pdssjax.explore, "serve")),
        *((pdssjax.files, "write_study"), (pdssjax.files, "write_friction_study")),
    ):
        vars(module)[name] = work
    vars(pdssjax)["sweep"] = plan
    pdssjax.study.Study.predict = work  # type: ignore[method-assign]


KINDS: dict[str, Callable[[Path], Callable[[random.Random], None]]] = {
    "studies": of_studies,
    "estimates": of_estimates,
    "draws": of_draws,
    "sweeps": of_sweeps,
    "options": of_options,
    **{
        name: of_files(name)
        for name in (*instrument_files.TEXTS, *instrument_files.SCOPES, *instrument_files.FORMATS, "ISF")
    },
}
"""By name, what makes the attempt of one mutant, in a folder."""
SLOW = ("MATLAB 4", "MATLAB 5", "MATLAB struct")
"""Kinds of which each mutant is read by a process of its own."""


def main(kind: str, first: int, last: int) -> None:
    """Tries the mutants `first` to `last` of a `kind`."""
    pdssjax.prepare_jax()
    for values in ("TIME", "VOLTAGE", "MOTION", "ROWS"):
        setattr(instrument_files, values, getattr(instrument_files, values)[:40])
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        attempt = KINDS[kind](Path(folder))
        with contextlib.suppress(BaseException):
            attempt(random.Random(0))  # loads libraries
        _limit_memory()
        for number in range(first, last):
            sys.stdout.write(f"{number}\n")
            sys.stdout.flush()
            _limit_time()
            try:
                attempt(random.Random(f"{kind} {number}"))
                told = "kept"
            except InputError:
                told = "refused"
            except BaseException as error:  # whatever else is raised is a find
                told = f"find {type(error).__name__} {str(error)[:300]!r}"
                traceback.print_exc(limit=-5)
            sys.stdout.write(f"{told}\n")
            sys.stdout.flush()


def _limit_memory() -> None:
    try:
        import resource

        begun = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except (ImportError, OSError):  # no Linux
        return
    resource.setrlimit(resource.RLIMIT_AS, (begun + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _limit_time() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    soft = int(time.process_time()) + SECONDS
    resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.getrlimit(resource.RLIMIT_CPU)[1]))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
