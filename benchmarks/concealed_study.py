"""An actuator scale of 0.011 on all actuators of the telescope, hidden by the free fit: is it seen?

    python benchmarks/concealed_study.py [SEEDS]

Recordings come from ``telescope_simulator`` (rigid platform, pose noise 2 um and 8 urad), which shares no code
with truepose. Prints one row a seed: free fit, verdict, class, worst parameter before and after, what its null allows.
"""

from __future__ import annotations

import sys

import numpy as np
from studies import diagnose_texts
from telescope_simulator import PoseSensor, draw_machine, machine_text, paper_poses, recording_text, simulate

SCALE = 0.011
POSE = PoseSensor(sigma_xyz=0.002, sigma_rot=float(np.rad2deg(8e-6)))
WANTED = {"platform-deformation", "actuator-scale", "wrong-constant"}


def main(seeds: int) -> None:
    """Run the study and print its table."""
    roles, rho = paper_poses()
    rows = ["seed | free chi2/dof | verdict | concealed | class | worst before -> after (allowed 99 %)"]
    whole = 0
    for seed in range(seeds):
        recording = simulate(
            draw_machine(seed=seed), rho, ring_stiffness=np.inf, actuator_scale=SCALE, sensor=POSE, seed=seed
        )
        found = diagnose_texts(machine_text(POSE), recording_text(recording, roles))
        names = {(f.effect, f.place): f.probability for f in found.findings}
        names |= {(e.effect, e.place): e.probability for f in found.findings for e in f.equivalents}
        before, after = found.fits["before"], found.fits["after"]
        back = after.worst_parameter_sigma <= after.worst_allowed
        whole += found.concealed and {effect for effect, _ in names} >= WANTED and back
        said = ", ".join(f"{e}@{'+'.join(p)} {v:.2f}" for (e, p), v in names.items())
        rows.append(
            f"{seed} | {found.fits['free'].chi2_per_dof:.2f} | {found.verdict} | {found.concealed} | {said} | "
            f"{before.worst_parameter_sigma:.1f} -> {after.worst_parameter_sigma:.2f} ({after.worst_allowed:.2f})"
        )
    rows.append(f"concealed, whole class named, parameters back: {whole} of {seeds}")
    sys.stdout.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
