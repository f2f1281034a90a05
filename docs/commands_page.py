"""``reference/commands.md``, made from the commands themselves: what ``truepose COMMAND --help`` says, as a page.

Run it after a command or an option was added or described anew:

    python docs/commands_page.py
"""

from __future__ import annotations

import inspect
import re
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, get_args

from typer.models import ArgumentInfo, CommandInfo, OptionInfo

from truepose.cli import app

ROOT: Final = Path(__file__).resolve().parent.parent
PAGE: Final = ROOT / "docs/reference/commands.md"
COMMON: Final = ("as_json", "plugin")
"""Options that stand once, above all commands."""
SHARED: Final = 3
"""Arguments and options that so many commands have, with the same words, stand once, too."""
HEAD: Final = """# Commands

Made from the code by `python docs/commands_page.py`; `truepose COMMAND -h` prints the same. All commands have:

| option | meaning |
|---|---|
"""
SEVERAL: Final = """
Several commands have these; a command's usage says which:

| argument or option | meaning |
|---|---|
"""
CODES: Final = """
| exit code | meaning |
|---|---|
| 0 | done |
| 1 | a fault of truepose itself: the line names a report in the folder for temporary files |
| 2 | bad input: one line says what was found and what was expected; or a fit that is no calibration, whose files say so first |
| 3 | the fit did not converge: the parameters responsible are named, and nothing is written |
| 130 | stopped by Ctrl-C or SIGTERM |
"""
_EXAMPLE: Final = re.compile(r": (truepose .+)$")
_VALUES: Final = {int: "N", float: "X", str: "TEXT"}


@dataclass(frozen=True)
class Parameter:
    """An argument or an option of a command, as its function declares it."""

    name: str
    kind: Any
    info: ArgumentInfo | OptionInfo
    default: Any

    @property
    def is_option(self) -> bool:
        return isinstance(self.info, OptionInfo)

    @property
    def needed(self) -> bool:
        return self.default is inspect.Parameter.empty

    @property
    def value(self) -> str:
        """What stands for its value; empty for a switch."""
        return str(self.info.metavar or ("" if self.kind is bool else _VALUES.get(self.kind, "FILE")))

    @property
    def used(self) -> str:
        """As the usage of a command has it."""
        if not self.is_option:
            return self.value
        told = " ".join(filter(None, (self.flags[0], self.value)))
        return told if self.needed else f"[{told}]"

    @property
    def flags(self) -> tuple[str, ...]:
        first = self.info.default  # typer takes what stands first for the default until it knows better
        told = (*((first,) if isinstance(first, str) else ()), *(self.info.param_decls or ()))
        return tuple(told) or (f"--{self.name.replace('_', '-')}",)


def page() -> str:
    """The whole page."""
    commands = {_name(info): info.callback for info in offered() if info.callback}
    known = [p for command in commands.values() for p in _parameters(command)]
    everywhere = {p.name: _row(p) for p in known if p.name in COMMON}
    common = [everywhere[name] for name in COMMON]
    helped = "| `-h`, `--help` | Show the help of the command and exit. |"
    counted = Counter(_row(p) for p in known if p.name not in COMMON)
    several = sorted((row for row, times in counted.items() if times >= SHARED), key=lambda row: "`-" in row)
    sections = [_section(name, command, several) for name, command in commands.items()]
    tables = HEAD + _lines([*common, helped]) + SEVERAL + _lines(several) + CODES
    return tables + "\n" + "\n\n".join(sections) + "\n"


def offered() -> list[CommandInfo]:
    """The commands that ``truepose --help`` lists: what has moved away is hidden."""
    return [info for info in app.registered_commands if not info.hidden]


def _lines(rows: Sequence[str]) -> str:
    return "\n".join(rows) + "\n"


def _name(info: Any) -> str:
    return str(info.name or info.callback.__name__)


def _parameters(command: Callable[..., Any]) -> list[Parameter]:
    out = []
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        kind, *more = get_args(parameter.annotation)
        info = next(one for one in more if isinstance(one, ArgumentInfo | OptionInfo))
        out.append(Parameter(name, kind, info, parameter.default))
    return sorted(out, key=lambda p: p.is_option)


def _section(name: str, command: Callable[..., Any], several: Sequence[str]) -> str:
    text, examples = _told(inspect.getdoc(command) or "")
    told = [p for p in _parameters(command) if p.name not in COMMON]
    own = [p for p in told if _row(p) not in several]
    words = [p.used for p in told if p.needed or not p.is_option or p not in own]
    more = ["[OPTIONS]"] if any(p.is_option and not p.needed for p in own) else []
    usage = " ".join(["truepose", name, *words, *more])
    lines = [f"## {name}", "", text, "", f"Usage: `{usage}`", "", "```sh", *examples, "```"]
    if own:
        lines += ["", "| argument or option | meaning |", "|---|---|", *map(_row, own)]
    return "\n".join(lines)


def _told(text: str) -> tuple[str, list[str]]:
    """The description without its examples, and the examples."""
    said, examples = [], []
    for line in text.replace("``", "`").splitlines():
        example = _EXAMPLE.search(line)
        if example:
            examples += [part.strip() for part in example[1].split(";")]
        else:
            said.append(line)
    return re.sub(r"\n{3,}", "\n\n", "\n".join(said)).strip().replace("<", "&lt;"), examples


def _row(parameter: Parameter) -> str:
    value = f"`{parameter.value}`" if parameter.value else ""
    flags = ", ".join(f"`{flag}`" for flag in parameter.flags) if parameter.is_option else ""
    needed = " **Needed.**" if parameter.is_option and parameter.needed else _default(parameter.default)
    cells = (" ".join(filter(None, (flags, value))), f"{parameter.info.help or ''}{needed}")
    return "| " + " | ".join(" ".join(cell.replace("|", "\\|").split()) for cell in cells) + " |"


def _default(value: Any) -> str:
    """The default, where there is one to tell."""
    if isinstance(value, bool) or value in (None, "", (), inspect.Parameter.empty):
        return ""
    plain = f"{value:g}" if isinstance(value, float) else str(value)
    return f" Default: `{plain}`."


def main() -> None:
    """Renew the page."""
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"{PAGE.relative_to(ROOT)}: {len(offered())} commands\n")


if __name__ == "__main__":
    main()
