"""Machines to start from in the package ``robot_descriptions``, which fetches URDF and MJCF files by name."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path

from truepose.errors import InputError
from truepose.models.leaves.starting.start import Start

_PACKAGE = "robot_descriptions"
ENDING = "_description"


def described(name: str) -> bool:
    """Whether a name is of the kind that ``robot_descriptions`` uses."""
    return name.endswith(ENDING)


def described_start(name: str, output: Path, base: str, tip: str, *, written_out: bool) -> Start:
    """The start of a description, whose files are fetched where they are not at hand.

    Raises InputError where the package is missing, knows no such name, cannot fetch it or has no URDF or MJCF of it.
    """
    if importlib.util.find_spec(_PACKAGE) is None:
        raise InputError(
            f"--arm: found {name!r}, a name of the package {_PACKAGE}, expected it installed: "
            "pip install 'truepose[descriptions]'"
        )
    try:
        module = importlib.import_module(f"{_PACKAGE}.{name}")
    except ModuleNotFoundError:
        raise InputError(f"--arm: found {name!r}, expected a name that {_PACKAGE} knows") from None
    except Exception as exc:  # it fetches a repository when it is imported: anything may fail
        reason = " ".join(str(exc).split())[:200]
        raise InputError(f"--arm: {_PACKAGE} could not fetch {name!r}: {reason}") from None
    if hasattr(module, "URDF_PATH"):
        from truepose.models.leaves.starting.urdf import urdf_start

        return urdf_start(Path(module.URDF_PATH), output, base, tip, written_out=written_out)
    if hasattr(module, "MJCF_PATH"):
        from truepose.models.leaves.starting.mjcf import mjcf_start

        return mjcf_start(Path(module.MJCF_PATH), tip)
    raise InputError(
        f"--arm: found no URDF or MJCF in {name!r}, expected one: make a URDF of its xacro and use --urdf"
    )
