"""Generated inverse kinematics of calibrated machines beside other solvers, measured in one run; see ``__main__``.

| module | what |
|---|---|
| ``arms``, ``hexapod`` | the calibrated machines, written as machine files |
| ``forward`` | the forward model that judges every solver: numpy, nothing of truepose |
| ``problems`` | poses and guesses |
| ``generated``, ``newton``, ``peers`` | running the generated C, pinocchio in C++, and peers in Python |
| ``study``, ``branches``, ``evaluations``, ``instructions`` | the parts of the study |
| ``outcome``, ``tables`` | rows and their Markdown |

Sources that are compiled are in ``drivers``; scripts that the peers' interpreter runs in ``peer_scripts``.
"""
