"""An independent simulator of the telescope (its mechanics: ``challenge.simulator.telescope_ring``).

The platform is a ring of beam finite elements around a rigid hub, bent by circular flexures whose equilibrium
is solved; the effect catalogue of truepose plays no part. mm, N, rad (a pose sensor reads deg).

    from telescope_simulator import PoseSensor, draw_machine, paper_poses, recording_text, simulate

    machine = draw_machine(seed=7)                  # nominal + N(0, tolerance) on every geometric parameter
    roles, rho = paper_poses()                      # the 40 + 6 poses of Tables 3 and 4, (46, 6) mm
    demo = simulate(machine, rho, seed=8)           # elastic ring, flexures, targets with 5 um
    null = simulate(machine, rho, ring_stiffness=np.inf, seed=8)      # exact 6-PUS geometry and noise only
    pose = PoseSensor(sigma_xyz=0.003, sigma_rot=0.001)               # mm, deg
    scaled = simulate(machine, rho, ring_stiffness=np.inf, actuator_scale=0.011, sensor=pose, seed=8)
    stiff = simulate(machine, rho, ring_stiffness=np.inf, joints="flexure")  # rigid platform, real flexures
    text = recording_text(null, roles)              # CSV: pose, time, role, rho1..rho6, the sensor's columns

`simulate` returns a `Simulation`: `readings` and `exact_readings` under `columns`, `pose_world_tool`, and
`poses.leg_end_displacement` (n, 6, 3), how far each leg end moved against the hub.
`draw_machine(seed, scale)` widens the tolerances by `scale`; `nominal_machine()` is the drawing and
`machine_text(sensor)` its machine file.

`python -m benchmarks.telescope_simulator OUTDIR` writes the bundled demo.
"""

from challenge.simulator.telescope_ring.machine import Machine, draw_machine, nominal_machine
from challenge.simulator.telescope_ring.ring import Ring
from challenge.simulator.telescope_ring.simulation import (
    PoseSensor,
    Simulation,
    TargetsSensor,
    simulate,
)
from challenge.simulator.telescope_ring.statics import Flexure, NoEquilibriumError

from .bundle import machine_text, paper_poses, recording_text

__all__ = [
    "Flexure",
    "Machine",
    "NoEquilibriumError",
    "PoseSensor",
    "Ring",
    "Simulation",
    "TargetsSensor",
    "draw_machine",
    "machine_text",
    "nominal_machine",
    "paper_poses",
    "recording_text",
    "simulate",
]
