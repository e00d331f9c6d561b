"""The command `pdssjax`: its options, and its exit status, which `pdssjax --help` lists."""

import argparse
import contextlib
import importlib
import os
import shlex
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import NoReturn

from ..core import InputError, InputWarning, MiscompilationError, raise_gc_threshold
from .console import LenientStream, announce_warnings, note, replace_unknown_letters, say

COMMANDS = {
    "identify": "estimate an actuator's parameters, with uncertainties, from the records of a study",
    "compare": "fit records under several friction laws or piezos, and find the simplest that predicts as well as any",
    "new": "make a study of files: channels, waveforms, noise and laws guessed, marked and drawn to be checked",
    "report": "one HTML page of a folder of results, to be sent to a colleague",
    "simulate": "predict every record of a study, at its values and starts or at those of an estimate",
    "explore": "an interactive browser page: change a study's numbers, compare prediction and measurement, fit, sweep",
    "channels": "list the channels of files: CSV, MATLAB, TDMS, HDF5, oscilloscopes",
    "characterise": "step efficiency, speed and output force from records alone (thesis, chapter 3)",
    "record": "make the records of a study on a virtual rig, with noise, zeros and rounding, from a seed",
    "sweep": "net step, speed and step efficiency over a grid of drive quantities and parameters",
    "design": "which records to make next, and where their samples go: plan, study, drive files and templates",
    "models": "list the drives, piezos, friction laws, measurements and parts of a rig that a study may name, "
    "or explain one",
    "schema": "print the JSON schema of the study file, with which editors complete and check it",
    "example": "copy the packaged study, as a start for your own",
}
"""What each does, in the order of the help; each has a module beside this one, with its options (`add_options`)."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status; `arguments` default to the process's own."""
    raise_gc_threshold()
    replace_unknown_letters()
    # Of every function that it reads from its cache, XLA logs 2 kB of errors that are none, on processors with AVX-512
    # (jax issue 38445).  What does go wrong raises.  Read when JAX is imported, so not by `prepare_jax`.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    lenient = contextlib.redirect_stderr(LenientStream(sys.stderr))
    with lenient, warnings.catch_warnings(), requests_to_end() as received:
        warnings.simplefilter("always", InputWarning)
        # Plots show a box for a letter that their font does not have.
        warnings.filterwarnings("ignore", r"Glyph .* missing from font", UserWarning)
        warnings.showwarning = announce_warnings(warnings.showwarning)
        try:
            given = sys.argv[1:] if arguments is None else list(arguments)
            _check_values(given)
            options = _parser(given).parse_args(given)
            options.command_line = shlex.join(["pdssjax", *given])
            return options.run(options)
        except (InputError, MiscompilationError, OSError) as error:
            message = str(error)
            # Longer than any name of a file or a column; both ends tell most.
            note(f"error: {message if len(message) <= 2000 else f'{message[:1000]} ... {message[-1000:]}'}")
            return 2
        except KeyboardInterrupt:
            note("interrupted")
            return exit_status(received)


def run() -> int:
    """`main` as a process of its own, which ends at once where it was broken off: other threads may still compile.

    They would be waited for, which takes minutes, or crash Python's orderly end.
    """
    status = main()
    if status > 128:  # by a signal
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    return status


class Terminated(KeyboardInterrupt):
    """The process was asked to end."""


@contextlib.contextmanager
def requests_to_end() -> Iterator[list[int]]:
    """Let SIGTERM and SIGHUP raise `Terminated` in the main thread, as SIGINT raises `KeyboardInterrupt`.

    Does nothing outside the main thread, nor for a signal that has a handler or is ignored (`nohup`).

    **Returns:** the numbers of the signals that came, a list that grows with them.
    """
    received: list[int] = []

    def end(signum: int, frame: object) -> None:
        received.append(signum)
        raise Terminated(signal.Signals(signum).name)

    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    ours: list[int] = []
    try:
        with contextlib.suppress(ValueError):  # outside the main thread; to ask whether it is loads `threading`
            for number in signals:
                if signal.getsignal(number) is signal.SIG_DFL:
                    signal.signal(number, end)
                    ours.append(number)
        yield received
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def exit_status(received: Sequence[int]) -> int:
    """128 and the number of the first signal `received`, as shells count: 143 for SIGTERM, 130 for none but Ctrl-C."""
    return 128 + (received[0] if received else signal.SIGINT)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        text = f"option {message.removeprefix('argument ')}" if message.startswith("argument -") else message
        raise InputError(text if text.endswith(".") else f"{text} (see {self.prog} --help)")


def _check_values(given: Sequence[str]) -> None:
    """Refuse "--" as the value of an option, which argparse takes away without a look, and a NUL, which no file has."""
    for argument in given:
        if "\0" in argument:
            raise InputError(f"argument {argument!r:.80}: found a NUL character, expected none.")
        if argument == "--":
            return
        name, equals, value = argument.partition("=")
        if name.startswith("--") and equals and value == "--":
            raise InputError(f'option {name}: found "--", expected a value.')


class _Version(argparse.Action):
    """Prints the version; what tells it is imported only then."""

    def __call__(self, parser: argparse.ArgumentParser, *rest: object) -> None:
        from importlib.metadata import version

        say(f"pdssjax {version('pdssjax')}")
        parser.exit()


def _parser(given: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """The parser with all commands and options; with one command alone where the arguments `given` begin with it."""
    asked = list(COMMANDS) if given is None else [name for name in given[:1] if name in COMMANDS]
    parser = _Parser(
        prog="pdssjax",
        description="Models and identifies piezoelectric stick-slip actuators.",
        epilog="Exit status: 0 success; 2 invalid input, or a JAX that computes wrongly; 3 a fit did not converge or "
        "does not explain its records (its result is written), or no model, sweep point or record could be computed; "
        "4 results could not be written where asked; 130, 143 or 129 interrupted, terminated or hung up: a fit leaves "
        "its best point so far in estimate.json.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subcommands = parser.add_subparsers(required=True, metavar="COMMAND", prog=parser.prog)
    for name in asked or COMMANDS:
        text = COMMANDS[name]
        command = subcommands.add_parser(name, help=text, description=text)
        if asked:
            importlib.import_module(f"{__package__}.{name}").add_options(command)
    return parser
