"""Programs in languages that are not corrected are named; tables stay tables, dialects are known by their words."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.command import input_error, refused
from support.program_robots import arms, machine_file
from truepose.identification.leaves.programs.dialects import dialect_of
from truepose.identification.recording.languages import other_language, own_language

OTHERS = {
    "FANUC TP": ("job.ls", "/PROG  PICK\n/ATTR\nOWNER = MNEDITOR;\n/MN\n 1:J P[1] 100% FINE ;\n/POS\n/END\n"),
    "INFORM": ("job.jbi", "/JOB\n//NAME PICK\n//POS\n///NPOS 2,0,0,0,0,0\nC00000=1,2,3,4,5,6\n//INST\nMOVJ C00000 VJ=50.00\n"),
    "Kawasaki AS": ("job.txt", ".PROGRAM pick()\n  JMOVE home\n  LMOVE #p1\n.END\n.TRANS\np1 1 2 3 4 5 6\n.END\n"),
    "VAL 3": ("start.pgx", '<?xml version="1.0"?>\n<Programs xmlns="ProgramNameSpace">\n<code>movel(p)</code></Programs>\n'),
    "MELFA": ("job.prg", "10 OVRD 50\n20 MOV P1\n30 MVS P2\n40 END\nP1=(+300.00,+0.00,+400.00,+180.00,+0.00,+180.00)(7,0)\n"),
    "SPEL": ("main.prg", "Function main\n  Motor On\n  Go P1\n  Move P2 +Z(50)\nFend\n"),
    "Denso": ("pick.txt", "PROGRAM PICK\nTAKEARM\nMOVE P, @P P1\nEND\n"),
    "PDL2": ("pick.txt", "PROGRAM pick\nVAR p1 : POSITION\nBEGIN\n  MOVE LINEAR TO p1\nEND pick\n"),
    "DRL": ("job.py", "home = posj(0, 0, 90, 0, 90, 0)\nmovej(home, v=60)\nmovel(posx(400, 0, 300, 0, 180, 0))\n"),
    "Heidenhain": ("part.h", "0 BEGIN PGM PART MM\n1 TOOL CALL 5 Z S3000\n2 L X+10 Y+20 R0 FMAX\n3 END PGM PART MM\n"),
    "APT": ("part.txt", "PARTNO/1\nFEDRAT/500\nGOTO/10.0,20.0,-5.0,0.0,0.0,1.0\n"),
    "G-code": ("part.nc", "%\nO0001\nN10 G21 G90\nN20 G01X10.5Y20Z-5A30C45F500\nM30\n"),
    "PolyScope": ("job.urp", "\x1f\x8b"),
}  # fmt: skip
OURS = {
    "kuka": "&ACCESS RVP\nDEF job()\nPTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nEND\n",
    "rapid": "%%%\n VERSION:1\n%%%\nMODULE job\n  PROC main()\n  ENDPROC\nENDMODULE\n",
    "urscript": "def job():\n  movej([0,0,0,0,0,0])\nend\n",
}
NAMES = st.sampled_from(["x", "y", "z", "rx", "ry", "rz", "q1", "G1", "J1", "P[1]", "MOV", "name", "GOTO"])


@pytest.mark.parametrize("title", OTHERS)
def test_another_language_is_named(title: str, tmp_path: Path) -> None:
    file, text = OTHERS[title]
    (tmp_path / file).write_text(text, encoding="latin-1")
    machine = machine_file(tmp_path, arms()[1])
    said = refused("compensate", machine, tmp_path / file, "-o", tmp_path / "out", "--anyway")
    assert title in said and "expected a program in one of KUKA KRL, ABB RAPID, URScript" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", OURS)
def test_a_dialect_is_known_by_its_words_whatever_the_ending(name: str, tmp_path: Path) -> None:
    (tmp_path / "job.txt").write_text(OURS[name])
    found = dialect_of(tmp_path / "job.txt")
    assert found is not None and found.name == name
    assert own_language(OURS[name]) == name and other_language(OURS[name]) is None


@given(
    st.lists(NAMES, min_size=1, max_size=8),
    st.lists(st.lists(st.floats(-1e4, 1e4), min_size=1), max_size=5),
    st.sampled_from(",;\t"),
)
def test_a_table_is_no_program(header: list[str], rows: list[list[float]], mark: str) -> None:
    text = "\n".join([mark.join(header), *(mark.join(f"{v:.6g}" for v in row) for row in rows)])
    assert other_language(text, ".txt") is None and own_language(text) is None


def test_a_language_that_is_asked_for_is_not_judged(tmp_path: Path) -> None:
    (tmp_path / "job.ls").write_text("x,y,z,rx,ry,rz\n")
    with input_error("FANUC TP"):
        dialect_of(tmp_path / "job.ls")
    found = dialect_of(tmp_path / "job.ls", "csv")
    assert found is not None and found.name == "csv"
