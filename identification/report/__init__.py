"""Reports from results: one self-contained HTML file, or plain text for a terminal; nothing is estimated.

Use ``report_html`` for a diagnosis, ``calibration_html`` for a fit alone, and
``report_text`` for a terminal. A page is a ``Document`` of plain blocks (``document``); ``words`` says
results in sentences, ``figures`` draws them, ``sections`` arranges them, ``render`` writes the page.
"""

from truepose.identification.report.pages import (
    calibration_html,
    calibration_text,
    report_html,
    report_text,
)

__all__ = ["calibration_html", "calibration_text", "report_html", "report_text"]
