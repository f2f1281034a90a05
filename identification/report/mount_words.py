"""A mount's constants in the words of its field, for the terminal and for the report."""

from __future__ import annotations

from truepose.identification.fit.estimated import Estimate
from truepose.identification.report.document import Block, Table
from truepose.models.machine.mount_terms import Said, said_terms


def terms_of_fit(fit: Estimate) -> tuple[Said, ...]:
    """TPOINT's terms of a fit; none where the machine is no mount."""
    values = dict(zip(fit.prior.names, fit.p.tolist(), strict=True))
    std = dict(zip(fit.prior.names, fit.std.tolist(), strict=True))
    return said_terms(fit.nominal, fit.effects, values, std)


def mount_words(fit: Estimate) -> list[str]:
    """One sentence: ``TPOINT's terms, arcsec: IH +899.2 +- 0.3, ...``."""
    told = [f"{one.term.name} {one.value:+.1f} +- {one.std:.1f}" for one in terms_of_fit(fit)]
    return [f"TPOINT's terms, arcsec: {', '.join(told)}"] if told else []


def mount_blocks(fit: Estimate) -> list[Block]:
    """The terms beside our names, with formulas."""
    rows = [
        [
            one.term.name,
            one.term.ours,
            f"{one.value:+.2f}",
            f"{one.std:.2f}",
            one.term.formula,
            one.term.words,
        ]
        for one in terms_of_fit(fit)
    ]
    head = ["TPOINT", "here", "arcsec", "1 sigma", "formula", "what it is"]
    caption = (
        "The mount in the words of its field. A term is what is added to what the encoders say for where the telescope really"
        " points: h hour angle, d declination, A azimuth from the north by the east, E altitude, z zenith distance."
    )
    return [Table(head, rows, caption)] if rows else []
