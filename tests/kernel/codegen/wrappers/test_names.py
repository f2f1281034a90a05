"""All wrappers of a machine's generated C: which files there are, and whose names are in them."""

from __future__ import annotations

from support.generated_c import Built, cases, needs_compiler
from support.wrapped import wrapped

pytestmark = needs_compiler


@cases(("arm",), ("double",))
def test_wrappers_name_nothing_of_others(built: Built) -> None:
    files = sorted(path.name for path in wrapped(built).iterdir() if path.suffix in (".hpp", ".py", ".c"))
    assert files == ["arm_kin.hpp", "arm_kin.py", "arm_sfun.c"]
    for name in files:
        text = (wrapped(built) / name).read_text(encoding="utf-8")
        assert text.endswith("\n") and "nano" not in text and "{{" not in text.replace("{{ }}", "")
