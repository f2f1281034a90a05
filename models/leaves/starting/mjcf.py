"""A machine to start from in an MJCF: what leads to a body, with its loops, written out as a graph with masses and gravity.

MuJoCo itself reads the file, so that defaults, includes, angles and the masses of shapes are what it takes them for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truepose.errors import InputError
from truepose.models.leaves.starting.compiled_mjcf import Compiled, compiled
from truepose.models.leaves.starting.mjcf_choice import Choice, choose
from truepose.models.leaves.starting.mjcf_graph import MjcfGraph
from truepose.models.leaves.starting.mjcf_model import MM_PER_M, parts_of
from truepose.models.leaves.starting.mjcf_parts import Parts, Tip
from truepose.models.leaves.starting.start import Start, unranged
from truepose.models.lie import inverse_pose
from truepose.wording import close_matches, cut, shortened

if TYPE_CHECKING:
    import mujoco

CHAIN_MOST = 500
"""Bodies between the base and the tip."""
NAME_MOST = 200
"""Characters of a name."""
WEIGHTLESS = 1e-6
"""kg: what files give bodies that have no mass, as MuJoCo asks; a milligram."""
FARTHEST = 1e9
"""m, m/s^2, kg: what is larger in an MJCF is no robot's."""
_NAMED = 4


def mjcf_start(path: Path, tip: str = "") -> Start:
    """Return the start of an MJCF; empty ``tip``: the one last body of its chain; else a body or a site.

    Raises InputError where MuJoCo is missing or refuses the file, and for a machine that no graph holds.
    """
    found = compiled(path)
    model = found.model
    _check(model, path)
    parts = parts_of(model)
    end = _named_tip(parts, tip, path) if tip else _only_end(parts, path)
    if len(parts.way(end.body)) > CHAIN_MOST:
        raise InputError(
            f"{path}: found {len(parts.way(end.body))} bodies up to the tip, expected at most {CHAIN_MOST}"
        )
    choice = choose(parts, [end.body], str(path))
    graph = MjcfGraph(choice, str(path))
    section, sites = graph.section(end), _site_names(parts, end.site)
    masses, light = _masses(model, graph)
    gravity = graph.pose[:3, :3].T @ np.array(model.opt.gravity)
    x, y, z = (float(round(v, 9)) + 0.0 for v in gravity)
    return Start(
        path.stem,
        f"The MJCF {path.name}",
        section,
        (*_notes(choice, end, path), *unranged(section["joints"]), *_said_of_masses(light, found)),
        gravity=(x, y, z),
        masses=masses,
        left_out=(*choice.left_out(), *([f"sites, each of which --tip takes: {sites}"] if sites else [])),
    )


def _notes(choice: Choice, tip: Tip, path: Path) -> Iterator[str]:
    """Yield where the machine begins and ends, and joints that only the absence of a drive could be read from."""
    bodies = choice.parts.bodies
    end = f"site {tip.site}" if tip.site else f"body {bodies[tip.body].name}"
    yield f"Source: {path.name}, from the body {bodies[choice.base].name} to the {end}."
    driven = choice.parts.driven
    bare = [
        joint.name
        for body, joint in choice.joints
        if choice.drives(body, joint) and joint.name not in (driven or ())
    ]
    if driven is not None and bare:
        names = shortened(bare, _NAMED)
        yield f"CHECK joints without an actuator and outside loops, taken as read by the recording: {names}."
    if choice.ties:
        yield "CHECK home: loops are closed from where the file has the machine; a singular pose is a bad start."


def _said_of_masses(light: Sequence[str], found: Compiled) -> Iterator[str]:
    """Yield which bodies weigh nothing, and what MuJoCo warns of."""
    if light:
        why = "whose meshes were not at hand" if found.bare else "as the source says"
        yield f"Note: bodies without mass, {why}: {shortened(list(light), _NAMED)}. CHECK masses."
    yield from (f"Note: MuJoCo: {said}" for said in found.warnings)


def _masses(model: mujoco.MjModel, graph: MjcfGraph) -> tuple[dict[str, Any], list[str]]:
    """Return masses by the body that carries them, joints off the machine as the file has them, and bodies without any."""
    choice = graph.choice
    parts, poses = choice.parts, choice.parts.poses
    sums = {body: np.zeros(4) for body in choice.bodies}
    for body in range(1, model.nbody):
        carrier = next((b for b in reversed(parts.way(body)) if b in sums or b == choice.base), choice.base)
        if carrier != choice.base and model.body_mass[body] > WEIGHTLESS:
            centre = poses[body] @ [*(MM_PER_M * model.body_ipos[body]), 1.0]
            local = (inverse_pose(poses[carrier]) @ centre)[:3] - graph.shifts[carrier]
            sums[carrier] += model.body_mass[body] * np.array([1.0, *local])
    heavy = {body: s for body, s in sums.items() if s[0]}
    masses = {
        graph.names[body]: {"kg": float(s[0]), "com": (s[1:] / s[0]).tolist(), "in": graph.names[body]}
        for body, s in heavy.items()
    }
    return masses, [graph.names[b] for b in choice.bodies if b not in heavy and parts.bodies[b].joints]


def _check(model: mujoco.MjModel, path: Path) -> None:
    """Refuse numbers that are no robot's, names that are no text, and axes that MuJoCo itself made nothing of."""
    sizes = {
        "position": model.body_pos, "joint's anchor": model.jnt_pos, "mass": model.body_mass, "gravity": model.opt.gravity,
        "centre of mass": model.body_ipos, "end of a joint's range": model.jnt_range[model.jnt_limited.astype(bool)],
        "joint's reference": model.qpos0,
    }  # fmt: skip
    for what, values in sizes.items():
        odd = [float(v) for v in np.ravel(values) if not abs(v) <= FARTHEST]
        if odd:
            raise InputError(f"{path}: found the {what} {odd[0]:g}, expected at most {FARTHEST:g}")
    try:
        names = [model.body(k).name for k in range(model.nbody)]
        names += [model.joint(k).name for k in range(model.njnt)] + [
            model.site(k).name for k in range(model.nsite)
        ]
    except UnicodeDecodeError:
        raise InputError(f"{path}: found a name that is no text, expected UTF-8") from None
    long = next((name for name in names if len(name) > NAME_MOST), None)
    if long is not None:
        found = f"the name {cut(long)!r} of {len(long)} characters"
        raise InputError(f"{path}: found {found}, expected at most {NAME_MOST}")
    bare = [k for k in range(model.njnt) if not 0.5 < np.linalg.norm(model.jnt_axis[k]) < 2.0]
    if bare:
        name = cut(model.joint(bare[0]).name)
        raise InputError(
            f"{path}: joint {name!r}: found an axis that MuJoCo takes for none, expected a direction"
        )


def _named_tip(parts: Parts, name: str, path: Path) -> Tip:
    """Return the body or the site of a name."""
    tips = {site.site: site for site in reversed(parts.sites)}
    tips |= {body.name: Tip(k) for k, body in enumerate(parts.bodies)}
    if name not in tips:
        raise InputError(
            f"--tip: found {cut(name)!r}, no body or site of {path}; {close_matches(name, list(tips))}"
        )
    return tips[name]


def _only_end(parts: Parts, path: Path) -> Tip:
    """Return the one body without others beyond that a hinge, slide or ball leads to."""
    moving = [
        any(parts.bodies[b].joints and not parts.bodies[b].free for b in parts.way(k))
        for k in range(len(parts.bodies))
    ]
    carrying = {body.parent for body in parts.bodies}
    ends = [k for k, moved in enumerate(moving) if moved and k not in carrying]
    if len(ends) != 1:
        names = shortened([cut(parts.bodies[k].name, 60) for k in ends], 10) or "none with joints"
        sites = f" (sites: {_site_names(parts)})" if parts.sites else ""
        raise InputError(
            f"{path}: found several ends of a chain: {names}{sites}, expected one: say which with --tip, which also takes a "
            "site, or a body before they part, such as the flange"
        )
    return Tip(ends[0])


def _site_names(parts: Parts, but: str = "") -> str:
    """Return the names of sites, up to ten, without the one that is the tip."""
    return shortened([cut(site.site, 60) for site in parts.sites if site.site != but], 10)
