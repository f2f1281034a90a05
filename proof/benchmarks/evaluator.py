"""Normal equations of a six-axis arm's calibration, by this project's evaluator and by others: time a pose, memory.

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m benchmarks.evaluator [--most 1000000]

One step of Gauss-Newton needs the sums of J'J and J'r over poses. J (6, 30) is the tool's twist by the 30
constants of the arm (Khalil-Kleinfinger with Hayati's rotation: beta, alpha, d, theta, r of each joint), r the
pose's error [p - p_measured; half the sum of the axes' cross products]. All compute the same sums (printed: largest
difference) in one thread. Memory is the peak of the process above what it had when the inputs were there.
Pinocchio (``pip install pin``) is taken twice, where it can be imported: with the constants as 30 joints, so that all is one
call in C++ a pose, and with six joints, the columns of the constants made of its frames in numpy.
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.codegen.evaluation.gram import GramFunction

Array = NDArray[np.float64]
Sums = Callable[[Array, Array], Array]
"""Joints (n, 6) and measured poses (n, 12), [R by columns, p], to the Gram matrix (31, 31) of [J r]."""
MOTIONS = (("r", 1), ("r", 0), ("t", 0), ("r", 2), ("t", 2))
"""beta about y, alpha about x, d along x, theta about z, r along z."""
MDH = np.array(
    [
        [0.0005, 0.001, 0.4, 0.003, 128.1],
        [-0.0008, 1.572, 0.6, -0.002, 0.3],
        [0.0012, 0.0008, -612.7, 0.005, -0.2],
        [0.0017, -0.0014, -571.9, 0.003, 163.2],
        [-0.0003, 1.567, 0.3, 0.0026, 115.2],
        [0.0007, -1.574, -0.5, 0.007, 92.7],
    ]
)


# -- this project -------------------------------------------------------------------------------------------------


def symbols() -> tuple[list[ca.SX], ca.SX, ca.SX, ca.SX]:
    """Inputs q, y, p; the tool's pose (3, 4); its derivative by screws; r."""
    q, y, p = ca.SX.sym("q", 6), ca.SX.sym("y", 12), ca.SX.sym("p", 30)
    rotation, origin, screws = ca.SX.eye(3), ca.SX.zeros(3), list[tuple[str, ca.SX, ca.SX]]()
    for k, (joint, (kind, axis)) in enumerate(itertools.product(range(6), MOTIONS)):
        along = rotation[:, axis]
        screws.append((kind, along, origin))
        if kind == "t":
            origin = origin + p[k] * along
            continue
        angle = p[k] + q[joint] if axis == 2 else p[k]
        c, s, a, b = ca.cos(angle), ca.sin(angle), rotation[:, (axis + 1) % 3], rotation[:, (axis + 2) % 3]
        turned = {axis: along, (axis + 1) % 3: c * a + s * b, (axis + 2) % 3: c * b - s * a}
        rotation = ca.horzcat(*(turned[j] for j in range(3)))
    columns = [
        ca.vertcat(ca.cross(along, origin - at), along) if kind == "r" else ca.vertcat(along, ca.SX(3, 1))
        for kind, along, at in screws
    ]
    turn = sum((ca.cross(y[3 * k : 3 * k + 3], rotation[:, k]) for k in range(3)), ca.SX.zeros(3))
    residual = ca.vertcat(origin - y[9:], 0.5 * turn)
    return [q, y, p], ca.horzcat(rotation, origin), ca.horzcat(*columns), residual


def ours(compiled: bool) -> Sums:
    """``GramFunction``: compiled, or CasADi's virtual machine with numpy."""
    inputs, _, jacobian, residual = symbols()
    function = GramFunction("arm", inputs, residual, jacobian, rows=10**6 if compiled else 0)
    p = MDH.ravel()

    def sums(q: Array, y: Array) -> Array:
        return function(q, y, p)

    sums(np.zeros((1, 6)), np.zeros((1, 12)))
    engine = "compiled" if function.engine.compiled else "virtual machine"
    sys.stdout.write(f"this project: {engine}\n")
    return sums


# -- others -------------------------------------------------------------------------------------------------------


def by_numpy(q: Array, y: Array, some: int = 512) -> Array:
    """Screws of all poses at once, components in contiguous arrays, some hundred poses at a time."""
    total = np.zeros((31, 31))
    for start in range(0, len(q), some):
        columns = _numpy_columns(q[start : start + some].T, y[start : start + some].T)
        flat = columns.reshape(31, -1)
        total += flat @ flat.T
    return total


def _numpy_columns(q: Array, y: Array) -> Array:
    """(31, 6, n) columns of [J r]."""
    n = q.shape[1]
    axes, origin = [np.repeat(np.eye(3)[:, k : k + 1], n, axis=1) for k in range(3)], np.zeros((3, n))
    out, turning = np.zeros((31, 6, n)), list[tuple[int, Array]]()
    for k, (joint, (kind, axis)) in enumerate(itertools.product(range(6), MOTIONS)):
        along, value = axes[axis], MDH[joint, k % 5]
        if kind == "t":
            out[k, :3] = along
            origin = origin + value * along
            continue
        out[k, 3:] = along
        turning.append((k, origin))
        angle = value + q[joint] if axis == 2 else value
        c, s, a, b = np.cos(angle), np.sin(angle), axes[(axis + 1) % 3], axes[(axis + 2) % 3]
        axes[(axis + 1) % 3], axes[(axis + 2) % 3] = c * a + s * b, c * b - s * a
    for k, at in turning:
        _cross(out[k, 3:], origin - at, out[k, :3])
    out[30, :3] = origin - y[9:]
    turn = np.empty((3, n))
    for k in range(3):
        _cross(y[3 * k : 3 * k + 3], axes[k], turn)
        out[30, 3:] += 0.5 * turn
    return out


def _cross(a: Array, b: Array, out: Array) -> None:
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.subtract(a[i] * b[j], a[j] * b[i], out=out[k])


def by_casadi() -> Sums:
    """CasADi's map over 1,000 poses, which sums the Gram matrices, in its own virtual machine."""
    inputs, _, jacobian, residual = symbols()
    columns = ca.densify(ca.horzcat(jacobian, residual))
    one = ca.Function("one", inputs, [columns.T @ columns])
    maps: dict[int, Any] = {}

    def sums(q: Array, y: Array) -> Array:
        total = np.zeros((31, 31))
        for start in range(0, len(q), 1000):
            part = slice(start, start + 1000)
            n = len(q[part])
            if n not in maps:
                maps[n] = one.map("sums", "serial", n, [2], [0])
            total += maps[n](q[part].T, y[part].T, MDH.ravel()).full()
        return total

    return sums


def _pinocchio_arm(pin: Any, joints: int) -> tuple[Any, int]:
    """The arm, and its tool's frame."""
    model = pin.Model()
    kinds = {("r", 0): "RX", ("r", 1): "RY", ("r", 2): "RZ", ("t", 0): "PX", ("t", 2): "PZ"}
    last, placement = 0, pin.SE3.Identity()
    for joint, (k, motion) in itertools.product(range(6), enumerate(MOTIONS)):
        if joints == 30 or motion == ("r", 2):
            last = model.addJoint(
                last, getattr(pin, f"JointModel{kinds[motion]}")(), placement, f"{joint}{k}"
            )
            placement = pin.SE3.Identity()
        if joints == 6:
            value, unit = MDH[joint, k], np.eye(3)[motion[1]]
            placement = placement * (
                pin.SE3(pin.AngleAxis(value, unit).matrix(), np.zeros(3))
                if motion[0] == "r"
                else pin.SE3(np.eye(3), value * unit)
            )
    return model, model.addFrame(pin.Frame("tool", last, placement, pin.FrameType.OP_FRAME))


def by_pinocchio(joints: int) -> Sums:
    """A pose a call from Python; ``joints`` 30 (the constants are joints) or 6. Raises ImportError without it."""
    pin: Any = importlib.import_module("pinocchio")
    model, tool = _pinocchio_arm(pin, joints)
    data = model.createData()
    turning = np.array([5 * j + 3 for j in range(6)])

    def sums(q: Array, y: Array) -> Array:
        total, columns, configuration = np.zeros((31, 31)), np.zeros((6, 31)), MDH.ravel().copy()
        for joint, measured in zip(q, y, strict=True):
            if joints == 30:
                configuration[turning] = MDH[:, 3] + joint
                columns[:, :30] = pin.computeFrameJacobian(
                    model, data, configuration, tool, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                )
                pin.updateFramePlacement(model, data, tool)
            else:
                pin.framesForwardKinematics(model, data, joint)
                _columns_of_frames(data, tool, joint, columns)
            pose = data.oMf[tool]
            columns[:3, 30] = pose.translation - measured[9:]
            columns[3:, 30] = 0.5 * np.cross(measured[:9].reshape(3, 3), pose.rotation.T).sum(axis=0)
            total += columns.T @ columns
        return total

    return sums


def _columns_of_frames(data: Any, tool: int, q: Array, columns: Array) -> None:
    """Twists by the constants of each link, from the frames of its joint."""
    end = data.oMf[tool].translation
    for joint in range(6):
        here, alpha, d = data.oMi[joint + 1], MDH[joint, 1], MDH[joint, 2]
        c, s, rotation, reached = np.cos(q[joint]), np.sin(q[joint]), here.rotation, here.translation
        along, across = rotation @ np.array([c, -s, 0.0]), rotation @ np.array([s, c, 0.0])
        z = rotation[:, 2]
        beta, origin = np.cos(alpha) * across - np.sin(alpha) * z, reached - d * along
        column = columns[:, 5 * joint : 5 * joint + 5]
        column[3:, 0], column[3:, 1], column[3:, 3] = beta, along, z
        column[:3, 0], column[:3, 1] = np.cross(beta, end - origin), np.cross(along, end - origin)
        column[:3, 2], column[:3, 3], column[:3, 4] = along, np.cross(z, end - reached), z


# -- measuring ----------------------------------------------------------------------------------------------------


def poses(n: int) -> tuple[Array, Array]:
    """Joints at random and measured poses next to the model's."""
    rng = np.random.default_rng(1)
    q = rng.uniform(-2.5, 2.5, (n, 6))
    inputs, pose, _, _ = symbols()
    at = ca.Function("pose", [inputs[0], inputs[2]], [ca.vec(pose)])
    some = at(q[:1000].T, MDH.ravel()).full().T
    y = np.ascontiguousarray(some[np.arange(n) % len(some)])
    q = np.ascontiguousarray(q[np.arange(n) % len(some)])
    return q, y + rng.normal(0, 1e-3, y.shape)


def measured(sums: Sums, q: Array, y: Array) -> tuple[float, float, Array]:
    """Seconds a pose, MB above what was there, result; the best of some calls."""
    result, best, begin = sums(q[:100], y[:100]), np.inf, time.perf_counter()
    above = _peak(lambda: sums(q, y))
    while time.perf_counter() - begin < 1.0 or not np.isfinite(best):
        start = time.perf_counter()
        result = sums(q, y)
        best = min(best, time.perf_counter() - start)
    return best / len(q), above, result


def _peak(run: Callable[[], object]) -> float:
    """MB by which the process grows at its largest; NaN where the system does not tell."""
    status, marks = Path("/proc/self/status"), Path("/proc/self/clear_refs")
    try:
        marks.write_text("5")
    except OSError:
        run()
        return float("nan")

    def tell(word: str) -> float:
        line = next(line for line in status.read_text().splitlines() if line.startswith(word))
        return float(line.split()[1]) / 1024

    before = tell("VmRSS")
    run()
    return tell("VmHWM") - before


def peers() -> Iterator[tuple[str, int, Sums]]:
    """Name, most poses that it is asked for, and the function."""
    yield "this project, compiled", 10**6, ours(True)
    yield "this project, virtual machine", 10**4, ours(False)
    yield "numpy, analytic, vectorised", 10**6, by_numpy
    yield "CasADi map, virtual machine", 10**5, by_casadi()
    for joints in (30, 6):
        try:
            yield f"pinocchio, {joints} joints, Python loop", 10**4, by_pinocchio(joints)
        except ImportError:
            sys.stdout.write("pinocchio: cannot be imported, left out\n")


def main(most: int) -> None:
    """Print the table."""
    everyone = list(peers())
    sizes = [10**k for k in range(2, 7) if 10**k <= most]
    sys.stdout.write(f"{'poses':>9}  {'':36}{'us a pose':>11}{'ratio':>9}{'MB':>9}  difference\n")
    for n in sizes:
        q, y = poses(n)
        reference, unit = np.zeros(0), 0.0
        for name, limit, sums in everyone:
            if n > limit:
                continue
            seconds, above, result = measured(sums, q, y)
            if not reference.size:
                reference, unit = result, seconds
            scale = np.sqrt(np.outer(np.diag(reference), np.diag(reference)))
            difference = float(np.max(np.abs(result - reference) / scale))
            sys.stdout.write(
                f"{n:>9}  {name:36}{seconds * 1e6:11.3f}{seconds / unit:9.1f}{above:9.1f}  {difference:.0e}\n"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--most", type=int, default=10**6, help="largest number of poses")
    main(parser.parse_args().most)
