"""Messages of errors: of bounded length, and nothing in them drives a terminal."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import TrueposeError

LONGEST, BETWEEN = 1500, " [...] "


@given(st.text(max_size=40), st.integers(1, 400))
def test_a_message_can_be_shown(text: str, times: int) -> None:
    said = str(TrueposeError(text * times))
    assert len(said) <= LONGEST + len(BETWEEN)
    assert all(c.isprintable() or c == "\n" for c in said)


@given(st.text(st.characters(categories=["L", "N", "P"], include_characters=" \n"), max_size=LONGEST))
def test_one_that_can_be_shown_is_said_as_it_is(text: str) -> None:
    assert str(TrueposeError(text)) == text


def test_a_long_one_keeps_its_beginning_and_its_end() -> None:
    text = "".join(chr(ord("a") + k % 26) for k in range(LONGEST + 1))
    assert str(TrueposeError(text)) == text[: LONGEST // 2] + BETWEEN + text[-LONGEST // 2 :]
    assert str(TrueposeError("\x1b[31m")) == "\\x1b[31m"
