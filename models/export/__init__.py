"""A calibrated machine in formats of others: a URDF, or the kinematics file of Universal Robots' ROS packages.

``write.export`` writes a file. Below it: ``tree`` (the machine as rigid links, with numbers in place of parameters),
``held`` (which effects such links can hold, and how much the others move the tool), ``urdf`` and ``ur_kinematics``
(the texts), ``numbers`` (metres, radians and how they are written).
"""
