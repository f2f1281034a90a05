"""Mutants of good files: bytes are cut, doubled and replaced, and words and numbers by such as break careless readers."""

from __future__ import annotations

import re
from typing import Final

from hypothesis import strategies as st

from fuzzing.kinds import Seed

WORDS: Final = (
    "0", "-1", "1e300", "-1e300", "1e-300", "5e-324", ".inf", ".nan", "nan", "inf", "0127", "2:07", "0x1F", "1_000", "9" * 400,
    "1,5", "-90", "360", "2147483648", "9007199254740993", "null", "true", "[]", "{}", "''", "!!bool abc", "&a [*a]", "<<",
    "!!python/object/apply:os.system [id]", '"\\ud800"', '"\\u202e"', "[" * 3000, "5 furlong", "9**9**9 m", "1 m**-999",
    "nonsense", "q1", "world", "../../../etc/passwd", "/dev/zero", "<script>alert(1)</script>", "%s%n", "*/",
)  # fmt: skip
BYTES: Final = (
    b"", b"\x00", b"\xff\xfe", b"\xed\xa0\x80", b"\r", b"\n\n", b"\t", b" " * 3000, b'"', b"'", b"#", b"[", b"}", b":", b",",
    b";", b"%", b"<!--", b"\xe2\x80\xae", b"\x7f\xff\xff\xff", b"\xff" * 8, b"\x80" + bytes(7),
)  # fmt: skip
_WORD: Final = re.compile(rb"[\w.+-]+")


@st.composite
def mutants(draw: st.DrawFn, seed: Seed) -> bytes:
    """Return the bytes of a good file with one to three flaws."""
    data = seed.data
    for _ in range(draw(st.integers(1, 3))):
        low = draw(st.integers(0, len(data)))
        word = _WORD.search(data, low)
        if word is not None and draw(st.booleans()):
            data = data[: word.start()] + draw(st.sampled_from(WORDS)).encode() + data[word.end() :]
        else:
            high = min(len(data), low + draw(st.sampled_from((0, 1, 4, 64, len(data)))))
            pieces = (st.sampled_from(BYTES), st.binary(max_size=8), st.just(2 * data[low:high]))
            data = data[:low] + draw(st.one_of(*pieces)) + data[high:]
    return data
