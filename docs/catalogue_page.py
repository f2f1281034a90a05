"""``catalogue.md`` and its drawings, made from the effects themselves.

Run it after an effect was added or described anew:

    python docs/catalogue_page.py
"""

from __future__ import annotations

import re
import sys
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from catalogue_canvas import Array
from catalogue_drawings import DRAWINGS, FOLDER, drawing, path_of
from catalogue_law import MACHINE
from catalogue_numbers import placed, sizes, tried
from truepose.models.file.driver import OF_THE_WAY, STEP, VELOCITY, Driver
from truepose.models.load import load_machine
from truepose.models.machine.effect import effects
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import Effect, Place, Settings

ROOT: Final = Path(__file__).resolve().parent.parent
PAGE: Final = ROOT / "docs/catalogue.md"
GROUPS: Final = {
    "Joints and drives": (
        "actuator-scale", "transmission-error", "encoder-eccentricity", "screw-periodic", "axis-coupling", "axis-straightness",
        "axis-wobble", "joint-runout", "flexure-shift", "counterbalance", "dress-pack",
    ),
    "Play, friction, creep and arrival": (
        "backlash", "friction-hysteresis", "piezo-hysteresis", "piezo-creep", "early-reading",
    ),
    "Weight and forces": (
        "joint-compliance", "link-bending", "leg-compliance", "platform-deformation", "screw-windup", "gravity-sag",
        "axis-flexure", "rocking-mount",
    ),
    "Heat, time and sessions": (
        "thermal-expansion", "motor-heat", "screw-growth", "mount-drift", "frame-shift", "zero-shift",
    ),
    "Sensors": (
        "sensor-scale", "sensor-periodic", "target-offset", "lens-distortion", "air-refraction", "latency", "fringe-miscount",
    ),
    "Constants, rows and the rest": ("wrong-constant", "outliers", "empirical"),
}  # fmt: skip
OTHER: Final = "Further effects"
HEAD: Final = """# Catalogue of effects

The {count} effects that truepose can find. `python docs/catalogue_page.py` makes this page from the code. Further forms and
sources: `truepose effects SLUG`. In the drawings grey is the machine as drawn, blue what it really does, orange the error.

**Needs** is what machine file and recording must have beside joints and readings. **Experiment** tells an effect from its
look-alikes. "Recalled": not checked against its source. **Assumed** is how large its numbers may be before a reading is
seen (the scale of the prior, on the machines that come with truepose), and which settings are tried; a recording may add more.
"""
_COLUMNS: Final = {
    "approach": "`approach.<joint>`",
    "velocity": "`velocity.<joint>`",
    "temperature": "`temperature.<place>`",
    "creep": "`time`",
}
_ANY: Final = {"empirical": "the column that the error follows"}
_ORDER: Final = "rows in the order measured"


class _EverythingLogged:
    """A recording that has every column, for effects that choose their settings by what was logged."""

    n_sessions = 2

    def driver(self, name: str) -> Array:
        if name.startswith(VELOCITY):  # read at rest
            return np.zeros(4)
        return (
            np.array([-1.0, 1.0, -1.0, 1.0])
            if name.startswith("approach")
            else np.array([0.0, 1e3, 4e3, 2e4])
        )

    def inferred(self, name: str) -> bool:
        return False


@cache
def _machines() -> tuple[Machine, ...]:
    bundled = sorted((ROOT / "models/machines").glob("*/machine.yaml"))
    return tuple(load_machine(path) for path in (MACHINE, *bundled))


def listed() -> list[str]:
    """Slugs of the effects that come with the program, none of plug-ins."""
    return [slug for slug in effects if effects.get(slug, "catalogue").__module__.startswith("truepose.")]


def needs(slug: str) -> str:
    """What a machine file and a recording must have for an effect beside joints and readings; empty for nothing."""
    effect = effects.get(slug, "catalogue")()
    read = dict.fromkeys(name for machine in _machines() for name in _read(effect, machine))
    if _COLUMNS["approach"] in read and _ORDER not in read:  # where no column tells the side, the order does
        read = {f"{name} or {_ORDER}" if name == _COLUMNS["approach"] else name: None for name in read}
    parts = (["`gravity`, `masses`"] if effect.needs_load else []) + list(read)
    return _ANY.get(slug) or ", ".join(parts)


def _read(effect: Effect, machine: Machine) -> list[str]:
    """Columns that the effect reads anywhere on a machine."""
    found = placed(effect, (machine,), _EverythingLogged())
    return [column for _, place, settings in found for column in _columns(effect, machine, place, settings)]


def assumed(slug: str) -> str:
    """How large an effect may be before a reading is seen, and the settings that are tried."""
    effect, logged = effects.get(slug, "catalogue")(), _EverythingLogged()
    large, settings = (told(effect, _machines(), logged) for told in (sizes, tried))
    return "; ".join(
        text for text in (large and f"size {large}", settings and f"tried with {settings}") if text
    )


def _columns(effect: Effect, machine: Machine, place: Place, settings: Settings) -> list[str]:
    out = []
    for name in effect.drivers(machine, place, settings):
        driver = Driver.of(name)
        if driver.kind in (*OF_THE_WAY, STEP):
            out.append(_ORDER)
            continue
        out.append(_COLUMNS.get(driver.kind, f"`{driver.kind}`"))
        if driver.numbers and driver.kind == "temperature":
            out.append("`time`")
    return out


def page() -> str:
    """The whole page."""
    known = listed()
    grouped = {slug for group in GROUPS.values() for slug in group}
    groups = {**GROUPS, OTHER: tuple(slug for slug in known if slug not in grouped)}
    parts = [HEAD.format(count=len(known))]
    for heading, slugs in groups.items():
        if slugs:
            parts += [f"## {heading}\n", *(_entry(slug) for slug in slugs)]
    return "\n".join(parts)


def _entry(slug: str) -> str:
    kind = effects.get(slug, "catalogue")
    idea = " ".join((kind.__doc__ or kind.title).split("\n\n")[0].split())
    read = needs(slug)
    rows = {
        "Formula": f"`{_first(kind.formula)}`",
        "Size": kind.size,
        "Assumed": assumed(slug),
        "Needs": read,
        "Look-alikes": ", ".join(f"[`{other}`](#{_anchor(other)})" for other in kind.look_alikes),
        "Experiment": kind.experiment,
    }
    lines = [
        f"### {kind.title}",
        "",
        f"![{slug}](figures/effects/{slug}.svg)",
        "",
        f"{idea} <small>`{slug}`</small>",
        "",
    ]
    lines.append("  \n".join(f"**{name}:** {_escaped(text)}" for name, text in rows.items() if text))
    return "\n".join([*lines, ""])


def _first(text: str) -> str:
    """The first of several clauses, none cut within brackets; ``truepose effects SLUG`` has them all."""
    kept, *others = text.split("; ")
    for other in others:
        if kept.count("(") == kept.count(")"):
            break
        kept = f"{kept}; {other}"
    return kept


def _anchor(slug: str) -> str:
    """What the heading of an effect is called in links."""
    title = effects.get(slug, "catalogue").title
    return re.sub(r"[^\w]+", "-", title.lower()).strip("-")


def _escaped(text: str) -> str:
    """Stars and underscores of formulas, as they stand; micrometres and microradians as the other pages have them."""
    if "`" in text or "](" in text:
        return text
    return re.sub(r"\bu(m|rad)\b", r"µ\1", re.sub(r"([*_])", r"\\\1", text))


def main() -> None:
    """Renew the page and the drawings; exit with what lacks a drawing before anything is written."""
    if missing := [slug for slug in listed() if slug not in DRAWINGS]:
        sys.exit(
            f"{', '.join(missing)}: add a curve to docs/catalogue_curves.py or a sketch to docs/catalogue_sketches.py"
        )
    FOLDER.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    for slug in listed():
        path_of(slug).write_text(drawing(slug, effects.get(slug, "catalogue").title), encoding="utf-8")
    sys.stdout.write(f"{PAGE.relative_to(ROOT)}: {len(listed())} effects\n")


if __name__ == "__main__":
    main()
