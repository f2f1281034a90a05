"""How a diagnosis is fitted to a screen: everything in its order while there is room, then fewer and shorter lines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from support.told_diagnoses import diagnosis, finding
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Applied,
    Finding,
    Form,
    Lead,
    Levels,
    PoseError,
    Quantity,
    Remainder,
    SetOfEffects,
    Together,
)
from truepose.identification.report.terminal import diagnosis_lines
from truepose.identification.signatures.untestable import Missing

OUT = Path("out")
GOOD = PoseError(0.5, 0.2)
APPLIED = Applied("whole", "role", GOOD, 0.4, GOOD, 0.4)
LOAD = Levels(0.99, "load", 0.95)
LONG = "word " * 60
STANDS = "stand where they do by the side from which they arrived (97.0 %; which law is open); fitted as"
SETS = tuple(SetOfEffects(((f"e{k}", ("q1",)),), 0.25) for k in range(4))


def play(**more: Any) -> Finding:
    return replace(finding(0.5, 2), **{"levels": Levels(0.98, "arrival", 0.97), **more})


def lines(*found: Finding, verdict: str = "missing-physics", most: int = 25, **more: Any) -> list[str]:
    return diagnosis_lines(diagnosis(verdict, *found, **more), OUT, most)


def test_a_diagnosis_is_told_in_this_order() -> None:
    told = lines(
        play(),
        concealed=True,
        applied=APPLIED,
        terms=("one",),
        sets=SETS,
        missing=(Missing(("latency",), "no `time`", "add it"),),
        outlier_rows=tuple(range(1, 15)),
        together=(Together("load", ("q1", "q2"), 0.98),),
        remainder=Remainder(("q1",), "temperature.air", Form("curve"), 1.5),
        disagreement=0.2,
    )
    starts = [
        "arm: physics is missing, though the ordinary fit looked good",
        "  position: 30.0 µm with the ordinary fit, 30.0 µm held to the drawing, 30.0 µm after on the fitted rows",
        "  Error of the tool's position, on the validation rows, after a rigid refit: 500 µm with plain calibration,",
        f"  q1, q2 {STANDS}",
        "    a0 = 0 +- 0.01, a1 = 1.5 +- 0.01 mm",
        "    could also be: friction-hysteresis at q2; something without a name",
        "  together: q1 or q2 gives way under the load that it carries (98.0 % that at least one does), which is not",
        "  remainder follows temperature.air: ",
        "  against it: Probabilities are known to 20 % only",
        "  likeliest sets: e0 at q1 (25 %) | e1 at q1 (25 %) | e2 at q1 (25 %)",
        "  could not be tested: latency: no `time`; add it",
        "  14 rows excluded as outliers: rows 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 and 2 more",
        "  chi2 per degree of freedom: free 1, before 12, after 1.01",
        "next: tell them apart: truepose plan MACHINE -n 40 -o poses.csv",
        "then: truepose codegen out/improved.yaml -o controller",
        "report: out/report.html",
    ]
    told = [
        line
        for line in told
        if line not in ("    backlash: They have play.", "    200 µm with improved.yaml.", "    known")
    ]  # ends of two sentences
    assert len(told) == len(starts)
    for line, start in zip(told, starts, strict=True):
        assert line.startswith(start)


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        ("adequate", "arm: the model is adequate"),
        ("unknown", "arm: something is missing; neither its place nor its driver is known"),
    ],
)
def test_the_verdict_stands_first(verdict: str, said: str) -> None:
    assert lines(verdict=verdict)[0] == said


def test_a_law_that_is_known_is_told_by_its_name_and_one_that_is_open_after_what_it_follows() -> None:
    for known in (replace(play(), probability=0.99), play(levels=Levels())):
        assert [line for line in lines(known) if line.startswith("  backlash at q1, q2, ")]
    (bent,) = [line for line in lines(play(levels=LOAD)) if "fitted as" in line]
    assert bent.startswith(
        "  q1, q2 give way under the load that they carry (95.0 %; which law is open); fitted as"
    )
    coupled = play(levels=Levels(0.98, "coupling", 0.97))  # the second joint drives
    assert [
        line
        for line in lines(coupled)
        if line.startswith("  q1 follows the position of other joints (97.0 %")
    ]
    assert not [line for line in lines(play(parameters={})) if line.startswith("    a0 ")]


def test_four_rivals_and_six_places_are_named_each_rival_once() -> None:
    rivals = tuple(Alternative(f"e{k}", ("q1",), 0.1, 1.0) for k in range(6))
    (also,) = [line for line in lines(play(equivalents=(rivals[0], *rivals))) if "could also be" in line]
    assert also == "    could also be: e0 at q1; e1 at q1; e2 at q1; e3 at q1"
    places = tuple(f"q{k}" for k in range(1, 9))
    wide = lines(play(place=places, equivalents=(Alternative("e", places, 0.1, 1.0),)))
    six = "q1, q2, q3, q4, q5, q6 and 2 more"
    assert any(line.startswith(f"  {six} stand where they do ") for line in wide)
    assert f"    could also be: e at {six}" in wide
    assert not [line for line in lines(play(equivalents=())) if "could also be" in line]
    (bare,) = [
        line
        for line in lines(play(equivalents=(Alternative(UNNAMED, ("q2",), 0.1, 1.0),)))
        if "could" in line
    ]
    assert bare == "    could also be: something without a name"


def test_what_leads_is_told_where_nothing_was_found_a_line_each() -> None:
    place = tuple(f"a-place-with-a-long-name-{k}" for k in range(6))
    leads = tuple(Lead("backlash", place, Levels(0.5, "load", 0.4), 0.3) for _ in range(9))
    found = [line for line in lines(verdict="unknown", leading=leads) if line.startswith("  leading: ")]
    assert 1 < len(found) < 9 and all(line.endswith(" ...") for line in found)
    assert not [line for line in lines(play(), leading=leads) if "leading" in line]


def test_what_has_no_name_is_told_after_what_has() -> None:
    bare = replace(finding(0.0, 1), effect="empirical", place=("q3",), equivalents=(), levels=LOAD)
    told = [line for line in lines(bare, play()) if line.startswith(("  q1", "  without"))]
    assert [line.split()[0] for line in told] == ["q1,", "without"]
    assert told[1] == "  without a name: q3 gives way under the load that it carries"


LACKS = tuple(Missing((f"e{k}",), LONG, "add it") for k in range(6))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_all_is_told_on_a_screen_that_holds_it_and_less_on_one_that_is_a_line_shorter(count: int) -> None:
    """Parts beside the findings are shortened first, then findings, then these are counted."""
    more: dict[str, Any] = {"missing": LACKS, "sets": SETS, "disagreement": 0.2}
    own = (play(explanation="talk " * 60),) * count
    whole = lines(*own, most=999, **more)
    assert lines(*own, most=len(whole), **more) == whole
    for most in range(13, len(whole)):
        told = lines(*own, most=most, **more)
        assert len(told) <= most and told != whole
        shown = sum(line.startswith(f"  q1, q2 {STANDS}") for line in told)
        rest = [line for line in told if line.startswith("  and ") and line.endswith("more: see report.html")]
        assert rest == ([] if shown == count else [f"  and {count - shown} more: see report.html"])
        tight = not any("likeliest sets" in line for line in told)
        assert tight or shown == count  # no finding is dropped before all else is short
        assert any("could also be" in line for line in told) is (not tight)
        explained = [line for line in told if line.startswith("    backlash: talk ")]
        assert len(explained) == (0 if tight else shown)


def test_parts_beside_the_findings_keep_eight_lines_then_four_then_two() -> None:
    """And each of their sentences two lines, then one."""
    more: dict[str, Any] = {"missing": LACKS, "sets": SETS}
    whole = lines(play(), most=999, **more)

    def untested(most: int) -> list[str]:
        told = lines(play(), most=most, **more)
        return [line for line in told if "could not be tested" in line or line.startswith("    word ")]

    counts = [len(untested(most)) for most in range(len(whole), 12, -1)]
    assert counts[0] == 7 and set(counts) <= {7, 3, 1}  # pairs of lines, and the line that counts the rest
    assert counts == sorted(counts, reverse=True) and len(set(counts)) >= 2
    assert untested(len(whole))[-1] == "  could not be tested: and 3 more: see report.html"


def test_a_doubt_has_two_lines_and_one_where_there_is_no_room() -> None:
    """However long the names of its place are; it is cut then."""
    place = tuple(f"a-place-with-a-long-name-{k}" for k in range(20))
    weak = play(place=place, parameters={"a": Quantity(0.1, 1.0, "mm")})

    def doubt(most: int) -> list[str]:
        told = lines(weak, most=most, missing=LACKS, sets=SETS)
        k = next(k for k, line in enumerate(told) if line.startswith("  against it: No amplitude of "))
        return told[k : k + 1 + told[k + 1].startswith("    ")]

    whole = len(lines(weak, most=999, missing=LACKS, sets=SETS))
    sizes = [len(doubt(most)) for most in range(whole, 12, -1)]
    assert sizes[0] == 2 and sizes[-1] == 1 and sizes == sorted(sizes, reverse=True)
    assert all(doubt(most)[-1].endswith(" ...") for most in range(13, whole + 1))
    tight = lines(weak, most=13, missing=LACKS, sets=SETS)
    assert sum("could not be tested" in line for line in tight) == 1


def test_chi2_of_every_fit_is_told() -> None:
    fits = {
        name: SimpleNamespace(
            chi2_per_dof=chi2, rms={"position": 0.03}, validation_rms=None,
            worst_parameter_sigma=1.0, worst_allowed=3.0,
        )
        for name, chi2 in (("free", 1.0), ("before", 1234.0), ("after", 1.016))
    }  # fmt: skip
    assert "  chi2 per degree of freedom: free 1, before 1.23e+03, after 1.02" in lines(fits=fits)
