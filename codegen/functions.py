"""The text of a static C function over ``model *m``."""

from __future__ import annotations

import re
from collections.abc import Sequence

_LOCALS = {"p": "const real *p = m->p;", "z": "const real *z = m->z;", "k": "const real *k = m->k;"}


def function_text(
    title: str, name: str, arguments: str, statements: Sequence[str], *, lines: bool = False
) -> str:
    """A static C function; arguments that the statements do not read are marked so."""
    body = "\n".join(statements)
    used = set(re.findall(r"(?<!>)\b([a-zA-Z]\w*)(?=\[|->)", body)) | set(re.findall(r"\bj\b", body))
    named = [re.split(r"\W", argument)[-1] for argument in arguments.split(",")]
    head = [text for local, text in _LOCALS.items() if local in used and local not in named]
    head += [
        f"(void){argument};" for argument in named if argument not in used and not (argument == "m" and head)
    ]
    if lines:
        statements = ["EACH_LINE(j) {", *(f"    {statement}" for statement in statements), "}"]
    indented = "\n".join(f"    {line}" for line in [*head, *statements])
    keyword = "LINE_FUNCTION" if lines else "static"
    return f"/* {title} */\n{keyword} void {name}({arguments})\n{{\n{indented}\n}}\n"
