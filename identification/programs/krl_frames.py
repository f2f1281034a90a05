"""Which base and tool the motions of a KRL program go by: followed through its text from top to bottom."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from truepose.identification.programs.program import BASE_ITSELF, NUMBER, Span, parts

_NULL = {"$NULLFRAME", "$WORLD", "$ROBROOT"}
_SET = re.compile(r"(?i)^[ \t]*\$(BASE|TOOL)\s*=\s*(?P<what>[^\r\n]+?)\s*$")
_BAS = re.compile(r"(?i)^[ \t]*BAS\s*\(\s*#(BASE|TOOL)\s*,\s*(?P<n>\d+)\s*\)")
_FDAT_ACT = re.compile(r"(?i)^[ \t]*FDAT_ACT\s*=\s*(?P<name>\w+)")
_IPO = re.compile(r"(?i)^[ \t]*\$IPO_MODE\s*=\s*#(?P<mode>\w+)")
_MOTION = re.compile(r"(?i)^[ \t]*(?P<how>S?PTP|S?LIN|S?CIRC|SPL)\b(?P<rest>[^\r\n]*)")
_FACTOR = re.compile(r"\{[^{}]*\}|[A-Za-z_]\w*+(?:[ \t]*\[[^\]]*\])?")
_PLACE = re.compile(rf"\s*+(?P<what>(?:{_FACTOR.pattern})(?:\s*:\s*(?:{_FACTOR.pattern}))*)\s*+(?P<rest>.*)")
_BEHIND = re.compile(r"(?:C_\w++\s*+)*+(?:WITH\b.*)?")
_FIELD = re.compile(rf"(\w+)\s+({NUMBER})\s*(?=,|$)")
_FDAT = re.compile(r"(?i)\bFDAT\s+(?P<name>\w+)\s*=\s*\{(?P<fields>[^{}]*)\}")
_STATED = re.compile(r"(?<!\w)(?P<name>\$?\w+(?:\s*\[\s*\d+\s*\])?)\s*=\s*\{(?P<fields>[^{}]*)\}")
_LINE = re.compile(r"[^\r\n]+")


@dataclass(frozen=True)
class Stand:
    """Names of the base and the tool in force, None where the text says nothing; ``fixed``: the robot holds the part.

    ``base_at`` and ``tool_at`` are where a name of the program's own was put in force.
    """

    base: str | None
    tool: str | None
    fixed: bool = False
    base_at: int | None = field(default=None, compare=False)
    tool_at: int | None = field(default=None, compare=False)


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
    """Frames whose six numbers a text states, by name; those of ``$BASE`` and ``$TOOL`` by their place in ``file``, too.

    What is stated with several numbers is not known.
    """
    out: dict[str, tuple[float, ...]] = {}
    several: set[str] = set()
    for m in _STATED.finditer(mask):
        name = re.sub(r"\s", "", m["name"]).upper()
        numbers = stated(m["fields"])
        if numbers is not None:
            own = f"{name}@{file}{m.end('name')}" if name in ("$BASE", "$TOOL") else name
            several |= {own} if out.setdefault(own, numbers) != numbers else set()
    return {name: numbers for name, numbers in out.items() if name not in several}


@dataclass(frozen=True)
class Motion:
    """What a motion goes to at ``start``: a product of ``factors`` (spans), the last of them its target.

    ``checked``: it goes from point to point; others do not look at status and turn.
    """

    start: int
    stand: Stand
    factors: tuple[Span, ...]
    checked: bool


def motions(mask: str, taught: Mapping[str, Stand], file: str) -> Iterator[Motion]:
    """Yield the motions of a text; ``taught`` are the frames of taught points (``fdats``)."""
    stand = Stand(None, None)
    for line in _LINE.finditer(mask):
        text = line.group()
        stand = _after(text, line.start(), stand, taught, file)
        motion = _MOTION.match(text)
        if motion is None:
            continue
        start = line.start() + motion.start("rest")
        for span in parts(mask, start, line.end()):
            m = _PLACE.match(mask, *span)
            if m is None or not (m["what"].endswith("}") or _BEHIND.fullmatch(m["rest"])):
                continue
            factors = tuple(one.span() for one in _FACTOR.finditer(mask, *m.span("what")))
            yield Motion(m.start("what"), stand, factors, motion["how"].upper() in ("PTP", "SPTP"))


def stated(text: str) -> tuple[float, ...] | None:
    """Return the numbers of a position in braces; None where one is missing, or no number."""
    told = dict(_FIELD.findall(text.upper().strip("{} ")))
    return tuple(float(told[field]) for field in "XYZABC") if set(told) >= set("XYZABC") else None


def _after(line: str, start: int, stand: Stand, taught: Mapping[str, Stand], file: str) -> Stand:
    """What is in force behind a line that begins at ``start``."""
    setting, bas, act, ipo = (p.match(line) for p in (_SET, _BAS, _FDAT_ACT, _IPO))
    if setting is not None:
        what = re.sub(r"\s", "", setting["what"]).upper()
        which = setting[1].upper()
        own = f"${which}@{file}{start + setting.end(1)}"
        name = BASE_ITSELF if what in _NULL else own if what.startswith("{") else what
        return _with(stand, which, name, start + setting.start("what") if _FACTOR.fullmatch(what) else None)
    if bas is not None:
        return _with(stand, bas[1].upper(), _numbered(bas[1].upper(), bas["n"]))
    if act is not None:
        return taught.get(f"X{act['name'].upper().removeprefix('F')}", Stand(None, None))
    if ipo is not None:
        return replace(stand, fixed=ipo["mode"].upper() == "TCP")
    return stand


def _with(stand: Stand, which: str, name: str | None, at: int | None = None) -> Stand:
    if which == "BASE":
        return replace(stand, base=name, base_at=at)
    return replace(stand, tool=name, tool_at=at)


def _numbered(which: str, number: str | None) -> str | None:
    """Name of a numbered frame; number 0 is none, one below zero says nothing."""
    if number is None or not number.isdigit():
        return None
    return BASE_ITSELF if int(number) == 0 else f"{which}_DATA[{int(number)}]"


__all__ = ["Motion", "Stand", "fdats", "frames", "motions", "stated"]
