"""Wrappers of the generated C for those who call it from elsewhere: Python (ctypes), C++17 and a Simulink block.

They add no arithmetic: every number comes from the library. The texts go into ``wrappers/`` beside the C.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from truepose.codegen.texts import environment

_TEMPLATES = {"kin.py": "kin.py.j2", "kin.hpp": "kin.hpp.j2", "sfun.c": "sfun.c.j2"}


def wrappers(context: Mapping[str, Any]) -> dict[str, str]:
    """Texts of ``wrappers/NAME_kin.py``, ``wrappers/NAME_kin.hpp`` and ``wrappers/NAME_sfun.c`` by file name.

    ``context`` says what the C says: ``name``, ``real``, ``joints`` (place, name, unit), ``parameters`` and
    ``drivers`` (name, identifier, unit), ``p0`` and ``z0`` (at least one number each).
    """
    return {
        f"wrappers/{context['name']}_{ending}": environment()
        .get_template(f"wrappers/{template}")
        .render(context)
        for ending, template in _TEMPLATES.items()
    }
