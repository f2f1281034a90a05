"""The machine: mechanism, assembly, closure, kinematics and statics, and the contracts of what plugs in."""
