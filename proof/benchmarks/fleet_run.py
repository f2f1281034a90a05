"""What `truepose fleet` costs: small machines by the thousand, on cores and on Dask, and the page of many records.

    python -m benchmarks.fleet_run draw -n 2000 -o FLEET           # arms of two joints, 16 poses each
    python -m benchmarks.fleet_run ways FLEET -n 24 -o ROOM        # 1 and 2 workers, Dask: processor time, same bytes
    truepose fleet FLEET -o RESULTS --brief                        # all of them
    python -m benchmarks.fleet_run page RESULTS -o ROOM            # the end alone: its time and what is kept for each
    python -m benchmarks.fleet_run page RESULTS -n 10000 -o ROOM   # the same with so many records, drawn from these

Every command prints rows of the tables of `benchmarks/results/fleet_run.md`. The arms' forward kinematics are written out
here; three in ten have a scale error in the first joint, one in ten a play in the second.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.identification.leaves.fleet.record import RECORDS, Record, read_records
from truepose.identification.leaves.fleet.run import end_run, run_fleet
from truepose.identification.leaves.fleet.work import Options
from truepose.pool import Cores, Pool, cluster

Array = NDArray[np.float64]
SIGMA, LENGTH, ANGLE = 0.01, 0.1, 0.0005
MACHINE = f"""schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 300, range: [-170, 170]}}
    - {{name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}}
frames: {{tool: {{in: flange, xyz: [400, 50, 30], tolerance: {{xyz: {LENGTH}}}}}}}
sensor: {{type: position, sigma: {{xyz: {SIGMA}}}}}
tolerances: {{length: {LENGTH}, angle: {np.degrees(ANGLE):.6f}}}
"""
POSES = 16


def draw(count: int, output: Path, seed: int) -> None:
    """Recordings of so many machines, and one machine file for all."""
    output.mkdir(parents=True)
    (output / "machine.yaml").write_text(MACHINE, encoding="utf-8")
    for k in range(count):
        _recording(np.random.default_rng([seed, k])).to_csv(output / f"arm{k:06d}.csv", index=False)


def _recording(rng: np.random.Generator) -> pd.DataFrame:
    q = np.radians([165.0, 85.0]) * rng.uniform(-1.0, 1.0, (POSES, 2))
    side = rng.choice([-1.0, 1.0], (POSES, 2))
    gain = 2e-3 * np.exp(0.3 * rng.standard_normal()) if rng.random() < 0.3 else 0.0
    play = 2e-3 * np.exp(0.3 * rng.standard_normal()) if rng.random() < 0.1 else 0.0
    turn = q * [1.0 + gain, 1.0] - side * [0.0, play / 2] + ANGLE * rng.standard_normal(2)
    up = np.array([0.0, 0.0, 300.0 + LENGTH * rng.standard_normal()])
    out = np.array([100.0 + LENGTH * rng.standard_normal(), 0.0, 0.0])
    tool = np.array([400.0, 50.0, 30.0]) + LENGTH * rng.standard_normal(3)
    first, second = np.array([0.0, -np.pi / 2]) + ANGLE * rng.standard_normal(2)
    elbow = _about_x(second).apply(_about_z(turn[:, 1]).apply(tool)) + out
    point = _about_x(first).apply(_about_z(turn[:, 0]).apply(elbow + up))
    point = point + SIGMA * rng.standard_normal(point.shape)
    columns = {"q1": np.degrees(q[:, 0]), "q2": np.degrees(q[:, 1])}
    columns |= dict(zip("xyz", point.T, strict=True)) | {"approach.q1": side[:, 0], "approach.q2": side[:, 1]}
    return pd.DataFrame(columns)


def _about_x(angle: float) -> Rotation:
    return Rotation.from_euler("x", angle)


def _about_z(angles: Array) -> Rotation:
    return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0]))


def ways(fleet: Path, count: int, room: Path) -> Iterator[str]:
    """The first machines of a fleet on cores and on Dask: processor time of all processes, and whether bytes are the same."""
    from distributed import LocalCluster

    few = room / "fleet"
    few.mkdir(parents=True)
    for file in [fleet / "machine.yaml", *sorted(fleet.glob("*.csv"))[:count]]:
        shutil.copy(file, few)
    first: dict[str, bytes] = {}
    for name in ("1 worker", "2 workers", "Dask, 2 workers"):
        began, used = time.perf_counter(), _processor()
        with ExitStack() as stack:
            pool: Pool = Cores(int(name[0])) if name[0].isdigit() else _local(stack, LocalCluster)
            run_fleet(few, room / name, pool, Options(brief=True))
        wall, own = time.perf_counter() - began, _processor() - used
        files = {
            str(f.relative_to(room / name)): f.read_bytes() for f in (room / name).rglob("*") if f.is_file()
        }
        first = first or files
        same = "yes" if files == first else "NO"
        yield f"| {name} | {count} | {wall:.0f} s | {own / count:.2f} s | {same} ({len(files)} files) |"


def _local(stack: ExitStack, local: type) -> Pool:
    found = stack.enter_context(local(n_workers=2, threads_per_worker=1, dashboard_address=None))
    return stack.enter_context(cluster(found.scheduler_address))


def _processor() -> float:
    """Seconds of this process and of those that ended below it."""
    own, below = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + below.ru_utime + below.ru_stime


def page(results: Path, count: int | None, room: Path) -> str:
    """The end of a run with the records that another left, or with more that are drawn from them."""
    kept = list(read_records(results / RECORDS).values())
    some = kept if count is None else [_another(kept[k % len(kept)], k) for k in range(count)]
    records, folder = {record.name: record for record in some}, room / "results"
    shutil.rmtree(folder, ignore_errors=True)
    began = time.process_time()
    end_run(room / "fleet", folder, records, is_brief=True)
    used = time.process_time() - began
    sizes = {file.name: file.stat().st_size for file in folder.iterdir()}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    told = [f"{used:.1f} s", f"{sizes[RECORDS] / len(records):.0f} bytes"]
    told += [f"{sizes[name] / 1e3:,.0f} kB" for name in ("fleet.csv", "fleet.html")]
    return f"| {' | '.join([f'{len(records):,}', *told, f'{memory:.0f} MB'])} |"


def _another(record: Record, number: int) -> Record:
    """A machine like one of these: other constants, by their 1-sigma, so that no two records are alike."""
    rng = np.random.default_rng(number)
    own = {n: (round(v + s * rng.standard_normal(), 9), s) for n, (v, s) in record.parameters.items()}
    told = dict(record.evidence)
    if told:
        parameters = {
            n: [round(x + e * rng.standard_normal(), 4), e, c] for n, (x, e, c) in told["parameters"].items()
        }
        told["parameters"] = parameters
    key = f"{rng.integers(2**63):064x}"
    changed = {"name": f"arm{number:06d}", "key": key, "parameters": own, "evidence": told}
    return record.model_copy(update=changed)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("draw", "ways", "page"))
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("-n", type=int)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "draw":
        draw(asked.n or 2000, asked.output, asked.seed)
        return
    lines = (
        ways(asked.folder, asked.n or 24, asked.output)
        if asked.what == "ways"
        else iter([page(asked.folder, asked.n, asked.output)])
    )
    for line in lines:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
