"""What a builder is: a function from its section of the machine file to a Mechanism.

To add one, write a file in ``truepose.models.builders`` (or a plugin) with a function registered by
``@builders.add("my-type")``; it parses its own section and returns bodies, joints and parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from truepose.models.machine.context import BuildContext
from truepose.models.machine.mechanism import Mechanism
from truepose.models.registry import Registry

Builder = Callable[[Mapping[str, Any], BuildContext], Mechanism]
builders: Registry[Builder] = Registry("mechanism type", "truepose.models.builders")
