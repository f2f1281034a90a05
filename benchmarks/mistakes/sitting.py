"""Every case is sat by ``truepose check`` in a process and a folder of its own; answers and corrected pairs are kept."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from joblib import Parallel, delayed

from truepose.errors import InputError

from .pairs import found
from .scoring import VERDICTS, Answer, Scored, scored

TIMEOUT = 300.0
EXAMINEE = Path(__file__).with_name("examinee.py")
FAILED = {"exit": 1, "seconds": TIMEOUT, "said": "", "printed": ""}


def sit(drawn: Path, truth: Path, output: Path, jobs: int, progress: Callable[[str], None]) -> list[Scored]:
    """Answers to all drawn cases, scored, in order. Raises InputError where nothing was drawn."""
    keys = sorted((truth / "truth").glob("case*.json"))
    if not keys:
        raise InputError(f"{truth}: found no truth/case*.json, expected cases that were drawn")
    output.mkdir(parents=True, exist_ok=True)
    out: list[Scored] = []
    for one in Parallel(max(jobs, 1), return_as="generator", batch_size=1)(
        delayed(_one)(
            drawn / "cases" / key.stem, key, truth / "right" / key.stem, output / "fixed" / key.stem
        )
        for key in keys
    ):
        progress(f"{one.name}: {one.verdict or 'no answer'}")
        out.append(one)
    return out


def _one(case: Path, key: Path, right: Path, fixed: Path) -> Scored:
    shutil.rmtree(fixed, ignore_errors=True)
    fixed.parent.mkdir(parents=True, exist_ok=True)
    answer = asked(case, fixed)
    return scored(json.loads(key.read_text(encoding="utf-8")), answer, right, fixed)


def asked(case: Path, fixed: Path) -> Answer:
    """``check --json --fix`` on copies of the case's files; what it writes goes to ``fixed``."""
    with tempfile.TemporaryDirectory() as room:
        here = Path(room) / "pair"
        shutil.copytree(case, here)
        machine, tables = found(here)
        out, mended = Path(room) / "out.json", Path(room) / "fixed"
        paths = [str(p) for p in (machine, *tables, mended, out)]
        threads = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}
        start = time.perf_counter()
        said = ""
        try:
            done = subprocess.run(
                [sys.executable, "-P", str(EXAMINEE), *paths],
                cwd=room,
                env=os.environ | threads,
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
                check=False,
            )
            said = (done.stderr.strip().splitlines() or [""])[-1]
        except subprocess.TimeoutExpired:
            said = f"timeout after {TIMEOUT:g} s"
        wall = time.perf_counter() - start
        about = json.loads(out.read_text(encoding="utf-8")) if out.is_file() else FAILED
        if mended.is_dir():
            for path in case.iterdir():  # what a fix need not write again, such as a URDF
                if not (mended / path.name).exists() and path.suffix not in (".yaml", ".csv"):
                    shutil.copy(path, mended)
            shutil.copytree(mended, fixed)
        return _answer(about, said, wall)


def _answer(about: dict[str, object], said: str, wall: float) -> Answer:
    try:
        told = json.loads(str(about["printed"]))
        verdict = told["verdict"] if told["verdict"] in VERDICTS else ""
        entries = tuple(told["found"])
    except (ValueError, KeyError, TypeError):
        verdict, entries = "", ()
    code, seconds = int(str(about["exit"])), float(str(about["seconds"]))
    return Answer(verdict, entries, code, seconds, round(wall, 3), str(about["said"]) or said)


__all__ = ["asked", "sit"]
