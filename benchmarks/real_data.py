"""Figures on real recordings: UR10 with a laser tracker, a Stewart platform with motion capture, a Panda in sockets.

    python benchmarks/real_data.py stewart DATA_FOLDER
    python benchmarks/real_data.py ur10 DATA_FOLDER WORK_FOLDER
    python benchmarks/real_data.py remainder DATA_FOLDER WORK_FOLDER
    python benchmarks/real_data.py panda DATA_FOLDER WORK_FOLDER
    python benchmarks/real_data.py unseen DATA_FOLDER WORK_FOLDER [RECORDING ...]
    python benchmarks/real_data.py carried DATA_FOLDER WORK_FOLDER
    python benchmarks/real_data.py cuts DATA_FOLDER
    python benchmarks/real_data.py mount DATA_FOLDER WORK_FOLDER

DATA_FOLDER holds ``ur10-laser-tracker/``, ``stewart-mocap/`` and ``panda-ball-socket/``. For the UR10 the rows whose
goal modulo 10 is 3, 6 or 9 are marked validation; each file is diagnosed through the command line (results stay in
WORK_FOLDER), then the periodic joint functions of the two files are compared and carried from one file to the other;
``remainder`` asks what is left. For the Panda it is every fifth row of a socket. ``unseen``: what the
diagnosed models are worth on rows and campaigns that they have not seen, and whether halves agree; ``carried``: how far any
model of one campaign of the UR10 can be carried to another; ``cuts``: what is applied after 60, 120 and 240 rows;
``mount``: an amateur telescope's mount (``telescope-mount/``) as a machine of two axes.
"""

from __future__ import annotations

import sys
from pathlib import Path

from real_recordings.carried import carried
from real_recordings.cuts import cuts
from real_recordings.mount import mount
from real_recordings.panda import SENSORS, panda, panda_files, panda_scatter
from real_recordings.remainder import remainder
from real_recordings.stewart import leg_errors, stewart
from real_recordings.unseen import unseen
from real_recordings.ur10 import ur10

__all__ = ["SENSORS", "leg_errors", "panda_files", "panda_scatter"]

if __name__ == "__main__":
    studies = {"carried": carried, "mount": mount, "panda": panda, "remainder": remainder, "ur10": ur10}
    if sys.argv[1] in ("stewart", "cuts"):
        {"stewart": stewart, "cuts": cuts}[sys.argv[1]](Path(sys.argv[2]))
    elif sys.argv[1] == "unseen":
        unseen(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:])
    else:
        studies[sys.argv[1]](Path(sys.argv[2]), Path(sys.argv[3]))
