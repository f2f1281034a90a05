"""A machine file of two turning joints and a position, for tests of plug-ins."""

from __future__ import annotations

TWO_JOINTS = """
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-150, 150]}
    - {name: q2, kind: revolute, alpha: 90, d: 80, range: [-110, 110]}
frames: {tool: {in: flange, xyz: [500, 0, 40], tolerance: {xyz: 1}}}
sensor: {type: position, sigma: {xyz: 0.02}}
tolerances: {length: 0.2, angle: 0.05}
"""
