"""What a fit says of itself in its machine file: the sections ``pose_error`` and ``judgement``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import Field

from truepose.models.file.fields import In, Number, Section

NO_WORSE: Final = 1.02
"""Most that an error may be of the one that it is compared with for a model to be applied: no more than chance makes."""


@dataclass(frozen=True)
class ExpectedPose:
    """Rms error of the tool's position, mm, in what counts of it (``judged_axes``), after a rigid refit.

    ``before`` is that of the model that ``than`` names (``drawing`` or ``plain calibration``), ``after`` that of this file's;
    ``rows`` says on which rows.
    """

    than: str
    before: float
    after: float
    rows: str

    @property
    def worse(self) -> bool:
        """Whether the file's model leaves the tool worse than the other, by more than chance makes."""
        return self.after > NO_WORSE * self.before


class ExpectedPoseSection(Section):
    than: str
    """What it was compared with: `drawing` or `plain calibration`."""
    before: Annotated[Number, In("mm")] = Field(ge=0.0)
    """Rms error of the tool's position, in what a stated task counts of it, with that model, after a rigid refit."""
    after: Annotated[Number, In("mm")] = Field(ge=0.0)
    """The same with this file's model."""
    unit: Literal["mm"] = "mm"
    """Unit of both, whatever `units` says."""
    rows: str
    """On which rows, in words."""


class JudgementSection(Section):
    calibrated: bool
    """Whether the fit may be called a calibration."""
    why: tuple[str, ...] = ()
    """Why not, in words."""


def refused_by(found: JudgementSection | None) -> tuple[str, ...]:
    return () if found is None or found.calibrated else found.why or ("its judgement says so",)


def expected_pose(found: ExpectedPoseSection | None) -> ExpectedPose | None:
    return None if found is None else ExpectedPose(found.than, found.before, found.after, found.rows)
