"""What hostile files hold: values, names and pieces of bytes that break careless readers, and mutation of plain bytes."""

from __future__ import annotations

from random import Random

NUMBERS = (
    "0", "-0", "-1", "1", "1e300", "-1e300", "1e-300", "5e-324", "1e308", "1e309", ".inf", "-.inf", ".nan", "nan", "inf",
    "0127", "2:07", "0x1F", "0b11", "0o17", "1_000", "9" * 400, "-" + "9" * 400, "0." + "0" * 400 + "1", "1e400", "1,5",
    "1e22", "1e-22", "3.14159", "90", "-90", "180", "360", "1e6", "1e9", "2147483648", "9007199254740993", "+5", "1.e5", ".5",
)  # fmt: skip
VALUES = (
    "null", "~", "true", "no", "[]", "{}", "''", "!!bool abc", "!!int x", "!!float x", "!!python/object/apply:os.system [id]",
    "!!binary aGVsbG8=", "!!timestamp 2020-01-01", "!!set {a}", "2026-01-01", "*nowhere", "&a [*a]", "<<", "? x", "|-\n  x",
    '"\\ud800"', '"\\0"', '"\\u202e"', '"\\u2028"', '"\\x1b[31m"', "'a\tb'", '"' + "a" * 5000 + '"', "[[[[[[]]]]]]",
    "[" * 3000 + "]" * 3000, "{a: " * 2000 + "1" + "}" * 2000, '"20um"', '"5 furlong"', '"1 kg"', '"1e400 mm"', '".inf mm"',
    '"9**9**9 m"', '"1 (((9**99*m)**99)**99)"', '"1 m**-999"', '"1 mm/mm"', '"1 degC"', '"1 %"', '"-5 deg"', "nonsense",
    "q1", "q2", "world", "base", "flange", "tool", "../../../etc/passwd", "/dev/zero", "/", '"<script>alert(1)</script>"',
    '"{{ 7*7 }}"', '"%s%n"', '"*/"', '"a\\nb"',
)  # fmt: skip
BYTES = (
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\xed\xa0\x80", b"\xc3\x28", b"\r", b"\r\n", b"\n\n", b"\t", b" " * 3000, b"\x1a",
    b'"', b"'", b"#", b"[", b"]", b"{", b"}", b":", b",", b";", b"%", b"&a ", b"*a", b"<!--", b"]]>", b"\xe2\x80\xae",
    b"\x7f\xff\xff\xff", b"\xff\xff\xff\xff\xff\xff\xff\xff", b"\x80\x00\x00\x00\x00\x00\x00\x00", b"1e999", b"nan", b"-",
)  # fmt: skip


def number(rng: Random) -> str:
    """A hostile number, or one of any size."""
    if rng.random() < 0.5:
        return rng.choice(NUMBERS)
    return f"{rng.choice(('', '-'))}{rng.random() * 10 ** rng.randint(-12, 12):.6g}"


def value(rng: Random) -> str:
    """A hostile value of YAML, as it is written."""
    return number(rng) if rng.random() < 0.5 else rng.choice(VALUES)


def mutated(rng: Random, seed: bytes, other: bytes) -> bytes:
    """Bytes with a few flaws; ``other`` gives pieces."""
    out = seed
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        out = _flawed(rng, out, other)
    return out


def _flawed(rng: Random, seed: bytes, other: bytes) -> bytes:  # noqa: PLR0911 - a flaw a return
    low, high = sorted((_place(rng, seed), _place(rng, seed)))
    if rng.random() < 0.7:
        high = min(high, low + rng.choice((1, 2, 4, 16, 64)))
    piece = seed[low:high]
    kind = rng.randrange(8)
    if kind == 0:
        return seed[:low] + seed[high:]
    if kind == 1:
        return seed[:low] + piece * rng.choice((2, 3, 50)) + seed[high:]
    if kind == 2:
        return seed[:low] + rng.choice(BYTES) + seed[high:]
    if kind == 3:
        return seed[:low] + bytes(rng.randrange(256) for _ in piece) + seed[high:]
    if kind == 4:
        return seed[:low]
    if kind == 5:
        at = _place(rng, other)
        return seed[:low] + other[at : at + 64] + seed[high:]
    if kind == 6:
        return seed[:low] + number(rng).encode() + seed[high:]
    return seed[high:] + seed[:low] if rng.random() < 0.1 else seed[:low] + piece[::-1] + seed[high:]


def _place(rng: Random, data: bytes) -> int:
    return rng.randint(0, len(data))


__all__ = ["BYTES", "NUMBERS", "VALUES", "mutated", "number", "value"]
