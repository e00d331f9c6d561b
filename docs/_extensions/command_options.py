"""The options of a command as Markdown, as its parser has them."""

import argparse

from pdssjax.cli.main import _parser


def commands() -> dict[str, argparse.ArgumentParser]:
    """The parsers of all commands, by name."""
    (choice,) = [a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction)]
    return choice.choices


def rows(parser: argparse.ArgumentParser) -> list[str]:
    """A table of arguments and options with what they mean."""
    lines = ["| | |", "|---|---|"]
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction):
            continue
        said = _value(action)
        shown = ", ".join(action.option_strings) + (f" {said}" if said else "") if action.option_strings else said
        text = ((action.help or "") % vars(action)).replace("|", "\\|")
        lines.append(f"| `{shown.replace('|', chr(92) + '|')}` | {text} |")
    return lines


def _value(action: argparse.Action) -> str:
    """What follows an option."""
    if action.nargs == 0:
        return ""
    if action.metavar is not None:
        told = action.metavar
    elif action.choices is not None:
        told = "{" + ",".join(map(str, action.choices)) + "}"
    else:
        told = action.dest.upper()
    shown = " ".join(told) if isinstance(told, tuple) else told
    more = {"+": f"{shown} [{shown} ...]", "*": f"[{shown} ...]", "?": f"[{shown}]"}
    return more.get(str(action.nargs), shown)
