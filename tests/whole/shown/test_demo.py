"""What the demo shows: the diagnosis of the bundled telescope, which the other tests of this folder show, too."""

from __future__ import annotations

from support.results import diagnosis


def test_the_demo_is_named_beyond_doubt_and_leaves_no_alarm() -> None:
    """Symmetric and other entries of the matrix: with the first alone, tolerances would have to be four times as wide."""
    found = diagnosis()
    (finding,) = found.findings
    assert (finding.effect, finding.place) == ("platform-deformation", ("platform",))
    assert finding.probability > 0.99
    assert {settings["form"] for settings in finding.settings} == {2.0, 3.0}
    assert not [name for name, alarm in found.alarms_after.items() if alarm.raised]
    assert found.concealed
