"""A calibrated machine in formats of others.

``write.export`` writes a file, after it has read the text back. Descriptions of links: ``links`` (the machine as rigid links,
with numbers in place of parameters), ``held`` (which effects such links can hold, and how much the others move the tool), and
the formats ``urdf``, ``mjcf`` and ``ur_kinematics``. Tables of axes: ``volumetric`` (errors of each axis by itself, and what
they leave) and the format ``iso230``.
"""
