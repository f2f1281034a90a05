"""``NAME_point``: the readings of two axes that point the tool somewhere."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from truepose.codegen.c import generate
from truepose.models.load import load_machine

FILE = """schema: truepose/machine/1
name: mount
mechanism:
  type: mount
  kind: {kind}
  latitude: 39
  first: {{offset: 3, range: [-20, 200]}}
  second: {{offset: -1, tilt: 0.3, range: [-80, 260]}}
frames:
  base: {{in: world, rpy: [0.4, -0.2, 0]}}
  tool: {{in: flange, rpy: [0, 0, 0.5]}}
sensor: {{type: direction, sigma: {{angle: 1 arcsec}}}}
effects:
  - {{effect: gravity-sag, place: [tool], parameters: {{c: {{value: 1.0e-5, unit: rad/(N*m)}}}}}}
"""
MAIN = """#include "mount_kin.h"
#include <math.h>
#include <stdio.h>
int main(void)
{
    int k, failed = 0, aside = 0, code;
    double worst = 0.0, q[2], g[2], T[12], u[3];
    for (k = 0; k < 500; ++k) {
        q[0] = -0.3 + 3.7 * fmod(0.618034 * k, 1.0);
        q[1] = -1.3 + 5.7 * fmod(0.414214 * k, 1.0);
        if (mount_fk(0, 0, q, T) != 0) { return 2; }
        u[0] = T[0]; u[1] = T[4]; u[2] = T[8];
        g[0] = q[0] + (k % 2 ? 0.02 : -0.7);
        g[1] = q[1] - (k % 2 ? 0.03 : -0.4);
        code = mount_point(0, 0, u, g, g);
        if (code != 0 || mount_fk(0, 0, g, T) != 0) { ++failed; continue; }
        worst = fmax(worst, hypot(hypot(T[0] - u[0], T[4] - u[1]), T[8] - u[2]));
        aside += k % 2 && fabs(sin(q[1])) < 0.95 && hypot(g[0] - q[0], g[1] - q[1]) > 1e-6;
    }
    u[0] = NAN;
    g[0] = g[1] = 0.25;
    printf("%d %d %.3g %d %d\\n", failed, aside, worst, mount_point(0, 0, u, g, g), g[0] == 0.25);
    u[0] = u[1] = u[2] = 0.0;
    printf("%d\\n", mount_point(0, 0, u, g, g));
    return 0;
}
"""


@pytest.mark.parametrize("kind", ["equatorial", "alt-az"])
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_directions_are_met_near_the_guess(tmp_path: Path, kind: str) -> None:
    (tmp_path / "mount.yaml").write_text(FILE.format(kind=kind))
    generate(load_machine(tmp_path / "mount.yaml"), tmp_path / "c")
    (tmp_path / "c/main.c").write_text(MAIN)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-O1"]
    subprocess.run(
        ["gcc", *strict, "main.c", "mount_kin.c", "-lm", "-o", "t"], cwd=tmp_path / "c", check=True
    )
    said = subprocess.run([tmp_path / "c/t"], capture_output=True, text=True, check=True).stdout.split()
    failed, aside, worst, refused, kept, no_direction = said
    assert (failed, aside, refused, kept, no_direction) == ("0", "0", "4", "1", "4")
    assert float(worst) < 1e-9  # what the header promises


def test_machines_that_point_nothing_have_no_such_function(tmp_path: Path) -> None:
    text = FILE.format(kind="alt-az").replace("{type: direction, sigma: {angle: 1 arcsec}}", "POSE")
    (tmp_path / "mount.yaml").write_text(text.replace("POSE", "{type: pose, sigma: {xyz: 0.1, rot: 0.1}}"))
    generate(load_machine(tmp_path / "mount.yaml"), tmp_path / "c")
    assert "mount_point" not in (tmp_path / "c/mount_kin.h").read_text()
