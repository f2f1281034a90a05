"""What every command shares: options, folders of results, errors as one line with an exit code, notes, summaries."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.commands.one_line import BAD_INPUT, NOT_CONVERGED, forget, say
from truepose.commands.progress import progress
from truepose.errors import ConvergenceError, InputError, TrueposeError
from truepose.files import check_place

if TYPE_CHECKING:
    from truepose.identification.fit.summary import Judgement
    from truepose.identification.load import Caution
    from truepose.identification.recording.recording import Recording
    from truepose.models.machine.machine import Machine

__all__ = ["BAD_INPUT", "NOT_CONVERGED", "progress"]
"""What commands take from here beside what is defined here."""

MachineArg = Annotated[Path, typer.Argument(metavar="MACHINE", help="Machine file (YAML).")]
RecordingArg = Annotated[
    Path, typer.Argument(metavar="RECORDING", help="Recording (text, Parquet, Excel or a ROS bag).")
]
RecordingsArg = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING...", help="One or several recordings (text, Parquet, Excel or ROS bags)."
    ),
]
DirectoryOption = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Directory for the results.")
]
FileOption = Annotated[
    Path, typer.Option("-o", "--output", metavar="FILE", help="File to write (.csv or .parquet).")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")
]
AnywayOption = Annotated[
    bool,
    typer.Option(
        "--anyway",
        help="Go on where the file is no calibration, or would leave the tool worse than a plain one.",
    ),
]
GateOption = Annotated[
    bool,
    typer.Option(
        "--anyway", help="Go on although 'truepose check' says that the files do not belong together."
    ),
]
ShuffledOption = Annotated[
    bool,
    typer.Option(
        "--shuffled",
        help="Rows are no visits one after the other: nothing is looked for that depends on how joints came to a row.",
    ),
]
PluginOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE",
        help="Python file that registers effects, sensors or builders; repeatable.",
    ),
]


@contextlib.contextmanager
def reported(plugins: Sequence[Path] | None = None) -> Iterator[None]:
    """Load plugins, run the block, and turn an error a user can mend into one line and an exit code."""
    from truepose.models.registry import load_plugin, plugin_fault

    try:
        for path in plugins or ():
            load_plugin(path)
        yield
    except ConvergenceError as exc:
        fail(str(exc), NOT_CONVERGED)
    except TrueposeError as exc:
        fail(str(exc), BAD_INPUT)
    except Exception as exc:
        words = plugin_fault(exc) if plugins else None
        if words is None:
            raise
        fail(words, BAD_INPUT)


def gated(
    machine: Path,
    recordings: Sequence[Path],
    *,
    irradiance: Sequence[Path] = (),
    anyway: bool = False,
    tried: Sequence[str] | None = None,
    shuffled: bool = False,
) -> tuple[Machine, Recording, Caution]:
    """Load and check files (``truepose.identification.load.load_checked``).

    Raises InputError where the check is certain of a mistake.

    With ``anyway`` what was found stands above the result; a file without a sensor is refused all the same.
    """
    from truepose.identification.load import load_checked

    caution, loaded, rows = load_checked(
        machine, recordings, irradiance=irradiance, tried=tried, shuffled=shuffled
    )
    if loaded is None or rows is None or (caution.refusal and not anyway):
        raise InputError(f"{machine}: {caution.refusal}")
    return loaded, rows, caution


def refuse(judgement: Judgement, output: Path, *, as_json: bool) -> None:
    """Exit with 2 and one line on standard error where a result is no calibration; its files are there to be looked at."""
    if judgement.calibrated:
        return
    why = judgement.refusal if as_json else "not calibrated, for the reason above"
    fail(f"{why}; {output} holds it to be looked at: no command applies it without --anyway", BAD_INPUT)


def fail(message: str, code: int) -> None:
    """One line on standard error, then out."""
    say(message)
    raise typer.Exit(code)


def tell(text: str, *, nl: bool = True) -> None:
    """Write text on standard output. Where nobody reads on the command goes on: its files and exit code say enough."""
    try:
        typer.echo(text, nl=nl)
    except BrokenPipeError:
        forget(sys.stdout)


def note(text: str) -> None:
    """A line on standard error, if anybody can read it."""
    with contextlib.suppress(OSError):
        typer.echo(text, err=True)


def finish(summary: Mapping[str, Any], lines: Iterable[str], notes: Iterable[str], *, as_json: bool) -> None:
    """The end of a command: the JSON summary alone, or plain lines with notes on standard error."""
    if as_json:
        from truepose.identification.report.json_text import json_text

        tell(json_text({**summary, "notes": list(notes)}), nl=False)
        return
    for text in notes:
        note(f"note: {text}")
    tell("".join(f"{line}\n" for line in lines), nl=False)


def check_file(path: Path, *inputs: Path | None) -> None:
    """Refuse at once an output that cannot be a file, or that is one of the files that are read. Raises InputError."""
    if _is(Path.is_dir, path):
        raise InputError(f"{path}: expected a file to write, found a directory")
    check_place(path, "file")
    if not _is(Path.is_dir, path.parent):
        raise InputError(f"{path}: cannot write the file: its directory does not exist")
    for one in inputs:
        if one is not None and _is(Path.is_file, path) and _is(Path.exists, one) and path.samefile(one):
            raise InputError(f"{path}: found the file {one}, which is read, expected another one to write")


def _is(what: Callable[[Path], bool], path: Path) -> bool:
    """False, too, where the system will not tell: `check_place` says why."""
    try:
        return what(path)
    except (OSError, ValueError):
        return False


def pairs(option: str, texts: Iterable[str], expected: str) -> dict[str, str]:
    """Return what a repeatable option says, ``NAME=VALUE`` each. Raises InputError that shows ``expected`` for another text."""
    out = {}
    for text in texts:
        name, _, value = (word.strip() for word in text.partition("="))
        if not name or not value:
            raise InputError(f"{option}: found {text!r}, expected {expected}")
        out[name] = value
    return out


def written(directory: Path, names: Iterable[str]) -> list[str]:
    """Paths of the files written, as text."""
    return [str(directory / name) for name in names]


FIT, DIAGNOSIS, DRIFT, FLEET = "fit.json", "diagnosis.json", "drift.json", "fleet.json"
WRITERS = {FIT: "calibrate", DIAGNOSIS: "diagnose", DRIFT: "drift", FLEET: "fleet"}
"""Commands that write a report.html or a folder of machines, by the file that tells that it is theirs."""
CODE = "_kin.h"


def check_directory(path: Path, own: str = "") -> None:
    """Refuse at once what could only fail after the work: a file in the directory's place, another command's result there.

    ``own``: the file of ``WRITERS`` that the command writes. Raises InputError.
    """
    for place in (path, *path.parents):
        with contextlib.suppress(OSError, ValueError):  # `check_place` says why
            if place.exists():
                if not place.is_dir():
                    raise InputError(f"{path}: expected a directory for the results, found the file {place}")
                break
    check_place(path, "directory")
    others = [name for name in WRITERS if own and name != own and (path / name).is_file()]
    if others:
        _refuse(
            path, f"{others[0]}, a result of truepose {WRITERS[others[0]]}", f"one of truepose {WRITERS[own]}"
        )


def check_machine(path: Path, own: str, name: str) -> None:
    """Refuse a folder that holds the same command's result of another machine. Raises InputError."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        held = json.loads((path / own).read_text(encoding="utf-8"))["machine"]
        if held != name:
            _refuse(path, f"a result of the machine {held!r}", f"one of {name!r}")


def check_code(path: Path, name: str) -> None:
    """Refuse a folder that holds another machine's C. Raises InputError."""
    others = sorted(file.name for file in path.glob(f"*{CODE}") if file.name != f"{name}{CODE}")
    if others and not (path / f"{name}{CODE}").exists():
        _refuse(path, f"{others[0]}, another machine's code", f"one of {name!r}")


def _refuse(path: Path, found: str, expected: str) -> None:
    raise InputError(
        f"{path}: found {found}, expected an empty folder or {expected}; nothing is overwritten: give another folder with -o,"
        " or delete this one"
    )
