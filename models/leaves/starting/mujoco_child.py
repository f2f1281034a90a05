"""MuJoCo in a process of its own: it compiles an MJCF and hands the model over, or says why not; run as a script.

A model of a few lines may ask for any time and memory, and what breaks MuJoCo ends its process. So this one has limits,
and the process that started it goes on. Nothing of truepose is imported here.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

LEAST = 1e-9
"""kg: what a body without mass is given, so that MuJoCo takes it."""


def main() -> None:
    """``mujoco_child.py MODEL SECONDS MIB``: a line of JSON to the standard output, then the model as MJB."""
    path, seconds, mib = sys.argv[1:]
    import mujoco  # before the limits, which are those of the model
    import numpy as np

    _limit(int(seconds), int(mib))
    told: dict[str, Any] = {}
    binary = b""
    mujoco.set_mju_user_warning(warnings.warn)  # it would write a file of them where it works
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            model, told["bare"] = _compiled(path)
            buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
            mujoco.mj_saveModel(model, None, buffer)
            binary = buffer.tobytes()
        except Exception as exc:
            told = {"error": str(exc) or repr(exc)}
    told["warnings"] = [str(one.message) for one in heard]
    sys.stdout.buffer.write(json.dumps(told).encode() + b"\n" + binary)


def _limit(seconds: int, mib: int) -> None:
    """Limits of this process, where the system has them."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_DATA, (mib << 20, mib << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _compiled(path: str) -> tuple[Any, bool]:
    """The model, and whether its meshes were left out because their files were not there."""
    import mujoco

    try:
        return mujoco.MjSpec.from_file(path).compile(), False
    except ValueError as exc:
        if "opening file" not in str(exc) or not Path(path).is_file():
            raise
    return _without_meshes(mujoco.MjSpec.from_file(path)).compile(), True


def _without_meshes(spec: Any) -> Any:
    """The same model without anything that stands in files of its own."""
    import mujoco

    for geom in list(spec.geoms):
        if int(geom.type) in (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD)):
            spec.delete(geom)
    for part in (*spec.meshes, *spec.hfields, *spec.skins, *spec.materials, *spec.textures):
        spec.delete(part)
    spec.compiler.boundmass, spec.compiler.boundinertia = LEAST, LEAST
    return spec


if __name__ == "__main__":
    main()
