"""Good files that mutants are made from: machines of every form with a recording each, and what else truepose reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import truepose
from support import ROOT, TESTS

ROWS = 14
ARM = """
schema: truepose/machine/1
name: arm
units: {length: mm, angle: deg}
gravity: [0, 0, -9.81]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, beta: 0, alpha: 0, d: 0, theta: 0, r: 300, range: [-150, 150], gear_ratio: 100}
    - {name: q2, kind: revolute, beta: 0, alpha: -90, d: 100, theta: 0, r: 0, range: [-90, 90]}
    - {name: q3, kind: prismatic, beta: 0, alpha: 90, d: 0, theta: 0, r: 200, range: [-50, 50], screw_pitch: 5}
frames:
  base: {in: world, xyz: [10, 20, 0], rpy: [0, 0, 5], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [300, 10, 20], rpy: [0, 10, 0], tolerance: {xyz: 1, rpy: 0.5}}
sensor:
  - {type: position, sigma: {xyz: 0.02}}
tolerances: {length: 0.1, angle: 0.1, q2.d: 0.5}
masses:
  link2: {kg: 35.0, com: [300, 0, 0], in: link2}
  payload: {kg: 0, com: [0, 12, 60], in: tool}
drivers: [temperature.base, payload, approach.q1, torque.q2, {name: fan, unit: "1"}]
loads: {hose: {from: {in: base, at: [0, 0, 600]}, to: {in: link2, at: [200, 0, 0]}, stiffness: 0.5, free_length: 300}}
bounds: {q2.d: [99, 101]}
nominal: {q2.d: 100.0}
effects:
  - {effect: actuator-scale, place: [q1], parameters: {s: {value: 8.1e-4, unit: "1"}}}
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 2.1e-7, unit: rad/(N*m)}}}
  - {effect: backlash, place: [q3], parameters: {b: {value: 0.01, unit: mm}}}
"""
URDF_MACHINE = """
schema: truepose/machine/1
name: arm
mechanism: {type: urdf, file: arm.urdf, base_link: world, tip_link: tip}
sensor: {type: position, sigma: {xyz: 0.02}}
tolerances: {length: 0.3, angle: 0.1}
"""
URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="world"/> <link name="stand"><inertial><origin xyz="0 0 0.1"/><mass value="3"/></inertial></link>
  <link name="upper"/> <link name="hand"/> <link name="tip"/>
  <joint name="foot" type="fixed"><origin xyz="0.1 0 0.2" rpy="0 0 0.3"/><parent link="world"/><child link="stand"/></joint>
  <joint name="pan" type="continuous"><parent link="stand"/><child link="upper"/>
    <origin xyz="0 0.05 0.333"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz="0.02 0 0.15" rpy="-1.2 0.4 0.1"/>
    <axis xyz="0 0.6 -0.8"/><limit lower="-1.5" upper="2" effort="87" velocity="2"/></joint>
  <link name="jaw"/> <link name="thumb"/>
  <joint name="grip" type="prismatic"><parent link="hand"/><child link="jaw"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04"/></joint>
  <joint name="other" type="prismatic"><parent link="hand"/><child link="thumb"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.04"/><mimic joint="grip" multiplier="1" offset="0.001"/></joint>
  <joint name="flange" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0.3 0 0.107"/></joint>
</robot>
"""
MJCF = """<mujoco model="arm">
  <compiler angle="degree" autolimits="true"/>
  <default><joint range="-90 90"/><geom type="sphere" size="0.01" density="1000"/></default>
  <worldbody>
    <body name="stand" pos="0 0 0.1"><geom/>
      <body name="upper" pos="0 0 0.3" euler="0 30 0"><joint name="pan" axis="0 0 1"/><geom/>
        <body name="hand" pos="0.3 0 0" quat="0.7 0.7 0 0"><joint name="lift" type="hinge" axis="0 1 0" range="-50 70"/><geom/>
          <site name="tip" pos="0 0 0.1"/>
          <body name="jaw" pos="0 0 0.05"><joint name="grip" type="slide" axis="1 0 0" range="0 0.04" ref="0.01"/>
            <inertial pos="0.01 0 0" mass="0.2" diaginertia="0.1 0.1 0.1"/></body></body></body></body>
  </worldbody>
</mujoco>
"""
LOOPED_MJCF = """<mujoco model="bars">
  <default><geom type="sphere" size="0.01"/></default>
  <worldbody>
    <body name="c1" pos="-0.1 0 0" euler="0 0 120"><joint name="a1" ref="3"/><geom/>
      <body name="r1" pos="0.2 0 0" euler="0 0 -60"><joint name="e1"/><geom/>
        <body name="pen" pos="0.2 0 0"><geom/><joint name="f" type="slide"/></body></body></body>
    <body name="c2" pos="0.1 0 0" euler="0 0 60"><joint name="a2"/><geom/>
      <body name="r2" pos="0.2 0 0" euler="0 0 60"><joint name="e2"/><geom/></body></body>
    <body name="box" pos="1 0 0"><freejoint/><geom/></body>
  </worldbody>
  <equality><connect name="tie" body1="r2" body2="r1" anchor="0.2 0 0"/><weld body1="box" body2="c2" active="false"/>
    <joint joint1="f" joint2="a1" polycoef="0 0.01 0 0 0"/></equality>
  <actuator><position joint="a1"/><motor joint="a2"/></actuator>
</mujoco>
"""
POINTS = (
    "// SpatialAnalyzer 2023.1\n// Units: Millimeters\nA::Main::P1, 1234.5678, -12.5, 800.0\n"
    "A::Main::P2, 1300.25, 40.125, 790.5\n"
    "A::Main::P3, 1400.0, 99.0, -3.25\n",
    "! Leica Axyz point list, units: mm\nS/P1 1234.5 -12.5 800.0 0.011 0.012 0.010 2024-05-02 10:11:12\n"
    "S/P2 1300.25 40.1 790.5 0.01 0.01 0.01 2024-05-02 10:12:12\nS/P3 1400.0 99.0 -3.2 0.01 0.01 0.01 2024-05-02 10:13:12\n",
    "Leica Tracker Pilot\nPointId;X [m];Y [m];Z [m];Rms\nP1;1,2345678;-0,0125;0,8;0,01\n"
    "P2;1,30025;0,040;0,79;0,01\nP3;1,4;0,09;-0,003;0,01\n",
    "FARO CAM2 Measure, Units: mm\nP1 X 1234.5678 Y -12.5 Z 800.0\nP2 X 1300.25 Y 40.125 Z 790.5\nP3 X 1400.0 Y 99.0 Z -3.25\n",
    "A caption\n:EQUAT\n:NODA\n+40 30 00 2024 5 2 15.0 1013 100 0.5\n"
    + "".join(
        f"{h:02d} 10 20.0 +{d} 10 11.0 {h:02d} 10 21.0 +{d} 10 12.0 {h + 1} 12.5\n"
        for h, d in ((1, 20), (3, 35), (7, 5))
    )
    + "END\n",
)  # fmt: skip
JOINTS = "name,q1,q2\nP1,0,10\nP2,20,30\nP3,-5.5,60\n"
PLUGIN = '''
from truepose.models.effects.common import Coefficient, Effect, effects


@effects.add("stretched-belt")
class StretchedBelt(Effect):
    """A belt that runs out of round: dq = k q^3."""

    slug = "stretched-belt"

    def places(self, machine):
        return [(a.reading,) for a in machine.mechanism.actuators if a.unit == "rad"]

    def coefficients(self, machine, place, settings):
        return (Coefficient("k", "1/rad^2", 0.01),)

    def shifts(self, site):
        return {site.port(site.place[0]): site.c["k"] * site.displacement(site.place[0]) ** 3}
'''
KRL = """DEF job()
;FOLD
BAS(#INITMOV,0)
$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}
PTP {A1 10,A2 -20,A3 30,A4 0,A5 40,A6 0}
LIN {X 300,Y 10,Z 500,A 0,B 90,C 0} C_DIS
PTP {X 320,Y 10,Z 480,A 0,B 90,C 0,S 2,T 2}
XP1={E6POS: X 300,Y 50,Z 500,A 10,B 90,C 0,S 2,T 2}
END
"""
RAPID = """MODULE weld
  PERS wobjdata fix:=[FALSE,TRUE,"a; b",[[100,0,0],[1,0,0,0]],[[0,50,0],[0.70710678,0,0,0.70710678]]];
  CONST robtarget p10 := [[300,1.5,500],[0.7071068,0,0.7071068,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget home:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveAbsJ home\\NoEOffs,v500,fine,tool0;
    MoveL p10,v100\\V:=50,z10,gun\\WObj:=fix;
    MoveL Offs(p10,0,0,50),v100,z10,gun\\WObj:=fix;
  ENDPROC
ENDMODULE
"""
URSCRIPT = """def job():
  set_tcp(p[0,0,0.1,0,0,0])
  movej([0.1,-0.5,0.3,0,0.4,0], a=1.4, v=1.05)
  movel(p[0.3,0.01,0.5,0,1.57,0], a=1.2, v=0.25, r=0.01)
  global Point_1 = p[0.3,0.05,0.5,0,1.57,0]
end
"""
TABLE = """name,x [mm],y [mm],z [mm],rx [rad],ry [rad],rz [rad]
a,300,1.5,500,0,1.57,0
b,320,10,480,0.1,1.5,0
# c
d,310,-20,490,0,1.6,0.1
"""


@dataclass(frozen=True)
class Case:
    """A machine file with a recording of it that everybody accepts."""

    name: str
    machine: str
    recording: str


def cases(folder: Path) -> list[Case]:
    """Machines of every form, with what they measure at poses near the middle of their ranges."""
    files = {
        path.stem: path.read_text(encoding="utf-8") for path in sorted((TESTS / "machines").glob("*.yaml"))
    }
    files |= {"mount": (ROOT / "models/machines/mount/machine.yaml").read_text(encoding="utf-8"), "full": ARM}
    return [_case(name, text, folder) for name, text in files.items()]


def _case(name: str, text: str, folder: Path) -> Case:
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    machine = truepose.load_machine(path)
    rng, poses = np.random.default_rng(1), dict[str, object]()
    for actuator in machine.mechanism.actuators:
        low, high = actuator.range or (-1.0, 1.0)
        column = f"{actuator.reading} [{actuator.reading_unit}]"
        poses[column] = (low + high) / 2 + 0.2 * (high - low) * rng.uniform(-1, 1, ROWS)
    poses |= {"pose": np.arange(1, ROWS + 1), "time": 60.0 * np.arange(ROWS)}
    if name == "distance":
        poses["from"] = np.maximum(1, np.arange(ROWS))
    seen = truepose.simulate(machine, poses, seed=1)
    table = pd.concat([pd.DataFrame(poses), seen], axis="columns").round(9)
    if name == "full":
        table["temperature.base"], table["payload"], table["role"] = 21.5, 2.0, "calibration"
        table["approach.q1"], table["torque.q2"], table["fan"] = (
            1,
            30.0 + np.arange(ROWS),
            np.arange(ROWS) % 3,
        )
        table.loc[ROWS - 3 :, "role"] = "validation"
    return Case(name, text, table.to_csv(index=False, lineterminator="\n"))
