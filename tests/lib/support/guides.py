"""How the tutorial and the how-tos are tried: their commands run in order, and what they show is what was printed.

A fence ``text`` after commands shows a part of what they print: words must be the same, numbers nearly so, line breaks
do not count, and ``[...]`` stands for what was left out.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from support.documents import blocks
from truepose.cli import app

LEFT_OUT = "[...]"
PRINTED_WITH = "2.4"
"""numpy when the pages were printed. Another one rounds otherwise, a plan ends elsewhere on its flat top, and what is read
there are other numbers: then words are compared alone."""
SAME_NUMBERS = np.__version__.startswith(f"{PRINTED_WITH}.")
NEARLY, DIGITS = 0.1, 2
"""How far a number may be from the one shown, of its size, and in its last decimal: other processors round otherwise, so that
a plan ends elsewhere on its flat top there, too."""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def run_page(page: Path, folder: Path) -> None:
    """Run every command of a page in a folder that holds its files (and is the working directory)."""
    printed = ""
    for block in blocks(page):
        if block.language == "sh":
            commands = block.text.replace("\\\n", " ").splitlines()
            printed = "\n".join(run(command, folder) for command in commands)
        elif block.language == "text":
            assert shown(block.text, printed, SAME_NUMBERS), (
                f"{page.name} shows\n{block.text}\nprinted was\n{printed}"
            )


def run(command: str, folder: Path) -> str:
    """What a command prints. Those of truepose run in this process; python is this interpreter."""
    program, *rest = shlex.split(command)
    if program == "truepose":
        result = CliRunner().invoke(app, rest)
        assert result.exit_code == 0, f"{command}\n{result.output}"
        return result.output
    found = [sys.executable if program == "python" else program, *rest]
    done = subprocess.run(found, cwd=folder, capture_output=True, text=True, check=False, env=os.environ)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def shown(text: str, printed: str, numbers: bool = True) -> bool:
    """Whether the parts of a text stand in what was printed, in their order; ``numbers``: nearly the same there."""
    words, at = printed.split(), 0
    for part in text.split(LEFT_OUT):
        wanted = part.split()
        places = range(at, len(words) - len(wanted) + 1)
        end = next((k + len(wanted) for k in places if _alike(wanted, words[k:], numbers)), None)
        if end is None:
            return False
        at = end
    return True


def _alike(wanted: Sequence[str], words: Sequence[str], numbers: bool) -> bool:
    return all(a == b or _same(a, b, numbers) for a, b in zip(wanted, words, strict=False))


def _same(wanted: str, word: str, numbers: bool) -> bool:
    """The same but for numbers, and these nearly the same, or any where they are no part of a name."""
    rest = _NUMBER.sub("#", wanted)
    if rest != _NUMBER.sub("#", word):
        return False
    if not numbers and not any(sign.isalpha() for sign in rest):
        return True
    pairs = zip(_NUMBER.findall(wanted), _NUMBER.findall(word), strict=True)
    return all(abs(float(a) - float(b)) <= _room(a) for a, b in pairs)


def _room(number: str) -> float:
    """How far another number may be from this one."""
    value = Decimal(number)
    last = 10.0 ** int(value.as_tuple().exponent) if "." in number else 0.0
    return max(NEARLY * abs(float(value)), DIGITS * last)
