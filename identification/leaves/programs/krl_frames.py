"""Which base and tool the motions of a KRL program go by: followed through its text from top to bottom."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from truepose.identification.leaves.programs.flow import Assignment, Flow, Keywords
from truepose.identification.leaves.programs.program import BASE_ITSELF, NUMBER, Span, parts

_NULL = {"$NULLFRAME", "$WORLD", "$ROBROOT"}
_SET = re.compile(r"(?i)^[ \t]*\$(BASE|TOOL)(?P<part>\.\w+)?\s*=\s*(?P<what>[^\r\n]+?)\s*$")
_BAS = re.compile(r"(?i)^[ \t]*BAS\s*\(\s*#(BASE|TOOL)\s*,\s*(?P<n>\d+)\s*\)")
_FDAT_ACT = re.compile(r"(?i)^[ \t]*FDAT_ACT\s*=\s*(?P<name>\w+)")
_IPO = re.compile(r"(?i)^[ \t]*\$IPO_MODE\s*=\s*#(?P<mode>\w+)")
_MOTION = re.compile(r"(?i)^[ \t]*(?P<how>S?PTP|S?LIN|S?CIRC|SPL)\b(?P<rest>[^\r\n]*)")
WORDS = Keywords(
    function=r"(?:GLOBAL[ \t]+)?(?:DEF|DEFFCT)\b",
    loop=r"(?:LOOP|WHILE|REPEAT|FOR)\b",
    branch=r"(?:IF|SWITCH)\b",
    turn=r"(?:ELSE|CASE|DEFAULT)\b",
    close=r"(?:END(?:FCT|LOOP|WHILE|FOR|IF|SWITCH)?|UNTIL)\b",
    jump=r"GOTO\b",
)
_FACTOR = re.compile(r"\{[^{}]*\}|[A-Za-z_]\w*+(?:[ \t]*\[[^\]]*\])?")
_PLACE = re.compile(rf"\s*+(?P<what>(?:{_FACTOR.pattern})(?:\s*:\s*(?:{_FACTOR.pattern}))*)\s*+(?P<rest>.*)")
_BEHIND = re.compile(r"(?:C_\w++\s*+)*+(?:WITH\b.*)?")
_FIELD = re.compile(rf"(\w+)\s+({NUMBER})\s*(?=,|$)")
_FDAT = re.compile(r"(?i)\bFDAT\s+(?P<name>\w+)\s*=\s*\{(?P<fields>[^{}]*)\}")
_STATED = re.compile(r"(?<!\w)(?P<name>\$?\w+(?:\s*\[\s*\d+\s*\])?)\s*=\s*\{(?P<fields>[^{}]*)\}")
_NUMBERED = re.compile(
    r"(?im)^[ \t]*(?P<name>(?P<bare>\w+)\s*\[(?P<index>[^\]\r\n]*)\])\s*(?P<part>\.\w+)?\s*=(?!=)(?P<value>[^\r\n]*)"
)
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


def changing(masks: Iterable[str]) -> set[str]:
    """Return names of numbered frames that texts give several values, or change by component; where the number is none to
    read, without it."""
    values: dict[str, set[str]] = {}
    out: set[str] = set()
    for m in (m for mask in masks for m in _NUMBERED.finditer(mask)):
        bare, name = m["bare"].upper(), re.sub(r"\s", "", m["name"]).upper()
        values.setdefault(name, set()).add(re.sub(r"\s", "", m["value"]).upper())
        if m["part"] or not m["index"].strip().isdigit() or len(values[name]) > 1:
            out.add(name if m["index"].strip().isdigit() else bare)
    return out


@dataclass(frozen=True)
class Motion:
    """What a motion goes to at ``start``: a product of ``factors`` (spans), the last of them its target.

    ``checked``: it goes from point to point; others do not look at status and turn. ``sure``: no other base and tool can be
    in force there.
    """

    start: int
    stand: Stand
    factors: tuple[Span, ...]
    checked: bool
    sure: bool


def motions(mask: str, taught: Mapping[str, Stand], file: str) -> Iterator[Motion]:
    """Yield the motions of a text; ``taught`` are the frames of taught points (``fdats``)."""
    settings = list(_settings(mask, taught, file))
    made = {(one.which, one.place): one for one in settings}
    flow = Flow.of(mask, WORDS, [Assignment(f"${one.which}", one.place, one.place) for one in settings])
    for line in _LINE.finditer(mask):
        text = line.group()
        motion = _MOTION.match(text)
        if motion is None:
            continue
        start = line.start() + motion.start("rest")
        for span in parts(mask, start, line.end()):
            m = _PLACE.match(mask, *span)
            if m is None or not (m["what"].endswith("}") or _BEHIND.fullmatch(m["rest"])):
                continue
            factors = tuple(one.span() for one in _FACTOR.finditer(mask, *m.span("what")))
            stand, sure = _stand(flow, made, m.start("what"))
            yield Motion(m.start("what"), stand, factors, motion["how"].upper() in ("PTP", "SPTP"), sure)


def stated(text: str) -> tuple[float, ...] | None:
    """Return the numbers of a position in braces; None where one is missing, or no number."""
    told = dict(_FIELD.findall(text.upper().strip("{} ")))
    return tuple(float(told[field]) for field in "XYZABC") if set(told) >= set("XYZABC") else None


@dataclass(frozen=True)
class _Setting:
    """A base, a tool, or that the tool is fixed, put in force by ``text``; ``at`` is where a name of the program's own is.

    ``partly``: only a component of what is in force is changed.
    """

    which: str
    place: int
    value: str | None
    text: str
    at: int | None = None
    partly: bool = False


def _settings(mask: str, taught: Mapping[str, Stand], file: str) -> Iterator[_Setting]:
    """Yield what puts frames in force, in the order of a text."""
    for line in _LINE.finditer(mask):
        text, place = line.group(), line.start()
        setting, bas, act, ipo = (p.match(text) for p in (_SET, _BAS, _FDAT_ACT, _IPO))
        if setting is not None:
            what = re.sub(r"\s", "", setting["what"]).upper()
            which = setting[1].upper()
            own = f"${which}@{file}{place + setting.end(1)}"
            name = BASE_ITSELF if what in _NULL else own if what.startswith("{") else what
            at = place + setting.start("what") if _FACTOR.fullmatch(what) else None
            yield _Setting(which, place, name, what, at, setting["part"] is not None)
        elif bas is not None:
            numbered = _numbered(bas[1].upper(), bas["n"])
            yield _Setting(bas[1].upper(), place, numbered, str(numbered))
        elif act is not None:
            stand = taught.get(f"X{act['name'].upper().removeprefix('F')}", Stand(None, None))
            for part, held in (("BASE", stand.base), ("TOOL", stand.tool)):
                yield _Setting(part, place, held, str(held))
            yield _Setting("FIXED", place, "#TCP" if stand.fixed else None, str(stand.fixed))
        elif ipo is not None:
            fixed = ipo["mode"].upper() == "TCP"
            yield _Setting("FIXED", place, "#TCP" if fixed else None, str(fixed))


def _stand(flow: Flow, made: Mapping[tuple[str, int], _Setting], place: int) -> tuple[Stand, bool]:
    """Return what is in force at a place, and whether nothing else can be."""
    last: dict[str, _Setting | None] = {}
    sure = True
    for which in ("BASE", "TOOL", "FIXED"):
        found = [made[which, one.start] if one else None for one in flow.in_force(f"${which}", place)]
        last[which] = found[-1]
        alike = len({one.text if one else None for one in found}) == 1
        # a name may have another value at each
        named = any(one is not None and one.at is not None for one in found)
        partly = any(one is not None and one.partly for one in found)
        sure = sure and alike and (len(found) == 1 or not named) and not partly
    base, tool, fixed = last["BASE"], last["TOOL"], last["FIXED"]
    stand = Stand(
        base.value if base else None, tool.value if tool else None, bool(fixed and fixed.value),
        base.at if base else None, tool.at if tool else None,
    )  # fmt: skip
    return stand, sure


def _numbered(which: str, number: str | None) -> str | None:
    """Name of a numbered frame; number 0 is none, one below zero says nothing."""
    if number is None or not number.isdigit():
        return None
    return BASE_ITSELF if int(number) == 0 else f"{which}_DATA[{int(number)}]"
