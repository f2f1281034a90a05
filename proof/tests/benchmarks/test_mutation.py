"""The mutation run's changes: one a mutant, in code and never in words."""

from __future__ import annotations

import ast
import difflib
from importlib import import_module
from pathlib import Path

mutants_of = import_module("mutation.mutants").mutants_of
SOURCE = '''"""Words: 1 + 1."""

__all__ = ["limit"]
LIMIT = 3600.0


def limit(values: "list[float | None]", factor: float = 2.5, *, whole: bool = False) -> bool:
    """Whether 3 < 4."""
    if not values:
        raise ValueError(f"found {len(values) + 1} values, expected at least {1 + 1}")
    total = values[0] * factor + (LIMIT - 1e-300) / max(len(values), 1)
    total += 4.0
    checked(total)
    for one in values:
        if one is None or one < 0 and whole:
            continue
    return total > LIMIT  # größer
'''
EXPECTED = {
    ("3600.0", "7200.0"),
    ("2.5", "5.0"),
    ("False", "True"),
    ("not values", "values"),
    ("values[0] * factor", "(values[0] / factor)"),
    ("LIMIT - 1e-300", "(LIMIT + 1e-300)"),
    ("max(len(values), 1)", "min(len(values), 1)"),
    ("total += 4.0", "total -= 4.0"),
    ("total += 4.0", "pass"),
    ("4.0", "8.0"),
    ("checked(total)", "pass"),
    ("one is None", "(one is not None)"),
    ("one < 0", "(one >= 0)"),
    ("one < 0", "(one <= 0)"),
    ("one < 0 and whole", "(one < 0 or whole)"),
    ("continue", "break"),
    ("total > LIMIT", "(total <= LIMIT)"),
    ("return total > LIMIT", "return True"),
    ("return total > LIMIT", "return False"),
}


def test_a_mutant_is_one_change_of_code(tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text(SOURCE, encoding="utf-8")
    found = mutants_of(tmp_path, "code.py")
    assert len({m.key for m in found}) == len(found)
    changes = {tuple(m.key.partition(": ")[2].partition(" #")[0].split(" -> ")) for m in found}
    assert changes >= EXPECTED
    assert not any("1e-300" in before and before.startswith("1e") for before, _ in changes)
    for mutant in found:
        text = mutant.applied(SOURCE.encode()).decode()
        ast.parse(text)
        matcher = difflib.SequenceMatcher(a=SOURCE.splitlines(), b=text.splitlines(), autojunk=False)
        (change,) = [code for code in matcher.get_opcodes() if code[0] != "equal"]
        line = SOURCE.splitlines()[change[1]]
        assert change[2] - change[1] == 1 and mutant.line == change[1] + 1
        assert not line.lstrip().startswith(('"""', "raise", "__all__"))


def test_a_mutant_knows_which_lines_a_test_must_run_and_who_uses_a_constant(tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text(SOURCE, encoding="utf-8")
    of = {m.key.partition(": ")[2]: m for m in mutants_of(tmp_path, "code.py")}
    assert (of["3600.0 -> 7200.0"].lines, of["3600.0 -> 7200.0"].names) == ((), ("LIMIT",))
    assert of["LIMIT - 1e-300 -> (LIMIT + 1e-300)"].lines == (11,)
    assert set(range(9, 18)) <= set(of["2.5 -> 5.0"].lines)  # a default serves the whole function
