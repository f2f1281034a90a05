"""A calibrated machine in formats of others.

``write.export`` writes a file. Descriptions of links: ``tree`` (the machine as rigid links, with numbers in place of
parameters), ``held`` (which effects such links can hold, and how much the others move the tool), ``links`` (all frames and
masses with their names), and the texts ``urdf``, ``xacro``, ``mjcf`` and ``ur_kinematics``. Machines with loops: ``standing``
(assembled at home) and ``mjcf_loops``. Tables of axes: ``volumetric`` (errors of each axis by itself, and what they leave) and
``iso230`` (the texts). ``numbers``: how numbers are written. ``read_back`` reads each text before it is published, by
``read_urdf``, ``read_xacro``, ``read_mjcf``, ``read_ur_kinematics`` and ``read_volumetric``.
"""
