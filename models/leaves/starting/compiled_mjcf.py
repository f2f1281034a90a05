"""An MJCF as MuJoCo compiles it, in a process of its own with limits (``mujoco_child``)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from truepose.errors import InputError
from truepose.files import read_input
from truepose.models.leaves.starting import mujoco_child
from truepose.wording import cut

if TYPE_CHECKING:
    import mujoco

SECONDS_MOST: Final = 6
"""Seconds of the processor that MuJoCo may take for a model; a humanoid with a hundred meshes takes one."""
MIB_MOST: Final = 1536
"""MiB of memory that MuJoCo may take for a model."""
_NAME: Final = "model.mjb"
PATIENCE: Final = 60.0
"""Seconds by the clock after which it is ended: other work may take most of the processor's time."""


@dataclass(frozen=True)
class Compiled:
    """A model; ``bare``: its meshes were left out as their files were not there; ``warnings`` of MuJoCo."""

    model: mujoco.MjModel
    bare: bool
    warnings: tuple[str, ...] = ()


def compiled(path: Path) -> Compiled:
    """The model of an MJCF. Raises InputError where MuJoCo is missing, refuses the file, or needs too much for it."""
    if find_spec("mujoco") is None:
        raise InputError(
            "--mjcf: MuJoCo reads these files, expected it installed: pip install 'truepose[mjcf]'"
        )
    if not path.is_file():
        raise InputError(f"{path}: cannot read the MJCF: error opening file: found none, expected one")
    if b"<!DOCTYPE" in read_input(path):  # MuJoCo would read its entities as they are written
        raise InputError(f"{path}: found <!DOCTYPE>, expected an MJCF without a document type and entities")
    told, binary = _told(path)
    import mujoco  # here, as what is refused need not wait for it

    model = mujoco.MjModel.from_binary_path(_NAME, {_NAME: binary})
    return Compiled(model, bool(told["bare"]), tuple(cut(one) for one in told["warnings"]))


def _told(path: Path) -> tuple[dict[str, Any], bytes]:
    """What the process says, and the model."""
    words = [mujoco_child.__file__, os.path.abspath(path), str(SECONDS_MOST), str(MIB_MOST)]  # noqa: PTH100
    too_much = f"that MuJoCo needs more than {SECONDS_MOST} s of the processor, expected a smaller model"
    try:
        done = subprocess.run(
            [sys.executable, *words],
            env=os.environ | {"MUJOCO_GL": "disable"},  # nothing is drawn: a quarter of its start
            capture_output=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: cannot read the MJCF: found {too_much}") from None
    try:
        line, _, binary = done.stdout.partition(b"\n")
        told: dict[str, Any] = json.loads(line)
    except ValueError:
        ended = f"that MuJoCo ended with {done.returncode}, expected a model"
        found = too_much if done.returncode in (-24, -9) else ended
        raise InputError(f"{path}: cannot read the MJCF: found {found}") from None
    if "error" in told:
        reason = str(told["error"]).replace(str(Path(words[1]).parent) + os.sep, "")
        raise InputError(f"{path}: cannot read the MJCF: {cut(reason, 600)}")
    return told, binary
