"""Commands of the command line run in this process, and errors of input, each in one line."""

from __future__ import annotations

import re
from contextlib import AbstractContextManager

import pytest
from typer.testing import CliRunner, Result

from truepose.cli import app
from truepose.errors import InputError


def invoke(*words: object) -> Result:
    """Run a command with these words, or with those of one text, whatever comes of it."""
    texts = [str(word) for word in words]
    return CliRunner().invoke(app, texts[0].split() if len(texts) == 1 else texts)


def run(*words: object) -> Result:
    """Run a command that succeeds."""
    done = invoke(*words)
    assert done.exit_code == 0, done.output
    return done


def refused(*words: object, said: str = "") -> str:
    """Run a command that is refused in one line, which holds ``said``; return that line."""
    done = invoke(*words)
    assert done.exit_code == 2, done.output
    assert len(done.stderr.strip().splitlines()) == 1 and said in done.stderr, done.stderr
    return done.stderr


def input_error(
    match: str = "", *, says: str = ""
) -> AbstractContextManager[pytest.ExceptionInfo[InputError]]:
    """Expect an error of input that matches a pattern, or says a text."""
    return pytest.raises(InputError, match=match or re.escape(says))
