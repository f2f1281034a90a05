"""Machines whose C is generated: arms, a stage, hexapods, the hybrid and a planar machine, as built."""

from __future__ import annotations

from pathlib import Path

from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

HEAD = "schema: truepose/machine/1\nname: {name}\ngravity: [0, 0, -9.80665]\nmechanism:\n"
ARM = """  type: serial
  joints:
    - {name: q1, kind: revolute, beta: 0.03, alpha: 0.1, d: 0.4, theta: 0.2, r: 128.1, range: [-360, 360]}
    - {name: q2, kind: revolute, beta: -0.05, alpha: 90.1, d: 0.6, theta: -0.1, r: 0.3, range: [-360, 360]}
    - {name: q3, kind: revolute, beta: 0.07, alpha: 0.05, d: -612.7, theta: 0.3, r: -0.2, range: [-160, 160]}
    - {name: q4, kind: revolute, beta: 0.1, alpha: -0.08, d: -571.9, theta: 0.2, r: 163.2, range: [-360, 360]}
    - {name: q5, kind: revolute, beta: -0.02, alpha: 89.8, d: 0.3, theta: 0.15, r: 115.2, range: [-360, 360]}
    - {name: q6, kind: revolute, beta: 0.04, alpha: -90.2, d: -0.5, theta: 0.4, r: 92.7}
frames: {tool: {in: flange, xyz: [12, -7, 93], rpy: [3, -5, 20]}}
masses:
  link2: {kg: 12.0, com: [-300, 0, 0], in: link2}
  payload: {kg: 2.0, com: [0, 12, 60], in: tool}
drivers: [payload, temperature.link3]
effects:
  - {effect: actuator-scale, place: [q4], parameters: {s: {value: 8.0e-4, unit: "1"}}}
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 2.1e-6, unit: rad/(N*m)}}}
  - {effect: thermal-expansion, place: [link3], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
"""
SMOOTH = (
    ARM.partition("effects:")[0].replace("link3]", "base]")
    + """effects:
  - effect: empirical
    place: [q2]
    degree: 3
    from.q3: -1.1
    to.q3: 1.7
    parameters: {c1: {value: 2e-3, unit: rad}, c2: {value: -1e-3, unit: rad}, c3: {value: 5e-4, unit: rad}}
  - {effect: empirical, place: [q4], from.q2: -2, to.q2: 1, from.q3: -1, to.q3: 2, parameters: {c: {value: 1e-3, unit: rad}}}
  - effect: empirical
    place: [base]
    from.temperature.base: 18
    to.temperature.base: 26
    parameters: {x1: {value: 0.3, unit: mm}, z2: {value: -0.2, unit: mm}, ry1: {value: 4e-4, unit: rad}}
"""
)
NANO = """  type: serial
  joints:
    - {name: q1, kind: prismatic, alpha: -90.2, theta: 0.1, range: [-0.15, 0.15]}
    - {name: q2, kind: prismatic, alpha: 90.1, theta: 90.05, d: 0.3, range: [-0.15, 0.15]}
    - {name: q3, kind: prismatic, alpha: 90, theta: -0.2, r: 5.1, range: [-0.15, 0.15]}
    - {name: q4, kind: revolute, alpha: -90.1, theta: -90, d: 0.2, range: [-3, 3]}
    - {name: q5, kind: revolute, alpha: -90, theta: 90.2, r: 0.3, range: [-3, 3]}
    - {name: q6, kind: revolute, alpha: 90.1, d: -0.1, r: 1.7, range: [-3, 3]}
frames: {tool: {in: flange, xyz: [0, 1, 20], rpy: [0, 0, 5]}}
"""
TURNS = """  type: 6-ups
  legs:
    - {name: leg1, joint: n1, a: [-385.3, -140.2, 0.4],
       b: [-197.4, 95.0, 0.1], offset: 640.2, gain: 75.7}
    - {name: leg2, joint: n2, a: [-314.1, -263.5, 0],
       b: [-16.4, -218.5, 0], offset: 639.8, gain: 71.2}
    - {name: leg3, joint: n3, a: [314.1, -263.5, -0.3],
       b: [16.4, -218.5, 0], offset: 640.2, gain: 72.3}
    - {name: leg4, joint: n4, a: [385.3, -140.2, 0],
       b: [197.4, 95.0, -0.2], offset: 641.1, gain: 70.8}
    - {name: leg5, joint: n5, a: [71.2, 403.8, 0],
       b: [181.0, 123.5, 0], offset: 640.2, gain: 70.6, range: [-1.5, 1.5]}
    - {name: leg6, joint: n6, a: [-71.2, 403.8, 0.2],
       b: [-181.0, 123.5, 0], offset: 640.3, gain: 71.3}
  home: [0, 0, 565, 0, 0, 0]
units: {joint: turn}
frames: {tool: {in: flange, xyz: [10, 0, 80], rpy: [0, 4, 0]}}
"""
RAILS = """  type: 6-pus
  legs:
    - {name: leg1, joint: rho1, a: [391.3, -83.2, 0.1],
       u: [0.01, 0, 1], b: [173.7, -179.8, 0], length: 500.1, range: [-20, 20]}
    - {name: leg2, joint: rho2, a: [391.3, 83.2, 0],
       u: [0, 0.02, 1], b: [173.7, 179.8, 0.2], length: 499.9, range: [-20, 20]}
    - {name: leg3, joint: rho3, a: [-123.6, 380.4, 0],
       u: [0, 0, 1], b: [68.9, 240.3, 0], length: 500.2, range: [-20, 20]}
    - {name: leg4, joint: rho4, a: [-267.7, 297.3, -0.2],
       u: [0, 0, 1], b: [-242.6, 60.5, 0], length: 500, range: [-20, 20]}
    - {name: leg5, joint: rho5, a: [-267.7, -297.3, 0],
       u: [0, 0.01, 1], b: [-242.6, -60.5, 0.1], length: 499.7, range: [-20, 20]}
    - {name: leg6, joint: rho6, a: [-123.6, -380.4, 0],
       u: [0, 0, 1], b: [68.9, -240.3, 0], length: 500, range: [-20, 20]}
  home: [0, 0, 439.7, 0, 0, 0]
frames: {tool: {in: flange, xyz: [0, 5, 120], rpy: [1, 0, 30]}}
masses: {payload: {kg: 30, com: [20, 0, 90], in: platform}}
drivers: [payload, approach.rho4]
effects:
  - {effect: leg-compliance, place: [leg3], parameters: {c: {value: 2.0e-4, unit: mm/N}}}
  - {effect: backlash, place: [rho4], parameters: {b: {value: 0.02, unit: mm}}}
"""
FOUR_AXES = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, d: 325, range: [-140, 140]}
    - {name: q3, kind: prismatic, alpha: 0.1, d: 275, range: [-200, 0]}
    - {name: q4, kind: revolute, alpha: 179.9}
"""
SEVEN_AXES = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 333, range: [-166, 166]}
    - {name: q2, kind: revolute, alpha: -90, range: [-101, 101]}
    - {name: q3, kind: revolute, alpha: 90, r: 316, range: [-166, 166]}
    - {name: q4, kind: revolute, alpha: 90, d: 82.5, range: [-176, -4]}
    - {name: q5, kind: revolute, alpha: -90, d: -82.5, r: 384, range: [-166, 166]}
    - {name: q6, kind: revolute, alpha: 90, range: [-1, 215]}
    - {name: q7, kind: revolute, alpha: 90, d: 88, r: 107, range: [-166, 166]}
"""
HYBRID = """  {type: 3ups-up-3r, base_radius: 340, platform_radius: 165, platform_offset: 127.5, wrist_offset: 120,
    head: 90, limb_range: [600, 880], wrist_range: [-60, 60], screw_pitch: 5}
drivers: [temperature.leg2]
effects:
  - {effect: actuator-scale, place: [leg3], parameters: {s: {value: 8.0e-4, unit: "1"}}}
  - {effect: thermal-expansion, place: [leg2], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
"""
PLANAR = """  type: graph
  bodies: [ground, crank1, crank2, crank3, rod1, rod2, rod3, corner1, corner2, corner3, platform]
  joints:
    - {name: a1, kind: revolute, parent: ground, child: crank1, xyz: [-141, -255, 0], actuated: true, range: [15, 45]}
    - {name: b1, kind: revolute, parent: crank1, child: rod1, xyz: [100, 0, 0.2], rpy: [0.1, 0, 0]}
    - {name: p1, kind: revolute, parent: rod1, child: corner1, xyz: [150, 0, 0]}
    - {name: mount1, kind: fixed, parent: corner1, child: platform, xyz: [130, 75, 0]}
    - {name: a2, kind: revolute, parent: ground, child: crank2, xyz: [291, 5, 0], actuated: true, range: [136, 166]}
    - {name: b2, kind: revolute, parent: crank2, child: rod2, xyz: [103, 0, 0]}
    - {name: mount2, kind: fixed, parent: platform, child: corner2, xyz: [130, -74, 0]}
    - {name: p2, kind: revolute, parent: rod2, child: corner2, xyz: [147, 0, 0]}
    - {name: a3, kind: revolute, parent: ground, child: crank3, xyz: [-150, 250, 0.1], actuated: true, range: [-106, -76]}
    - {name: b3, kind: revolute, parent: crank3, child: rod3, xyz: [98, 0, 0]}
    - {name: mount3, kind: fixed, parent: platform, child: corner3, xyz: [1, 150, 0]}
    - {name: p3, kind: revolute, parent: rod3, child: corner3, xyz: [152, 0, 0], rpy: [0, 0.05, 0]}
  home: {a1: 30, a2: 151, a3: -91, b1: 90, b2: 90, b3: 90, p1: -120}
frames: {tool: {in: flange, xyz: [10, 5, 30], rpy: [0, 0, 20]}}
"""
BODIES = {
    "arm": ARM,
    "smooth": SMOOTH,
    "nano": NANO,
    "turns": TURNS,
    "rails": RAILS,
    "scara": FOUR_AXES,
    "redundant": SEVEN_AXES,
    "hybrid": HYBRID,
    "planar": PLANAR,
}


def machine_of(where: Path, name: str) -> Machine:
    file = where / f"{name}.yaml"
    file.write_text(HEAD.format(name=name) + BODIES[name])
    return load_machine(file)
