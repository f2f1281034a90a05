"""``python -m benchmarks.many_rows.texts 1000000``: how long texts of each form take to read, and the memory, as a table.

The rows are those of the arm, with a label. Each file is read in a process of its own, and all its numbers and labels
are asked for; memory is the largest that the process held, of it what its imports take.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
from many_rows.arm import write

from truepose.errors import InputError
from truepose.identification.recording.table import Table, read_table

LABELLED = 1000
"""Rows that have one label."""
_LABEL, _POINT = re.compile(r"stop\d+"), re.compile(r"(?<=\d)\.(?=\d)")


def _quoted(text: str) -> str:
    return "".join(f'"{line}"\n'.replace(",", '","') for line in text.splitlines())


def _labels(written: str) -> Callable[[str], str]:
    return lambda text: _LABEL.sub(written, text)


def _commented(text: str) -> str:
    return re.sub(r"((?:.*\n){10})", "\\1# the beam was lost\n\n", text)


def _with_commas(separator: str) -> Callable[[str], str]:
    return lambda text: _POINT.sub(",", text.replace(",", separator))


FORMS: Mapping[str, Callable[[str], str]] = {
    "plain": lambda text: text,
    "all cells in quotes": _quoted,
    "separators and quotes within quotes": _labels(r'"\g<0>, ""upper"""'),
    "line ends within quotes": _labels('"\\g<0>\nupper"'),
    "comments and empty lines between rows": _commented,
    "decimal commas between semicolons": _with_commas(";"),
    "decimal commas between tabs": _with_commas("\t"),
    "decimal commas in quotes": lambda text: _POINT.sub(",", _quoted(text)),
    "spaces": lambda text: text.replace(",", "  "),
    "decimal commas between spaces": _with_commas("  "),
}
"""How plain rows, cells apart by commas, are written in each form."""


def plain_text(recording: Path) -> Iterator[str]:
    """A recording's header, then its rows, some at a time."""
    done = 0
    with pq.ParquetFile(recording) as file:
        yield ",".join([*file.schema_arrow.names, "note"]) + "\n"
        for batch in file.iter_batches(50_000):
            labels = pa.array([f"stop{k}" for k in np.arange(done, done + len(batch)) // LABELLED])
            stream = io.BytesIO()
            options = pacsv.WriteOptions(include_header=False, quoting_style="none")
            pacsv.write_csv(pa.Table.from_batches([batch.append_column("note", labels)]), stream, options)
            done += len(batch)
            yield stream.getvalue().decode()


def measured(path: Path) -> dict[str, float]:
    """What reading took, in a process of its own."""
    paths = os.pathsep.join([str(Path(__file__).resolve().parents[2]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.many_rows.texts", "--file", str(path)]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    return dict(json.loads(done.stdout))


def read(path: Path) -> dict[str, float]:
    """Read one file: rows, seconds of the processor, GB at most and before."""
    before, began = _gigabytes(), time.process_time()
    found = read_table(path)
    for name in found.names:
        _asked(found, name)
    return {
        "rows": found.n_rows,
        "processor": time.process_time() - began,
        "gigabytes": _gigabytes(),
        "before": before,
    }


def _asked(found: Table, name: str) -> None:
    try:
        found.readings(name)
    except InputError:
        found.texts(name)


def _gigabytes() -> float:
    """The largest memory so far, of this program only: what ``resource`` tells begins at that of the process before it."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(re.findall(r"VmHWM:\s*(\d+) kB", status)[0]) / 2**20


def table(rows: int, folder: Path) -> str:
    """Every form written, read and removed, a line each."""
    lines = ["| text | size, MB | processors, s | memory, GB | of it imports, GB |", "|" + "---|" * 5]
    _, recording = write(rows, folder)
    for form, written in FORMS.items():
        path = folder / "rows.csv"
        with path.open("w", encoding="utf-8", newline="") as stream:
            stream.writelines(map(written, plain_text(recording)))
        found = measured(path)
        if found["rows"] != rows:
            raise AssertionError(f"{form}: found {found['rows']} rows, expected {rows}")
        lines.append(
            f"| {form} | {path.stat().st_size / 1e6:.0f} | {found['processor']:.1f} "
            f"| {found['gigabytes']:.2f} | {found['before']:.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table, or what reading one file took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=int, nargs="?", default=1_000_000)
    parser.add_argument("--file", type=Path, help="read this file only")
    asked = parser.parse_args()
    if asked.file:
        sys.stdout.write(json.dumps(read(asked.file)) + "\n")
        return
    with tempfile.TemporaryDirectory() as folder:
        sys.stdout.write(table(asked.rows, Path(folder)) + "\n")


if __name__ == "__main__":
    main()
