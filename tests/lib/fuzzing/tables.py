"""Mutation of tables of text by their structure: headers, cells, rows, what stands between them, how they are encoded."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from random import Random

from fuzzing import texts

HEADERS = (
    "", " ", "q1", "x", "x [mm]", "x [furlong]", "x [9**9**9 m]", "x (m)", "x []", "x [[mm]]", "Q1", "time", "session", "pose",
    "from", "role", "approach.q1", "temperature.", "temperature.air [degC]", "temperature.air [K]", "torque.q1", "payload",
    "velocity.q1", "x.sigma", "samples", "<script>", '"><img src=x>', "#", "a" * 4000, "x" + " " * 3000 + "[",
    "\u202ex", "q1\x00",
)  # fmt: skip
CELLS = (
    "",
    " ",
    "text",
    "validation",
    "TRUE",
    "NULL",
    "NaN",
    "1 mm",
    "1,5",
    "1.234,5",
    "--",
    '"',
    "'",
    "=1+1",
    "\u0661",
)


@dataclass
class _Sheet:
    head: list[str]
    rows: list[list[str]]


def mutated(rng: Random, seed: str) -> bytes:
    """The bytes of a table with one flaw or some."""
    lines = [line for line in seed.splitlines() if line and not line.startswith("#")]
    sheet = _Sheet(lines[0].split(","), [line.split(",") for line in lines[1:]])
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        _flaw(rng, sheet)
    return _written(rng, sheet)


def _flaw(rng: Random, sheet: _Sheet) -> None:
    if not sheet.rows or not sheet.head:
        return
    if rng.random() < 0.5:
        _of_cell(rng, sheet)
    elif rng.random() < 0.5:
        _of_row(rng, sheet)
    else:
        _of_column(rng, sheet)


def _of_cell(rng: Random, sheet: _Sheet) -> None:
    row = rng.choice(sheet.rows)
    if row:
        row[rng.randrange(len(row))] = rng.choice(CELLS) if rng.random() < 0.3 else texts.number(rng)


def _of_row(rng: Random, sheet: _Sheet) -> None:
    rows, k, kind = sheet.rows, rng.randrange(len(sheet.rows)), rng.randrange(7)
    if kind == 0:
        del rows[k]
    elif kind == 1:
        rows[k:k] = [list(rows[k]) for _ in range(rng.choice((1, 5, 300)))]
    elif kind == 2:
        rng.shuffle(rows)
    elif kind == 3:
        rows[k] = rows[k][: rng.randrange(len(rows[k]) + 1)]
    elif kind == 4:
        rows[k] = rows[k] + [texts.number(rng)] * rng.choice((1, 2, 500))
    elif kind == 5:
        del rows[rng.choice((0, 1, 2, k)) :]
    else:
        rows[k] = [rng.choice(("#", "", "text", " ", "nan"))] * len(rows[k])


def _of_column(rng: Random, sheet: _Sheet) -> None:
    k, kind = rng.randrange(len(sheet.head)), rng.randrange(7)
    if kind == 0:
        del sheet.head[k]
        for row in sheet.rows:
            del row[k : k + 1]
    elif kind == 1:
        sheet.head[k] = rng.choice(HEADERS)
    elif kind == 2:
        sheet.head[k] = (
            f"{sheet.head[k]} [{rng.choice(('m', 'um', 'deg', 'rad', 'turn', 's', 'K', '1', 'arcsec', 'inch'))}]"
        )
    elif kind == 3:
        cell = texts.number(rng)
        for row in sheet.rows:
            row[k : k + 1] = [cell]
    elif kind == 4:
        factor = 10.0 ** rng.randint(-9, 9)
        for row in sheet.rows:
            row[k : k + 1] = [_scaled(cell, factor) for cell in row[k : k + 1]]
    elif kind == 5:
        sheet.head.append(rng.choice(HEADERS))
        for row in sheet.rows:
            row.append(texts.number(rng))
    else:
        for row in sheet.rows:
            row[k : k + 1] = [""] * len(row[k : k + 1])


def _scaled(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


def _written(rng: Random, sheet: _Sheet) -> bytes:
    separator = rng.choice((",",) * 12 + (";", "\t", " ", "|"))
    end = rng.choice(("\n",) * 12 + ("\r\n", "\r", "\n\n"))
    lines = [separator.join(row) for row in (sheet.head, *sheet.rows)]
    if rng.random() < 0.1:
        lines[0:0] = [
            rng.choice(("# order: shuffled", "# date: 9999-99-99", "sep=;", "#", "# \u202e", "sep=\t"))
        ]
    body = end.join(lines) + end
    if rng.random() < 0.05:
        body = re.sub(r"(\d)\.(\d)", r"\1,\2", body)
    encoding = rng.choice(("utf-8",) * 12 + ("utf-16", "latin-1", "utf-8-sig", "utf-32"))
    data = body.encode(encoding, errors="replace")
    return data + rng.choice((b"",) * 20 + (codecs.BOM_UTF8, b"\x1a", b"\x00" * 50))


__all__ = ["mutated"]
