"""truepose: calibrate precision robots and find the physics their models leave out.

The names below are all that a script needs; they are imported when first used.
"""

import importlib as _importlib
import typing as _typing
from pathlib import Path as _Path

from truepose.version import VERSION as _VERSION

if _typing.TYPE_CHECKING:
    from truepose.api import (
        calibrate,
        compensate,
        diagnose,
        estimate,
        identifiability,
        predict,
        simulate,
    )
    from truepose.codegen.c import generate
    from truepose.errors import ConvergenceError, InputError, TrueposeError
    from truepose.identification.compensation.inverse import inverse
    from truepose.identification.fit.write_machine import write_calibrated
    from truepose.identification.leaves.check.run import check
    from truepose.identification.leaves.drift.public import drift
    from truepose.identification.leaves.planning.plan import plan
    from truepose.identification.load import load_recording
    from truepose.identification.report.results import diagnosis_json, fit_json
    from truepose.models.effect_text import parse_effect
    from truepose.models.leaves.export.write import export
    from truepose.models.load import load_machine

__version__ = _VERSION

_HERE = _Path(__file__).parent
if not (_HERE / "models").is_dir():  # unpacked or cloned without links: models and its like are beside src
    __path__.append(str(_HERE.parents[1]))

_NAMES = {
    "truepose.api": "calibrate compensate diagnose estimate identifiability predict simulate",
    "truepose.codegen.c": "generate",
    "truepose.errors": "ConvergenceError InputError TrueposeError",
    "truepose.identification.compensation.inverse": "inverse",
    "truepose.identification.fit.write_machine": "write_calibrated",
    "truepose.identification.leaves.check.run": "check",
    "truepose.identification.leaves.drift.public": "drift",
    "truepose.identification.leaves.planning.plan": "plan",
    "truepose.identification.load": "load_recording",
    "truepose.identification.report.results": "diagnosis_json fit_json",
    "truepose.models.effect_text": "parse_effect",
    "truepose.models.leaves.export.write": "export",
    "truepose.models.load": "load_machine",
}
_HOMES = {_name: _home for _home, _names in _NAMES.items() for _name in _names.split()}

__all__ = [
    "ConvergenceError", "InputError", "TrueposeError", "__version__", "calibrate", "check", "compensate", "diagnose",
    "diagnosis_json", "drift", "estimate", "export", "fit_json", "generate", "identifiability", "inverse", "load_machine",
    "load_recording", "parse_effect", "plan", "predict", "simulate", "write_calibrated",
]  # fmt: skip


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'truepose' has no attribute {name!r}")
    try:
        return getattr(_importlib.import_module(_HOMES[name]), name)
    except ModuleNotFoundError as exc:
        if ".leaves." not in _HOMES[name] or not (exc.name or "").startswith("truepose."):
            raise
        raise AttributeError(f"truepose.{name}: its part of truepose is not installed") from None


def __dir__() -> list[str]:
    """The public names, also those that nobody has used yet: what completion offers."""
    return sorted(__all__)
