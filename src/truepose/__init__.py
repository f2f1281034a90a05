"""truepose: calibrate precision robots and find the physics their models leave out.

The names below are all that a script needs; they are imported when first used.
"""

import importlib as _importlib
import typing as _typing
from pathlib import Path as _Path

from truepose.version import VERSION as _VERSION

if _typing.TYPE_CHECKING:
    from truepose.codegen.c import generate
    from truepose.errors import ConvergenceError, InputError, TrueposeError
    from truepose.identification.compensation.compensate import compensate
    from truepose.identification.compensation.inverse import inverse
    from truepose.identification.diagnosis.diagnose import diagnose
    from truepose.identification.fit.calibrate import calibrate
    from truepose.identification.fit.estimate import estimate
    from truepose.identification.fit.write_machine import write_calibrated
    from truepose.identification.identifiability.analysis import identifiability
    from truepose.identification.leaves.check.run import check
    from truepose.identification.leaves.drift.analysis import drift
    from truepose.identification.leaves.planning.plan import plan
    from truepose.identification.load import load_recording
    from truepose.identification.prediction.predict import predict
    from truepose.identification.prediction.simulate import simulate
    from truepose.identification.report.results import diagnosis_json, fit_json
    from truepose.models.effect_text import parse_effect
    from truepose.models.leaves.export.write import export
    from truepose.models.load import load_machine

__version__ = _VERSION

_HERE = _Path(__file__).parent
if not (_HERE / "models").is_dir():  # unpacked or cloned without links: models and its like are beside src
    __path__.append(str(_HERE.parents[1]))

_HOMES = {
    "ConvergenceError": "truepose.errors",
    "InputError": "truepose.errors",
    "TrueposeError": "truepose.errors",
    "calibrate": "truepose.identification.fit.calibrate",
    "check": "truepose.identification.leaves.check.run",
    "compensate": "truepose.identification.compensation.compensate",
    "diagnose": "truepose.identification.diagnosis.diagnose",
    "diagnosis_json": "truepose.identification.report.results",
    "drift": "truepose.identification.leaves.drift.analysis",
    "estimate": "truepose.identification.fit.estimate",
    "export": "truepose.models.leaves.export.write",
    "fit_json": "truepose.identification.report.results",
    "generate": "truepose.codegen.c",
    "identifiability": "truepose.identification.identifiability.analysis",
    "inverse": "truepose.identification.compensation.inverse",
    "load_machine": "truepose.models.load",
    "load_recording": "truepose.identification.load",
    "parse_effect": "truepose.models.effect_text",
    "plan": "truepose.identification.leaves.planning.plan",
    "predict": "truepose.identification.prediction.predict",
    "simulate": "truepose.identification.prediction.simulate",
    "write_calibrated": "truepose.identification.fit.write_machine",
}

__all__ = [
    "ConvergenceError",
    "InputError",
    "TrueposeError",
    "__version__",
    "calibrate",
    "check",
    "compensate",
    "diagnose",
    "diagnosis_json",
    "drift",
    "estimate",
    "export",
    "fit_json",
    "generate",
    "identifiability",
    "inverse",
    "load_machine",
    "load_recording",
    "parse_effect",
    "plan",
    "predict",
    "simulate",
    "write_calibrated",
]


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
