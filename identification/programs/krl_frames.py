"""Which base and tool the motions of a KRL program go by: followed through its text from top to bottom."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from truepose.identification.programs.program import BASE_ITSELF, NUMBER, closing, parts

_NULL = {"$NULLFRAME", "$WORLD", "$ROBROOT"}
_SET = re.compile(r"(?i)^[ \t]*\$(BASE|TOOL)\s*=\s*(?P<what>[^\r\n]+?)\s*$")
_BAS = re.compile(r"(?i)^[ \t]*BAS\s*\(\s*#(BASE|TOOL)\s*,\s*(?P<n>\d+)\s*\)")
_FDAT_ACT = re.compile(r"(?i)^[ \t]*FDAT_ACT\s*=\s*(?P<name>\w+)")
_IPO = re.compile(r"(?i)^[ \t]*\$IPO_MODE\s*=\s*#(?P<mode>\w+)")
_MOTION = re.compile(r"(?i)^[ \t]*(?P<how>S?PTP|S?LIN|S?CIRC|SPL)\b(?P<rest>[^\r\n]*)")
_NAME = re.compile(r"\s*+(?:(?P<name>[A-Za-z_]\w*+)\s*+(?:\[[^\]]*\])?)\s*+(?:C_\w++\s*+)*+(?:WITH\b.*)?")
_FDAT = re.compile(r"(?i)\bFDAT\s+(?P<name>\w+)\s*=\s*\{(?P<fields>[^{}]*)\}")
_STATED = re.compile(r"(?<!\w)(?P<name>\$?\w+(?:\s*\[\s*\d+\s*\])?)\s*=\s*\{(?P<fields>[^{}]*)\}")
_LINE = re.compile(r"[^\r\n]+")


@dataclass(frozen=True)
class Stand:
    """Names of the base and the tool in force, None where the text says nothing; ``fixed``: the robot holds the part."""

    base: str | None
    tool: str | None
    fixed: bool = False


def fdats(mask: str) -> dict[str, Stand]:
    """Frames of taught points by name: FP1 tells of XP1 and of P1."""
    out: dict[str, Stand] = {}
    for m in _FDAT.finditer(mask):
        fields = dict(re.findall(r"(\w+)\s+(#?\w+)", m["fields"].upper()))
        base, tool = (fields.get(f"{which}_NO") for which in ("BASE", "TOOL"))
        stand = Stand(_numbered("BASE", base), _numbered("TOOL", tool), fields.get("IPO_FRAME") == "#TCP")
        bare = m["name"].upper().removeprefix("F")
        out |= {f"X{bare}": stand, bare: stand}
    return out


def frames(mask: str, file: str) -> dict[str, tuple[float, ...]]:
    """Frames whose six numbers a text states, by name; those of ``$BASE`` and ``$TOOL`` by their place in ``file``, too."""
    out = {}
    for m in _STATED.finditer(mask):
        name = re.sub(r"\s", "", m["name"]).upper()
        told = dict(re.findall(rf"(\w+)\s+({NUMBER})\s*(?=,|$)", m["fields"].upper()))
        if set(told) >= set("XYZABC"):
            own = f"{name}@{file}{m.end('name')}" if name in ("$BASE", "$TOOL") else name
            out[own] = tuple(float(told[field]) for field in "XYZABC")
    return out


def uses(mask: str, taught: Mapping[str, Stand], file: str) -> dict[str, dict[Stand, bool]]:
    """Frames by the names of points that motions go to, and by ``file@position`` of the constants in motions.

    Beside each, whether one of the motions goes from point to point: others do not look at status and turn. ``taught`` are
    the frames of taught points (``fdats``).
    """
    out: dict[str, dict[Stand, bool]] = {}
    stand = Stand(None, None)
    for line in _LINE.finditer(mask):
        text = line.group()
        stand = _after(text, line.start(), stand, taught, file)
        motion = _MOTION.match(text)
        if motion is None:
            continue
        start = line.start() + motion.start("rest")
        for a, b in parts(mask, start, line.end()):
            piece = mask[a:b]
            inside = mask.find("{", a, b)
            name = _NAME.fullmatch(piece)
            if inside >= 0 and not mask[a:inside].strip() and closing(mask, inside) is not None:
                key = f"{file}@{inside}"
            elif name is not None:
                key = name["name"].upper()
            else:
                continue
            held = out.setdefault(key, {})
            held[stand] = held.get(stand, False) or motion["how"].upper() in ("PTP", "SPTP")
    return out


def _after(line: str, start: int, stand: Stand, taught: Mapping[str, Stand], file: str) -> Stand:
    """What is in force behind a line that begins at ``start``."""
    setting, bas, act, ipo = (p.match(line) for p in (_SET, _BAS, _FDAT_ACT, _IPO))
    if setting is not None:
        what = re.sub(r"\s", "", setting["what"]).upper()
        which = setting[1].upper()
        own = f"${which}@{file}{start + setting.end(1)}"
        name = BASE_ITSELF if what in _NULL else own if what.startswith("{") else what
        return _with(stand, which, name)
    if bas is not None:
        return _with(stand, bas[1].upper(), _numbered(bas[1].upper(), bas["n"]))
    if act is not None:
        return taught.get(f"X{act['name'].upper().removeprefix('F')}", Stand(None, None))
    if ipo is not None:
        return replace(stand, fixed=ipo["mode"].upper() == "TCP")
    return stand


def _with(stand: Stand, which: str, name: str | None) -> Stand:
    return replace(stand, base=name) if which == "BASE" else replace(stand, tool=name)


def _numbered(which: str, number: str | None) -> str | None:
    """Name of a numbered frame; number 0 is none, one below zero says nothing."""
    if number is None or not number.isdigit():
        return None
    return BASE_ITSELF if int(number) == 0 else f"{which}_DATA[{int(number)}]"


__all__ = ["Stand", "fdats", "frames", "uses"]
