"""``truepose.drift``: for machines and recordings that are given in any form."""

from __future__ import annotations

from truepose.api import of_sources
from truepose.identification.leaves.drift import analysis

drift = of_sources(analysis.drift)
