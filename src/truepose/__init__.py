"""truepose: calibrate precision robots and find the physics their models leave out.

The names below are all that a script needs; they are imported when first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from truepose.codegen.c import generate
    from truepose.identification.calibrate import calibrate
    from truepose.identification.diagnosis.engine import diagnose
    from truepose.identification.estimate import estimate
    from truepose.identification.export import diagnosis_json, fit_json
    from truepose.identification.load import load_recording
    from truepose.identification.predict import predict
    from truepose.identification.simulate import parse_effect, simulate
    from truepose.identification.write_machine import write_calibrated
    from truepose.models.load import load_machine

__version__ = "0.1.0"

_HOMES = {
    "calibrate": "truepose.identification.calibrate",
    "diagnose": "truepose.identification.diagnosis.engine",
    "diagnosis_json": "truepose.identification.export",
    "estimate": "truepose.identification.estimate",
    "fit_json": "truepose.identification.export",
    "generate": "truepose.codegen.c",
    "load_machine": "truepose.models.load",
    "load_recording": "truepose.identification.load",
    "parse_effect": "truepose.identification.simulate",
    "predict": "truepose.identification.predict",
    "simulate": "truepose.identification.simulate",
    "write_calibrated": "truepose.identification.write_machine",
}

__all__ = [
    "__version__",
    "calibrate",
    "diagnose",
    "diagnosis_json",
    "estimate",
    "fit_json",
    "generate",
    "load_machine",
    "load_recording",
    "parse_effect",
    "predict",
    "simulate",
    "write_calibrated",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'truepose' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
