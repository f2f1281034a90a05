"""The text of a machine file: a slide, an axis on it, a tool, and a tracker that reads where it is."""

TINY = """schema: truepose/machine/1
name: tiny
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-100, 100]}
    - {name: q2, kind: revolute, d: 50, range: [-90, 90]}
frames:
  tool: {in: flange, xyz: [100, 0, 0]}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.1}
"""
