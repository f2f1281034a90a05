"""Rivals without a name: the effect ``empirical`` in every form that a recording supports.

They compete with the catalogue, so that physics outside it is not given the nearest wrong name: where one of
these explains the data better than every named effect, the verdict is ``unknown`` and the remainder says
which part, driven by what, in which form.
"""

from __future__ import annotations

from collections.abc import Sequence

from truepose.identification.recording.empirical_forms import empirical_forms
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import Observed, Place, Settings
from truepose.models.effects.empirical import Empirical
from truepose.models.machine import Machine

UNNAMED = "unknown"


class Unnamed(Empirical):
    """The forms of one recording as a kind of candidate; reports call it ``unknown``."""

    slug = UNNAMED
    title = "Something the catalogue does not know"

    def __init__(self, machine: Machine, recording: Recording) -> None:
        self._forms = empirical_forms(machine, recording)

    def screened(self, machine: Machine, place: Place) -> bool:
        return True

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Those of the recording's forms there."""
        return [form.settings_map for form in self._forms if form.place == tuple(place)]


__all__ = ["UNNAMED", "Unnamed"]
