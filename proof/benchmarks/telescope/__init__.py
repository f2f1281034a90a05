"""Studies on the telescope of Gayral and Daney, INRIA RR-8096 (2012), beside the simulator.

    python -m benchmarks.telescope.body_pose_study        # Fig. 5: poses of bodies from photogrammetry points
    python -m benchmarks.telescope.pose_choice_study      # Figs. 13-14: choice of the measurement poses

``inverse.py`` is the 6-PUS in plain numpy (eq. 7), which the second study simulates its measurements with.
"""
